"""A process that begins keeps what was on for a session before it, and presses nothing because of that."""

import asyncio
from collections.abc import Callable, Mapping, Sequence

import pytest

from drivers.errors import ConnectProblem
from drivers.modbus.memory import MemoryDevice, ReceivedRequest, exception
from drivers.modbus.output import LOOK_S
from drivers.modbus.outputs import Outputs
from drivers.modbus.steps import Phase, Step, StepKind
from drivers.model import Command, CommandKind, Result
from register_maps.words import Side, Table
from tests.drivers.by_hand import LogByHand
from tests.drivers.caller import Caller
from tests.drivers.linked import now
from tests.drivers.rig import CLOSE_FRONT, HOLD_FRONT, SIGNALS, Rig, allowed, on_rig
from tests.support.rows import each_row
from tests.support.virtual_time import elapse
from tests.support.written_maps import HEAD, written_map

MODE = Command(CommandKind.ROBOT_MODE)
REAR = Command(CommandKind.HOLD_DOOR, side=Side.REAR)
GO1, GO2 = Command(CommandKind.GO_TO, "L1"), Command(CommandKind.GO_TO, "L2")
LEVEL = "action: hold, max_hold_s: 10, on_link_loss: device_watchdog, confirm: {any_of: [readback], within_s: 2}"
LATCH = LEVEL.replace("device_watchdog", "latches")
SINGLE = f'{SIGNALS}commands:\n  hold_door.front: {{at: "coil:8", refresh_s: 1, {LEVEL}}}\n'
NOT_REFRESHED = f'{SIGNALS}commands:\n  hold_door.front: {{at: "coil:8", {LATCH}}}\n'
SHARED = f'{SIGNALS}commands:\n  hold_door.front: {{at: "holding:9.2", shared_word: accepted, refresh_s: 1, {LEVEL}}}\n'
MASKED = SHARED.replace("accepted", "mask_write")
BLOCK = (
    f'{SIGNALS}commands:\n  hold_door.front: {{at: "coil:1", refresh_s: 1, {LEVEL}}}\n'
    f'  robot_mode: {{at: "coil:2", refresh_s: 1, {LEVEL}}}\n'
    '  heartbeat: {at: "coil:3", action: toggle, every_s: 0.5}\n'
    'write_blocks: [{at: "coil:1", count: 3, function: 15, every_s: 0.25}]\n'
)
EXCLUDING = (
    f'{SIGNALS}commands:\n  hold_door.front: {{at: "coil:8", {LATCH}, excludes: [close_door.front], gap_s: 0.5}}\n'
    f'  close_door.front: {{at: "coil:9", until: closed, {LATCH}}}\n'
)
CALL = f'{SIGNALS}commands: {{go_to: {{at: "holding:40", as: floor, rest: 0, until: arrived, {LATCH}}}}}\n'
ONE_OF = f'{SIGNALS}commands: {{go_to: {{one_of: ["coil:30", "coil:31", "coil:32"], until: arrived, {LATCH}}}}}\n'


def left_on(values: Mapping[Table, Mapping[int, int]], **how: float) -> MemoryDevice:
    """A controller whose outputs an earlier process has left like this."""
    device = MemoryDevice(delay_s=how.get("delay_s", 0.01), timed_coils=True)
    for table, cells in values.items():
        device.values[table].update(cells)
    device.values[Table.DISCRETE][1] = 1
    return device


def adopting(*commands: Command) -> Callable[[Caller], None]:
    def first(lift: Caller) -> None:
        for command in commands:
            lift.adopt(command, allowed)
            assert lift.given(command)

    return first


def values_of(heard: Sequence[ReceivedRequest], table: Table, address: int) -> list[int]:
    """What was written to one address."""
    found = []
    for each in heard:
        request = each.request
        if request.is_write and request.table is table and request.address <= address < request.address + request.count:
            values = request.values if request.function != 22 else (request.values[1] & ~request.values[0],)
            found.append(values[address - request.address])
    return found


