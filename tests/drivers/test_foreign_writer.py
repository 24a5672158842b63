"""Somebody else writes our outputs: it is told once, nobody fights, and what is not ours any more does not count as held."""

from collections.abc import Callable

import pytest

from drivers.modbus.memory import MemoryDevice
from drivers.model import Command, CommandKind
from register_maps.words import Side, Table
from tests.drivers.linked import now
from tests.drivers.rig import HOLD_FRONT, SIGNALS, Rig, allowed, on_rig
from tests.support.virtual_time import elapse

REFRESHED = (
    "action: hold, max_hold_s: 30, refresh_s: 1, on_link_loss: device_watchdog,"
    " confirm: {any_of: [readback], within_s: 2}"
)
UNREFRESHED = "action: hold, max_hold_s: 30, on_link_loss: latches, confirm: {any_of: [readback], within_s: 2}"
GO_TO = '  go_to: {at: "holding:16", as: floor, action: pulse, width_s: 0.5, rest: 0, confirm: {any_of: [effect], within_s: 2}}\n'


def commands(hold: str = REFRESHED, more: str = GO_TO) -> str:
    return f'{SIGNALS}commands:\n  hold_door.front: {{at: "holding:17", {hold}}}\n{more}'


def notices(made: Rig) -> list[str]:
    return [notice for reading in made.readings for notice in reading.notices]


async def keep(made: Rig, seconds: float, each: Callable[[], None] = lambda: None) -> None:
    """Want the door hold for so long, as a session does."""
    end = now() + seconds
    while now() < end:
        made.lift.hold(HOLD_FRONT, allowed)
        each()
        await elapse(0.1)


def looks(made: Rig, since: float) -> list[float]:
    """Times of the reads of our outputs."""
    return [
        heard.at_s
        for heard in made.device.heard
        if heard.at_s >= since and not heard.request.is_write and heard.request.table is Table.HOLDING
    ]


def test_a_foreign_press_is_told_once_where_and_what_and_is_not_undone() -> None:
    async def check(made: Rig) -> None:
        await elapse(5)
        made.device.values[Table.HOLDING][17] = 1
        writes = len(made.device.writes)
        await elapse(4)
        assert notices(made) == ["somebody else writes hold_door.front at holding:17: it reads 1, we wrote 0"]
        await elapse(60)
        assert len(notices(made)) == 1
        assert len(made.device.writes) == writes
        assert made.cells(Table.HOLDING, 17) == [1]
        made.device.values[Table.HOLDING][17] = 0
        await elapse(15)
        assert notices(made)[1:] == ["hold_door.front at holding:17 reads what we wrote again"]

    on_rig(check, commands())


def test_a_foreign_call_is_told_with_the_floor_code_it_reads() -> None:
    async def check(made: Rig) -> None:
        made.device.values[Table.HOLDING][16] = 2
        await elapse(5)
        assert notices(made) == ["somebody else writes go_to at holding:16: it reads 2, we wrote 0"]

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


def test_outputs_are_compared_with_one_read_every_two_seconds() -> None:
    async def check(made: Rig) -> None:
        since = now()
        await elapse(60)
        assert len(looks(made, since)) == pytest.approx(30, abs=2)
        read = [heard.request for heard in made.device.heard if heard.at_s >= since]
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
            "hold_door.front was let go by the controller or by somebody else at holding:17: it reads 0, we wrote 1"
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
        fight = [notice for notice in notices(made) if "is not pressed again for this hold" in notice]
        assert len(fight) == 1
        assert "hold_door.front at holding:17 was let go 4 times within 60 s" in fight[0]
        writes = len(made.device.writes)
        await keep(made, 60)
        assert len(made.device.writes) == writes
        assert not made.lift.held(HOLD_FRONT)
        # a new hold is a new command
        made.lift.let_go(HOLD_FRONT)
        await elapse(1)
        await keep(made, 5)
        assert made.lift.held(HOLD_FRONT)

    on_rig(check, commands(hold))


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
        assert made.cells(Table.HOLDING, 17) == [1]
        assert len(notices(made)) == 1

    on_rig(check, commands())


def test_two_doors_are_told_apart() -> None:
    async def check(made: Rig) -> None:
        made.device.values[Table.HOLDING][18] = 1
        await elapse(5)
        assert notices(made) == ["somebody else writes hold_door.rear at holding:18: it reads 1, we wrote 0"]
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
            while not any(heard.request.is_write and heard.at_s >= began for heard in device.heard):
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

        await keep(made, 60, release)
        assert any("is not pressed again for this hold" in notice for notice in notices(made))
        since = now()
        await keep(made, 10)
        images = [heard.request.values for heard in made.device.heard if heard.at_s > since and heard.request.is_write]
        assert set(images) == {(0, 0)}
        assert len(images) == pytest.approx(20, abs=1)

    cyclic = "action: hold, max_hold_s: 30, on_link_loss: latches, confirm: {any_of: [readback], within_s: 2}"
    block = 'write_blocks:\n  - {at: "holding:16", count: 2, function: 16, every_s: 0.5}\n'
    on_rig(check, commands(cyclic) + block)
