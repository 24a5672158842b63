"""Somebody else writes our outputs: it is told once and let go of, nobody fights, and what is not ours any more does not count as held."""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import pytest

from drivers.modbus.memory import MemoryDevice, exception, silence
from drivers.model import Command, CommandKind
from register_maps.words import Side, Table
from tests.drivers.by_hand import LogByHand
from tests.drivers.linked import now
from tests.drivers.rig import HOLD_FRONT, SIGNALS, Rig, allowed, on_rig
from tests.support.rows import each_row
from tests.support.virtual_time import elapse

REFRESHED = (
    "action: hold, max_hold_s: 30, refresh_s: 1, on_link_loss: device_watchdog,"
    " confirm: {any_of: [readback], within_s: 2}"
)
UNREFRESHED = "action: hold, max_hold_s: 30, on_link_loss: latches, confirm: {any_of: [readback], within_s: 2}"
GO_TO = '  go_to: {at: "holding:16", as: floor, action: pulse, width_s: 0.5, rest: 0, confirm: {any_of: [effect], within_s: 2}}\n'


def commands(hold: str = REFRESHED, more: str = GO_TO) -> str:
    return f'{SIGNALS}commands:\n  hold_door.front: {{at: "holding:17", {hold}}}\n{more}'


LET_GO = "it is released, once in 60 s at most"
BLOCK = (
    f'{SIGNALS}commands:\n  hold_door.front: {{at: "coil:1", {REFRESHED}}}\n  robot_mode: {{at: "coil:2", {UNREFRESHED}}}\n'
    'write_blocks: [{at: "coil:1", count: 2, function: 15}]\n'
)


async def until(true: Callable[[], bool]) -> float:
    """Wait for it, and return how long that took."""
    began = now()
    while not true():
        await elapse(0.01)
        assert now() < began + 100
    return now() - began


def notices(made: Rig) -> list[str]:
    return [notice for reading in made.readings for notice in reading.notices]


async def keep(made: Rig, seconds: float, each: Callable[[], None] = lambda: None) -> None:
    """Want the door hold for so long, as a session does."""
    end = now() + seconds
    while now() < end:
        made.lift.hold(HOLD_FRONT, allowed)
        each()
        await elapse(0.1)


def presses(made: Rig, since: float) -> list[float]:
    """Times at which the door hold was pressed."""
    return [
        heard.at_s
        for heard in made.device.received
        if heard.at_s >= since and heard.request.is_write and heard.request.values == (1,)
    ]


def looks(made: Rig, since: float) -> list[float]:
    """Times of the reads of our outputs."""
    return [
        heard.at_s
        for heard in made.device.received
        if heard.at_s >= since and not heard.request.is_write and heard.request.table is Table.HOLDING
    ]


@each_row("delay_s", [0.0, 0.2])
def test_a_foreign_press_is_told_once_where_and_what_and_is_let_go_of(delay_s: float) -> None:
    device = MemoryDevice(delay_s=delay_s)

    async def check(made: Rig) -> None:
        await elapse(5)
        made.device.values[Table.HOLDING][17] = 1
        writes = len(made.device.writes)
        took_s = await until(lambda: made.cells(Table.HOLDING, 17) == [0])
        # two looks, the first of them after a pause of them, and the release
        assert took_s <= max(2.0, 20 * delay_s) * 1.12 + 0.3 + 6 * delay_s + 0.1 <= 6.5
        await elapse(1)
        assert notices(made) == [
            f"somebody else writes hold_door.front at holding:17: it reads 1, we wrote 0; {LET_GO}"
        ]
        assert made.writes()[writes:] == ["write holding register 17 := 0, unit 1"]
        await elapse(40)
        assert notices(made)[1:] == ["hold_door.front at holding:17 reads what we wrote again"]
        assert len(made.device.writes) == writes + 1

    on_rig(check, commands(), {"": device})


def test_a_press_left_behind_by_somebody_who_goes_away_keeps_the_door_from_nobody() -> None:
    async def check(made: Rig) -> None:
        made.device.values[Table.HOLDING][17] = 1
        await elapse(5)
        await keep(made, 5)
        assert made.lift.held(HOLD_FRONT)
        made.lift.let_go(HOLD_FRONT)
        await elapse(1)
        assert made.cells(Table.HOLDING, 17) == [0]

    on_rig(check, commands())


