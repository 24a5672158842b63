"""Carries out the commands that reach a site from the hub: checks freshness, signature, key and lift, then does what /api/v1 would."""

from __future__ import annotations

import hmac
from collections.abc import Sequence
from contextlib import suppress
from typing import Protocol

from pydantic import TypeAdapter, ValidationError

from lift_manager.api.keys import Key
from lift_manager.api.rides import ANY, Plan, RideRequest
from lift_manager.api.roles import OF_SOME_LIFTS, AccessLevel, commandable, refusal
from lift_manager.api.sessions import Command, Session
from lift_manager.hub.errors import SiteRefused
from lift_manager.hub.messages import (
    REMOTE,
    Action,
    BeginRide,
    CancelRide,
    CloseSession,
    CommandMessage,
    CommandResult,
    LiftAction,
    OpenSession,
    ProblemMessage,
    RemoteRide,
    RenewSession,
    RideAction,
    SendCommand,
)
from lift_manager.hub.signing import signature, signed_text
from lift_manager.hub.tickets import Tickets
from lift_manager.lift.commands import CommandRequest, SessionInfo
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import Holder
from lift_manager.rides import ride as rides
from lift_manager.runtime.errors import NotFound
from lift_manager.runtime.refusals import FaceRefusal
from lift_manager.runtime.site import Site
from lift_manager.web.callers import RIDE_FACE, ROBOT_SEPARATOR, holder_named

FACE = "hub"
"""The face of every holder whose session was opened through the hub."""

_ACTION: TypeAdapter[Action] = TypeAdapter(Action)


def read_action(text: str) -> Action:
    """Return the action of a command. Raises SiteRefused with the first mistake."""
    try:
        return _ACTION.validate_json(text)
    except ValidationError as error:
        found = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(part) for part in found["loc"])
        raise SiteRefused(
            ProblemMessage(code="malformed", status=422, message=f"action: {where} {found['msg']}")
        ) from error


class Signers(Protocol):
    """The keys of a site."""

    def find_by_id(self, key_id: str) -> tuple[Key, str] | None:
        """Return the live key with this id, and the digest of its secret."""
        ...


