"""Lifts made for robots, at their registers: the handshakes of the field notes, and controllers that want to be asked nicely."""

import asyncio
import io

import pytest
from rich.console import Console

from lift_manager.lab.simulate import run_simulation
from register_maps.load import load
from register_maps.words import Table
from simulator.controller import Parameters
from tests.simulator.faces import Faced, faced, is_closed, is_open, stands_open_at
from tests.support.rows import each_row
from tests.support.written_maps import written_map

COIL, DISCRETE, HOLDING, INPUT = Table.COIL, Table.DISCRETE, Table.HOLDING, Table.INPUT

DOOR_BUTTON = """\
signals:
  car_floor: {at: "input:1", as: floor}
  door.front: {at: "discrete:0"}
commands:
  hold_door.front:
    at: "coil:0"
    action: hold
    max_hold_s: 30
    on_link_loss: latches
    MORE
    confirm: {any_of: [effect], within_s: 5}
"""
REPEATED = DOOR_BUTTON.replace("MORE", "width_s: 0.5\n    repeat_pulse_s: 2")
RESET_FIRST = DOOR_BUTTON.replace("MORE", "reset_first_s: 0.5")
TAKEN = DOOR_BUTTON.replace("MORE", "refresh_s: 1\n    self_clearing: true")
TAKEN_LATER = DOOR_BUTTON.replace("MORE", "refresh_s: 1\n    cleared_after_s: 5")
STATIONARY = 30.0
"""Seconds after which a lift of three floors has long come to rest."""


# -- Siemens Chengdu, elevator-interfaces 1.1: call 4x1, go 4x2, in place 0x1, left 0x2; 1x1 may enter, 1x2 may leave, 1x3 door


def chengdu(start: int = 0) -> Faced:
    return faced("seer-siemens-chengdu", (1, 2, 3), start=start)


def says(lift: Faced) -> tuple[int, ...]:
    """May enter, may leave, door, floor."""
    return (*lift.read(DISCRETE, 1, 3), *lift.read(INPUT, 1))


def test_chengdu_takes_a_robot_from_one_floor_to_another() -> None:
    lift = chengdu()
    assert says(lift) == (0, 0, 0, 1)
    lift.write(HOLDING, 1, 3)
    lift.after(STATIONARY)
    assert says(lift) == (1, 0, 1, 3)
    lift.write(COIL, 1, 1)
    lift.after(0.1)
    assert says(lift) == (0, 0, 1, 3)
    lift.write(HOLDING, 1, 0)
    lift.write(HOLDING, 2, 1)
    lift.write(COIL, 1, 0, after_s=5)
    lift.after(STATIONARY)
    assert says(lift) == (0, 1, 1, 1)
    lift.write(COIL, 2, 1)
    lift.write(HOLDING, 2, 0, after_s=1)
    lift.write(COIL, 2, 0, after_s=4)
    lift.after(STATIONARY)
    assert says(lift) == (0, 0, 0, 1)


def test_chengdu_ignores_a_go_while_empty_and_a_call_while_occupied() -> None:
    lift = chengdu()
    lift.write(HOLDING, 2, 3)
    lift.after(STATIONARY)
    assert says(lift) == (0, 0, 0, 1)
    lift.write(HOLDING, 2, 0)
    lift.write(HOLDING, 1, 2)
    lift.after(STATIONARY)
    lift.write(COIL, 1, 1)
    lift.write(HOLDING, 1, 0, after_s=1)
    lift.write(HOLDING, 1, 3, after_s=1)
    lift.after(STATIONARY)
    assert says(lift) == (0, 0, 0, 2)


def test_chengdu_calls_that_are_written_over_and_over_open_the_door_once() -> None:
    lift = chengdu()
    for _ in range(20):
        lift.write(HOLDING, 1, 2, after_s=2)
    assert says(lift) == (1, 0, 1, 2)
    lift.write(COIL, 1, 1)
    lift.write(COIL, 1, 0, after_s=5)
    lift.write(COIL, 2, 1)
    lift.write(COIL, 2, 0, after_s=5)
    for _ in range(20):
        lift.write(HOLDING, 1, 2, after_s=2)
    assert says(lift) == (0, 0, 0, 2)


# -- LPS3, elevator-interfaces 1.3: coils 17 and 19 call, 18 in place; inputs 1 and 3 are the open doors


