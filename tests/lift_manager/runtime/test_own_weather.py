"""One lift's weather is its own: three others are polled and commanded as if the bad one were not there."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise

import pytest

from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link
from drivers.modbus.memory import MemoryDevice, hang_up
from lift_manager.lift.refusals import Accepted
from lift_manager.lift.session import Holder
from lift_manager.lift.state import Quality
from lift_manager.runtime.actor import LiftActor
from lift_manager.runtime.bus import Bus, Event
from lift_manager.runtime.poll import LiftPoll
from lift_manager.runtime.recorder import MemoryRecorder
from lift_manager.runtime.site import Site
from lift_manager.runtime.ticker import BEAT_S, Ticker
from register_maps.words import Table
from tests.support.lift_configs import front_door_config
from tests.support.refusals import reply
from tests.support.shipped_maps import compiled
from tests.support.virtual_time import cancel_all, elapse, run_virtual

CODEC = compiled("generic-registers")
FLOORS = {"L1": 1, "L2": 2, "L3": 3}
GOOD, BAD = ("north", "east", "south"), "west"
ROBOT = Holder("workshop", "workshop")
POLL_S = 0.2
GO_TO, BEATS = 16, 0
TURNS, TURN_S = 5, 3.0
RUN_S = TURNS * TURN_S


def lift_device(delay_s: float = 0.003) -> MemoryDevice:
    """A lift that stands open at L1 in robot mode, its counter at two beats a second."""
    device = MemoryDevice(delay_s=delay_s)
    device.values[Table.HOLDING].update({1: 1, 2: 1, 3: 3, 4: 2, 5: 0b111})
    return device


def slow(device: MemoryDevice) -> None:
    device.delay_s = 0.9


def mute(device: MemoryDevice) -> None:
    device.fall_silent(RUN_S * 2)


def resets(device: MemoryDevice) -> None:
    device.fail_next(hang_up(executes=False), times=10_000)


@dataclass
class Seen:
    """What the three good lifts have shown, by name, and how the bad one was published."""

    polls: dict[str, list[float]] = field(default_factory=dict)
    presses: dict[str, list[float]] = field(default_factory=dict)
    bad: set[Quality] = field(default_factory=set)


@dataclass
class Building:
    """Lifts by name, each on a controller of its own, in one site."""

    devices: dict[str, MemoryDevice]
    links: dict[str, Link]
    site: Site
    lifts: list[LiftActor]

    async def count(self) -> None:
        """Let every alive counter beat twice a second."""
        while True:
            for device in self.devices.values():
                device.values[Table.HOLDING][BEATS] = device.values[Table.HOLDING].get(BEATS, 0) + 1
            await elapse(0.5)

    def start(self) -> list[asyncio.Task[None]]:
        links = [link.run() for link in self.links.values()]
        ticker = Ticker()
        polls = [
            LiftPoll(lift, ticker, first_poll_s=POLL_S * number / 4).run() for number, lift in enumerate(self.lifts)
        ]
        works = (*links, *polls, *(lift.driver.run() for lift in self.lifts), self.count())
        return [asyncio.create_task(work) for work in works]

    def seen(self, name: str, since: float) -> tuple[list[float], list[float]]:
        """When a lift was polled and when a call was pressed."""
        heard = [each for each in self.devices[name].received if each.at_s >= since]
        polls = [each.at_s for each in heard if not each.request.is_write and each.request.address == BEATS]
        press = [each.at_s for each in heard if each.request.address == GO_TO and any(each.request.values)]
        return polls, press


def building(names: tuple[str, ...]) -> Building:
    devices = {name: lift_device() for name in names}
    links = {name: Link(device.wire, name=name) for name, device in devices.items()}
    bus: Bus[Event] = Bus()
    recorder = MemoryRecorder()
    lifts = []
    for name, link in links.items():
        driver = ModbusLift(CODEC, link, LiftSettings(name=name, floors=FLOORS, control=True))
        lifts.append(LiftActor(driver, front_door_config(driver, FLOORS, poll_s=POLL_S, name=name), bus, recorder))
    return Building(devices, links, Site(lifts, bus, recorder), lifts)


async def weather(spoil: Callable[[MemoryDevice], None] | None) -> Seen:
    """Run three good lifts, and a fourth that is spoilt; ask each of them for a floor, again and again."""
    made = building((*GOOD, *(() if spoil is None else (BAD,))))
    seen = Seen()
    running = made.start()
    await elapse(3.0)
    if spoil is not None:
        spoil(made.devices[BAD])
    began = asyncio.get_running_loop().time()
    for turn in range(TURNS):
        for name in made.devices:
            answer = reply(made.site.request, name, ROBOT, ("L2", "L3")[turn % 2], hold_door=True)
            assert name == BAD or answer == Accepted()
        for _ in range(round(TURN_S / 0.1)):
            await elapse(0.1)
            qualities = {name: made.site.state(name).quality for name in made.devices}
            assert {qualities[name] for name in GOOD} == {Quality.LIVE}
            seen.bad |= {qualities[name] for name in qualities if name == BAD}
    for name in GOOD:
        seen.polls[name], seen.presses[name] = made.seen(name, began)
    await cancel_all(running)
    return seen


@cache
def in_good_weather() -> Seen:
    """What the three show without a fourth, for all to compare with."""
    return run_virtual(lambda: weather(None))


@pytest.mark.parametrize(
    ("spoil", "quality"),
    [(slow, None), (mute, Quality.OFFLINE), (resets, Quality.OFFLINE)],
    ids=["900 ms", "mute", "resets"],
)
def test_a_bad_controller_changes_neither_the_poll_rate_nor_the_command_latency_of_the_others(
    spoil: Callable[[MemoryDevice], None], quality: Quality | None
) -> None:
    alone = in_good_weather()
    beside = run_virtual(lambda: weather(spoil))
    assert quality is None or quality in beside.bad, "the bad one is bad"
    for name in GOOD:
        assert len(alone.polls[name]) == pytest.approx(RUN_S / POLL_S, abs=2)
        assert beside.polls[name] == pytest.approx(alone.polls[name], abs=BEAT_S)
        assert max(after - before for before, after in pairwise(beside.polls[name])) <= POLL_S + 2 * BEAT_S
        assert len(alone.presses[name]) >= TURNS
        assert beside.presses[name] == pytest.approx(alone.presses[name], abs=BEAT_S)
