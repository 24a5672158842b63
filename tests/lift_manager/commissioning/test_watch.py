"""What a watcher remembers of a lift, and how it is written down: the same with and without colour, within 80 columns."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

import pytest
from rich.console import Console

from drivers.modbus import signals as driver_signals
from lift_manager.api.lifts import Lift, Restricted, Signal, Signals
from lift_manager.cli.watch import signal_table
from lift_manager.commissioning.watch import text
from lift_manager.commissioning.watch.history import Change, History, Row, SignalQuality
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.state import Quality
from register_maps.codec import Block
from register_maps.load import shipped
from register_maps.words import Door, Mode, Motion, Side
from tests.support.rows import each_row
from tests.support.shipped_maps import compiled

BEGAN = datetime(2026, 11, 23, 12, tzinfo=UTC)
FLOORS = ("B1", "L1", "L2", "L3")
FREE = Restricted(fire_latched=False, lockout="", maybe_occupied_by=None, waiting_for="")


def lift(floor: str | None = "L1", **changes: object) -> Lift:
    usual = {
        "name": "east",
        "floors": FLOORS,
        "quality": Quality.LIVE,
        "reason": "",
        "age_s": 0.1,
        "max_age_s": 1.0,
        "floor": floor,
        "standing": True,
        "destination": None,
        "robot_door": RobotDoor.CLOSED,
        "doors": {Side.FRONT: Door.CLOSED},
        "motion": Motion.STOPPED,
        "mode": Mode.NORMAL,
        "permissions": {},
        "session": None,
        "waiting": 0,
        "restrictions": FREE,
        "not_visible": {},
    }
    return Lift.model_validate(usual | changes)


OFFLINE = lift(None, quality=Quality.OFFLINE, reason="plc: no connection", age_s=3.0, doors={}, motion=Motion.UNKNOWN)


def signal(name: str, value: str | bool | float | None, raw: int | None = 1, age_s: float | None = 0.1) -> Signal:
    return Signal(name=name, value=value, raw=raw, addresses=("holding:12",), wire=("holding 11 bit 4",), age_s=age_s)


def reading(*signals: Signal) -> Signals:
    return Signals(name="east", age_s=0.1, max_age_s=1.0, signals=signals)


class Watched:
    """A history that takes readings at times of its own."""

    def __init__(self, *names: str) -> None:
        self.history = History(names)

    def at(self, now_s: float, *signals: Signal, state: Lift | None = None) -> tuple[Change, ...]:
        return self.history.take(reading(*signals), state or lift(), now_s, BEGAN + timedelta(seconds=now_s))

    def rows(self, now_s: float, *, recent: bool = False) -> dict[str, Row]:
        return {row.signal.name: row for row in self.history.rows(now_s, recent=recent)}


# -- what changed, and when


def test_a_change_has_its_time_and_what_was_before() -> None:
    watched = Watched()
    assert [change.before for change in watched.at(0, signal("fire", False), signal("level", True))] == [None, None]
    (change,) = watched.at(2, signal("fire", True, 0), signal("level", True))
    assert (change.at, change.signal.value, change.before and change.before.value) == (
        BEGAN + timedelta(seconds=2),
        True,
        False,
    )
    assert watched.rows(2)["fire"].changed == BEGAN + timedelta(seconds=2)
    assert watched.rows(2)["level"].changed is None


def test_another_raw_value_with_the_same_meaning_is_a_change() -> None:
    watched = Watched()
    watched.at(0, signal("mode", None, 77))
    assert len(watched.at(1, signal("mode", None, 78))) == 1


def test_only_what_changed_within_the_last_minute_is_recent() -> None:
    watched = Watched()
    watched.at(0, signal("fire", False), signal("level", True))
    watched.at(1, signal("fire", True), signal("level", True))
    assert list(watched.rows(60, recent=True)) == ["fire"]
    assert list(watched.rows(62, recent=True)) == []


def test_only_named_signals_are_followed() -> None:
    watched = Watched("fire")
    assert len(watched.at(0, signal("fire", False), signal("level", True))) == 1
    assert list(watched.rows(0)) == ["fire"]


# -- what may be believed


def test_a_value_grows_old_although_nobody_answers() -> None:
    watched = Watched()
    watched.at(0, signal("fire", False))
    assert watched.rows(0.5)["fire"].quality is SignalQuality.OK
    assert watched.rows(2)["fire"].quality is SignalQuality.OLD
    assert watched.rows(2)["fire"].age_s == pytest.approx(2.1)
    assert watched.history.is_live(0.5)
    assert not watched.history.is_live(2)


def test_a_signal_that_was_never_read_is_no_old_one() -> None:
    watched = Watched()
    watched.at(0, signal("fire", None, None, None))
    assert watched.rows(0)["fire"].quality is SignalQuality.UNREAD


@each_row(
    ("state", "now_s", "trouble", "begins"),
    [
        (lift(), 0.2, "", "east: live (0.3 s old), mode normal, at L1, stopped, front door closed"),
        (lift(), 5.0, "", "!!! east: OFFLINE, the values are OLD (5.1 s old)"),
        (OFFLINE, 0.0, "", "!!! east: OFFLINE, the values are OLD (3.0 s old): plc: no connection"),
        (lift(), 5.0, "refused", "!!! east: THE MANAGER DOES NOT ANSWER for 5 s, so the values are OLD: refused"),
        (lift(None, standing=False), 0.0, "", "east: live (0.1 s old), mode normal, floor not known"),
    ],
)
def test_the_first_line_says_in_words_whether_to_believe_the_rest(
    state: Lift, now_s: float, trouble: str, begins: str
) -> None:
    watched = Watched()
    watched.at(0, signal("fire", False), state=state)
    if trouble:
        watched.history.fail(trouble)
    assert text.headline(watched.history, now_s).startswith(begins)


def test_an_old_value_is_in_brackets_and_named_old() -> None:
    watched = Watched()
    watched.at(0, signal("fire", False))
    assert text.cells(watched.rows(0)["fire"])[1] == "no"
    old = text.cells(watched.rows(9)["fire"])
    assert (old[1], old[6]) == ("(no)", "OLD")


# -- the car


def shaft(state: Lift, now_s: float = 0.0, rows: int | None = None) -> list[str]:
    watched = Watched()
    watched.at(0, state=state)
    return text.shaft(watched.history, now_s, rows=rows)


def test_the_car_is_drawn_at_its_floor_with_its_destination() -> None:
    assert shaft(lift(destination="L3", motion=Motion.UP)) == [
        "> L3  .",
        "  L2  .",
        "  L1  [||] ^ front closed, up",
        "  B1  .",
    ]


def test_every_state_of_a_door_has_a_form_of_its_own() -> None:
    drawn = [shaft(lift(doors={Side.FRONT: door}))[2].split("front")[0] for door in Door]
    assert len(set(drawn)) == len(Door)
    assert len(set(text.DOOR_MARKS.values())) == len(Door)


def test_two_doors_are_drawn_side_by_side() -> None:
    doors = {Side.FRONT: Door.OPEN, Side.REAR: Door.CLOSED}
    assert shaft(lift(doors=doors))[2] == "  L1  [  ][||] front open, rear closed, stopped"


def test_a_car_of_which_nothing_is_known_is_at_no_floor() -> None:
    offline, old = shaft(OFFLINE), shaft(lift(), now_s=9)
    assert offline == old
    assert offline[:4] == ["  L3  .", "  L2  .", "  L1  .", "  B1  ."]
    assert "nobody knows where the car is" in offline[4]
    assert shaft(lift(None))[4] == "  ?   [||] front closed, stopped; its floor is not known"


def test_of_a_tall_shaft_the_floors_around_the_car_are_shown() -> None:
    floors = tuple(f"L{number}" for number in range(30))
    drawn = shaft(lift("L14", floors=floors), rows=7)
    assert drawn[0] == "  ... 13 more above"
    assert drawn[-1] == "  ... 12 more below"
    assert any("[||]" in line for line in drawn)
    assert len(drawn) == 7


# -- the last minute


def test_the_last_minute_of_the_car_is_one_character_for_each_second() -> None:
    watched = Watched()
    ride = [("L1", Door.CLOSED, Motion.UP), ("L2", Door.CLOSED, Motion.UP), ("L3", Door.OPENING, Motion.STOPPED)]
    for second in range(57, 60):
        floor, door, motion = ride[second - 57]
        watched.at(second, state=lift(floor, doors={Side.FRONT: door}, motion=motion))
    floor_line, door_line, motion_line, scale, _ = text.trace(watched.history, 59.0, columns=60)
    assert [line[12:].lstrip() for line in (floor_line, door_line, motion_line)] == ["▃▅█", "||<", "^^."]
    assert len(floor_line) == len(scale) == 72


def test_seconds_without_a_reading_have_a_mark_of_their_own() -> None:
    watched = Watched()
    watched.at(50)
    watched.at(51, state=OFFLINE)
    watched.at(52)
    # and then the manager answers no more
    assert text.trace(watched.history, 60.0, columns=60, is_unicode=False)[0][12:].lstrip() == "1x11xxxxxxx"


# -- 80 columns, and words for addresses


def signals_of(map_name: str) -> Sequence[Signal]:
    """Every signal of a map, as a manager offers it, with values as long as they come."""
    codec = compiled(map_name)
    cells = dict.fromkeys((point.table, point.address, point.endpoint) for point in codec.signal_points)
    blocks = [Block(table, address, 1, endpoint) for table, address, endpoint in cells]
    found = driver_signals.Signals(codec, blocks, {}, watchdog_unit_s=1.0).values_at(codec.reader(blocks), (), 0.0)
    return [
        Signal(name=one.name, value="out_of_service", raw=65535, addresses=one.addresses, wire=one.wire, age_s=12.3)
        for one in found
    ]


@each_row("map_name", shipped())
def test_the_table_of_every_shipped_map_fits_into_80_columns(map_name: str) -> None:
    watched = Watched()
    watched.at(0, *signals_of(map_name))
    watched.at(1, *(one.model_copy(update={"raw": 0}) for one in signals_of(map_name)))
    console = Console(width=80)
    with console.capture() as captured:
        console.print(signal_table(list(watched.history.rows(1)), width=80, is_cut=True))
    lines = captured.get().splitlines()
    assert len(lines) == 1 + len(signals_of(map_name))
    for line, one in zip(lines[1:], signals_of(map_name), strict=True):
        assert len(line.rstrip()) <= 80
        # what tells one signal from another, and whether to believe it, is never cut
        assert line.split()[0] == one.name
        assert "12:00:01" in line
        assert " 12.3 OLD " in line


def test_addresses_are_shortened_and_never_invented() -> None:
    assert text.short_wire("holding 11 bit 4") == "holding 11.4"
    assert text.short_wire("sensor/holding 11 bits 4 to 5") == "sensor/holding 11.4-5"
    assert text.places(("holding:1",)) == "holding:1"
    assert text.places(("holding 1.0", "holding 1.3")) == "holding 1.0,1.3"
    assert text.places(("discrete:0", "discrete:1", "discrete:2")) == "discrete:0...2"
    assert text.places(("10001", "10002")) == "10001,10002"
    assert text.places(("coil:1", "holding:2")) == "coil:1 ... holding:2"


def test_a_change_is_one_line_with_both_addresses() -> None:
    watched = Watched()
    watched.at(0, signal("door.front", "closed"))
    (change,) = watched.at(1, signal("door.front", "open", 3))
    line = text.change_line(change, "east")
    assert line.endswith("east door.front open, was closed (holding:12 = holding 11.4 on the wire, raw 3)")
