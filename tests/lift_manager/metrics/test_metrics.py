"""What Prometheus is told, read with the parsers of the library."""

import asyncio
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime

import pytest

from drivers.model import Command, CommandKind, Outcome, Proof, Result
from lift_manager.lift.events import Alarm, CommandEnded, SessionEnded, SessionOpened
from lift_manager.lift.session import EndReason, Holder
from lift_manager.lift.state import LiftState, Quality, Restrictions
from lift_manager.metrics.lag import ProcessLag
from lift_manager.rides.inputs import RideChanged
from lift_manager.rides.ride import Guidance, Phase, Ride
from lift_manager.runtime.bus import Event, Occurrence, StateChanged
from register_maps.words import Mode, Side
from tests.lift_manager.metrics.measured import LINK, OPEN, Rig, lifts, measured, rig_of
from tests.lift_manager.web.fake import FakeSite, one_lift
from tests.lift_manager.web.fake_lifts import IDLE
from tests.support.rows import each_row
from tests.support.virtual_time import elapse, run_virtual

AT = datetime(2026, 3, 1, 20, 15, tzinfo=UTC)
ROBOT = Holder("api", "robot-7")
GO = Command(CommandKind.GO_TO, floor="L2")
FRAMES = ("01 06 00 0f 00 02",)
RIDE = Ride(
    id="ride-8f2c",
    lift="lift",
    any_lift=False,
    start="L1",
    destination="L2",
    door=None,
    robot="robot-7",
    caller=ROBOT,
    phase=Phase.CALLED,
    guidance=Guidance.WAIT,
    reason="",
    advice=None,
    ahead=None,
    phase_ends_in_s=10.0,
    maybe_aboard=False,
    begun_at=AT,
    changed_at=AT,
)


@each_row(
    ("accept", "content_type"),
    [
        ("", "text/plain; version=0.0.4; charset=utf-8"),
        ("*/*", "text/plain; version=0.0.4; charset=utf-8"),
        ("text/plain;version=0.0.4", "text/plain; version=0.0.4; charset=utf-8"),
        ("application/openmetrics-text;version=nonsense", "application/openmetrics-text; version=1.0.0; charset=utf-8"),
        (OPEN, "application/openmetrics-text; version=1.0.0; charset=utf-8"),
    ],
)
def test_the_format_is_that_which_was_asked_for(accept: str, content_type: str) -> None:
    async def check(rig: Rig) -> None:
        body, said = await rig.metrics.scrape(accept)
        assert said == content_type
        assert body.endswith(b"# EOF\n") is content_type.startswith("application/openmetrics")
        assert body.count(b"# EOF") <= 1

    measured(check)


def test_both_formats_say_the_same() -> None:
    async def check(rig: Rig) -> None:
        rig.publish(Alarm("lift", "a text"))
        own = [
            {name: found for name, found in (await rig.read(accept)).items() if not _of_the_library(name)}
            for accept in ("", OPEN)
        ]
        assert own[0] == own[1]
        assert len(own[0]) > 30

    measured(check)


def _of_the_library(name: str) -> bool:
    return name.startswith("process_") or "_lag_seconds" in name


def test_a_lift_is_told_as_it_is_published() -> None:
    told = replace(
        IDLE,
        quality=Quality.OFFLINE,
        age_s=4.5,
        mode=Mode.FIRE,
        holder=ROBOT,
        held_since_s=12.0,
        restrictions=Restrictions(
            fire_latched=True, lockout="by M. Weber", maybe_aboard=ROBOT, distrusted="door inverted?"
        ),
        waiting=3,
    )

    async def check(rig: Rig) -> None:
        read = await rig.read()
        of_lift = {name: found[(("lift", "lift"),)] for name, found in read.items() if (("lift", "lift"),) in found}
        assert {name.removeprefix("lift_manager_"): value for name, value in of_lift.items()} == {
            "lift_live": 0,
            "lift_held": 1,
            "lift_fire_latched": 1,
            "lift_locked_out": 1,
            "lift_draining": 0,
            "lift_distrusted": 1,
            "lift_maybe_occupied": 1,
            "lift_reading_age_seconds": 4.5,
            "lift_waiting": 3,
            "session_held_seconds": 12,
            "polls_total": 7,
            "alarms_total": 0,
        }
        modes = {dict(labels)["mode"]: value for labels, value in read["lift_manager_lift_mode"].items()}
        assert modes == {mode.value: float(mode is Mode.FIRE) for mode in Mode}

    measured(check, one_lift(told))


