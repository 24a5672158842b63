"""What the lift is told about the robot: in place, left. Nothing here waits."""

from __future__ import annotations

from asyncio import Future
from collections.abc import Callable
from enum import Enum, auto, unique
from typing import NamedTuple

from drivers.model import CommandKind, FloorName, Outcome
from lift_manager.core.acknowledgement import Acknowledgement
from lift_manager.core.calling import CallButton, Press
from lift_manager.core.options import LiftOptions
from lift_manager.core.outputs import LiftOutputs, Permit
from lift_manager.domain import boarding as boardings
from lift_manager.domain.asking import Ask, Blocking, Refusal, Refused, RobotWord
from lift_manager.domain.boarding import Boarding, KeptBoarding, Rules, Stop, Who
from lift_manager.domain.following import Told
from lift_manager.domain.service import how_to_acknowledge
from lift_manager.domain.session import Session
from lift_manager.domain.sight import Sight, permissions, robot_door, under_way
from lift_manager.domain.state import Holder, RobotDoor


@unique
class _Parting(Enum):
    """How the robot of a session and the lift part."""

    DONE = auto()
    LEFT = auto()
    """It got out, and the lift is told."""
    DOUBT = auto()


class LeftBehind(NamedTuple):
    """What a session leaves behind in the car."""

    occupied: tuple[Holder, bool] | None
    """Whose robot may be there, and whether it is known to be."""
    left_untold: bool
    """The lift has still to be told that the robot left."""


