"""A manager and links as the metrics see them, and ways to read what they export."""

import asyncio
from collections.abc import Awaitable, Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

from prometheus_client.openmetrics.parser import text_string_to_metric_families as parse_open_metrics
from prometheus_client.parser import text_string_to_metric_families as parse_plain

from lift_manager.core.figures import Durations, LinkFigures
from lift_manager.domain.events import Event, Occurrence
from lift_manager.domain.state import LiftState, Quality, RobotDoor
from lift_manager.metrics.metrics import Metrics
from register_maps.words import Mode, Motion
from tests.support.virtual_time import run_virtual

OPEN = "application/openmetrics-text;version=1.0.0;q=0.6,text/plain;version=0.0.4;q=0.3,*/*;q=0.1"
Labels = tuple[tuple[str, str], ...]
IDLE = LiftState(
    lift="lift",
    floors=("L1", "L2"),
    quality=Quality.LIVE,
    reason="",
    age_s=0.1,
    floor="L1",
    standing=True,
    destination="L1",
    robot_door=RobotDoor.CLOSED,
    doors={},
    motion=Motion.STOPPED,
    mode=Mode.NORMAL,
    holder=None,
    held_since_s=None,
    not_visible={},
)
BOUNDS_S = (0.01, 0.1)
COUNTS = (
    "requests",
    "timeouts",
    "late_answers",
    "desyncs",
    "recycles",
    "connects",
    "failed_connects",
    "losses",
    "exceptions",
)
LINK = LinkFigures(
    link="tower",
    up=True,
    in_doubt=False,
    since_s=3.5,
    answer_age_s=0.25,
    in_flight=True,
    reads_waiting=2,
    commands_waiting=1,
    silent_units=0,
    counts={name: number for number, name in enumerate(COUNTS, start=1)},
    round_trips=Durations(BOUNDS_S, (3, 2, 1), 0.75),
    read_waits=Durations(BOUNDS_S, (1, 0, 0), 0.0),
    command_waits=Durations(BOUNDS_S, (0, 0, 0), 0.0),
)


@dataclass
class FakeManager:
    """Says what it was told to say; `publish` tells whoever listens."""

    states: Mapping[str, LiftState] = field(default_factory=lambda: {"lift": IDLE})
    unwritten: frozenset[str] = frozenset()
    refused: Mapping[tuple[str, str], int] = field(default_factory=dict)
    listeners: list[Callable[[Occurrence], None]] = field(default_factory=list)
    links: tuple[LinkFigures, ...] = (LINK,)

    def polls(self) -> Mapping[str, int]:
        return dict.fromkeys(self.states, 7)

    def lift_names(self) -> tuple[str, ...]:
        return tuple(self.states)

    def state(self, lift: str) -> LiftState | None:
        return self.states.get(lift)

    def link_figures(self) -> tuple[LinkFigures, ...]:
        return self.links

    @contextmanager
    def overhear(self, hear: Callable[[Occurrence], None]) -> Iterator[None]:
        self.listeners.append(hear)
        try:
            yield
        finally:
            self.listeners.remove(hear)

    def publish(self, *events: Event) -> None:
        for event in events:
            for hear in self.listeners:
                hear(Occurrence("boot-1", asyncio.get_running_loop().time(), event))


@dataclass
class Rig:
    """Metrics that run, of a manager that says what a test wants."""

    manager: FakeManager
    metrics: Metrics

    async def read(self, accept: str = "") -> dict[str, dict[Labels, float]]:
        """Scrape once: samples by name and labels, as the library's own parser reads them."""
        return samples(*await self.metrics.scrape(accept))

    async def value(self, sample: str, **labels: str) -> float:
        return (await self.read())[sample][tuple(sorted(labels.items()))]


def samples(body: bytes, content_type: str) -> dict[str, dict[Labels, float]]:
    parse = parse_open_metrics if content_type.startswith("application/openmetrics-text") else parse_plain
    found: dict[str, dict[Labels, float]] = {}
    for family in parse(body.decode()):
        for sample in family.samples:
            of_name = found.setdefault(sample.name, {})
            labels = tuple(sorted(sample.labels.items()))
            assert labels not in of_name, f"{sample.name} {labels} is there twice"
            of_name[labels] = sample.value
    return found


def measured(check: Callable[[Rig], Awaitable[None]], manager: FakeManager | None = None) -> None:
    """Run a check on virtual time, with the metrics running."""
    made = manager or FakeManager()

    async def main() -> None:
        commands = dict.fromkeys(made.states, ("go_to", "hold_door.front"))
        rig = Rig(made, Metrics(made, made, commands, version="1.2.3"))
        running = asyncio.ensure_future(rig.metrics.run())
        await asyncio.sleep(0)
        try:
            await check(rig)
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)

    run_virtual(main)


def lifts(count: int) -> dict[str, LiftState]:
    return {f"lift{number}": replace(IDLE, lift=f"lift{number}") for number in range(count)}