@each_row(
    ("text", "table", "address", "on"),
    [
        (SINGLE, Table.COIL, 8, 1),
        (NOT_REFRESHED, Table.COIL, 8, 1),
        (SHARED, Table.HOLDING, 9, 0xA004),
        (MASKED, Table.HOLDING, 9, 0xA004),
        (BLOCK, Table.COIL, 1, 1),
    ],
)
def test_a_hold_that_is_found_on_stays_on_is_refreshed_and_falls_by_its_limit(
    text: str, table: Table, address: int, on: int
) -> None:
    device = left_on({table: {address: on}})
    rest = on & 0xA000

    async def check(made: Rig) -> None:
        assert made.lift.held(HOLD_FRONT)
        begun = now() - 1.0
        for _ in range(50):
            made.lift.hold(HOLD_FRONT, allowed)
            await elapse(0.1)
        assert device.values[table][address] == on
        assert made.lift.held(HOLD_FRONT)
        if text is not NOT_REFRESHED:
            assert len(values_of(device.received, table, address)) >= 5
        await elapse(9.5)
        assert made.lift.given(HOLD_FRONT)
        await elapse(1.0)
        assert now() - begun < 17.0
        assert not made.lift.given(HOLD_FRONT)
        assert device.values[table][address] == rest

    on_rig(check, text, {"": device}, first=adopting(HOLD_FRONT))


def test_a_hold_that_nobody_renews_falls_max_hold_s_after_the_first_look() -> None:
    device = left_on({Table.COIL: {8: 1}})

    async def check(made: Rig) -> None:
        await elapse(8.9)
        assert made.lift.held(HOLD_FRONT)
        await elapse(0.4)
        assert device.values[Table.COIL][8] == 0

    on_rig(check, SINGLE, {"": device}, first=adopting(HOLD_FRONT))


@each_row("text", [SINGLE, NOT_REFRESHED, SHARED, MASKED, BLOCK])
def test_a_hold_that_is_found_off_is_at_rest_and_nothing_is_pressed(text: str) -> None:
    device = left_on({Table.HOLDING: {9: 0xA000}})

    async def check(made: Rig) -> None:
        assert not made.lift.given(HOLD_FRONT)
        await elapse(5.0)
        # the heartbeat is no press
        assert all(not any(request.values[:2]) for request in device.writes if request.table is Table.COIL)
        assert [request for request in device.writes if request.table is Table.HOLDING] == []
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(0.3)
        assert made.lift.held(HOLD_FRONT), "it is asserted like any other once it is asked for"

    on_rig(check, text, {"": device}, first=adopting(HOLD_FRONT))


@each_row(
    ("text", "found", "kept"),
    [
        (CALL, {Table.HOLDING: {40: 2}}, True),
        (CALL, {Table.HOLDING: {40: 1}}, False),
        (CALL, {Table.HOLDING: {40: 0}}, False),
        (ONE_OF, {Table.COIL: {32: 1}}, True),
        (ONE_OF, {Table.COIL: {31: 1}}, False),
        (ONE_OF, {Table.COIL: {31: 1, 32: 1}}, False),
        (ONE_OF, {}, False),
    ],
)
def test_a_call_that_is_a_level_is_kept_where_exactly_its_floor_is_on(
    text: str, found: Mapping[Table, Mapping[int, int]], *, kept: bool
) -> None:
    device = left_on(found)

    async def check(made: Rig) -> None:
        assert made.lift.given(GO2) is kept
        await elapse(2.0)
        assert made.lift.given(GO2) is kept
        outputs = {table: {at: value for at, value in cells.items() if value} for table, cells in device.values.items()}
        for table, address in ((Table.HOLDING, 40), (Table.COIL, 30), (Table.COIL, 31), (Table.COIL, 32)):
            assert outputs[table].get(address, 0) == (found.get(table, {}).get(address, 0) if kept else 0)
        if kept:
            assert device.writes == []
            made.lift.let_go(GO2)
            await elapse(0.5)
            assert made.cells(Table.HOLDING, 40) == made.cells(Table.COIL, 32) == [0]

    on_rig(check, text, {"": device}, first=adopting(GO2))


def test_what_is_not_adopted_is_cleared_and_what_is_adopted_beside_it_never_flickers() -> None:
    device = left_on({Table.COIL: {1: 1, 2: 1}}, delay_s=0.2)

    async def check(made: Rig) -> None:
        await elapse(3.0)
        assert made.cells(Table.COIL, 1, 2) == [1, 0]
        assert set(values_of(device.received, Table.COIL, 1)) == {1}
        assert values_of(device.received, Table.COIL, 2)[-1] == 0

    on_rig(check, BLOCK, {"": device}, first=adopting(HOLD_FRONT))