def test_lps3_is_sent_on_by_the_robot_in_place_and_freed_by_letting_that_go() -> None:
    lift = faced("seer-lps3-two-stop", (0, 1))
    lift.write(COIL, 19, 1)
    lift.after(STATIONARY)
    assert lift.read(DISCRETE, 1, 3) == [0, 0, 1]
    lift.write(COIL, 17, 0, 1, 0)
    lift.after(STATIONARY)
    assert lift.read(DISCRETE, 1, 3) == [1, 0, 0]
    lift.after(3600)
    assert lift.read(DISCRETE, 1, 3) == [1, 0, 0]
    lift.write(COIL, 18, 0)
    lift.after(STATIONARY)
    assert lift.read(DISCRETE, 1, 3) == [0, 0, 0]
    lift.write(COIL, 17, 1)
    assert lift.until(stands_open_at(0)).may_enter


# -- controllers that want to be asked nicely


def test_a_controller_that_drops_a_stuck_button_is_held_open_by_pressing_again() -> None:
    lift = faced(written_map(REPEATED), (0, 1), like=Parameters(drops_stuck_button_s=10.0))
    for _ in range(60):
        lift.write(COIL, 0, 1, after_s=1.5)
        lift.write(COIL, 0, 0, after_s=0.5)
    assert is_open(lift.face.picture)
    lift.write(COIL, 0, 1)
    lift.after(9)
    assert is_open(lift.face.picture)
    lift.after(1 + 3 + 3)
    assert is_closed(lift.face.picture)
    assert lift.read(COIL, 0) == [1], "it reads as pressed, and nobody believes it"


@pytest.mark.parametrize(("rest_s", "opens"), [(0.2, False), (0.5, True)])
def test_a_controller_that_needs_an_edge_wants_rest_before_a_press(rest_s: float, *, opens: bool) -> None:
    lift = faced(written_map(RESET_FIRST), (0, 1), like=Parameters(needs_edge_s=0.5))
    lift.write(COIL, 0, 1)
    lift.until(is_open)
    lift.write(COIL, 0, 0)
    lift.until(is_closed)
    lift.write(COIL, 0, 1)
    lift.until(is_open)
    lift.write(COIL, 0, 0)
    lift.write(COIL, 0, 1, after_s=rest_s)
    assert is_open(lift.after(STATIONARY)) is opens


# -- what `simulate` prints


@each_row(
    ("name", "printed"),
    [
        ("adam-pushbutton", "they do not show where the car is or whether its door is open"),
        ("wago-750", "read back at coil 512, coil 513"),
        ("robotnik-il-eth", "holding 384.0, holding 384.1, holding 384.2"),
        ("seer-siemens-chengdu", "unit 0"),
    ],
)
def test_simulate_describes_what_it_serves(name: str, printed: str) -> None:
    async def main() -> str:
        out = io.StringIO()
        shown = asyncio.Event()
        console = Told(out, shown)
        source = load(name).map
        work = run_simulation(source, host="127.0.0.1", port=0, floors=None, speed=1.0, console=console)
        running = asyncio.create_task(work)
        async with asyncio.timeout(60):
            await shown.wait()
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        return out.getvalue()

    assert printed in asyncio.run(main())


class Told(Console):
    """A wide console that says when the last line is out."""

    def __init__(self, out: io.StringIO, shown: asyncio.Event) -> None:
        super().__init__(file=out, width=400)
        self._shown_last = shown

    def print(self, *objects: object, **settings: object) -> None:
        super().print(*objects, **settings)  # type: ignore[arg-type]  # as they came
        if objects and "Ctrl-C" in str(objects[0]):
            self._shown_last.set()


def test_a_hold_whose_point_the_program_clears_goes_on_for_as_long_as_it_is_written_again() -> None:
    lift = faced(written_map(TAKEN), (1, 2, 3))
    for _ in range(20):
        lift.write(COIL, 0, 1)
        assert lift.read(COIL, 0) == [0]
        lift.after(1.0)
    assert lift.read(DISCRETE, 0) == [1]
    lift.after(STATIONARY)
    assert lift.read(DISCRETE, 0) == [0]


def test_a_hold_that_the_program_clears_now_and_then_goes_on_if_it_is_written_again_in_time() -> None:
    lift = faced(written_map(TAKEN_LATER), (1, 2, 3))
    lift.write(COIL, 0, 1)
    cleared = 0
    for _ in range(295):
        lift.after(0.1)
        if lift.read(COIL, 0) == [0]:
            cleared += 1
            lift.write(COIL, 0, 1)
    assert cleared == 5
    assert lift.read(DISCRETE, 0) == [1]
    lift.write(COIL, 0, 0)
    lift.after(STATIONARY)
    assert lift.read(DISCRETE, 0) == [0]
