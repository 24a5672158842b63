"""A stream that breaks goes on where it broke: nothing is lost, and nothing comes twice."""

import asyncio
import random
from dataclasses import replace

from lift_manager.lift.events import Alarm
from lift_manager.lift.session import Holder
from lift_manager.rides.ride import Phase
from lift_manager.web.app import make_app
from lift_manager.web.events.feed import MAX_KEPT_EVENTS
from tests.lift_manager.web.fake import serving
from tests.lift_manager.web.fake_lifts import ABLE
from tests.lift_manager.web.fake_rides import a_ride
from tests.lift_manager.web.listening import EVENTS, Happening, Message, listening
from tests.support.rows import each_row

CALLER = Holder("ride", "amr-7")
OF_LIFT = f"{EVENTS}?lift=lift"
QUIET_S = 0.05
"""A stream that says nothing for so long has said what there is."""


def numbers(found: list[Message]) -> list[int]:
    return [int(message.id.rpartition("-")[2]) for message in found]


async def cut_off(port: int, path: str, last_id: str, after_bytes: int) -> list[Message]:
    """Listen until so many bytes have come, in whatever event or head that is, and hang up."""
    async with listening(port, path, {"Last-Event-ID": last_id}) as stream:
        assert await stream.begin() == 200
        while len(stream.raw) < after_bytes:
            try:
                async with asyncio.timeout(QUIET_S):
                    stream.raw += await stream.reader.read(after_bytes - len(stream.raw))
            except TimeoutError:
                break
        return stream.messages()


async def after(port: int, path: str, last_id: str, count: int) -> list[Message]:
    async with listening(port, path, {"Last-Event-ID": last_id}) as stream:
        assert await stream.begin() == 200
        return await stream.take(count)


@each_row("seed", range(2))
@each_row("path", [EVENTS, OF_LIFT])
def test_a_stream_that_is_cut_anywhere_loses_and_repeats_nothing(seed: int, path: str) -> None:
    dice = random.Random(seed)
    # on a busy computer events wait, and those of a lift must not turn too old by that
    manager = Happening(able=replace(ABLE, max_age_s=3600.0))
    happened: list[tuple[int, str]] = []

    async def happen() -> None:
        for number in range(1, 201):
            lift, text = dice.choice(["lift", "goods"]), f"text {number} \u2028 and\r\nlines: ü"
            if dice.random() < 0.5:
                manager.shift(lift, reason=text)
            else:
                manager.happens(Alarm(lift, text))
            if path == EVENTS or lift == "lift":
                happened.append((number, text))
            if dice.random() < 0.3:
                await asyncio.sleep(0)

    async def main() -> list[Message]:
        async with serving(make_app(manager)) as port:
            async with listening(port, path) as stream:
                await stream.begin()
                (snapshot,) = await stream.take(1)
            last_id, heard = snapshot.id, list[Message]()
            happening = asyncio.create_task(happen())
            while not happening.done() or last_id != f"{manager.boot}-{happened[-1][0]}":
                heard += await cut_off(port, path, last_id, dice.choice([1, 30, 200, 1000, 4000]))
                last_id = heard[-1].id if heard else last_id
            return heard

    heard = asyncio.run(main())
    texts = [message.data["lift"]["reason"] if message.event == "state" else message.data["text"] for message in heard]
    assert list(zip(numbers(heard), texts, strict=True)) == happened


def test_the_id_in_the_query_serves_those_that_cannot_send_the_header() -> None:
    manager = Happening()

    async def main() -> list[Message]:
        async with serving(make_app(manager)) as port:
            async with listening(port) as stream:
                await stream.begin()
                (snapshot,) = await stream.take(1)
            for text in ("one", "two"):
                manager.happens(Alarm("lift", text))
            async with listening(port, f"{EVENTS}?last_event_id={snapshot.id}") as stream:
                await stream.begin()
                return await stream.take(2)

    assert [message.data["text"] for message in asyncio.run(main())] == ["one", "two"]


