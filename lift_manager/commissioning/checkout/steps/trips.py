"""The procedure of whole trips, with figures for travel and doors."""

from __future__ import annotations

import asyncio

from lift_manager.client.errors import ClientError
from lift_manager.commissioning.checkout.lift import Watch, WatchedLift
from lift_manager.commissioning.checkout.person import Prompt
from lift_manager.commissioning.checkout.record import CALLED, Trip, now
from lift_manager.commissioning.checkout.steps.press import Drive, Ridden, door_times, ride, travel_s
from lift_manager.commissioning.checkout.steps.step import Step
from lift_manager.rides.ride import Guidance
from register_maps.words import Side

EMPTY, ROBOT = "empty", "robot"
WHO_RIDES = "Trips of the empty car, or of the robot, which somebody drives in and out?"


async def check_trips(step: Step, lift: WatchedLift) -> None:
    """Carry out the item of the trips: over all floors, up and down."""
    count = int(step.item.subject)
    with_robot = await step.choose(WHO_RIDES, Prompt.RIDER, EMPTY, ROBOT) == ROBOT
    await step.may_move(
        f"The manager takes the {'car with the robot' if with_robot else 'empty car'} through {count} trips, one after the other. Is everybody clear?"
    )

    async def drive(guidance: Guidance) -> None:
        way = "in" if guidance is Guidance.ENTER else "out"
        await step.done(f"Let the robot drive {way}, and confirm once it is {way}side.", Prompt.DRIVE, value=way)

    floors = step.floors
    stops = [*floors, *reversed(floors[:-1])][:-1]
    async with lift.watched() as watch:
        for number in range(1, count + 1):
            start, destination = stops[(number - 1) % len(stops)], stops[number % len(stops)]
            trip = await _trip(step, lift, watch, number, (start, destination), drive if with_robot else None)
            step.trips.append(trip)
            step.person.show(f"trip {number} of {count}, {start} to {destination}: {_text(trip)}")
            if not trip.is_complete:
                step.problem(f"trip {number}, {start} to {destination}, was not completed: {trip.text}")
                return
    totals = [trip.figures["total_s"] for trip in step.trips]
    step.figures |= {"trips": float(count), "longest_s": max(totals), "mean_s": round(sum(totals) / len(totals), 2)}


async def _trip(
    step: Step, lift: WatchedLift, watch: Watch, number: int, stops: tuple[str, str], drive: Drive | None
) -> Trip:
    start, destination = stops
    loop, began, began_at = asyncio.get_running_loop(), watch.newest, now()
    ridden = Ridden(loop.time())
    try:
        ridden = await ride(lift, start, destination, drive)
    except (ClientError, TimeoutError) as error:
        ridden.reason = str(error) or "it took too long"
    figures = {"total_s": round(loop.time() - ridden.began_at, 2)}
    if ridden.entered_at is not None:
        figures[CALLED] = round(ridden.entered_at - ridden.began_at, 2)
        travelled = travel_s(watch, ridden.entered_at, destination)
        if travelled is not None:
            figures["travel_s"] = travelled
    for side in Side:
        for name, value in door_times(watch, began, side).items():
            figures.setdefault(name, value)
    return Trip(
        number=number,
        item=step.item.id,
        from_=start,
        to=destination,
        at=began_at,
        is_complete=ridden.is_complete,
        text="" if ridden.is_complete else ridden.reason,
        figures=figures,
    )


def _text(trip: Trip) -> str:
    words = {CALLED: "car there after"}
    figures = ", ".join(
        f"{words.get(name) or name.removesuffix('_s').replace('_', ' ')} {value:g} s"
        for name, value in trip.figures.items()
    )
    return figures if trip.is_complete else f"not completed, {trip.text}"