def test_no_cycle_and_no_heartbeat_writes_over_what_may_be_on_before_the_first_look() -> None:
    device = left_on({Table.COIL: {1: 1}})
    device.fail_next(exception(4), times=15, on=lambda request: not request.is_write)

    async def check(made: Rig) -> None:
        assert device.writes == []
        assert made.lift.given(HOLD_FRONT)
        await elapse(5.0)
        assert made.lift.held(HOLD_FRONT)
        assert set(values_of(device.received, Table.COIL, 1)) == {1}

    on_rig(check, BLOCK, {"": device}, first=adopting(HOLD_FRONT))


@each_row("turns", range(6))
def test_a_cycle_that_is_on_its_way_does_not_write_over_what_is_adopted_meanwhile(turns: int) -> None:
    device = left_on({Table.COIL: {1: 1}})

    def first(lift: Caller) -> None:
        def adopt_in(turns: int) -> None:
            if turns:
                asyncio.get_running_loop().call_soon(adopt_in, turns - 1)
            else:
                lift.adopt(HOLD_FRONT, allowed)

        adopt_in(turns)

    async def check(made: Rig) -> None:
        await elapse(5.0)
        assert made.lift.held(HOLD_FRONT)
        assert set(values_of(device.received, Table.COIL, 1)) == {1}

    no_heartbeat = "".join(line for line in BLOCK.splitlines(keepends=True) if "heartbeat" not in line)
    no_heartbeat = no_heartbeat.replace("count: 3", "count: 2")
    on_rig(check, no_heartbeat, {"": device}, first=first)


def test_a_lift_that_cannot_be_read_for_long_loses_what_was_to_be_adopted() -> None:
    device = left_on({Table.COIL: {8: 1}})
    device.connect_problem = ConnectProblem.REFUSED

    async def check(made: Rig) -> None:
        assert made.lift.given(HOLD_FRONT)
        await elapse(9.5)
        assert not made.lift.given(HOLD_FRONT)
        device.connect_problem = None
        await elapse(5.0)
        assert device.values[Table.COIL][8] == 0
        assert set(values_of(device.received, Table.COIL, 8)) == {0}

    on_rig(check, SINGLE, {"": device}, first=adopting(HOLD_FRONT))


def test_renewals_before_the_first_look_keep_the_adoption_alive() -> None:
    device = left_on({Table.COIL: {8: 1}})
    device.connect_problem = ConnectProblem.REFUSED
    log = LogByHand(trouble="the disk is full")

    async def check(made: Rig) -> None:
        for _ in range(200):
            made.lift.hold(HOLD_FRONT, allowed)
            await elapse(0.1)
        device.connect_problem = None
        for _ in range(50):
            made.lift.hold(HOLD_FRONT, allowed)
            await elapse(0.1)
        assert made.lift.held(HOLD_FRONT)
        assert set(values_of(device.received, Table.COIL, 8)) == {1}
        assert log.rows == [], "what is on needs no row"

    on_rig(check, SINGLE, {"": device}, first=adopting(HOLD_FRONT), log=log)


def test_what_the_map_requires_is_not_missing_before_anything_was_read() -> None:
    device = left_on({Table.COIL: {8: 1}})
    text = (
        'signals: {car_floor: {at: "input:1", as: floor, unknown: [0]}, door.front: {at: "discrete:1"}, '
        'robot_mode_on: {at: "discrete:2"}}\n'
        f'commands:\n  hold_door.front: {{at: "coil:8", refresh_s: 1, requires: [robot_mode_on], {LEVEL}}}\n'
        f'  robot_mode: {{at: "coil:9", refresh_s: 1, {LEVEL}}}\n'
    )
    device.values[Table.DISCRETE][2] = 1

    def first(lift: Caller) -> None:
        lift.adopt(HOLD_FRONT, allowed)
        lift.hold(HOLD_FRONT, allowed)
        assert lift.given(HOLD_FRONT)

    async def check(made: Rig) -> None:
        assert made.lift.held(HOLD_FRONT)
        assert set(values_of(device.received, Table.COIL, 8)) == {1}

    on_rig(check, text, {"": device}, first=first)


