"""END comes while a press is on its way: what has not left does not leave."""

from dataclasses import replace

import pytest

from drivers.model import Command, CommandKind
from lift_manager.lift.session import Holder
from tests.drivers.rig import HOLD, HOLD_FRONT, SIGNALS, Rig, allowed, on_rig
from tests.lift_manager.runtime.rmf_words import ends, open_for_it, wants
from tests.lift_manager.runtime.scripted import PLAIN, Bench, on_bench
from tests.support.spine import asked_of, spine
from tests.support.virtual_time import elapse, run_virtual

RMF = Holder("rmf", "fleet/robot1")
ANSWERS_S = 0.15
"""So long a press waits for the answer to a poll."""
GRACE_S = 3.0
GO_TO = (
    "commands:\n"
    '  go_to: {at: "holding:1", as: floor, action: pulse, width_s: 0.5, confirm: {any_of: [effect], within_s: 30}}\n'
)
GO_TO_L2 = Command(CommandKind.GO_TO, "L2")


async def written_after_the_end(map_name: str, since_poll_s: float) -> list[str]:
    """Ask for the highest floor, and end the session a hundredth of a second later; returns what was switched on after that."""
    async with spine(map_name, poll_s=0.2) as made:
        made.device.delay_s = ANSWERS_S
        await elapse(2.0 + since_poll_s)
        begun = len(made.device.writes)
        made.site.request("lift", RMF, made.actor.config.floors[-1], hold_door=True, stays=True)
        await elapse(0.01)
        before = {str(request) for _, request in made.device.writes[begun:]}
        ended = len(made.device.writes)
        made.site.end_session("lift", RMF, GRACE_S)
        await elapse(GRACE_S - 0.1)
        after = [request for _, request in made.device.writes[ended:] if any(asked_of(request))]
        return [str(request) for request in after if str(request) not in before]


async def handed_out(made: Rig) -> None:
    """Want the door held, while the answer to a poll is on its way."""
    made.device.delay_s = ANSWERS_S
    while not made.links[""].in_flight:
        await elapse(0.01)
    made.lift.hold(HOLD_FRONT, allowed)
    await elapse(0.02)


@pytest.mark.parametrize(
    "map_name", ["moxa-e1212", "waveshare-relay", "adam-io", "thingweb-elevator", "generic-coils", "generic-registers"]
)
def test_an_end_overtakes_whatever_waits_behind_an_answer(map_name: str) -> None:
    async def main() -> None:
        for hundredths in range(0, 20, 3):
            assert await written_after_the_end(map_name, hundredths / 100) == [], hundredths

    run_virtual(main)


def test_a_press_whose_beginning_is_refused_when_its_bytes_would_leave_does_not_leave() -> None:
    async def check(made: Rig) -> None:
        over: list[str] = []
        made.device.delay_s = ANSWERS_S
        while not made.links[""].in_flight:
            await elapse(0.01)
        outcome = made.lift.press(GO_TO_L2, allowed, lambda: over[0] if over else None)
        await elapse(0.02)
        over.append("its session is over")
        await elapse(1.0)
        assert made.writes() == []
        assert outcome.result().reason == "its session is over"

    on_rig(check, SIGNALS + GO_TO)


def test_a_beginning_is_not_asked_about_once_the_press_was_answered() -> None:
    async def check(made: Rig) -> None:
        over: list[str] = []
        outcome = made.lift.press(GO_TO_L2, allowed, lambda: over[0] if over else None)
        await elapse(0.3)
        over.append("its session is over")
        await elapse(0.4)
        assert made.writes()[-1].endswith(":= 0, unit 1")
        assert not outcome.done()

    on_rig(check, SIGNALS + GO_TO)


def test_a_hold_that_may_not_begin_any_more_does_not_leave_and_one_that_is_on_stays() -> None:
    async def check(made: Rig) -> None:
        await handed_out(made)
        made.lift.hold(HOLD_FRONT, allowed, begin=False)
        await elapse(1.0)
        assert made.writes() == []
        assert not made.lift.given(HOLD_FRONT)
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(1.0)
        made.lift.hold(HOLD_FRONT, allowed, begin=False)
        await elapse(1.0)
        assert made.lift.held(HOLD_FRONT)

    on_rig(check, f'{SIGNALS}commands:\n  hold_door.front: {{at: "coil:8", {HOLD}}}\n')


def test_a_hold_that_is_wanted_again_before_its_bytes_would_leave_leaves() -> None:
    async def check(made: Rig) -> None:
        await handed_out(made)
        made.lift.hold(HOLD_FRONT, allowed, begin=False)
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(1.0)
        assert made.lift.held(HOLD_FRONT)

    on_rig(check, f'{SIGNALS}commands:\n  hold_door.front: {{at: "coil:8", {HOLD}}}\n')


def test_a_wish_that_was_taken_while_the_lift_could_not_be_read_is_pressed_when_it_is_repeated_and_not_before() -> None:
    async def check(made: Bench) -> None:
        await open_for_it(made)
        ends(made)
        made.driver.silent = True
        await elapse(2.0)
        wants(made, "L3")
        before = list(made.presses)
        await elapse(50.0)
        made.driver.silent = False
        await elapse(5.0)
        assert made.presses == before
        wants(made, "L3")
        await elapse(1.0)
        assert made.presses == [*before, "go_to L3"]

    on_bench(check, replace(PLAIN, granted_within_s=50.0, arrive_within_s=10.0))