class Commands:
    """The commands of one site. Every refusal is raised: as RequestRefused by the rules, as SiteRefused here."""

    def __init__(self, site_id: str, site: Site, signers: Signers) -> None:
        self._site_id, self._site, self._signers = site_id, site, signers
        self.tickets = Tickets()

    async def carry_out(self, message: CommandMessage, now: float) -> CommandResult:
        """Do what a command says, once. Raises RequestRefused and SiteRefused."""
        lift, command = message.lift, message.command
        is_fresh = self.tickets.take(command.ticket, now)
        key = self._signer(message)
        if not is_fresh:
            text = "the ticket is not good: it was used, or the command arrived later than 2 s after it was issued. Nothing was done"
            raise self._refused("ticket_over", 409, text, lift, key)
        try:
            action = read_action(command.action)
        except SiteRefused as refused:
            raise self._refused("malformed", 422, str(refused), lift, key) from refused
        if isinstance(action, BeginRide | CancelRide):
            if lift:
                text = "action: a ride names its lift itself, and is sent for none"
                raise self._refused("malformed", 422, text, lift, key)
            return await self._carry_out_ride(action, key)
        self._require_allowed(key, (lift,))
        result = self._do(action, lift, key)
        recorded = await self._site.recorded(lift)
        return _with_recorded(result, recorded=recorded)

    def _signer(self, message: CommandMessage) -> Key:
        """Return the key that signed a command. Raises SiteRefused if there is none."""
        lift, command = message.lift, message.command
        text = signed_text(self._site_id, lift, command.ticket, command.action)
        found = self._signers.find_by_id(command.key_id)
        key, digest = (None, "0" * 64) if found is None else found
        matches = hmac.compare_digest(signature(digest, text), command.signature)
        if key is None or not matches:
            why = "the signature is not that of a live key of this site: sign with a key of the site, not with that of the hub"
            raise self._refused("bad_key", 401, why, lift, None)
        return key

    def _require_allowed(self, key: Key, lifts: Sequence[str]) -> None:
        """Raise SiteRefused if a key may not command all of these lifts."""
        if why := refusal(key.role, key.lifts, AccessLevel.COMMAND, lifts):
            raise self._refused("not_allowed", 403, why, "".join(lifts[:1]), key)

    async def _carry_out_ride(self, action: RideAction, key: Key) -> CommandResult:
        if isinstance(action, CancelRide):
            ride = self._cancel(action, key)
        else:
            request = self._ride_request(action.body, key)
            if action.body.dry_run:
                return CommandResult(plan=Plan.model_validate(self._site.rides.plan(request)))
            _require_idempotency(action.body.idempotency_key)
            ride = self._site.rides.begin(request, is_remote=True).ride
        recorded = await self._site.recorded(ride.lift)
        with suppress(NotFound):  # it may have been forgotten meanwhile
            ride = self._site.rides.ride(ride.id)
        return CommandResult(ride=RemoteRide.of(ride).model_copy(update={"recorded": recorded}))

    def _ride_request(self, body: RideRequest, key: Key) -> rides.RideRequest:
        """Return the request of a ride, which is that of the key, as at the site: there its robot reports with the same key."""
        lifts = commandable(key.role, key.lifts, self._site.lift_names()) if body.lift == ANY else (body.lift,)
        self._require_allowed(key, lifts)
        return body.of(holder_named(RIDE_FACE, key.name, body.robot), lifts)

    def _cancel(self, action: CancelRide, key: Key) -> rides.Ride:
        """Cancel a ride. Nobody reports for its robot from afar, so this counts as a decision of an operator."""
        ride = self._site.rides.ride(action.ride)
        self._require_allowed(key, (ride.lift,))
        if key.role in OF_SOME_LIFTS and ride.caller.name.partition(ROBOT_SEPARATOR)[0] != key.name:
            text = "another key began this ride; only that key, or an operator's, cancels it"
            raise self._refused(Refusal.NOT_YOUR_RIDE, 403, text, ride.lift, key)
        return self._site.rides.cancel(ride.id, None, f"{action.body.reason} (through the hub, by {key.name})")

    def _do(self, action: LiftAction, lift: str, key: Key) -> CommandResult:
        site = self._site
        match action:
            case OpenSession(body=body):
                _require_idempotency(body.idempotency_key)
                name = f"{key.name}/{body.robot}" if body.robot else key.name
                opened = site.open_session(lift, Holder(FACE, name), key=body.idempotency_key or "", ttl_s=body.ttl_s)
                return _session(opened.session)
            case RenewSession(session=session, body=renewal):
                own = self._own(lift, session, key)
                return _session(site.renew_session(lift, own.id, own.holder, renewal.ttl_s))
            case CloseSession(session=session):
                own = self._own(lift, session, key)
                return _session(site.close_session(lift, own.id, own.holder, None))
            case SendCommand(session=session, body=sent):
                _require_idempotency(sent.idempotency_key)
                own = self._own(lift, session, key)
                if sent.do not in REMOTE:
                    text = f"{sent.do} is not taken from the hub: it claims what only somebody at the lift knows"
                    raise self._refused(Refusal.NOT_POSSIBLE, 409, text, lift, key)
                request = CommandRequest(
                    session=own.id,
                    holder=own.holder,
                    kind=sent.do,
                    floor=sent.floor,
                    hold_door=sent.hold_door,
                    side=sent.door,
                    key=sent.idempotency_key or "",
                )
                return CommandResult(command=Command.of(site.command(lift, request)))

    def _own(self, lift: str, session: str, key: Key) -> SessionInfo:
        """Return a session that was opened through the hub with this key. Raises SiteRefused; the text does not reveal others."""
        try:
            found = self._site.session(lift, session, None)
        except NotFound as error:
            if error.code is not Refusal.NO_SUCH_SESSION:
                raise
        else:
            if found.holder.face == FACE and found.holder.name.partition("/")[0] == key.name:
                return found
        text = "this lift has no session of that id that was opened through the hub with this key"
        raise self._refused(Refusal.NO_SUCH_SESSION, 404, text, lift, key)

    def _refused(self, code: str, status: int, text: str, lift: str, key: Key | None) -> SiteRefused:
        """Write a refusal down, and return what is raised."""
        name = "" if key is None else f"{FACE}:{key.name}"
        self._site.turned_away(FaceRefusal(code, text, lift, name, "the hub"))
        return SiteRefused(ProblemMessage(code=code, status=status, message=text))


def _session(found: SessionInfo) -> CommandResult:
    return CommandResult(session=Session.model_validate(found))


def _require_idempotency(key: str | None) -> None:
    if key is None:
        text = "action: body.idempotency_key is missing: a reply may be lost on its way, and without it a repetition would begin twice"
        raise SiteRefused(ProblemMessage(code="malformed", status=422, message=text))


def _with_recorded(result: CommandResult, *, recorded: bool) -> CommandResult:
    changes = {"recorded": recorded}
    return CommandResult(
        session=None if result.session is None else result.session.model_copy(update=changes),
        command=None if result.command is None else result.command.model_copy(update=changes),
    )