def test_a_lift_that_was_never_read_has_no_age() -> None:
    async def check(rig: Rig) -> None:
        assert "lift_manager_lift_reading_age_seconds" not in await rig.read()
        assert await rig.value("lift_manager_lift_live", lift="lift") == 0

    measured(check, one_lift(replace(IDLE, quality=Quality.OFFLINE, age_s=None)))


def test_a_link_is_told_with_its_counts_and_its_histograms() -> None:
    async def check(rig: Rig) -> None:
        read, own = await rig.read(), (("link", "tower"),)
        assert {name: read[f"lift_manager_link_{name}_total"][own] for name in LINK.counts} == LINK.counts
        assert read["lift_manager_link_up"][own] == 1
        assert read["lift_manager_link_in_doubt"][own] == 0
        assert read["lift_manager_link_since_seconds"][own] == 3.5
        assert read["lift_manager_link_answer_age_seconds"][own] == 0.25
        assert read["lift_manager_link_in_flight"][own] == 1
        assert await rig.value("lift_manager_link_waiting", link="tower", lane="read") == 2
        assert await rig.value("lift_manager_link_waiting", link="tower", lane="command") == 1
        trips = read["lift_manager_link_round_trip_seconds_bucket"]
        assert {dict(labels)["le"]: value for labels, value in trips.items()} == {"0.01": 3, "0.1": 5, "+Inf": 6}
        assert read["lift_manager_link_round_trip_seconds_count"][own] == 6
        assert read["lift_manager_link_round_trip_seconds_sum"][own] == 0.75
        assert await rig.value("lift_manager_link_wait_seconds_count", link="tower", lane="read") == 1

    measured(check)


def test_names_of_a_site_file_break_nothing() -> None:
    name = 'Güter "A"\\\n, {link}'

    async def check(rig: Rig) -> None:
        for accept in ("", OPEN):
            read = await rig.read(accept)
            assert read["lift_manager_lift_live"] == {(("lift", "goods"),): 1}
            assert read["lift_manager_link_up"] == {(("link", name),): 1}

    measured(check, one_lift(replace(IDLE, lift="goods")), (replace(LINK, link=name),))


@each_row(
    ("outcome", "result", "reason"),
    [
        (Outcome(GO, Result.CONFIRMED, proof=Proof.LAMP, frames=FRAMES), "confirmed", "lamp"),
        (Outcome(GO, Result.REJECTED, "no robot mode", grant_missing=True), "rejected", "not_granted"),
        (Outcome(GO, Result.REJECTED, "held by fleet/robot-9"), "rejected", "not_sent"),
        (Outcome(GO, Result.REJECTED, "illegal data address", frames=FRAMES), "rejected", "lift_refused"),
        (Outcome(GO, Result.UNCONFIRMED, "another call took its place"), "unconfirmed", "not_sent"),
        (Outcome(GO, Result.UNCONFIRMED, "nothing showed within 2 s", frames=FRAMES), "unconfirmed", "no_evidence"),
    ],
)
def test_a_command_is_counted_by_what_became_of_it_and_why_in_closed_words(
    outcome: Outcome, result: str, reason: str
) -> None:
    async def check(rig: Rig) -> None:
        rig.publish(CommandEnded("lift", outcome, ROBOT))
        told = {"lift": "lift", "command": "go_to", "result": result, "reason": reason}
        assert await rig.value("lift_manager_commands_total", **told) == 1

    measured(check)