@pytest.mark.parametrize("every_s", [0.05, 1.0])
def test_somebody_who_presses_again_and_again_is_let_go_of_once_a_minute_at_most(every_s: float) -> None:
    async def check(made: Rig) -> None:
        writes = len(made.device.writes)
        for _ in range(round(190 / every_s)):
            made.device.values[Table.HOLDING][17] = 1
            await elapse(every_s)
        released = [heard.at_s for heard in made.device.received if heard.request.is_write][writes:]
        begun = [at for before, at in pairwise([-60.0, *released]) if at - before > 2]
        assert 3 <= len(begun) <= 4
        assert all(after - before >= 60 for before, after in pairwise(begun))
        # who writes faster than we can look is let go of three times at the most, within a second
        assert len(released) <= len(begun) * (1 if every_s >= 1 else 3)
        assert len(notices(made)) == 1
        # and once somebody stops, it is gone within the minute
        await elapse(65)
        assert made.cells(Table.HOLDING, 17) == [0]

    on_rig(check, commands())


def test_a_release_of_a_foreign_press_that_is_not_answered_is_tried_again() -> None:
    async def check(made: Rig) -> None:
        made.device.fail_next(exception(6), times=3, on=lambda request: request.is_write)
        made.device.fail_next(silence(executes=False), on=lambda request: request.is_write)
        made.device.values[Table.HOLDING][17] = 1
        await elapse(8)
        assert made.cells(Table.HOLDING, 17) == [0]

    on_rig(check, commands())


def test_a_second_press_of_somebody_within_the_minute_is_told_and_waits() -> None:
    async def check(made: Rig) -> None:
        made.device.values[Table.HOLDING][17] = 1
        await elapse(25)
        made.device.values[Table.HOLDING][17] = 1
        await elapse(5)
        assert made.cells(Table.HOLDING, 17) == [1]
        assert "; it was released not long ago, and is released again in " in notices(made)[2]
        await elapse(60)
        assert made.cells(Table.HOLDING, 17) == [0]

    on_rig(check, commands())


def test_what_excludes_a_foreign_press_waits_for_its_release_and_the_pause_between_them() -> None:
    async def check(made: Rig) -> None:
        made.device.values[Table.COIL][2] = 1
        until_s = now() + 8
        pressed: list[tuple[float, list[int]]] = []
        while now() < until_s:
            if made.cells(Table.COIL, 2) == [0]:
                made.lift.hold(HOLD_FRONT, allowed)
            pressed.append((now(), made.cells(Table.COIL, 1, 2)))
            await elapse(0.01)
        assert not any(cells == [1, 1] for _, cells in pressed)
        released = next(at for at, cells in pressed if cells == [0, 0])
        assert next(at for at, cells in pressed if cells == [1, 0]) >= released + 0.5 - 0.02

    both = (
        f"{SIGNALS}commands:\n"
        f'  hold_door.front: {{at: "coil:1", {REFRESHED}, excludes: [close_door.front], gap_s: 0.5}}\n'
        '  close_door.front: {at: "coil:2", action: pulse, width_s: 0.5}\n'
    )
    on_rig(check, both)


@pytest.mark.parametrize("shared", ["accepted", "mask_write"])
def test_of_a_shared_word_nothing_is_let_go_but_the_press_of_somebody_else(shared: str) -> None:
    async def check(made: Rig) -> None:
        await keep(made, 3)
        await elapse(0.05)  # away from our own writes, which begin with a read
        # bit 0 is our hold, bit 1 our resting mode, bit 7 nobody's here
        made.device.values[Table.HOLDING][9] |= 0b1000_0010
        seen: list[int] = []
        await keep(made, 6, lambda: seen.append(made.cells(Table.HOLDING, 9)[0]))
        assert seen[-1] == 0b1000_0001
        assert all(word & 0b1000_0001 == 0b1000_0001 for word in seen)

    word = f"shared_word: {shared}, {REFRESHED}"
    on_rig(
        check,
        f'{SIGNALS}commands:\n  hold_door.front: {{at: "holding:9.0", {word}}}\n  robot_mode: {{at: "holding:9.1", {word}}}\n',
    )


