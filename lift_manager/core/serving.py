"""What is pressed and held for the session that holds a lift, reading by reading. Nothing here waits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from drivers.model import FloorName
from lift_manager.core.announce import Announcer
from lift_manager.core.calling import CallButton, Press
from lift_manager.core.closing import DoorClosing
from lift_manager.core.doors import DoorHolds
from lift_manager.core.handshake import Handshake
from lift_manager.core.options import LiftOptions
from lift_manager.core.outputs import LiftOutputs, Permit
from lift_manager.core.session_call import SessionCall
from lift_manager.domain import call as calls
from lift_manager.domain import session as sessions
from lift_manager.domain.boarding import Who
from lift_manager.domain.call import Call, CallPhase
from lift_manager.domain.following import View
from lift_manager.domain.service import EndReason
from lift_manager.domain.session import KeptSession, Session
from lift_manager.domain.sight import Sight, barred, left, shuts
from register_maps.words import Door

UNGRANTED_S = 30.0
"""So long a door is held although the lift does not grant robot mode. Chosen: longer than a robot that saw it open takes through it, and
than a controller takes to grant the mode again."""

End = tuple[EndReason, str]
"""Why a session is over, as a code and in words."""


class Serving:
    """The call and the holds of a session. Each step returns the session as it goes on, or why it is over."""

    def __init__(
        self,
        outputs: LiftOutputs,
        options: LiftOptions,
        button: CallButton,
        handshake: Handshake,
        say: Announcer,
        *,
        press: Press,
        used: Callable[[Session], None],
    ) -> None:
        """`used` hears of the session as it is, just before something is held for it."""
        self.call = SessionCall(options.name, outputs.capabilities, button)
        self.doors = DoorHolds(outputs, options)
        self.closing = DoorClosing(outputs, press)
        self.awaits = ""
        """What the lift, or the holder, has still to give."""
        self._able = outputs.capabilities
        self._options = options
        self._button = button
        self._handshake = handshake
        self._say = say
        self._used = used
        self._ungranted: tuple[tuple[int, FloorName], float] | None = None
        """At which stop of which session a door was to be held without robot mode, and since when."""
        self._found_held = False
        """A door hold of before a restart waits until the car is seen to stand there."""

    def restore(self, session: Session, kept: KeptSession, permit: Permit, now: float) -> None:
        """Keep on what is found on after a restart, and press nothing."""
        if session.floor is None:
            return
        self.call.restore(session.floor, pressed=kept.pressed, now=now)
        self._handshake.restore(kept.boarding, session.floor, permit, now)
        if kept.pressed:
            self._button.adopt(session.floor, permit, aboard=self._handshake.aboard is True)
        if session.holding_since is not None and session.hold_door:
            self.doors.adopt(session.floor, permit)
            self._found_held = True

    def door_held(self, session: Session, sight: Sight | None) -> bool:
        """Whether what keeps the door open at the session's floor is on and verified, where the map has anything for that.

        The hold of a door that is seen shut or closing is none: a controller whose watchdog let go of it may read on still.
        """
        if session.floor is None or not self.doors.held(session.floor):
            return False
        if sight is not None and shuts(sight, self._options.doors_at[session.floor]):
            return False
        return not self._call_is_hold(session) or (
            self.call.told and self._button.keeps_door and not self._button.forgotten
        )

    @property
    def door_given(self) -> bool:
        """Whether anything is on, or asked for, to hold a door; whether the lift shows that is another question."""
        return self.doors.given or self._call_keeps_door

    @property
    def keeps_found_hold(self) -> bool:
        """Whether a door hold of before a restart waits until the car is seen to stand there."""
        return self._found_held

    @property
    def _call_keeps_door(self) -> bool:
        return self.call.arrived and not self._button.door_at_rest

    def keeps_open(self, session: Session, sight: Sight | None) -> bool:
        """Whether the door is held at the session's floor, on a map that has anything for that."""
        # a session from before a restart may name a floor that is no more
        if session.floor is None or session.floor not in self._options.floors:
            return False
        return self.why_no_hold(session.floor) is None and self.door_held(session, sight)

    def wants(self, session: Session, now: float, *, holds_again: bool = False) -> None:
        """Take a request that was accepted: a new call, or the same one again; `holds_again` after the hold was spent."""
        self.closing.forget()
        if session.floor is None:
            return
        moves_on = self.call.elsewhere(session.floor)
        if moves_on:
            self._found_held = False
        if moves_on and self._handshake.ready:
            self._button.let_go()
        holds_door = self._button.holds_door(session.floor, aboard=self._handshake.aboard is True)
        if moves_on or not (session.hold_spent and holds_door):
            self.call.want(session.floor, now)
        if (session.stays or holds_again) and self._needs_call(session) and not self._button.keeps_door:
            self.call.want_again(now)

    def let_go_of_door(self) -> None:
        """Let go of whatever holds the door; a call under way stays, though it may keep the door open where it ends."""
        self.closing.forget()
        self._let_go_of_doors()
        if self.call.arrived:
            self._button.let_go_of_door()

    def view(self, session: Session, sight: Sight | None, waits: str, now: float) -> View:
        """Return what the session has on the lift; `waits` is what it waits for."""
        in_place, left_word = self._handshake.told(now)
        return View(
            floor=session.floor,
            call=self.call.progress(now),
            door_held=self.door_held(session, sight),
            door_given=self.door_given,
            door_free=self.doors.at_rest and not self._call_keeps_door,
            hold_spent=session.hold_spent,
            in_place=in_place,
            left=left_word,
            close=self.closing.told,
            waits=waits,
        )

    def close(self, permit: Permit, now: float) -> None:
        """Press the close button where that is wanted, once nothing of ours holds the door."""
        self.closing.act(permit, now, free=self.doors.at_rest and self._button.door_at_rest)

    def why_no_hold(self, floor: FloorName) -> str | None:
        """Say why the door at a floor cannot be held; None where it can."""
        on_call = (self._button.holds_door(floor, aboard=aboard) for aboard in (False, True))
        if self.doors.known(floor) or any(on_call):
            return None
        return f"its map {self._able.map_name} has no hold for every door at {floor}"

    def why_no_close(self, session: Session | None, sight: Sight | None) -> str | None:
        """Say why the close button may not be pressed now; None when it may."""
        if session is None or session.floor is None or sight is None:
            return "nobody knows where the car stands"
        floor = session.floor
        if not (self.call.arrived and sight.floor == floor and sight.standing):
            return f"the car does not stand at {floor} for this session"
        if self._handshake.who is Who.MAY_BOARD:
            return "the robot may be in the doorway; say robot_in_place or robot_left first"
        return "the door is to be held" if session.hold_door else None

    def end(self) -> None:
        """Let go of the doors, and follow nothing any more."""
        self.call.forget()
        self.closing.forget()
        self.awaits, self._found_held = "", False
        self.doors.let_go()

    def advance(self, session: Session, sight: Sight, permit: Permit, now: float) -> Session | End:
        """Press, hold and let go for a session, as far as a fresh reading allows. `permit` is that of its presses."""
        call = self.call.now
        if call is None:
            self._handshake.seen(sight, None, now)
            return session
        is_hold = self._needs_call(session)
        call = self.call.seen(call, sight, now, is_hold=is_hold)
        self.awaits = _awaited(session, call, is_hold=is_hold)
        self._handshake.seen(sight, session, now)
        command = self._handshake.next_command(call.floor)
        missing = calls.missing(sight, self._able, command) if call.phase is CallPhase.WANTED else None
        if missing:
            self.doors.let_go()
            return self._await_grant(session, call, f"{', '.join(sorted(missing))} for {command}", now)
        if call.phase is CallPhase.WANTED and not self._handshake.ready:
            return self._await_word(session, sight, permit, now)
        if is_hold and call.phase is CallPhase.WANTED and sight.floor == call.floor and sight.must_close:
            self._let_go_of_doors()
            return session
        if not session.ending and calls.may_press(call, sight, self._able, now, is_hold=is_hold):
            self._let_go_of_doors()
            self.call.press(call, permit, aboard=self._handshake.aboard is True, now=now)
        elif call.phase is CallPhase.ARRIVED:
            self._button.let_go_at("arrived")
            self._found_held = False
            return self._stay(session, call, sight, permit, now)
        else:
            if call.phase is CallPhase.FAILED and self._button.until:
                self._button.let_go()
            return self._keep_found(session, call, sight, permit, now)
        return session

    def unread(self, session: Session, now: float) -> Session:
        """Let go of the doors once the site's limit of a hold has come: that needs no reading."""
        after = self._spent(session, now)
        if after is not session:
            self._let_go_of_doors()
            self._button.let_go_of_door()
        return after

    def _call_is_hold(self, session: Session) -> bool:
        """Whether nothing but the call to the session's floor keeps the door open there."""
        if session.floor is None:
            return False
        aboard = self._handshake.aboard is True
        return self._button.holds_door(session.floor, aboard=aboard) and not self.doors.known(session.floor)

    def _needs_call(self, session: Session) -> bool:
        """Whether the call is missed while it is off: it is what keeps the door open, and the robot has not said that it left."""
        wanted = session.hold_door and not session.hold_spent and self._call_is_hold(session)
        return wanted and self._handshake.kept().who is not Who.LEFT

    def _let_go_of_doors(self) -> None:
        self._found_held = False
        self.doors.let_go()

    def _keep_found(self, session: Session, call: Call, sight: Sight, permit: Permit, now: float) -> Session:
        """Keep a hold that a restart found on, as long as nothing says that the car has left; let go of any other one."""
        has_left = left(sight, call.floor)
        if not (self._found_held and session.hold_door) or has_left:
            self._let_go_of_doors()
            # once the car has left, a hold begins from the beginning
            return replace(session, holding_since=None) if has_left and session.holding_since is not None else session
        return self._hold_open(session, sight, call.floor, permit, now, begin=False)

    def _await_word(self, session: Session, sight: Sight, permit: Permit, now: float) -> Session:
        """Stay open for a robot aboard until the lift has been told of it; a robot on its way out needs nothing more."""
        if self._handshake.aboard and sight.floor is not None and sight.standing:
            return self._hold_open(session, sight, sight.floor, permit, now)
        self.doors.let_go()
        return session

    def _await_grant(self, session: Session, call: Call, what: str, now: float) -> Session | End:
        """Let the lease stand still while the lift has not granted what is needed, such as robot mode, but not for ever."""
        self.awaits = f"{what}, which the lift has not granted yet"
        if now - call.since > self._able.granted_within_s:
            return EndReason.NOT_GRANTED, f"{what} was not granted within {self._able.granted_within_s:g} s"
        return replace(session, lease_from=now)

    def _stay(self, session: Session, call: Call, sight: Sight, permit: Permit, now: float) -> Session | End:
        """Hold the door at the session's floor, or end a session that wanted no more than to get there.

        A robot aboard keeps its session: it has still to get out.
        """
        if not session.hold_door and not session.stays and self._handshake.aboard is not True:
            return EndReason.ARRIVED, "arrived"
        if self._handshake.door_is_open(sight, call.floor):
            session = sessions.stood_open(session, now)
        if session.hold_door:
            return self._hold_open(session, sight, call.floor, permit, now)
        if session.stays:
            self._let_go_of_doors()
            self._button.let_go_of_door()
            return session
        # what is on from before stays on for a robot aboard, but no longer than any hold
        session = self._spent(session, now)
        if session.hold_spent:
            self._let_go_of_doors()
            self._button.let_go_of_door()
        return session

    def _hold_open(
        self, session: Session, sight: Sight, floor: FloorName, permit: Permit, now: float, *, begin: bool = True
    ) -> Session:
        """Hold the doors that serve a floor, and the call that keeps them open, for as long as the site allows.

        After a restart what is found off stays off until the holder is heard.
        """
        session = self._spent(session, now)
        is_barred = barred(sight.values, self._able) is not None or self._is_for_nobody(session, sight, floor, now)
        # no robot was invited here, and none will be while our hold keeps the door from closing
        must_close = sight.must_close and floor == session.floor and not session.stood_open
        if session.hold_spent or is_barred or must_close:
            self._let_go_of_doors()
            if session.hold_spent:
                self._button.let_go_of_door()
                session = self._seen_shut(session, sight, floor, now)
            else:
                self._button.interrupt()
            return session
        session = replace(session, holding_since=now if session.holding_since is None else session.holding_since)
        self._used(session)
        self._button.keep_on(permit)
        self.doors.hold(floor, permit, begin=begin and session.may_begin and not sight.must_close)
        if session.closing is not None:
            # one that the controller loses now stays off: a lockout forbids to press it again
            self.doors.keep()
        return session

    def _spent(self, session: Session, now: float) -> Session:
        """End a hold that has lasted for as long as the site allows."""
        ends_at = sessions.hold_ends_at(session, self._options.max_session_hold_s)
        if ends_at is None or now < ends_at or session.hold_spent:
            return session
        self._say.hold_spent(session.holder, self._options.max_session_hold_s)
        return replace(session, hold_spent=True, holding_since=None)

    def _seen_shut(self, session: Session, sight: Sight, floor: FloorName, now: float) -> Session:
        """Note when the door is seen shut after its hold was spent: from then on people have their turn."""
        if not (self.doors.at_rest and self._button.door_at_rest):
            return session
        doors, here = sight.values.doors, self._options.doors_at[floor]
        shut = left(sight, floor) or (bool(here) and all(doors.get(side) is Door.CLOSED for side in here))
        return replace(session, shut_at=now) if shut and session.shut_at is None else session

    def _is_for_nobody(self, session: Session, sight: Sight, floor: FloorName, now: float) -> bool:
        """Whether a held door has invited no robot for long, because the lift has no robot mode: it would keep the lift from people.

        And from the mode: a controller that grants it once its calls are served waits for the door in turn.
        """
        if "robot_mode_on" not in self._able.signals or sight.values.flags.get("robot_mode_on", False):
            self._ungranted = None
            return False
        stop = (session.number, floor)
        if self._ungranted is None or self._ungranted[0] != stop:
            self._ungranted = stop, now
        if now - self._ungranted[1] <= UNGRANTED_S:
            return False
        self.awaits = (
            f"robot_mode_on, which the lift has not granted for {UNGRANTED_S:g} s; its door is not held meanwhile"
        )
        return True


def _awaited(session: Session, call: Call, *, is_hold: bool) -> str:
    """Say what the holder has to do; empty where nothing waits for it."""
    if call.phase is not CallPhase.FAILED:
        return ""
    if session.restored:
        return f"{session.holder} to ask again after a restart of the manager"
    if is_hold and call.reached:
        return f"{session.holder} to ask again, because the call that keeps the door open is off"
    return ""