def test_a_command_is_named_with_its_door_and_without_its_floor() -> None:
    held = Outcome(Command(CommandKind.HOLD_DOOR, side=Side.FRONT), Result.CONFIRMED, proof=Proof.READBACK)

    async def check(rig: Rig) -> None:
        rig.publish(CommandEnded("lift", held))
        told = {"lift": "lift", "command": "hold_door.front", "result": "confirmed", "reason": "readback"}
        assert await rig.value("lift_manager_commands_total", **told) == 1

    measured(check)


def test_what_people_have_to_look_into_begins_at_zero_so_that_the_first_is_a_rise() -> None:
    async def check(rig: Rig) -> None:
        read = await rig.read()
        assert read["lift_manager_alarms_total"] == {(("lift", "lift"),): 0}
        assert set(read["lift_manager_commands_total"].values()) == {0}
        assert {dict(labels)["command"] for labels in read["lift_manager_commands_total"]} == {
            "go_to",
            "hold_door.front",
        }
        assert read["lift_manager_link_desyncs_total"] == {(("link", "tower"),): LINK.counts["desyncs"]}

    measured(check)


def test_sessions_are_counted_by_face_and_by_why_they_ended() -> None:
    async def check(rig: Rig) -> None:
        rig.publish(
            SessionOpened("lift", ROBOT, "L2"),
            SessionEnded("lift", ROBOT, EndReason.LEASE, "silent for 60 s", None),
            SessionOpened("lift", Holder("rmf", "fleet/tinyRobot1"), "L1"),
        )
        assert await rig.value("lift_manager_sessions_opened_total", lift="lift", face="api") == 1
        assert await rig.value("lift_manager_sessions_opened_total", lift="lift", face="rmf") == 1
        told = {"lift": "lift", "face": "api", "reason": "lease"}
        assert await rig.value("lift_manager_sessions_ended_total", **told) == 1

    measured(check)


def test_the_end_of_a_ride_is_counted_once_whatever_changes_of_it_afterwards() -> None:
    over = replace(RIDE, phase=Phase.GAVE_UP, guidance=Guidance.GAVE_UP, reason="the lift was taken out of service")

    async def check(rig: Rig) -> None:
        for ride in (RIDE, over, replace(over, maybe_aboard=True), replace(over, maybe_aboard=False)):
            rig.publish(RideChanged("lift", ride))
        rig.publish(RideChanged("lift", replace(over, id="another")))
        assert await rig.value("lift_manager_rides_ended_total", lift="lift", end="gave_up") == 2
        assert await rig.value("lift_manager_rides_ended_total", lift="lift", end="done") == 0

    measured(check)


def test_every_event_is_counted_by_its_kind() -> None:
    events: tuple[Event, ...] = (StateChanged("lift", IDLE), StateChanged("lift", IDLE), Alarm("lift", "a text"))

    async def check(rig: Rig) -> None:
        rig.publish(*events)
        assert await rig.value("lift_manager_events_total", event="state_changed") == 2
        assert await rig.value("lift_manager_events_total", event="alarm") == 1
        assert await rig.value("lift_manager_events_total", event="locked_out") == 0

    measured(check)


def test_no_holder_no_ride_and_no_text_is_told() -> None:
    told = replace(
        IDLE,
        holder=ROBOT,
        held_since_s=1.0,
        reason="SECRET",
        restrictions=Restrictions(lockout="SECRET", maybe_aboard=ROBOT, waiting_for="SECRET"),
    )

    async def check(rig: Rig) -> None:
        rig.publish(
            SessionOpened("lift", ROBOT, "L2"),
            SessionEnded("lift", ROBOT, EndReason.MODE, "SECRET", None),
            Alarm("lift", "SECRET", ROBOT),
            RideChanged("lift", replace(RIDE, phase=Phase.DONE, reason="SECRET")),
            CommandEnded("lift", Outcome(GO, Result.REJECTED, "SECRET"), ROBOT),
        )
        text = (await rig.metrics.scrape(""))[0].decode()
        assert not [word for word in ("SECRET", "robot-7", "ride-8f2c") if word in text]

    measured(check, one_lift(told))