@pytest.mark.parametrize("at_rest", [True, False])
def test_letting_go_before_the_first_look_releases_without_one(*, at_rest: bool) -> None:
    device = left_on({Table.COIL: {8: int(not at_rest)}})
    device.fail_next(exception(4), times=10**6, on=lambda request: request.table is Table.INPUT)

    def first(lift: Caller) -> None:
        lift.adopt(HOLD_FRONT, allowed)
        lift.let_go(HOLD_FRONT)
        assert not lift.given(HOLD_FRONT)

    async def check(made: Rig) -> None:
        await elapse(2.0)
        assert made.readings == []
        assert set(values_of(device.received, Table.COIL, 8)) == {0}
        async with asyncio.timeout(0.1):
            await made.lift.release_all()

    on_rig(check, SINGLE, {"": device}, first=first)


def test_an_end_before_the_first_look_lets_go_of_what_was_to_be_adopted() -> None:
    device = left_on({Table.COIL: {8: 1}})
    device.connect_problem = ConnectProblem.REFUSED

    async def check(made: Rig) -> None:
        ending = asyncio.ensure_future(made.lift.release_all())
        await elapse(0.1)
        assert not ending.done()
        device.connect_problem = None
        await elapse(2.0)
        assert ending.done()
        assert device.values[Table.COIL][8] == 0

    on_rig(check, SINGLE, {"": device}, first=adopting(HOLD_FRONT))


def test_of_two_that_exclude_each_other_the_one_adopted_last_is_kept() -> None:
    device = left_on({Table.COIL: {8: 1, 9: 1}})

    def first(lift: Caller) -> None:
        lift.adopt(CLOSE_FRONT, allowed)
        lift.adopt(HOLD_FRONT, allowed)
        assert not lift.given(CLOSE_FRONT)
        assert lift.given(HOLD_FRONT)

    async def check(made: Rig) -> None:
        assert made.cells(Table.COIL, 8, 9) == [1, 0]
        assert 0 not in values_of(device.received, Table.COIL, 8)
        assert 1 not in values_of(device.received, Table.COIL, 9)

    on_rig(check, EXCLUDING, {"": device}, first=first)


def test_a_press_of_what_an_adoption_excludes_ends_it_and_waits_for_the_gap() -> None:
    device = left_on({Table.COIL: {8: 1}})

    async def check(made: Rig) -> None:
        _ = made.lift.press(CLOSE_FRONT, allowed)
        await elapse(2.0)
        assert made.cells(Table.COIL, 8, 9) == [0, 1]
        off = next(h.at_s for h in device.received if values_of([h], Table.COIL, 8) == [0])
        pressed = next(h.at_s for h in device.received if values_of([h], Table.COIL, 9) == [1])
        assert pressed - off >= 0.5

    on_rig(check, EXCLUDING, {"": device}, first=adopting(HOLD_FRONT))


def test_a_new_call_before_the_first_look_ends_the_adopted_one_though_it_cannot_be_given_yet() -> None:
    device = left_on({Table.HOLDING: {40: 1}})
    device.connect_problem = ConnectProblem.REFUSED

    async def check(made: Rig) -> None:
        press = made.lift.press(GO2, allowed)
        device.connect_problem = None
        await elapse(3.0)
        assert press.result().result is Result.REJECTED
        assert not made.lift.given(GO1)
        assert values_of(device.received, Table.HOLDING, 40) == [0]
        _ = made.lift.press(GO2, allowed)
        await elapse(0.5)
        assert values_of(device.received, Table.HOLDING, 40) == [0, 2]

    on_rig(check, CALL, {"": device}, first=adopting(GO1))


