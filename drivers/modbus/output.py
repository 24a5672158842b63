"""The state of one output, of a heartbeat and of a cyclic block, and the rules that change it. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from drivers.modbus.steps import Phase
from drivers.model import PressId
from register_maps.codec import Block, Cell, CommandCodec, Point
from register_maps.command_codec import Stamp, Written
from register_maps.schema import Command

RETRY_S = 0.2
"""Pause before a release, or the refresh of a hold that did not stick, is written again. Chosen: five tries a second do not
load a controller, and a button left pressed is released soon."""

LOOK_S = 2.0
"""How often a hold that is not refreshed is read back, in case the controller dropped it. Chosen: RMF acts within a second or two,
and a look costs one read."""

LONGEST_RETRY_S = 2.0
"""The pause doubles with every failure of one release, up to this. Chosen: an output that cannot be released must not block the
link for everything else."""

REJECTED_PAUSE_S = 2.0
"""Pause after an exception answer before the output is pressed for the same hold again, or refreshed, unless it is refreshed more often
than that. Chosen: as for a failed call; a controller that refuses is not pressed again at the pace of the polls."""

MOST_PRESSES = 3
"""How often a hold that the controller dropped is pressed again within `FIGHT_S`. Chosen: one press heals a drop-out; a door that is
pressed open and released against somebody else flaps, and people are in it."""
TAKEN_WITHIN_S = 1.0
"""How far the clock of a controller that clears a point as its map says may differ from ours, beyond a refresh. Chosen: a write and two
looks on a slow link."""
FIGHT_S = 60.0
"""Chosen: longer than any hiccup of a controller."""

COUNTS = 0x10000
"""A counting heartbeat restarts at 1 after so many beats: 0 is the value of a controller that was never written to."""

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
    """When the press that follows its rest value may be sent."""
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
    """It was dropped and has not been found to stay on since: one read-back after a press proves little against a second writer."""
    begin: int = 0
    """The newest declared `Hold.begin`; 0 if none is declared."""
    used_begin: int = 0
    """The newest `begin` that is used up."""
    press: PressId | None = None
    """The press that switched it on, or will."""
    set_at: float | None = None
    """When its point was last written from rest to on; None if that was before this process started."""
    paused: bool = False
    """It is between two pulses of a hold that consists of pulses."""
    is_abandoned: bool = False
    """It is no longer requested, and its press was under way: bytes already sent stay in effect (only kept, or until the device ends it), others are not sent."""
    failures: int = 0
    """Failures of the release under way."""
    leave_by: float = math.inf
    """A press that is not written by then is given up."""
    is_found_off: bool = False
    """It was read back as off, and is written again."""
    was_found_on: bool = False
    """It was read back as on since it was pressed."""
    dropped_at: tuple[float, ...] = ()
    """The recent times at which it was found off."""
    echoed: bool = False
    """Its release was answered but is not read back yet."""
    is_yielding: bool = False
    """It was dropped too often, and is not pressed again until `FIGHT_S` is over."""
    adopt_by: float = -math.inf
    """Until then the first look at the controller may find it on from before this process started."""
    is_only_kept: bool = False
    """It was adopted, or its caller is gone: it is kept as found and not pressed until it is requested again."""
    foreign: int = 0
    """Remaining tries to release a press of somebody else; 0 for an output of ours, which is tried until it is released."""

    @property
    def spec(self) -> Command:
        return self.codec.spec

    @property
    def is_visible(self) -> bool:
        """Whether its points show that it is on: not a lamp, nor a command bit that the controller consumes."""
        return bool(self.codec.read_points) and not self.codec.shows_lamp and not self.spec.self_clearing

    @property
    def is_only_looked_at(self) -> bool:
        """Whether it is read back from time to time because it is not refreshed. Never a call, which is not written again."""
        return self.is_written_again and self.is_visible and math.isinf(self.every_s)

    @property
    def is_looked_at_first(self) -> bool:
        """Whether it is read back before each refresh: a refresh of an output that is off would be an unnoticed press."""
        is_level = self.spec.action == "hold" and self.spec.repeat_pulse_s is None
        refreshed = is_level and not math.isinf(self.every_s)
        # for an output that the controller grants, its grant decides
        return refreshed and self.is_visible and self.spec.granted_by is None

    @property
    def is_read_next(self) -> bool:
        """Whether it is read back next instead of written: a write would press an output that is only kept and is off by now."""
        unsure = self.is_only_kept and not self.verified and not self.spec.self_clearing
        return self.is_yielding or unsure or (self.is_only_looked_at and not self.is_found_off)

    def pause_s(self, *, was_read: bool) -> float:
        """Return the pause after it was written, or read back (`was_read`): one that is refreshed is due as soon as it was read."""
        if self.is_only_looked_at or self.is_yielding:
            return LOOK_S
        return 0.0 if was_read else self.every_s

    @property
    def is_written_again(self) -> bool:
        """Whether it is written again when found off. Never a call: each write would be another call."""
        return self.spec.action == "hold" and not self.codec.is_call

    @property
    def is_settled(self) -> bool:
        """Whether the controller should hold what we wrote last: it is at rest, or a hold that was read back as on.

        Not while it pauses, may end by itself, is given up, or is read back and pressed again anyway.
        """
        if self.phase is not Phase.ON:
            return self.phase is Phase.REST
        return self.is_looked_at_first and self.verified and not (self.is_found_off or self.is_yielding)

    @property
    def release_at(self) -> float:
        """When it is next written to rest, for good or between two pulses; infinity while no release is due."""
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
        """Whether it is declared with a `begin` that is not used up."""
        return self.begin > self.used_begin

    @property
    def press_waits(self) -> bool:
        """Whether a press of it waits to be written, or is under way."""
        return self.press is not None and (self.has_next_press or self.phase in (Phase.DUE, Phase.LEAVING))

    @property
    def awaits_press_answer(self) -> bool:
        """Whether a press that is answered now puts it on; one that was released on its way only has to be released."""
        return self.phase is Phase.LEAVING or (self.phase is Phase.ON and self.is_found_off)

    @property
    def is_asserted(self) -> bool:
        """Whether a write to its cells has to write it as pressed."""
        if self.phase is not Phase.ON or self.spec.ends_itself:
            return False
        return not (self.paused or self.is_yielding or self.is_lost)

    @property
    def is_held(self) -> bool:
        """Whether it is on according to the answers to our writes: neither dropped nor in doubt."""
        return (
            self.phase is Phase.ON and self.answered and not (self.is_found_off or self.was_dropped or self.is_yielding)
        )

    @property
    def is_lost(self) -> bool:
        """Whether it was found off, and may not be switched on again."""
        return self.phase is Phase.ON and self.is_found_off and not self.may_begin

    @property
    def due_at(self) -> float:
        """When it is next written or read back while it is on; infinity while it may not be switched on again."""
        if self.is_lost:
            return math.inf
        return max(self.refresh_at, self.not_before) if self.is_found_off else self.refresh_at

    @property
    def can_be_adopted(self) -> bool:
        """Whether it can be found on and kept: not a lamp, nor a hold that consists of pulses, nor an output that ends by itself."""
        level = self.spec.action == "hold" and self.spec.repeat_pulse_s is None and not self.spec.ends_itself
        return level and bool(self.codec.read_points) and not self.codec.shows_lamp

    @property
    def awaits_look(self) -> bool:
        """Whether it may be on from before and was not read back yet: its cells may not be overwritten."""
        return self.adopt_by > -math.inf

    def reconnect(self, cells: Cells, now: float) -> None:
        """Compare it with what the controller holds after a new connection."""
        until, self.armed_at = self.adopt_by, None
        if self.awaits_look:
            self.adopt_by, self.used_begin = -math.inf, self.begin
        if self.phase is Phase.REST and now < until and matches(self.codec, cells, self.code):
            self._keep_from_before(now, until)
            return
        at_rest = self.codec.shows_lamp or matches(self.codec, cells, None)
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
        # written even if it reads at rest: our press may still arrive over the connection that broke
        if not self.has_next_press:
            self.used_begin = self.begin
        self.phase, self.try_at, self.verified = Phase.RELEASING, now, False
        self.failures, self.foreign, self.echoed = 0, 0, False

    def _keep_from_before(self, now: float, until: float) -> None:
        """Keep it on from before: it continues like a hold that was pressed now, but without the press."""
        self.phase, self.verified, self.was_found_on, self.is_found_off = Phase.ON, True, True, False
        self.answered, self.is_only_kept, self.set_at = True, not self.spec.self_clearing, None
        self.expires_at = min(until, now + (self.spec.max_hold_s or math.inf))
        if math.isinf(self.every_s):
            self.refresh_at = now + LOOK_S if self.is_only_looked_at else math.inf
        else:
            self.refresh_at = now

    def count_drop(self, now: float) -> None:
        """Count that it was found off after it had been on; once for each write."""
        if self.is_found_off or self.is_yielding or not self.was_found_on:
            return
        self.is_found_off, self.was_dropped, self.used_begin = True, True, self.begin
        self.dropped_at = (*(at for at in self.dropped_at if now - at < FIGHT_S), now)
        if len(self.dropped_at) > MOST_PRESSES:
            self.is_yielding, self.is_found_off, self.refresh_at = True, False, now + LOOK_S

    def end_yielding(self, now: float) -> None:
        """Allow one more press after `FIGHT_S`; if that is dropped within `FIGHT_S`, it yields again."""
        if self.is_yielding and self.is_written_again and now - self.dropped_at[-1] >= FIGHT_S:
            self.dropped_at = (now,) * MOST_PRESSES
            self.is_yielding, self.is_found_off, self.used_begin, self.refresh_at = False, True, self.begin, now

    def record_write(self, now: float, *, was_read: bool) -> None:
        """Record that the controller answered the write of it as pressed, or the look at it (`was_read`)."""
        self.refresh_at = now + self.pause_s(was_read=was_read)
        if not was_read:
            self.paused = self.is_found_off = False
            self.answered, self.used_begin = True, self.begin
        if self.spec.repeat_pulse_s is not None:
            self.pause_at = now + (self.spec.width_s or math.inf)

    def check_before_refresh(self, *, holds: bool, now: float, excused: bool) -> bool:
        """Take a read-back before a refresh. Returns whether to refresh it; an output found off is pressed again or stays off."""
        if holds:
            # after a write without an answer only the read-back of the next write counts
            self.verified, self.was_found_on = self.answered, True
            self.was_dropped = self.was_dropped and not self.answered
            return True
        if self.was_cleared_by_device(now):
            self.set_at = now
            return True
        self.handle_found_off(now, pause_s=0.0 if self.verified or not self.was_found_on else LOOK_S, excused=excused)
        return False

    def handle_found_off(self, now: float, *, pause_s: float, excused: bool) -> None:
        """Take that it was found off: release it if it is only kept or a call, whose caller requests it again; else press it again."""
        if self.is_only_kept or self.codec.is_call:
            self.release()
        else:
            self.press_again_later(now, pause_s=pause_s, excused=excused)

    def was_cleared_by_device(self, now: float) -> bool:
        """Whether the controller has cleared it to have it written again, as its map says; then the hold continues."""
        after_s = self.spec.cleared_after_s
        if after_s is None or self.was_dropped or not self.answered:
            return False
        late_s = 0.0 if self.set_at is None else now - self.set_at - after_s
        return -TAKEN_WITHIN_S <= late_s <= self.every_s + TAKEN_WITHIN_S

    def press_again_later(self, now: float, *, pause_s: float, excused: bool) -> None:
        """Press a declared hold again after the pause, unless it was dropped too often."""
        if not excused:
            self.count_drop(now)
        self.verified = False
        if self.is_written_again and not self.is_yielding:
            if not self.is_found_off:
                self.used_begin = self.begin
            self.refresh_at, self.is_found_off = now + pause_s, True

    def record_failed_press(self, *, maybe_sent: bool, arrived: bool, now: float) -> None:
        """Record that a press or its read-back failed: release what may have been pressed. One that has `arrived` is used up."""
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
        """Keep a declared hold. One that the controller dropped is written again, unless it is a call or only kept."""
        if self.spec.self_clearing:
            self.refresh_at = min(now, self.refresh_at)
            return True
        # what the controller has cleared to see it written again is obeyed still; where nobody knows when it was set it may have lost power
        was_cleared = self.set_at is not None and self.was_cleared_by_device(now)
        self.verified = matches(self.codec, cells, self.code) or was_cleared
        if not self.is_found_off:
            self.used_begin = self.begin
        self.is_found_off = not self.verified
        self.refresh_at = min(now, self.refresh_at)
        return self.verified or not (self.codec.is_call or self.is_only_kept)

    def renew(self, until: float, *, begin: bool) -> bool:
        """Renew the hold until then. Returns whether nothing else is to be done: it awaits its first look, or may not `begin`."""
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
        """Keep it only as far as it is on; drop a press that was not written yet.

        A hold that cannot be read back continues: it may still be needed.
        """
        self.has_next_press = False
        if self.phase is Phase.DUE:
            self.release()
        elif self.phase in (Phase.LEAVING, Phase.ON):
            # its bytes may still wait behind an answer: then they are not sent
            self.is_abandoned = self.phase is Phase.LEAVING
            self.is_only_kept = self.can_be_adopted and not self.spec.self_clearing

    def release(self) -> None:
        """Release it. The present declaration no longer switches it on."""
        self.used_begin = self.begin
        if self.phase in (Phase.ON, Phase.LEAVING) and self.spec.ends_itself:
            # it cannot be released: another write would press it again
            self.is_abandoned = self.phase is Phase.LEAVING
            return
        if self.phase in (Phase.ON, Phase.LEAVING) or self.awaits_look:
            self.phase, self.try_at, self.failures = Phase.RELEASING, -math.inf, 0
        elif self.phase is Phase.DUE:
            self.phase = Phase.REST
        self.verified, self.armed_at, self.pause_at, self.adopt_by = False, None, math.inf, -math.inf

    def come_to_rest(self, now: float) -> None:
        """Record that it is at rest, and make the next press due."""
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
        """Schedule the next try of its release, later each time."""
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


def put(image: dict[Cell, int], stamp: Stamp) -> None:
    for cell, others, bits in stamp:
        image[cell] = image.get(cell, 0) & others | bits


def read_values(codec: CommandCodec, cells: Cells) -> Iterator[tuple[Point, int]]:
    """Yield the value read at each point of a command."""
    for point, read in zip(codec.points, codec.read_points, strict=bool(codec.read_points)):
        if read.cell in cells:
            yield point, read.within(cells[read.cell])


def matches(codec: CommandCodec, cells: Cells, code: int | None) -> bool:
    """Whether the cells hold what this code writes; of lamps, whether the lamp of the pressed button is lit."""
    expected, found = codec.encode(code), dict(read_values(codec, cells))
    if codec.shows_lamp:
        return all(found.get(point) == value for point, value in expected.items() if value)
    return found == expected