def test_a_foreign_press_is_no_reason_to_let_go_of_a_hold_in_the_same_block() -> None:
    said: list[str | None] = [None]

    async def check(made: Rig) -> None:
        made.lift.hold(HOLD_FRONT, lambda: said[0])
        await elapse(3)
        said[0] = "the last reading is too old"
        made.device.values[Table.COIL][2] = 1
        for _ in range(100):
            made.lift.hold(HOLD_FRONT, lambda: said[0])
            await elapse(0.1)
            assert made.cells(Table.COIL, 1) == [1]
        said[0] = None
        await elapse(5)
        assert made.cells(Table.COIL, 1, 2) == [1, 0]

    on_rig(check, BLOCK)


def test_a_foreign_call_is_told_with_the_floor_code_it_reads() -> None:
    async def check(made: Rig) -> None:
        made.device.values[Table.HOLDING][16] = 2
        await elapse(5)
        assert notices(made) == [f"somebody else writes go_to at holding:16: it reads 2, we wrote 0; {LET_GO}"]

    on_rig(check, commands())


def test_one_look_is_no_proof() -> None:
    async def check(made: Rig) -> None:
        since = now()
        while not looks(made, since):
            made.device.values[Table.HOLDING][17] = 1
            await elapse(0.01)
        made.device.values[Table.HOLDING][17] = 0
        await elapse(20)
        assert notices(made) == []

    on_rig(check, commands())


def test_who_writes_now_and_then_is_one_episode() -> None:
    async def check(made: Rig) -> None:
        for _ in range(8):
            made.device.values[Table.HOLDING][17] = 1
            await elapse(4)
            made.device.values[Table.HOLDING][17] = 0
            await elapse(4)
        assert len(notices(made)) == 1

    on_rig(check, commands())


def test_outputs_are_compared_with_one_read_about_every_two_seconds() -> None:
    async def check(made: Rig) -> None:
        since = now()
        await elapse(60)
        assert 26 <= len(looks(made, since)) <= 30
        read = [heard.request for heard in made.device.received if heard.at_s >= since]
        assert {request.count for request in read if request.table is Table.HOLDING} == {2}

    on_rig(check, commands())


def test_a_slow_controller_is_asked_so_seldom_that_its_polls_do_not_suffer() -> None:
    device = MemoryDevice(delay_s=0.4)
    device.values[Table.INPUT][1] = 1

    async def check(made: Rig) -> None:
        await elapse(20)
        since = now()
        await elapse(160)
        assert 10 <= len(looks(made, since)) <= 21

    on_rig(check, commands(), {"": device})


def test_our_own_presses_and_holds_are_nobody_elses() -> None:
    async def check(made: Rig) -> None:
        for floor in ("L1", "L2") * 10:
            press = made.lift.press(Command(CommandKind.GO_TO, floor), allowed)
            await keep(made, 2.7)
            assert press.done()
            made.lift.let_go(HOLD_FRONT)
            await elapse(1.3)
        assert notices(made) == []

    on_rig(check, commands())


def test_a_hold_that_somebody_lets_go_is_told_and_does_not_count_as_held() -> None:
    async def check(made: Rig) -> None:
        await keep(made, 5)
        assert made.lift.held(HOLD_FRONT)
        held: list[bool] = []

        def release() -> None:
            made.device.values[Table.HOLDING][17] = 0
            held.append(made.lift.held(HOLD_FRONT))

        await keep(made, 12, release)
        assert notices(made)[0] == (
            "hold_door.front was released by the controller or by somebody else at holding:17: it reads 0, we wrote 1"
        )
        assert False in held

    on_rig(check, commands())


@pytest.mark.parametrize("hold", [REFRESHED, UNREFRESHED], ids=["refreshed", "not refreshed"])
def test_whoever_lets_go_again_and_again_is_not_fought(hold: str) -> None:
    async def check(made: Rig) -> None:
        await keep(made, 3)

        def release() -> None:
            made.device.values[Table.HOLDING][17] = 0

        await keep(made, 60, release)
        fight = [notice for notice in notices(made) if "is pressed again once in 60 s at most" in notice]
        assert len(fight) == 1
        assert "hold_door.front at holding:17 was released 4 times within 60 s" in fight[0]
        pressed = presses(made, now() - 40)
        assert pressed == []
        assert not made.lift.held(HOLD_FRONT)
        since = now()
        await keep(made, 190, release)
        begun = [at for before, at in pairwise([-60.0, *presses(made, since)]) if at - before > 5]
        assert 3 <= len(begun) <= 4
        assert all(after - before >= 60 for before, after in pairwise(begun))
        assert sum("once in 60 s at most" in notice for notice in notices(made)) == 1
        # a new hold is a new command
        made.lift.let_go(HOLD_FRONT)
        await elapse(1)
        await keep(made, 5)
        assert made.lift.held(HOLD_FRONT)

    on_rig(check, commands(hold))