EFFECT = "confirm: {any_of: [effect], within_s: 5}"
LAMPS = '["coil:6", "coil:7", "coil:8"]'
NOTHING_TO_ADOPT = {
    "pulse": (f'close_door.front: {{at: "coil:8", action: pulse, width_s: 0.5, {EFFECT}}}', CLOSE_FRONT, 0),
    "a pulse that the device ends": (
        f'close_door.front: {{at: "coil:8", action: pulse, width_s: 0.5, timed_by: device, {EFFECT}}}',
        CLOSE_FRONT,
        1,
    ),
    "a hold made of pulses": (
        f'hold_door.front: {{at: "coil:8", {LATCH.split(", confirm")[0]}, repeat_pulse_s: 2, width_s: 0.5, {EFFECT}}}',
        HOLD_FRONT,
        0,
    ),
    "lamps": (
        f"go_to: {{one_of: {LAMPS}, until: arrived, {LATCH.replace('readback', 'calls_registered')}}}",
        GO2,
        1,
    ),
}


@each_row("what", NOTHING_TO_ADOPT)
def test_what_cannot_be_seen_to_be_on_is_not_adopted(what: str) -> None:
    text, command, stays = NOTHING_TO_ADOPT[what]
    signals = SIGNALS.replace("}}", f"}}, calls_registered: {{each_of: {LAMPS}}}}}") if what == "lamps" else SIGNALS
    device = left_on({Table.COIL: {8: 1}})

    def first(lift: Caller) -> None:
        lift.adopt(command, allowed)
        assert not lift.given(command)

    async def check(made: Rig) -> None:
        await elapse(5.0)
        assert not made.lift.given(command)
        assert device.values[Table.COIL][8] == stays
        assert 1 not in values_of(device.received, Table.COIL, 8)

    on_rig(check, f"{signals}commands: {{{text}}}\n", {"": device}, first=first)


def test_a_floor_or_a_command_that_is_gone_from_the_site_is_not_adopted() -> None:
    device = left_on({Table.HOLDING: {40: 2}})

    def first(lift: Caller) -> None:
        for command in (Command(CommandKind.GO_TO, "L9"), REAR, MODE):
            lift.adopt(command, allowed)
            assert not lift.given(command)

    async def check(made: Rig) -> None:
        await elapse(1.0)
        assert made.cells(Table.HOLDING, 40) == [0]

    on_rig(check, CALL, {"": device}, first=first)


def test_after_the_first_reading_nothing_is_adopted_any_more() -> None:
    async def check(made: Rig) -> None:
        made.lift.adopt(HOLD_FRONT, allowed)
        assert made.lift.at_rest(HOLD_FRONT)
        await elapse(3.0)
        assert made.writes() == []

    on_rig(check, SINGLE)


def test_an_output_on_a_second_device_is_adopted_by_the_first_look_at_all_devices() -> None:
    devices = {"": left_on({}), "door": left_on({Table.COIL: {4: 1}})}
    devices["door"].connect_problem = ConnectProblem.REFUSED
    head = HEAD + "endpoints: {door: {unit_id: 1, served: {coil: [[0, 9]]}}}\n"
    text = f'{SIGNALS}commands:\n  hold_door.front: {{at: "door/coil:4", refresh_s: 1, {LEVEL}}}\n'

    async def check(made: Rig) -> None:
        assert made.lift.given(HOLD_FRONT)
        devices["door"].connect_problem = None
        await elapse(3.0)
        assert made.lift.held(HOLD_FRONT)
        assert set(values_of(devices["door"].received, Table.COIL, 4)) == {1}

    on_rig(check, text, devices, head, first=adopting(HOLD_FRONT))


def test_an_adopted_hold_that_the_controller_drops_later_is_written_again_as_any_hold_is() -> None:
    device = left_on({Table.COIL: {8: 1}})

    async def check(made: Rig) -> None:
        device.values[Table.COIL][8] = 0
        for _ in range(50):
            made.lift.hold(HOLD_FRONT, allowed)
            await elapse(0.1)
        assert made.lift.held(HOLD_FRONT)

    on_rig(check, NOT_REFRESHED, {"": device}, first=adopting(HOLD_FRONT))


def dropped(made: Rig) -> None:
    """The controller has let go by itself."""
    for table, cells in made.device.values.items():
        cells.update({Table.COIL: {1: 0, 8: 0}, Table.HOLDING: {9: 0xA000}}.get(table, {}))


def switched_off_and_on(made: Rig) -> None:
    dropped(made)
    made.device.disconnect()