@each_row("last_id", ["a0-1", "b0-99", "b0--1", "b0-1x", "b0-\u0661", "-", "nonsense", "b0-" + "9" * 60])
def test_an_id_of_another_process_or_of_nothing_begins_with_a_snapshot_that_says_so(last_id: str) -> None:
    manager = Happening()

    async def main() -> Message:
        async with serving(make_app(manager)) as port:
            async with listening(port) as stream:
                await stream.begin()
                await stream.take(1)
            manager.happens(Alarm("lift", "one"))
            async with listening(port, EVENTS, {"Last-Event-ID": last_id}) as stream:
                await stream.begin()
                return (await stream.take(1))[0]

    first = asyncio.run(main())
    assert (first.event, first.id, first.data["lost"]) == ("snapshot", "b0-1", True)


def test_an_event_that_is_not_kept_any_more_is_made_up_for_by_a_snapshot() -> None:
    manager = Happening()

    async def main() -> tuple[Message, list[Message]]:
        async with serving(make_app(manager)) as port:
            async with listening(port) as stream:
                await stream.begin()
                await stream.take(1)
            for number in range(MAX_KEPT_EVENTS + 1):
                manager.happens(Alarm("lift", str(number)))
            (gone,) = await after(port, EVENTS, "b0-0", 1)
            return gone, await after(port, EVENTS, "b0-1", MAX_KEPT_EVENTS)

    gone, kept = asyncio.run(main())
    assert (gone.event, gone.data["lost"], gone.id) == ("snapshot", True, f"b0-{MAX_KEPT_EVENTS + 1}")
    assert numbers(kept) == list(range(2, MAX_KEPT_EVENTS + 2))


def test_a_ride_that_gets_another_lift_takes_its_reader_along_also_one_that_was_away() -> None:
    manager = Happening()
    ride = a_ride(CALLER, "r1", "lift")
    manager.fake_rides.going_on(ride, a_ride(CALLER, "r2", "goods"))
    path = f"{EVENTS}?ride=r1"

    def happen() -> None:
        manager.shift("lift", floor="L2")
        manager.shift("goods", floor="L2")
        manager.rides_on(replace(ride, lift="goods"))
        manager.shift("lift", floor="L1")
        manager.shift("goods", floor="L1")
        manager.rides_on(a_ride(CALLER, "r2", "goods"))
        manager.rides_on(replace(ride, lift="goods", phase=Phase.DONE))

    async def main() -> tuple[list[Message], list[Message]]:
        async with serving(make_app(manager)) as port, listening(port, path) as stream:
            await stream.begin()
            (snapshot,) = await stream.take(1)
            assert [lift["name"] for lift in snapshot.data["lifts"]] == ["lift"]
            assert [each["id"] for each in snapshot.data["rides"]] == ["r1"]
            happen()
            there = (await stream.take(6))[1:]
            return there, await after(port, path, snapshot.id, 5)

    there, away = asyncio.run(main())
    told = [
        (message.id, message.data["lift"]["name"] if message.event == "state" else message.data["ride"]["lift"])
        for message in there
    ]
    # the state of the lift that the ride has got has no id of its own: who is cut off behind it hears of both again
    assert told == [("b0-1", "lift"), ("", "goods"), ("b0-3", "goods"), ("b0-5", "goods"), ("b0-7", "goods")]
    assert [message.id for message in away] == [message.id for message in there]


def test_both_lifts_hear_of_a_ride_that_goes_from_one_to_the_other() -> None:
    manager = Happening()
    manager.fake_rides.going_on(a_ride(CALLER, "r1", "lift"))

    async def main() -> list[Message]:
        async with serving(make_app(manager)) as port, listening(port, OF_LIFT) as stream:
            await stream.begin()
            await stream.take(1)
            manager.rides_on(a_ride(CALLER, "r1", "goods"))
            manager.rides_on(replace(a_ride(CALLER, "r1", "goods"), phase=Phase.DONE))
            manager.happens(Alarm("lift", "the last"))
            return (await stream.take(3))[1:]

    left, last = asyncio.run(main())
    assert (left.event, left.data["ride"]["lift"], last.data["text"]) == ("ride", "goods", "the last")
