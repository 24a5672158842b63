"""Robot mode is not dropped while the car moves, whether or not the lift tells that it is on."""

import pytest

from register_maps.words import Motion
from tests.support.spine import Spine, on_spine
from tests.support.virtual_time import elapse


@pytest.mark.parametrize("name", ["generic-registers", "robotnik-il-eth"])
def test_a_robot_that_lets_go_under_way_leaves_robot_mode_on_until_the_car_stands(name: str) -> None:
    async def check(made: Spine) -> None:
        last = made.task.options.floors[-1]
        made.accept(last)
        await made.until(lambda _: made.face.picture.motion is not Motion.STOPPED)
        await elapse(1)
        made.accept(last, hold=False)
        made.accept(made.state.floor or last, hold=False)
        while made.face.picture.motion is not Motion.STOPPED:
            assert "robot_mode" in made.face.asked
            await elapse(0.1)
        await elapse(4)
        assert "robot_mode" not in made.face.asked

    on_spine(check, name)
