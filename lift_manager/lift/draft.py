"""A step while it is being worked out: the record so far, and the actions that follow from it. It never leaves its step."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from drivers.model import Command, OutputState, PressId
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.events import Alarm, Event
from lift_manager.lift.freshness import is_fresh
from lift_manager.lift.inputs import LEAVE_WITHIN_S, Action, Cancel, Press
from lift_manager.lift.observation import Moment, Observation
from lift_manager.lift.record import LiftRecord, PendingPress
from lift_manager.lift.session import Holder, Session


class Draft:
    """The one mutable thing in this package: rules read `record`, and change it with `change`."""

    def __init__(self, config: LiftConfig, record: LiftRecord, moment: Moment) -> None:
        self.config = config
        self.record = record
        self.moment = moment
        self.now = moment.now
        """Monotonic seconds."""
        self.actions: list[Action] = []
        self.events: list[Event] = []

    @property
    def session(self) -> Session | None:
        """The session that holds the lift now."""
        return self.record.session

    @property
    def observation(self) -> Observation | None:
        """What is known of the lift, unless it is too old."""
        return self.record.observation if is_fresh(self.config.capabilities, self.moment) else None

    def change(self, **fields: Any) -> None:
        """Go on with another record. The names are those of `LiftRecord`; the rules' tests see to the rest."""
        known = vars(self.record)
        for name, value in fields.items():
            # most changes of a step are none, and a copy costs more than this
            if known[name] is not value and known[name] != value:
                self.record = self.record.having(**fields)
                return

    def change_durable(self, **fields: Any) -> None:
        """Continue with a record whose durable part has changed."""
        durable = self.record.durable
        if any(getattr(durable, name) != value for name, value in fields.items()):
            self.record = self.record.having(durable=replace(durable, **fields))

    def emit(self, event: Event) -> None:
        """Publish an event once this step is done."""
        self.events.append(event)

    def alarm(self, text: str, holder: Holder | None = None) -> None:
        """Alert people to something."""
        self.events.append(Alarm(self.config.name, text, holder))

    def press(self, command: Command) -> PressId:
        """Press a command once this step is on the disk. An earlier press of it that has no outcome yet is withdrawn."""
        self.cancel(command)
        record = self.record
        press, session = record.presses_made + 1, record.session
        self.actions.append(
            Press(press, command, self.now + LEAVE_WITHIN_S, None if session is None else session.holder)
        )
        number = None if session is None else session.number
        pending = PendingPress(press, command, record.sequence + 1, number)
        self.change(presses=(*record.presses, pending), presses_made=press)
        return press

    def cancel(self, command: Command, press: PressId | None = None) -> None:
        """Withdraw every press of a command without an outcome; and `press`, whose pulse may still be on, whatever its outcome."""
        gone = tuple(pending for pending in self.record.presses if pending.command.name == command.name)
        ids = [pending.id for pending in gone]
        if press is not None and press not in ids and self.record.status(command) is not OutputState.AT_REST:
            ids.append(press)
        self.actions += [Cancel(one) for one in ids]
        if gone:
            self.change(presses=tuple(pending for pending in self.record.presses if pending not in gone))