@each_row(
    ("text", "table", "address", "on", "drops"),
    [
        (NOT_REFRESHED, Table.COIL, 8, 1, dropped),
        (NOT_REFRESHED, Table.COIL, 8, 1, switched_off_and_on),
        (SINGLE, Table.COIL, 8, 1, switched_off_and_on),
        (SHARED, Table.HOLDING, 9, 0xA004, switched_off_and_on),
        (BLOCK, Table.COIL, 1, 1, switched_off_and_on),
    ],
)
def test_an_adopted_hold_that_the_controller_drops_stays_off_until_it_may_be_begun(
    text: str, table: Table, address: int, on: int, drops: Callable[[Rig], None]
) -> None:
    device = left_on({table: {address: on}})

    async def check(made: Rig) -> None:
        made.lift.hold(HOLD_FRONT, allowed, begin=False)
        assert made.lift.held(HOLD_FRONT)
        drops(made)
        before = len(device.writes)
        for _ in range(50):
            made.lift.hold(HOLD_FRONT, allowed, begin=False)
            await elapse(0.1)
        assert not made.lift.given(HOLD_FRONT)
        assert on not in values_of([h for h in device.received if h.request in device.writes[before:]], table, address)
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(0.5)
        assert made.lift.held(HOLD_FRONT)

    on_rig(check, text, {"": device}, first=adopting(HOLD_FRONT))


def test_an_adopted_hold_is_looked_at_before_it_is_written_again_after_a_refresh_that_failed() -> None:
    device = left_on({Table.COIL: {8: 1}})

    async def check(made: Rig) -> None:
        device.fail_next(exception(4), times=10**6, on=lambda request: request.is_write)
        await elapse(1.5)
        device.clear_faults()
        await elapse(1.5)
        assert made.lift.held(HOLD_FRONT), "it was still on"
        device.fail_next(exception(4), times=10**6, on=lambda request: request.is_write)
        await elapse(1.5)
        dropped(made)
        device.clear_faults()
        for _ in range(30):
            made.lift.hold(HOLD_FRONT, allowed, begin=False)
            await elapse(0.1)
        assert made.cells(Table.COIL, 8) == [0]

    on_rig(check, SINGLE, {"": device}, first=adopting(HOLD_FRONT))


def test_a_hold_that_may_not_be_begun_stays_at_rest_and_one_that_was_begun_goes_on() -> None:
    async def check(made: Rig) -> None:
        made.lift.hold(HOLD_FRONT, allowed, begin=False)
        await elapse(1.0)
        assert not made.lift.given(HOLD_FRONT)
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(0.5)
        dropped(made)
        for _ in range(50):
            made.lift.hold(HOLD_FRONT, allowed, begin=False)
            await elapse(0.1)
        assert made.lift.held(HOLD_FRONT), "somebody has asked for it"

    on_rig(check, NOT_REFRESHED)


def outputs(text: str) -> Outputs:
    codec = written_map(text)
    return Outputs(codec.commands, codec.written)


def test_an_adoption_whose_time_is_over_counts_no_more_though_nobody_has_looked_at_the_clock() -> None:
    for looked_at, kept in ((9.9, True), (10.0, False)):
        made = outputs(SINGLE)
        made.adopt("hold_door.front", 1, 0.0)
        made.record_reconnect({("", Table.COIL, 8): 1}, looked_at)
        assert (made.phase("hold_door.front") is Phase.ON) is kept


def test_an_adopted_hold_that_is_not_refreshed_is_looked_at_from_then_on() -> None:
    made = outputs(NOT_REFRESHED)
    made.adopt("hold_door.front", 1, 0.0)
    made.record_reconnect({("", Table.COIL, 8): 1}, 3.0)
    assert made.next_step(3.0) is None
    assert made.wake_at() == 3.0 + LOOK_S
    assert made.next_step(3.0 + LOOK_S) == Step(StepKind.LOOK, "hold_door.front", 1)


def test_a_call_that_was_given_anew_and_failed_leaves_nothing_to_adopt() -> None:
    made = outputs(CALL)
    made.adopt("go_to", 1, 0.0)
    made.press("go_to", 1, 0.1)
    step = made.next_step(0.1)
    assert step is not None
    made.record_failure(step, maybe_sent=False, now=0.2)
    made.record_reconnect({("", Table.HOLDING, 40): 1}, 0.5)
    assert made.next_step(0.5) == Step(StepKind.RELEASE, "go_to", None)