def test_a_hold_that_dropped_out_four_times_in_a_minute_is_pressed_again_when_the_minute_is_over() -> None:
    async def check(made: Rig) -> None:
        await keep(made, 8)
        for _ in range(4):
            made.device.values[Table.HOLDING][17] = 0
            await keep(made, 8)
        assert made.cells(Table.HOLDING, 17) == [0]
        await keep(made, 60)
        assert made.lift.held(HOLD_FRONT)
        await keep(made, 130)
        assert made.lift.held(HOLD_FRONT)
        # forgiven by then: the next drop-out heals at once
        made.device.values[Table.HOLDING][17] = 0
        await keep(made, 5)
        assert made.lift.held(HOLD_FRONT)

    on_rig(check, commands(UNREFRESHED))


@each_row(("refresh_s", "delay_s"), [(1, 0.02), (2, 0.05), (4, 0.0)])
def test_no_refresh_hides_for_long_that_somebody_lets_go_between_two_of_them(refresh_s: int, delay_s: float) -> None:
    device = MemoryDevice(delay_s=delay_s)

    async def check(made: Rig) -> None:
        def release() -> None:
            written = [heard.at_s for heard in device.received[-99:] if heard.request.is_write]
            if written and now() - written[-1] > 0.5 * refresh_s:
                device.values[Table.HOLDING][17] = 0

        await keep(made, 20, release)
        assert "hold_door.front was released by the controller or by somebody else" in notices(made)[0]

    on_rig(check, commands(REFRESHED.replace("refresh_s: 1", f"refresh_s: {refresh_s}")), {"": device})


def test_who_lets_go_of_a_hold_between_its_quick_refreshes_is_not_fought_either() -> None:
    device = MemoryDevice(delay_s=0.005)

    async def check(made: Rig) -> None:
        def release() -> None:
            device.values[Table.HOLDING][17] = 0

        since = now()
        await keep(made, 60, release)
        assert any("was released 4 times within 60 s" in notice for notice in notices(made))
        # it is dropped and written again until it was seen four times, and then no more
        assert max(presses(made, since)) < since + 20

    on_rig(check, commands(REFRESHED.replace("refresh_s: 1", "refresh_s: 0.25")), {"": device})


def test_the_looks_take_no_more_of_a_slow_link_while_a_difference_lasts() -> None:
    device = MemoryDevice(delay_s=0.4)

    async def check(made: Rig) -> None:
        await elapse(20)
        since = now()
        until_s = since + 160
        while now() < until_s:
            device.values[Table.HOLDING][17] = 1
            await elapse(0.1)
        # a twentieth of 160 s, at 0.4 s each, and those of the releases
        assert len(looks(made, since)) <= 160 / 20 / 0.4 + 3 * 3

    on_rig(check, commands(), {"": device})


def test_a_hold_that_drops_out_now_and_then_is_pressed_again_each_time() -> None:
    async def check(made: Rig) -> None:
        for _ in range(6):
            await keep(made, 25)
            assert made.lift.held(HOLD_FRONT)
            made.device.values[Table.HOLDING][17] = 0
        await keep(made, 5)
        assert made.lift.held(HOLD_FRONT)
        assert notices(made) == []

    on_rig(check, commands(UNREFRESHED))


def test_what_the_watchdog_of_the_module_let_go_is_nobody_elses_doing() -> None:
    async def check(made: Rig) -> None:
        await keep(made, 5)

        def trip() -> None:
            made.device.values[Table.HOLDING][17] = 0
            made.device.values[Table.DISCRETE][7] = 1

        await keep(made, 30, trip)
        assert notices(made) == []

    tripped = SIGNALS.rstrip().removesuffix("}") + ', watchdog_tripped: {at: "discrete:7"}}\n'
    on_rig(check, commands().replace(SIGNALS, tripped))


