"""What a listener has heard so far, by kind."""

import asyncio
from typing import TypeVar

from lift_manager.runtime.bus import Event, Subscription

Kind = TypeVar("Kind")


async def heard(listener: Subscription[Event]) -> list[Event]:
    """Take all events that wait."""
    events: list[Event] = []
    while True:
        try:
            async with asyncio.timeout(0):
                events.append(await listener.next())
        except TimeoutError:
            return events


def only(events: list[Event], kind: type[Kind]) -> list[Kind]:
    return [event for event in events if isinstance(event, kind)]