class Handshake:
    """Who is aboard, and what is pressed because of it."""

    def __init__(
        self, outputs: LiftOutputs, options: LiftOptions, button: CallButton, press: Press, *, permit: Permit
    ) -> None:
        """`permit` is that of a word which must reach the lift although the session is over."""
        able = outputs.capabilities
        self._outputs = outputs
        self._able = able
        self._options = options
        self._button = button
        self._press = press
        self._permit = permit
        self._rules = Rules(boardings.matters(able), options.infer_occupancy, options.board_min_s)
        self._boarding = Boarding()
        self._in_place = Acknowledgement(CommandKind.ROBOT_IN_PLACE, able)
        self._left = Acknowledgement(CommandKind.ROBOT_LEFT, able)
        self._abandoned_by: Holder | None = None
        """Whose session ended while its robot was, or may have been, in the car."""

    @property
    def aboard(self) -> bool | None:
        """Whether the session's robot is in the car; None where nobody knows."""
        return boardings.aboard(self._boarding, self._rules)

    @property
    def reporting(self) -> bool:
        """Whether the lift has still to be told that a robot left, and that is not waiting for its next try."""
        return self._left.pending

    @property
    def untold(self) -> bool:
        """Whether the lift has not taken that a robot left. One that is aboard again makes its picture right."""
        return self._left.owed and self._boarding.who is not Who.ABOARD

    @property
    def awaits(self) -> str:
        """Say that a session waits for the lift to take the word of the robot before it; empty where it does not."""
        if not self._retries or not self._left.late:
            return ""
        return f"the lift to take robot_left for the robot before; {_tried_again(self._options.name)}"

    @property
    def _retries(self) -> bool:
        """Whether the word that a robot left is given until it is taken: not while one may be going in."""
        return self._left.owed and not boardings.possible(self._boarding)

    @property
    def ready(self) -> bool:
        """Whether the lift has been told what it must know before it is sent on."""
        told_left = not self._left.pending and not self._retries
        return told_left and (self.aboard is not True or self._in_place.taken)

    @property
    def who(self) -> Who:
        """Where the session's robot is, as far as anybody knows."""
        return Who.MAY_BOARD if self._boarding.who is Who.EMPTY and self._boarding.sent_on else self._boarding.who

    def told(self, now: float) -> tuple[Told, Told]:
        """Return how far the words are that the robot is in place, and that it left."""
        return self._in_place.told(now), self._left.told(now)

    def next_command(self, floor: FloorName) -> str:
        """Return the command that sends the car to a floor: the call, or a word that has to come before it or does without."""
        aboard = self.aboard is True
        call = self._button.command(floor, aboard=aboard)
        if call is None or (aboard and not self._in_place.taken):
            return self._in_place.command.name
        return call.name

    def door_is_open(self, sight: Sight, floor: FloorName) -> bool:
        """Whether the car stands open at a floor for the robot where it is now, as far as the lift's own signals go."""
        needs = permissions(self._able, aboard=self.aboard)
        doors = self._options.doors_at.get(floor, ())
        return sight.floor == floor and robot_door(sight, doors, needs) is RobotDoor.OPEN

    def hear(
        self, ask: Ask, session: Session | None, sight: Sight | None, *, arrived: bool, now: float
    ) -> Refused | None:
        """Take a request of the holder that nothing else speaks against, or refuse it.

        A session that was asked for no floor yet has no part in the handshake: its first request is heard as the one that
        opens a session.
        """
        name, before, stop = self._options.name, self._boarding, None
        if session is not None and session.floor is None:
            session = None  # what is known of the car is as it was before the session
        if session is not None and session.floor is not None:
            is_open = sight is not None and self.door_is_open(sight, session.floor)
            stop = Stop(session.floor, arrived, is_open)
        if (kept := self.why_kept(ask.holder)) is not None:
            return kept
        if (unknown := self._why_unknown(ask, session, sight)) is not None:
            return Refused(Refusal.OCCUPANCY_UNKNOWN, f"{name}: {unknown}", Blocking(holder=ask.holder))
        heard = boardings.hear(before, ask, stop, self._rules, now)
        if isinstance(heard, str):
            return Refused(Refusal.OCCUPANCY_UNKNOWN, f"{name}: {heard}")
        if (impossible := self.impossible(ask.floor, aboard=heard.who is Who.ABOARD)) is not None:
            return impossible
        self._boarding, self._abandoned_by = heard, None
        self._heed(before, ask, session, stop, now)
        return None

    def why_kept(self, asker: Holder) -> Refused | None:
        """Refuse the lift to a caller while a robot of another one may be in its car without a session."""
        if (holder := self._abandoned_by) in (None, asker):
            return None
        person = _a_person_looks(self._options.name)
        text = f"a robot of {holder} may still be aboard; {holder} must ask for the lift again, or {person}"
        return Refused(Refusal.OCCUPANCY_UNKNOWN, f"{self._options.name}: {text}", Blocking(holder=holder))

    def goes_on(self, holder: Holder) -> bool:
        """Whether a robot of this holder may be in the car without a session: it has to get out, whoever waits."""
        return self._abandoned_by == holder and boardings.possible(self._boarding)

    def handed_over(self, to: Holder) -> None:
        """Take it that whatever is known of the holder's robot is known of another caller's."""
        if self._abandoned_by is not None:
            self._abandoned_by = to

    def impossible(self, floor: FloorName, *, aboard: bool) -> Refused | None:
        """Refuse a floor to which nothing of the map brings the car; `aboard` says that it is the occupied one."""
        if self._button.command(floor, aboard=aboard) is not None or (aboard and self._in_place.known):
            return None
        car = "the occupied car" if aboard else "the car"
        text = f"{self._options.name}: its map {self._able.map_name} has no command that brings {car} to {floor}"
        return Refused(Refusal.NOT_POSSIBLE, text)

    def no_words(self) -> Refused | None:
        """Refuse a caller without robot words where the lift needs them: its robot would ride in, and be taken nowhere."""
        if not self._rules.matters or self._rules.infer:
            return None
        why = "has to be told when a robot is in place, and this caller has no word for it; set `infer_occupancy: true`"
        return Refused(
            Refusal.NOT_POSSIBLE, f"{self._options.name} {why} in the site file, if its requests may count as one"
        )

    def _why_unknown(self, ask: Ask, session: Session | None, sight: Sight | None) -> str | None:
        """Say why nobody knows whether the holder's robot of an earlier session is in the car, where that speaks against a request."""
        person = _a_person_looks(self._options.name)
        taken_up = session is None and self._boarding.who is Who.MAY_BOARD and self._rules.matters
        stays_here = sight is not None and sight.floor == ask.floor
        if taken_up and ask.robot is None and not stays_here:
            here = "" if sight is None or sight.floor is None else f", ask for {sight.floor}, where the car is"
            return f"your robot may have entered the car; say that it is in place or has left{here}, or {person}"
        return None

    def _heed(self, before: Boarding, ask: Ask, session: Session | None, stop: Stop | None, now: float) -> None:
        """Want the words that follow from what was heard."""
        here = stop.floor if stop is not None else ask.floor
        if self._boarding.who is Who.ABOARD:
            if before.who is not Who.ABOARD and self._left.is_level:
                self._outputs.let_go(self._left.command)
            self._in_place.want(here, now)
        elif before.who is Who.ABOARD:
            self._report_left(here, now)
        elif session is None or ask.robot is RobotWord.LEFT:
            self._left.again(now)

    def seen(self, sight: Sight, session: Session | None, now: float) -> None:
        """Take a fresh reading."""
        floor = sight.floor
        self._boarding = boardings.car_seen_at(self._boarding, floor, under_way=under_way(sight))
        if floor is None or not self.door_is_open(sight, floor):
            return
        self._boarding = boardings.open_to_leave(self._boarding, floor)
        if session is not None and floor == session.floor:
            self._boarding = boardings.open_to_enter(self._boarding, now)

    def act(self, session_permit: Permit | None, now: float, *, begin: bool = True) -> None:
        """Give what is wanted, as far as it is permitted. `session_permit` is None without a session.

        What is found off is put on, and an owed word given once more, only where it may `begin`.
        """
        if begin and self._retries:
            self._left.again(now)
        if self._left.wanted:
            if self._permit() is None:
                self._left.give(self._press, self._permit, now)
            else:
                self._let_go_of_stay()
        if session_permit is None or self.aboard is not True or self._left.pending or session_permit() is not None:
            return
        self._in_place.give(self._press, session_permit, now)
        if self._in_place.taken:
            self._button.let_go_at("robot_in_place")
            if (
                self._in_place.known
                and self._in_place.is_level
                and (begin or self._outputs.given(self._in_place.command))
            ):
                self._outputs.hold(self._in_place.command, session_permit, begin=begin)

    def ended(self, future: Future[Outcome], outcome: Outcome, now: float) -> str | None:
        """Take the outcome of a press; a text is what a person should know."""
        self._in_place.ended(future, outcome, now)
        if not self._left.ended(future, outcome, now):
            return None
        self._after_left()
        if not self._left.failed_once:
            return None
        tried = _tried_again(self._options.name)
        return f"robot_left was not taken, so the lift may still count a robot aboard: {outcome.reason}; {tried}"

    def end(self, session: Session, release: Ask | None, now: float, *, arrived: bool) -> None:
        """Close the session's part.

        `release` is the holder's own word that it is over; so is that it wanted no more than to be where it has `arrived`.
        """
        if self._abandoned_by is not None:
            # it was asked for no floor: the car is as the session before left it
            if release is not None:
                self.end_again(release, now)
            return
        parting = self._parting(session, release, arrived=arrived)
        boarding, self._boarding = self._boarding, Boarding()
        if parting is _Parting.LEFT and release is not None:
            self._report_left(release.floor, now)
            self._keep_until_told()
            return
        self._let_go_of_stay()
        if parting is _Parting.DOUBT:
            self._abandoned_by, self._boarding = session.holder, boarding
        if boarding.who is Who.ABOARD and (self._in_place.is_level or not self._in_place.taken):
            self._in_place.forget()

    def _parting(self, session: Session, release: Ask | None, *, arrived: bool) -> _Parting:
        boarding, let_out = self._boarding, session.stood_open or session.has_words or not session.stays
        if release is not None:
            to = session.floor if let_out else None
            if boardings.has_left(boarding, release, to, self._rules):
                return _Parting.LEFT
        doubt = boardings.leaves_doubt(boarding, release, arrived=arrived, has_words=session.has_words, let_out=let_out)
        return _Parting.DOUBT if doubt else _Parting.DONE

    def end_again(self, release: Ask, now: float) -> None:
        """Take a release that finds no session: what the lift should have been told by an earlier one is told again.

        Only the word that the robot left ends a doubt: an idle client posts bare releases once a second.
        """
        mine = release.holder == self._abandoned_by and release.robot is RobotWord.LEFT
        if mine and self._boarding.who is not Who.ABOARD:
            self.found_empty(now)
        elif mine and self._boarding.may_leave_at is not None:
            self._boarding, self._abandoned_by = Boarding(), None
            self._report_left(release.floor, now)
        elif self._abandoned_by is None:
            self._left.again(now)

    def occupied_by(self, session: Session | None) -> tuple[Holder, bool] | None:
        """Return whose robot may be in the car, and whether it is known to be; None where there is none."""
        holder = session.holder if session is not None else self._abandoned_by
        if holder is None or not boardings.possible(self._boarding):
            return None
        return holder, self._boarding.who is Who.ABOARD

    def left_behind(self, session: Session | None, release: Ask | None) -> LeftBehind:
        """Return what outlives a session: as it goes on, or were it over with this `release`."""
        if session is None or release is None or self._abandoned_by is not None:
            return LeftBehind(self.occupied_by(session), left_untold=self.untold)
        parting = self._parting(session, release, arrived=False)
        occupied = (session.holder, self._boarding.who is Who.ABOARD) if parting is _Parting.DOUBT else None
        return LeftBehind(occupied, left_untold=self.untold or (parting is _Parting.LEFT and self._left.known))

    def take_up(self, holder: Holder, *, aboard: bool) -> None:
        """Remember whose robot may be in the car from before this process began."""
        self._abandoned_by, self._boarding = holder, boardings.taken_up(aboard=aboard)

    def kept(self) -> KeptBoarding:
        """Return what a restart must know of the session's robot."""
        boarding = self._boarding
        return KeptBoarding(
            who=boarding.who,
            sent_on=boarding.sent_on,
            may_leave_at=boarding.may_leave_at,
            in_place_told=self._in_place.known and self._in_place.taken,
        )

    def owe_left(self) -> None:
        """Owe the lift the word that a robot left before this process began."""
        self._left.restore(self._options.floors[0], 0.0, taken=False)

    def to_see_to(self, session: Session | None, *, fire: bool) -> Callable[[float], None] | None:
        """Return what to do once a person has seen to the car and the lift; None where nothing of ours needs one.

        After a fire, and behind a robot that may be in the car, the lift is told once more that an earlier one left. A word
        that is on its way for the first time needs nobody: a lift that never heard it would take no robot any more.
        """
        if session is None and self.occupied_by(None) is not None:
            return self.found_empty
        return self._forget_left if self.untold and self._left.late and not fire else None

    def _forget_left(self, _: float) -> None:
        self._left.forget()
        self._outputs.let_go(self._left.command)
        self._after_left()

    def restore(self, kept: KeptBoarding, floor: FloorName, permit: Permit, now: float) -> None:
        """Go on with the robot of a session from before a restart. What the lift was told is not said again."""
        self._abandoned_by = None
        self._boarding = Boarding(kept.who, may_leave_at=kept.may_leave_at, sent_on=kept.sent_on)
        if kept.in_place_told:
            self._in_place.restore(floor, now, taken=True)
            if self._in_place.is_level and kept.who is Who.ABOARD:
                self._outputs.adopt(self._in_place.command, permit)

    def found_empty(self, now: float) -> None:
        """Take it that no robot of an earlier session is in the car; a lift that may still count one is told."""
        was_aboard = self._boarding.who is Who.ABOARD
        self._abandoned_by, self._boarding = None, Boarding()
        if was_aboard:
            self._report_left(self._options.floors[0], now)
        else:
            self._in_place.forget()

    def let_go(self) -> None:
        """Let go of everything at once."""
        self._let_go_of_stay()
        self._outputs.let_go(self._left.command)

    def _let_go_of_stay(self) -> None:
        """Let go of what is on for a robot that boards, rides or leaves."""
        self._button.let_go()
        self._outputs.let_go(self._in_place.command)

    def _report_left(self, floor: FloorName, now: float) -> None:
        """Tell the lift that the robot left. What stays on until then is let go once it has been told."""
        if not self._in_place.taken:
            self._outputs.let_go(self._in_place.command)
        self._in_place.forget()
        self._left.forget()
        self._left.want(floor, now)
        if self._button.until != "robot_left":
            self._button.let_go()
        if not self._left.pending:
            self._after_left()

    def _keep_until_told(self) -> None:
        """Put what stays on until the lift knows that the robot left under the permit of that word: the session's is over."""
        self._button.keep_on(self._permit)
        if self._in_place.is_level and self._outputs.given(self._in_place.command):
            self._outputs.hold(self._in_place.command, self._permit)

    def _after_left(self) -> None:
        """Let go of what was on for the robot aboard."""
        self._button.let_go_at("robot_left")
        if self._in_place.is_level:
            self._outputs.let_go(self._in_place.command)


def _a_person_looks(lift: str) -> str:
    return f"a person must look into the car and say so: {how_to_acknowledge(lift)}"


def _tried_again(lift: str) -> str:
    return f"it is given again until it is taken, or until a person has seen to the lift: {how_to_acknowledge(lift)}"
