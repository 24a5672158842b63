"""Every shipped map drives a whole robot trip on the lift that is simulated from it: call, enter, ride, leave, release."""

import pytest

from drivers.model import Command, CommandKind, Proof
from lift_manager.domain.state import RobotDoor
from register_maps.codec import compile_map
from register_maps.load import load, shipped
from register_maps.words import Motion
from tests.support.trip import Trip, on_trip
from tests.support.trip_second import SecondPlant, naive_lift
from tests.support.trip_simulator import Mirror, SimulatedPlant, foreign_writes, requests, simulated_trip
from tests.support.trip_sites import COMPLETIONS, NO_TRIP, Incomplete, Site, lacking, site_of, stops
from tests.support.virtual_time import elapse

RIDEABLE = [name for name in shipped() if name not in NO_TRIP]
"""Every other map that is shipped, or comes later, is tried; one that lacks something fails until it is told what."""


@pytest.mark.parametrize("in_words", [True, False], ids=["in words", "by requests alone"])
@pytest.mark.parametrize("name", RIDEABLE)
def test_a_robot_is_invited_only_where_the_lift_stands_open_for_it_and_everything_is_let_go(
    name: str, in_words: bool
) -> None:
    plant, made = simulated_trip(name, in_words=in_words)
    site = made.site
    pickup, destination = stops(site)
    assert made.opened > 80
    assert foreign_writes(site, made.exchanges) == []
    mirror = Mirror(site)
    asked = [mirror.take(*one) for one in requests(made.exchanges)]
    assert asked[-1] == {}
    assert mirror.not_at_rest(made.exchanges[-1].at) == []
    pressed = [str(outcome.command) for outcome in made.outcomes]
    assert len(pressed) == len(set(pressed)), "repeats of a request press nothing"
    floors = list(site.floors)
    called = {command[call] for command in asked for call in ("go_to", "call") if call in command}
    assert floors.index(pickup) in called
    assert plant.face.picture.floor == floors.index(destination)


@pytest.mark.parametrize("name", sorted(COMPLETIONS))
def test_a_map_that_is_completed_is_none_that_could_do_without(name: str) -> None:
    loaded = load(name)
    assert [*loaded.unset, *loaded.map.needs, *lacking(compile_map(loaded.map))] != []


@pytest.mark.parametrize("name", sorted(NO_TRIP))
def test_a_map_that_makes_no_trip_has_no_door(name: str) -> None:
    assert [signal for signal in load(name).map.signals if signal.startswith("door.")] == []


@pytest.mark.parametrize("name", sorted(COMPLETIONS))
def test_a_map_that_lacks_something_and_is_not_told_what_fails(name: str) -> None:
    with pytest.raises(Incomplete, match=f"{name} has no "):
        site_of(name, {})


@pytest.mark.parametrize("second", [False, True], ids=["simulated", "second controller"])
def test_the_demo_without_doors_is_called_and_confirmed_and_never_invites_a_robot(second: bool) -> None:
    site = site_of("thingweb-elevator")
    plant = SecondPlant(site, naive_lift(site)) if second else SimulatedPlant(site)

    async def check(made: Trip) -> None:
        made.ask("L3", hold=False)
        await made.until(lambda state: state.motion is Motion.MOVING)
        assert made.state.floor is None, "the number it shows is where it is going"
        await made.until(lambda state: state.floor == "L3")
        assert made.state.standing
        await made.until(lambda state: state.holder is None)
        await elapse(10)
        made.check()

    made = on_trip(check, site, plant)
    command = Command(CommandKind.GO_TO, "L3")
    assert [(outcome.command, outcome.proof) for outcome in made.outcomes] == [(command, Proof.EFFECT)]
    assert made.opened == 0
    assert [request.values for _, _, request in requests(made.exchanges) if request.is_write] == [(site.floors["L3"],)]
    assert foreign_writes(site, made.exchanges) == []


def test_a_door_with_a_closed_contact_only_is_held_but_never_open_for_a_robot() -> None:
    site = Site("robotnik-il-eth", compile_map(load("robotnik-il-eth").map), {"0": 0, "1": 1, "2": 2})
    plant = SimulatedPlant(site)

    async def check(made: Trip) -> None:
        made.ask("2")
        await made.until(lambda state: state.floor == "2" and state.robot_door is RobotDoor.MOVING)
        await elapse(20)
        assert plant.face.picture.door_open_floor == 2
        made.ask("2", hold=False)
        await made.until(lambda state: state.robot_door is RobotDoor.CLOSED)
        made.check()

    assert on_trip(check, site, plant).opened == 0