def test_where_the_map_reads_a_signal_at_the_same_place_the_controller_may_write_there() -> None:
    async def check(made: Rig) -> None:
        made.device.values[Table.HOLDING][16] = 2
        await elapse(10)
        assert notices(made) == []

    said = SIGNALS.rstrip().removesuffix("}") + ', destination: {at: "holding:16", as: floor, none: [0]}}\n'
    on_rig(check, commands().replace(SIGNALS, said))


def test_a_new_connection_clears_once_what_somebody_pressed_and_no_look_misses_it() -> None:
    async def check(made: Rig) -> None:
        made.device.values[Table.HOLDING][17] = 1
        made.device.disconnect()
        await elapse(3)
        assert made.cells(Table.HOLDING, 17) == [0]
        made.device.values[Table.HOLDING][17] = 1
        await elapse(10)
        assert made.cells(Table.HOLDING, 17) == [0]
        assert len(notices(made)) == 1

    on_rig(check, commands())


def test_two_doors_are_told_apart() -> None:
    async def check(made: Rig) -> None:
        made.device.values[Table.HOLDING][18] = 1
        await elapse(5)
        assert notices(made) == [f"somebody else writes hold_door.rear at holding:18: it reads 1, we wrote 0; {LET_GO}"]
        assert not made.lift.held(Command(CommandKind.HOLD_DOOR, side=Side.REAR))

    rear = f'  hold_door.rear: {{at: "holding:18", {REFRESHED}}}\n'
    both = SIGNALS.rstrip().removesuffix("}") + ', door.rear: {at: "discrete:2"}}\n'
    on_rig(check, commands(more=rear + GO_TO).replace(SIGNALS, both))


def test_a_look_never_goes_before_a_command() -> None:
    device = MemoryDevice(delay_s=0.1)
    device.values[Table.INPUT][1] = 1

    async def check(made: Rig) -> None:
        took_s: list[float] = []
        for _ in range(40):
            began = now()
            press = made.lift.press(Command(CommandKind.GO_TO, "L2"), allowed)
            while not any(heard.request.is_write and heard.at_s >= began for heard in device.received):
                await elapse(0.01)
            took_s.append(now() - began)
            await elapse(1.37)
            press.cancel()
        # what is in flight, and nothing more
        assert max(took_s) <= 0.1 + 0.02

    on_rig(check, commands(), {"": device})


def test_a_lift_whose_outputs_say_nothing_is_not_looked_at() -> None:
    async def check(made: Rig) -> None:
        since = now()
        await elapse(20)
        assert looks(made, since) == []

    timed = '{at: "coil:5", action: pulse, width_s: 1, timed_by: device, payload: {time: width_s, unit_s: 0.1}}'
    on_rig(check, f"{SIGNALS}commands:\n  close_door.front: {timed}\n")


def test_a_block_that_is_written_all_the_time_goes_on_at_rest_once_its_hold_is_given_up() -> None:
    async def check(made: Rig) -> None:
        await keep(made, 5)

        def release() -> None:
            made.device.values[Table.HOLDING][17] = 0

        await keep(made, 30, release)
        assert any("is pressed again once in 60 s at most" in notice for notice in notices(made))
        since = now()
        await keep(made, 10)
        images = [
            heard.request.values for heard in made.device.received if heard.at_s > since and heard.request.is_write
        ]
        assert set(images) == {(0, 0)}
        assert len(images) == pytest.approx(20, abs=1)

    cyclic = "action: hold, max_hold_s: 30, on_link_loss: latches, confirm: {any_of: [readback], within_s: 2}"
    block = 'write_blocks:\n  - {at: "holding:16", count: 2, function: 16, every_s: 0.5}\n'
    on_rig(check, commands(cyclic) + block)


FOUGHT = "was released 4 times within 60 s"


@dataclass
class Fight:
    """What became of a door hold that somebody else clears."""

    cleared: list[float] = field(default_factory=list)
    """When it was cleared while it was on."""
    pressed: list[float] = field(default_factory=list)
    """When it rose again."""
    held: list[tuple[float, bool]] = field(default_factory=list)
    """Whether it counted as held, each time with what stood there."""