def test_refusals_are_told_by_code() -> None:
    async def check(rig: Rig) -> None:
        rig.site.refusals.counts.update({("lift", "held"): 4, ("", "bad_key"): 2})
        assert await rig.value("lift_manager_refusals_total", lift="lift", code="held") == 4
        assert await rig.value("lift_manager_refusals_total", lift="", code="bad_key") == 2

    measured(check)


def test_a_file_that_cannot_be_written_is_told() -> None:
    async def check(rig: Rig) -> None:
        assert await rig.value("lift_manager_file_written", file="journal") == 0
        assert await rig.value("lift_manager_file_written", file="state") == 1

    measured(check, FakeSite(unwritten=frozenset({"journal"})))


def test_a_loop_that_was_held_up_is_told_with_how_long() -> None:
    async def check(rig: Rig) -> None:
        await elapse(2.1)
        assert await rig.value("lift_manager_loop_lag_seconds_count") == 8
        assert await rig.value("lift_manager_loop_lag_seconds_sum") == pytest.approx(0.0, abs=0.001)

    measured(check)


def test_the_lag_of_an_event_ends_when_all_who_were_woken_have_had_their_turn() -> None:
    async def main() -> None:
        lags, readers = ProcessLag(), list[float]()
        loop = asyncio.get_running_loop()

        def counted() -> float | None:
            return lags.registry.get_sample_value("lift_manager_event_lag_seconds_count")

        lags.measure_event(Occurrence("boot-1", loop.time(), Alarm("lift", "first")))
        lags.measure_event(Occurrence("boot-2", loop.time(), Alarm("lift", "second")))
        loop.call_soon(lambda: readers.append(counted() or 0.0))
        await asyncio.sleep(0)
        assert readers == [0.0]
        await asyncio.sleep(0)
        assert counted() == 1.0

    run_virtual(main)


class Overheard(FakeSite):
    """Knows how many overhear it."""

    listeners = 0

    @contextmanager
    def overhear(self, hear: Callable[[Occurrence], None]) -> Iterator[None]:
        self.listeners += 1
        try:
            with super().overhear(hear):
                yield
        finally:
            self.listeners -= 1


def test_nothing_is_heard_once_the_metrics_end() -> None:
    site = Overheard()

    async def check(_: Rig) -> None:
        assert site.listeners == 1

    measured(check, site)
    assert site.listeners == 0


def test_two_managers_in_one_process_count_apart() -> None:
    async def check(rig: Rig) -> None:
        second = rig_of(one_lift(IDLE))
        running = asyncio.ensure_future(second.metrics.run())
        await elapse(0.1)
        rig.publish(Alarm("lift", "a text"))
        assert await rig.value("lift_manager_alarms_total", lift="lift") == 1
        assert await second.value("lift_manager_alarms_total", lift="lift") == 0
        running.cancel()

    measured(check)


def test_a_scrape_of_a_hundred_lifts_gives_the_lifts_their_turns_in_between() -> None:
    states: dict[str, LiftState] = lifts(100)
    links = tuple(replace(LINK, link=name) for name in states)

    async def check(rig: Rig) -> None:
        longest_s, ended = 0.0, asyncio.ensure_future(rig.metrics.scrape(OPEN))
        turns = 0
        while not ended.done():
            began = time.thread_time()
            await asyncio.sleep(0)
            longest_s, turns = max(longest_s, time.thread_time() - began), turns + 1
        assert turns > 30
        assert longest_s < 0.25  # a tenth of it on an idle machine

    measured(check, FakeSite(states), links)
