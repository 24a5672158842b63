"""One output, the heartbeat and a cyclic block, as they stand at one moment; and small questions about them. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from drivers.modbus.steps import Phase
from drivers.model import PressId
from register_maps.codec import Block, Cell, CommandCodec, Point
from register_maps.command_codec import Written
from register_maps.schema import Command

RETRY_S = 0.2
"""Pause before a release, or the refresh of a hold that did not stick, is written again. Chosen: five tries a second do not
load a controller, and a button left pressed is let go soon."""

LOOK_S = 2.0
"""How often a hold that is not refreshed is looked at, for a controller that dropped it. Chosen: RMF acts on news of a second or
two, and a look costs one read."""

LONGEST_RETRY_S = 2.0
"""The pause doubles with every failure of one release, up to this. Chosen: an output that cannot be let go must not keep the
link from everything else for as long as it stays so."""

REJECTED_PAUSE_S = 2.0
"""Pause before an output whose press the controller answered with an exception is pressed for the same hold again, or refreshed, unless
it is refreshed more often than that. Chosen: as for a failed call; a controller that says no is not to be asked at the pace of the polls."""

MOST_PRESSES = 3
"""So often a hold that the controller dropped is pressed again within `FIGHT_S`. Chosen: a drop-out heals by one; a door that is
pressed open and released against somebody else flaps, and people are in it."""
TAKEN_WITHIN_S = 1.0
"""By how much the clocks of a controller that clears a point as its map says, and ours, may differ beyond a refresh. Chosen: a write and
two looks on a slow link."""
FIGHT_S = 60.0
"""Chosen: longer than any hiccup of a controller."""

COUNTS = 0x10000
"""After so many beats a counting heartbeat begins anew, at 1: 0 is what a controller shows that nobody has written to."""

Cells = Mapping[Cell, int]


@dataclass(slots=True)
class Output:
    codec: CommandCodec
    every_s: float
    """How often it is written while it is on."""
    phase: Phase = Phase.REST
    code: int | None = None
    next_code: int | None = None
    """A press that waits for this output to come to rest."""
    has_next_press: bool = False
    armed_at: float | None = None
    """When the press that was prepared by its rest value may leave."""
    expires_at: float = math.inf
    pause_at: float = math.inf
    refresh_at: float = math.inf
    try_at: float = -math.inf
    not_before: float = -math.inf
    rested_at: float = -math.inf
    verified: bool = False
    answered: bool = False
    """The controller answered the newest write of it."""
    was_dropped: bool = False
    """It was dropped, and was not seen to stay on since: the read-back of the press that follows proves little against a second writer."""
    begin: int = 0
    """The newest `Hold.begin` that is declared; 0 where none is."""
    used_begin: int = 0
    """What of it is used up."""
    press: PressId | None = None
    """The press that put it on, or will."""
    set_at: float | None = None
    """When its point was last written from rest to on; None where that was before this process began."""
    paused: bool = False
    """Between two pulses of a hold that is made of pulses."""
    is_abandoned: bool = False
    """Nobody wants it any more, and its press was on its way: what has left stays (only kept, or until the device ends it), the rest does not leave."""
    failures: int = 0
    """Of the release under way."""
    leave_by: float = math.inf
    """A press that was not written by then is given up."""
    is_found_off: bool = False
    """It was seen not to be there any more, and is written again."""
    was_found_on: bool = False
    """The controller was seen to hold it since it was pressed."""
    dropped_at: tuple[float, ...] = ()
    """When it was seen to be gone, of late."""
    echoed: bool = False
    """Its release was answered and not looked at yet."""
    is_yielding: bool = False
    """It was dropped too often: it is pressed once more when `FIGHT_S` is over, and not before."""
    adopt_by: float = -math.inf
    """Until then the first look at the controller may find it on for somebody from before this process began."""
    is_only_kept: bool = False
    """It was adopted, or whoever asked for it is gone: until somebody asks, it is kept as it is found, and not pressed."""
    foreign: int = 0
    """Tries that are left to let go of what somebody else pressed; 0: what is let go of is ours, and it is tried until it is done."""

    @property
    def spec(self) -> Command:
        return self.codec.spec

    @property
    def is_visible(self) -> bool:
        """Whether what stands at its points shows that it is on: not a lamp, nor a command bit that the controller consumes."""
        return bool(self.codec.read_points) and not self.codec.lamp and not self.spec.self_clearing

    @property
    def is_only_looked_at(self) -> bool:
        """Whether it is read back from time to time, because nothing writes it again. A call is never written again."""
        return self.is_written_again and self.is_visible and math.isinf(self.every_s)

    @property
    def is_looked_at_first(self) -> bool:
        """Whether it is read back before each refresh: a refresh that finds it off would be a press that nobody noticed."""
        is_level = self.spec.action == "hold" and self.spec.repeat_pulse_s is None
        refreshed = is_level and not math.isinf(self.every_s)
        # of what the controller grants, its grant is the judge
        return refreshed and self.is_visible and self.spec.granted_by is None

    @property
    def is_read_next(self) -> bool:
        """Whether it is read back next instead of written: a write would press what is only kept, should it be off by now."""
        unsure = self.is_only_kept and not self.verified and not self.spec.self_clearing
        return self.is_yielding or unsure or (self.is_only_looked_at and not self.is_found_off)

    def pause_s(self, *, was_read: bool) -> float:
        """How long it is left alone after it was written, or `was_read` at: one that is refreshed is due as soon as it was seen."""
        if self.is_only_looked_at or self.is_yielding:
            return LOOK_S
        return 0.0 if was_read else self.every_s

    @property
    def is_written_again(self) -> bool:
        """Whether it is written again as soon as it is not there. A call is not: each time would be another call."""
        return self.spec.action == "hold" and not self.codec.is_call

    @property
    def is_settled(self) -> bool:
        """Whether what the controller holds is what we wrote last, as far as we know: at rest, or a hold that was seen to be on.

        Not what pauses, may end by itself, is given up, or is looked at and pressed again anyhow.
        """
        if self.phase is not Phase.ON:
            return self.phase is Phase.REST
        return self.is_looked_at_first and self.verified and not (self.is_found_off or self.is_yielding)

    @property
    def release_at(self) -> float:
        """When it is next written to rest, for good or between two pulses; infinity while nothing asks for that."""
        if self.phase is Phase.RELEASING:
            return self.try_at
        return self.pause_at if self.phase is Phase.ON else math.inf

    @property
    def give_up_at(self) -> float:
        """When a press or hold that waits to be written is given up."""
        return self.leave_by if self.spec.ends_itself else min(self.expires_at, self.leave_by)

    @property
    def is_level(self) -> bool:
        """Whether it stays on until it is released."""
        return self.spec.action == "hold"

    @property
    def may_begin(self) -> bool:
        """Whether it is declared with a beginning that is not used up."""
        return self.begin > self.used_begin

    @property
    def press_waits(self) -> bool:
        """Whether a press of it is still to be written, or on its way."""
        return self.press is not None and (self.has_next_press or self.phase in (Phase.DUE, Phase.LEAVING))

    @property
    def is_asserted(self) -> bool:
        """Whether whoever writes its cells has to write it pressed."""
        off = self.paused or self.is_yielding or self.is_lost
        return self.phase is Phase.ON and not off and not self.spec.ends_itself

    @property
    def is_held(self) -> bool:
        """Whether it is on as far as the answers to our writes go: neither dropped nor in doubt."""
        return (
            self.phase is Phase.ON and self.answered and not (self.is_found_off or self.was_dropped or self.is_yielding)
        )

    @property
    def is_lost(self) -> bool:
        """Whether it was found off, and may not be put on again."""
        return self.phase is Phase.ON and self.is_found_off and not self.may_begin

    @property
    def due_at(self) -> float:
        """When it is next written or looked at while it is on; infinity while it may not be put on again."""
        if self.is_lost:
            return math.inf
        return max(self.refresh_at, self.not_before) if self.is_found_off else self.refresh_at

    @property
    def can_be_adopted(self) -> bool:
        """Whether what stands at its points shows that it is on: not a lamp, nor a hold made of pulses, nor what ends by itself."""
        level = self.spec.action == "hold" and self.spec.repeat_pulse_s is None and not self.spec.ends_itself
        return level and bool(self.codec.read_points) and not self.codec.lamp

    @property
    def awaits_look(self) -> bool:
        """Whether it may be on for somebody from before, and was not looked at yet: nothing may be written over it."""
        return self.adopt_by > -math.inf

    def reconnect(self, cells: Cells, now: float) -> None:
        """Compare it with what the controller holds after a new connection."""
        until, self.armed_at = self.adopt_by, None
        if self.awaits_look:
            self.adopt_by, self.used_begin = -math.inf, self.begin
        if self.phase is Phase.REST and now < until and matches(self.codec, cells, self.code):
            self._keep_from_before(now, until)
            return
        at_rest = self.codec.lamp or matches(self.codec, cells, None)
        if self.phase is Phase.ON and self.spec.action == "hold" and self.keep_after_reconnect(cells, now):
            return
        if self.phase is Phase.DUE and self.is_written_again and matches(self.codec, cells, self.code):
            self.phase, self.verified, self.was_found_on, self.refresh_at = Phase.ON, True, True, now
            self.answered = True
            return
        if self.phase in (Phase.REST, Phase.DUE) and at_rest:
            return
        if self.phase is Phase.DUE:
            self.has_next_press, self.next_code = True, self.code
        # written even if it reads at rest: the controller may still find our press in the connection that broke
        if not self.has_next_press:
            self.used_begin = self.begin
        self.phase, self.try_at, self.verified = Phase.RELEASING, now, False
        self.failures, self.foreign, self.echoed = 0, 0, False

    def _keep_from_before(self, now: float, until: float) -> None:
        """It is on for somebody from before: it goes on like a hold that was pressed now, but for the press."""
        self.phase, self.verified, self.was_found_on, self.is_found_off = Phase.ON, True, True, False
        self.answered, self.is_only_kept, self.set_at = True, not self.spec.self_clearing, None
        self.expires_at = min(until, now + (self.spec.max_hold_s or math.inf))
        if math.isinf(self.every_s):
            self.refresh_at = now + LOOK_S if self.is_only_looked_at else math.inf
        else:
            self.refresh_at = now

    def count_drop(self, now: float) -> None:
        """It was seen to be gone, after it had been seen to be there. Nothing counts twice that was not written in between."""
        if self.is_found_off or self.is_yielding or not self.was_found_on:
            return
        self.is_found_off, self.was_dropped, self.used_begin = True, True, self.begin
        self.dropped_at = (*(at for at in self.dropped_at if now - at < FIGHT_S), now)
        if len(self.dropped_at) > MOST_PRESSES:
            self.is_yielding, self.is_found_off, self.refresh_at = True, False, now + LOOK_S

    def end_yielding(self, now: float) -> None:
        """End the yielding once its time is over, for one press: if that is dropped within `FIGHT_S`, it yields again."""
        if self.is_yielding and self.is_written_again and now - self.dropped_at[-1] >= FIGHT_S:
            self.dropped_at = (now,) * MOST_PRESSES
            self.is_yielding, self.is_found_off, self.used_begin, self.refresh_at = False, True, self.begin, now

    def record_write(self, now: float, *, was_read: bool) -> None:
        """The controller answered the write of it as pressed, or the look at it."""
        self.refresh_at = now + self.pause_s(was_read=was_read)
        if not was_read:
            self.paused = self.is_found_off = False
            self.answered, self.used_begin = True, self.begin
        if self.spec.repeat_pulse_s is not None:
            self.pause_at = now + (self.spec.width_s or math.inf)

    def check_before_refresh(self, *, holds: bool, now: float, excused: bool) -> bool:
        """It was read back before a refresh. Returns whether it is to be refreshed: what is off is pressed again, or kept off."""
        if holds:
            # after a write without an answer only the read-back of the next one counts
            self.verified, self.was_found_on = self.answered, True
            self.was_dropped = self.was_dropped and not self.answered
            return True
        if self.was_cleared_by_device(now):
            self.set_at = now
            return True
        self.handle_found_off(now, pause_s=0.0 if self.verified or not self.was_found_on else LOOK_S, excused=excused)
        return False

    def handle_found_off(self, now: float, *, pause_s: float, excused: bool) -> None:
        """It was on, and was seen to be off: what is only kept stays so, and so does a call: whoever needs the car asks again."""
        if self.is_only_kept or self.codec.is_call:
            self.release()
        else:
            self.press_again_later(now, pause_s=pause_s, excused=excused)

    def was_cleared_by_device(self, now: float) -> bool:
        """Whether the controller has cleared it to have it written again, as its map says; then the hold goes on."""
        after_s = self.spec.cleared_after_s
        if after_s is None or self.was_dropped or not self.answered:
            return False
        late_s = 0.0 if self.set_at is None else now - self.set_at - after_s
        return -TAKEN_WITHIN_S <= late_s <= self.every_s + TAKEN_WITHIN_S

    def press_again_later(self, now: float, *, pause_s: float, excused: bool) -> None:
        """It was seen to be off while it is wanted: it is pressed again after the pause, unless that happened too often."""
        if not excused:
            self.count_drop(now)
        self.verified = False
        if self.is_written_again and not self.is_yielding:
            if not self.is_found_off:
                self.used_begin = self.begin
            self.refresh_at, self.is_found_off = now + pause_s, True

    def record_failed_press(self, *, maybe_sent: bool, arrived: bool, now: float) -> None:
        """A press, or the look at it, failed: what may have been pressed is let go. What has `arrived` is used up."""
        self.armed_at = None
        if self.phase is Phase.LEAVING and (maybe_sent or arrived):
            self.used_begin = self.begin
        if self.phase is Phase.ON and self.is_written_again:
            self.verified, self.refresh_at = False, now + RETRY_S
        elif not maybe_sent and self.phase in (Phase.LEAVING, Phase.RELEASING):
            self.come_to_rest(self.rested_at)
            self.try_at = now + RETRY_S
        elif self.phase is Phase.LEAVING and self.spec.ends_itself:
            self.phase, self.expires_at, self.is_abandoned = Phase.ON, now + (self.spec.width_s or 0.0), False
        elif self.phase is Phase.LEAVING:
            self.phase, self.try_at, self.failures = Phase.RELEASING, now, 0

    def keep_after_reconnect(self, cells: Cells, now: float) -> bool:
        """Keep a wanted hold as it is. One that the controller dropped is written again, unless it is a call or only kept."""
        if self.spec.self_clearing:
            self.refresh_at = min(now, self.refresh_at)
            return True
        self.verified = matches(self.codec, cells, self.code)
        if not self.is_found_off:
            self.used_begin = self.begin
        self.is_found_off = not self.verified
        self.refresh_at = min(now, self.refresh_at)
        return self.verified or not (self.codec.is_call or self.is_only_kept)

    def renew(self, until: float, *, begin: bool) -> bool:
        """Want it as a hold until then. Returns whether that is all: it has its first look before it, or may not `begin`."""
        self.is_only_kept, self.is_abandoned = self.is_only_kept and not begin, self.is_abandoned and not begin
        if self.awaits_look:
            self.adopt_by = until
        elif begin or self.phase is Phase.ON:
            self.expires_at = until
            return False
        else:
            self.keep()
        return True

    def keep(self) -> None:
        """Want it no more than it is there; one that was not pressed yet is not wanted at all.

        One that cannot be seen to be off goes on as it is: nobody can tell whether the lift still needs it.
        """
        self.has_next_press = False
        if self.phase is Phase.DUE:
            self.release()
        elif self.phase in (Phase.LEAVING, Phase.ON):
            # handed out, its bytes may wait behind an answer still: then they do not leave
            self.is_abandoned = self.phase is Phase.LEAVING
            self.is_only_kept = self.can_be_adopted and not self.spec.self_clearing

    def release(self) -> None:
        """Want rest. What was declared until now puts it on no more."""
        self.used_begin = self.begin
        if self.phase in (Phase.ON, Phase.LEAVING) and self.spec.ends_itself:
            # there is nothing to let go with: writing it again would press it again
            self.is_abandoned = self.phase is Phase.LEAVING
            return
        if self.phase in (Phase.ON, Phase.LEAVING) or self.awaits_look:
            self.phase, self.try_at, self.failures = Phase.RELEASING, -math.inf, 0
        elif self.phase is Phase.DUE:
            self.phase = Phase.REST
        self.verified, self.armed_at, self.pause_at, self.adopt_by = False, None, math.inf, -math.inf

    def come_to_rest(self, now: float) -> None:
        """It has come to rest."""
        self.phase, self.rested_at, self.verified = Phase.REST, now, False
        self.paused, self.is_abandoned, self.echoed, self.is_only_kept, self.foreign = False, False, False, False, 0
        self.was_found_on, self.is_yielding, self.dropped_at = False, False, ()
        self.was_dropped, self.is_found_off, self.answered = False, False, False
        if self.has_next_press:
            self.has_next_press = False
            self.phase, self.code = Phase.DUE, self.next_code
        else:
            self.press = None

    def retry_later(self, now: float) -> None:
        """Let the next try of its release wait, longer each time."""
        self.echoed = False
        self.try_at = now + min(LONGEST_RETRY_S, RETRY_S * 2.0 ** min(self.failures, 10))
        self.failures += 1


@dataclass(slots=True)
class Beat:
    codec: CommandCodec
    count: int = 0
    at: float = -math.inf

    @property
    def next_count(self) -> int:
        if self.codec.spec.action == "toggle":
            return 1 - self.count
        return (self.count + 1) % COUNTS or 1


@dataclass(slots=True)
class Cycle:
    block: Block
    every_s: float
    at: float = -math.inf


def period_s(codec: CommandCodec, written: Sequence[Written]) -> float:
    """Return how often an output is written while it is on: its refresh, its next pulse, or the cycle of its block."""
    spec = codec.spec
    own = [spec.refresh_s, spec.repeat_pulse_s] if spec.action == "hold" else []
    cycles = [every_s for block, _, every_s in written if block in codec.blocks]
    return min((every_s for every_s in (*own, *cycles) if every_s is not None), default=math.inf)


def put_values(image: dict[Cell, int], values: Mapping[Point, int]) -> None:
    for point, value in values.items():
        image[point.cell] = point.into(image.get(point.cell, 0), value)


def read_values(codec: CommandCodec, cells: Cells) -> Iterator[tuple[Point, int]]:
    """Yield what the controller holds at each point of a command that was read back."""
    for point, read in zip(codec.points, codec.read_points, strict=bool(codec.read_points)):
        if read.cell in cells:
            yield point, read.within(cells[read.cell])


def matches(codec: CommandCodec, cells: Cells, code: int | None) -> bool:
    """Whether the controller holds what this code writes; of lamps, whether that of the pressed button is lit."""
    expected, found = codec.encode(code), dict(read_values(codec, cells))
    if codec.lamp:
        return all(found.get(point) == value for point, value in expected.items() if value)
    return found == expected