async def fight(made: Rig, seconds: float, clears: Callable[[float | None], bool]) -> Fight:
    """Want the door hold for so long. `clears` is told since when it is on, and says whether somebody clears it now."""
    found, until_s, on_since = Fight(), now() + seconds, now()
    was_on = True
    while now() < until_s:
        made.lift.hold(HOLD_FRONT, allowed)
        is_on = made.cells(Table.HOLDING, 17) == [1]
        if is_on and not was_on:
            found.pressed.append(now())
            on_since = now()
        if clears(on_since) and is_on:
            made.device.values[Table.HOLDING][17] = 0
            found.cleared.append(now())
            is_on = False
        if not is_on and made.lift.held(HOLD_FRONT):
            found.held.append((now(), is_on))
        was_on = is_on
        await elapse(0.01)
    return found


def periodic(every_s: float, first_s: float) -> Callable[[float | None], bool]:
    """Clear it every so often."""
    at = [now() + first_s]

    def clears(_: float | None) -> bool:
        if now() < at[0]:
            return False
        at[0] += every_s
        return True

    return clears


def not_fought(made: Rig, log: LogByHand, found: Fight) -> None:
    told = next(reading.at for reading in made.readings if reading.notices)
    assert told <= found.cleared[0] + 6
    assert any(FOUGHT in notice for notice in notices(made))
    # each press has a row of its own before it; after the fourth drop there is none for a minute
    rows = [row for row, _ in log.rows if row.startswith("hold_door")]
    assert rows == ["hold_door.front"] + 3 * ["hold_door.front again"]
    assert len(found.pressed) == 3
    assert not made.lift.held(HOLD_FRONT)


@each_row(
    ("refresh_s", "every_s", "first_s"),
    [
        (1, 0.5, 0.0),
        (1, 1.0, 0.3),
        (1, 2.0, 0.6),
        (1, 3.0, 0.9),
        (2, 0.5, 0.9),
        (2, 1.0, 0.6),
        (2, 2.0, 0.3),
        (2, 3.0, 0.0),
    ],
)
def test_a_second_writer_of_any_period_and_phase_is_told_and_not_fought(
    refresh_s: int, every_s: float, first_s: float
) -> None:
    log = LogByHand()

    async def check(made: Rig) -> None:
        await keep(made, 8)
        found = await fight(made, 30, periodic(every_s, first_s))
        not_fought(made, log, found)
        # on a quick link it counts as held for no longer than from one look to the next
        off_s = sum(0.01 for _ in found.held)
        assert off_s <= 4 * 0.6

    on_rig(check, commands(REFRESHED.replace("refresh_s: 1", f"refresh_s: {refresh_s}")), log=log)


@each_row("delay_s", [0.0, 0.3])
def test_a_monostable_that_clears_a_hold_just_before_each_refresh_is_told_and_not_fought(delay_s: float) -> None:
    log = LogByHand()

    async def check(made: Rig) -> None:
        await keep(made, 8)
        found = await fight(made, 30, lambda on_since: on_since is not None and now() - on_since >= 0.8)
        not_fought(made, log, found)

    on_rig(check, commands(), {"": MemoryDevice(delay_s=delay_s)}, log=log)


LEVEL_CALL = (
    '  go_to: {at: "holding:16", as: floor, rest: 0, action: hold, until: arrived, max_hold_s: 300, refresh_s: 2,'
    " on_link_loss: latches, confirm: {any_of: [readback], within_s: 2}}\n"
)


def test_a_call_that_somebody_lets_go_is_told_and_not_pressed_again() -> None:
    go = Command(CommandKind.GO_TO, "L2")

    async def check(made: Rig) -> None:
        _ = made.lift.press(go, allowed)
        await elapse(5.0)
        assert made.lift.given(go)
        assert notices(made) == []
        made.device.values[Table.HOLDING][16] = 0
        await elapse(2.5)
        assert not made.lift.given(go)
        assert not made.lift.held(go)
        assert "go_to was released by the controller or by somebody else" in notices(made)[0]
        await elapse(10.0)
        assert made.cells(Table.HOLDING, 16) == [0]

    on_rig(check, commands(more=LEVEL_CALL))


