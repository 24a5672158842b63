"""What happened before a finding: the last words about each lift, kept until something must never happen and did."""

from collections import defaultdict, deque
from collections.abc import Iterator, Mapping, Sequence

from lift_manager.lab.world.lift_under_test import Finding
from lift_manager.lab.world.truth import Truth
from lift_manager.lab.world.witness import FaultChange, FloorRequest
from lift_manager.lift.state import LiftState
from lift_manager.runtime.bus import Event
from lift_manager.runtime.errors import RequestRefused
from simulator.wire_faults import Exchange

WORDS = 60
"""That are kept of each lift. Chosen: a ride with its troubles."""
LONGEST = 240
MOST_STORIES = 20


class Story:
    """A witness that remembers the newest words of every lift, and keeps them once there is a finding about it."""

    def __init__(self, findings: Sequence[Finding], controllers: Mapping[str, Sequence[str]]) -> None:
        """`controllers` are those of each lift, whose faults are its own."""
        self._findings = findings
        self._controllers = controllers
        self._places = {*controllers, *(one for several in controllers.values() for one in several)}
        self._words: dict[str, deque[str]] = defaultdict(lambda: deque(maxlen=WORDS))
        self._last: dict[tuple[str, str], object] = {}
        self._told = 0
        self._stories: dict[int, tuple[str, ...]] = {}
        """By the number of the finding."""

    def of(self, number: int) -> Iterator[str]:
        """Yield what happened before a finding, oldest first; nothing for late ones of many."""
        yield from self._stories.get(number, ())

    def on_truth(self, at: float, lift: str, truth: Truth) -> None:
        """Note what the car does."""
        self._change(
            at, lift, "is", (truth.at, truth.passed, truth.heading, truth.open_at, truth.doors_shut, truth.mode)
        )
        self._change(at, lift, "has", (sorted(truth.calls), truth.robot_mode, truth.given))

    def on_press(self, at: float, lift: str, commands: frozenset[str]) -> None:
        """Note what was newly asked for over the wire."""
        self._note(at, lift, f"pressed {', '.join(sorted(commands))}")

    def on_state(self, at: float, lift: str, state: LiftState) -> None:
        """Note what is said of it."""
        said = (str(state.quality), state.floor, str(state.robot_door), str(state.mode), str(state.holder))
        self._change(at, lift, "is said to be", (*said, state.restrictions.waiting_for))

    def on_exchange(self, at: float, controller: str, exchange: Exchange) -> None:
        """Too much to be kept."""

    def on_event(self, at: float, event: Event) -> None:
        """Note what the manager tells."""
        self._note(at, event.lift, f"tells {event}")

    def on_request(self, at: float, request: FloorRequest, refused: RequestRefused | None) -> None:
        """Note a request; one that is refused as the one before it was is no news."""
        lift, holder = request.lift, request.holder
        word = f"{holder} asks for {request.floor}, hold {request.hold_door}, {request.robot}: "
        if refused is None:
            self._note(at, lift, f"{word}accepted")
        else:
            self._change(at, lift, f"refuses {holder}", f"{word}{refused.code}")

    def on_fault(self, at: float, change: FaultChange) -> None:
        """Note a fault of the lift or of its wires, or of everything."""
        for lift, controllers in self._controllers.items():
            if change.where in (lift, *controllers) or change.where not in self._places:
                self._note(at, lift, f"fault {change.fault} {'begins' if change.began else 'ends'}")

    def _change(self, at: float, lift: str, what: str, value: object) -> None:
        if self._last.get((lift, what)) != value:
            self._last[lift, what] = value
            self._note(at, lift, f"{what} {value}")

    def _note(self, at: float, lift: str, text: str) -> None:
        self._words[lift].append(f"{at:10.3f} {text}"[:LONGEST])
        for number in range(self._told, len(self._findings)):
            if len(self._stories) < MOST_STORIES:
                self._stories[number] = tuple(self._words[self._findings[number].lift])
        self._told = len(self._findings)