def test_a_hold_that_was_dropped_counts_as_held_again_only_once_it_has_stood_until_the_next_look() -> None:
    async def check(made: Rig) -> None:
        await keep(made, 5)
        made.device.values[Table.HOLDING][17] = 0
        held: list[tuple[bool, bool]] = []
        await keep(made, 3, lambda: held.append((made.cells(Table.HOLDING, 17) == [1], made.lift.held(HOLD_FRONT))))
        assert (True, False) in held, "the read-back of the press alone does not make up for it"
        assert held[-1] == (True, True)

    on_rig(check, commands())


def test_a_drop_while_nothing_can_be_written_down_is_pressed_again_once_it_can() -> None:
    log = LogByHand()

    async def check(made: Rig) -> None:
        await keep(made, 5)
        log.trouble = "the disk is full"
        made.device.values[Table.HOLDING][17] = 0
        await keep(made, 5)
        assert made.cells(Table.HOLDING, 17) == [0]
        log.trouble = None
        await keep(made, 5)
        assert made.lift.held(HOLD_FRONT)

    on_rig(check, commands(), log=log)


def test_a_hold_that_falls_while_refreshes_are_lost_is_a_drop_without_an_alarm() -> None:
    log = LogByHand()

    async def check(made: Rig) -> None:
        await keep(made, 5)
        made.device.fail_next(silence(executes=False), times=3, on=lambda request: request.is_write)
        await keep(made, 2)
        made.device.values[Table.HOLDING][17] = 0
        assert not made.lift.held(HOLD_FRONT)
        await keep(made, 8)
        assert made.lift.held(HOLD_FRONT)
        assert [row for row, _ in log.rows] == ["hold_door.front", "hold_door.front again"]
        assert notices(made) == []

    on_rig(check, commands(), log=log)


SELF_CLEARING = (
    "action: hold, max_hold_s: 30, refresh_s: 1, self_clearing: true, on_link_loss: device_watchdog,"
    " confirm: {any_of: [effect], within_s: 5}"
)


def test_a_controller_that_consumes_its_command_is_no_fight_and_its_door_says_whether_it_is_held() -> None:
    log = LogByHand()

    async def check(made: Rig) -> None:
        taken: list[float] = []

        def consume() -> None:
            if made.cells(Table.HOLDING, 17) == [1]:
                made.device.values[Table.HOLDING][17] = 0
                taken.append(now())

        await keep(made, 10, consume)
        assert not made.lift.held(HOLD_FRONT), "the door is shut"
        made.device.values[Table.DISCRETE][1] = 1
        held: list[bool] = []

        def consume_and_look() -> None:
            consume()
            held.append(made.lift.held(HOLD_FRONT))

        await keep(made, 60, consume_and_look)
        assert all(held[5:])
        assert len(taken) == pytest.approx(70, abs=3)
        assert notices(made) == []
        assert [row for row, _ in log.rows] == ["hold_door.front"]
        made.device.fail_next(silence(executes=False), times=2, on=lambda request: request.is_write)
        await keep(made, 1.5, consume)
        assert not made.lift.held(HOLD_FRONT), "nobody knows whether it was written again"

    on_rig(check, commands(SELF_CLEARING), log=log)


def test_a_controller_that_clears_a_hold_when_its_map_says_is_no_fight_and_the_hold_goes_on() -> None:
    log = LogByHand()
    taking = REFRESHED.replace("refresh_s: 1", "refresh_s: 1, cleared_after_s: 5")

    async def check(made: Rig) -> None:
        on_since = [now()]
        await keep(made, 3)
        held: list[bool] = []

        def take() -> None:
            held.append(made.lift.held(HOLD_FRONT))
            if made.cells(Table.HOLDING, 17) == [0]:
                on_since[0] = now()
            elif now() - on_since[0] >= 5:
                made.device.values[Table.HOLDING][17] = 0
                on_since[0] = now()

        await keep(made, 120, take)
        assert all(held)
        assert notices(made) == []
        assert [row for row, _ in log.rows] == ["hold_door.front"]
        # sooner than that it was somebody else
        await keep(made, 2)
        made.device.values[Table.HOLDING][17] = 0
        await keep(made, 2)
        assert len(notices(made)) == 1

    on_rig(check, commands(taking), log=log)
