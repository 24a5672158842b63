"""Commands from the hub: fresh, signed with a key of the site, of a closed list, and never begun twice."""

import asyncio
import json
from collections.abc import Callable
from typing import Any

import pytest

from lift_manager.api.keys import Key, KeyRing, Secret, digest_of, token
from lift_manager.api.roles import Role
from lift_manager.hub.commands import Commands
from lift_manager.hub.errors import SiteRefused
from lift_manager.hub.messages import TICKET_S, CommandMessage, SignedCommand
from lift_manager.hub.signing import sign, signed_text
from lift_manager.lift.commands import CommandType
from lift_manager.lift.refusals import Refusal, Refused
from lift_manager.lift.session import Holder
from lift_manager.rides.ride import Phase
from lift_manager.runtime.errors import RequestRefused
from tests.lift_manager.web.fake import FakeSite
from tests.lift_manager.web.fake_rides import a_ride
from tests.lift_manager.web.fake_sessions import a_session

SECRET = "5" * 64
ROBOT, VIEWER, OPERATOR = (token(f"{number:08x}", SECRET) for number in range(3))
RING = KeyRing(
    [
        (Key("00000000", "amr", Role.ROBOT, ("lift",)), digest_of(SECRET)),
        (Key("00000001", "board", Role.VIEWER), digest_of(SECRET)),
        (Key("00000002", "desk", Role.OPERATOR), digest_of(SECRET)),
    ]
)
OPEN = {"what": "open", "body": {"robot": "r1", "ttl_s": 60.0, "idempotency_key": "a"}}
OWN = a_session(Holder("hub", "amr/r1"))
GO = {"what": "command", "session": OWN.id, "body": {"do": "go_to", "floor": "L2", "idempotency_key": "b"}}

RIDE = {"what": "ride", "body": {"lift": "any", "from": "L1", "to": "L2", "robot": "r1", "idempotency_key": "d"}}
CANCEL = {"what": "cancel_ride", "ride": "r7", "body": {"reason": "no order"}}

Change = Callable[[dict[str, Any]], None]


class Caller:
    """Sends commands to a site as they arrive from a hub, on a clock turned by hand."""

    def __init__(self, site: FakeSite | None = None) -> None:
        self.site = site or FakeSite()
        self.site.there(OWN)
        self.commands = Commands("berlin", self.site, RING)

    def send(
        self,
        action: object,
        *,
        key: Secret = ROBOT,
        lift: str = "lift",
        late_s: float = 0.0,
        change: Change = lambda _: None,
    ) -> Any:
        """Sign a command with a new ticket, change what was signed, and let it arrive so much later."""
        ticket, text = self.commands.tickets.issue(0.0), json.dumps(action)
        key_id, signature = sign(key, signed_text("berlin", lift, ticket, text))
        sent = {"ticket": ticket, "key_id": key_id, "signature": signature, "action": text, "lift": lift}
        change(sent)
        return self.deliver(sent, late_s)

    def deliver(self, sent: dict[str, Any], at: float = 0.0) -> Any:
        command = SignedCommand(**{name: value for name, value in sent.items() if name != "lift"})
        message = CommandMessage(lift=sent["lift"], command=command)
        return asyncio.run(self.commands.carry_out(message, at))

    def refused(self, action: object, **how: Any) -> str:
        """Send a command that is refused, and return the code; nothing was done."""
        with pytest.raises(SiteRefused) as found:
            self.send(action, **how)
        assert self.site.changes == []
        return found.value.problem.code


def test_a_session_is_opened_in_the_name_of_the_key_and_robot_that_signed() -> None:
    caller = Caller()
    assert caller.send(OPEN).session.holder == "hub:amr/r1"
    assert caller.site.done == [("open", "lift", Holder("hub", "amr/r1"), "a", 60.0)]


def test_the_same_idempotency_key_begins_nothing_twice() -> None:
    caller = Caller()
    assert caller.send(OPEN).session.id == caller.send(OPEN).session.id


def test_a_command_is_that_of_the_session() -> None:
    caller = Caller()
    assert caller.send(GO).command.do is CommandType.GO_TO


@pytest.mark.parametrize("late_s", [TICKET_S, TICKET_S + 60])
def test_what_arrives_later_than_its_ticket_allows_does_nothing(late_s: float) -> None:
    assert Caller().refused(GO, late_s=late_s) == "ticket_over"


def test_what_arrives_twice_is_carried_out_once() -> None:
    caller = Caller()
    sent: list[dict[str, Any]] = []
    caller.send(OPEN, change=sent.append)
    with pytest.raises(SiteRefused) as found:
        caller.deliver(sent[0])
    assert found.value.problem.code == "ticket_over"
    assert len(caller.site.done) == 1


@pytest.mark.parametrize(
    "changed",
    [
        {"lift": "goods"},
        {"action": json.dumps({**GO, "session": "another"})},
        {"ticket": "that-of-another"},
        {"key_id": "00000002"[:-1] + "9"},
        {"signature": "A" * 43},
    ],
    ids=lambda changed: next(iter(changed)),
)
def test_a_hub_that_changes_anything_of_it_is_found_out(changed: dict[str, str]) -> None:
    assert Caller().refused(GO, change=lambda sent: sent.update(changed)) == "bad_key"


def test_a_command_for_another_site_counts_for_nothing_here() -> None:
    def for_another(sent: dict[str, Any]) -> None:
        sent["signature"] = sign(ROBOT, signed_text("rome", sent["lift"], sent["ticket"], sent["action"]))[1]

    assert Caller().refused(GO, change=for_another) == "bad_key"


def test_a_key_may_do_what_it_may_do_at_the_site() -> None:
    assert Caller().refused(OPEN, key=VIEWER) == "not_allowed"
    assert Caller().refused(OPEN, lift="goods") == "not_allowed"
    assert Caller().send(OPEN, lift="goods", key=OPERATOR).session.lift == "goods"


def test_a_session_of_another_key_or_face_does_not_exist_here() -> None:
    caller = Caller()
    caller.site.there(a_session(Holder("api", "amr/r1"), "s7"))
    for session, key in ((OWN.id, OPERATOR), ("s7", ROBOT), ("none", ROBOT)):
        assert caller.refused({**GO, "session": session}, key=key) == "no_such_session"


@pytest.mark.parametrize("what", ["acknowledge", "lockout", "lockout_end", "drain", "release", "hand_over", ""])
def test_what_people_decide_at_the_lift_does_not_exist_here(what: str) -> None:
    assert Caller().refused({"what": what, "by": "M. Weber", "reason": "none"}, key=OPERATOR) == "malformed"


@pytest.mark.parametrize("do", ["close_door", "robot_in_place", "robot_left"])
def test_what_only_somebody_at_the_lift_knows_is_not_taken_from_afar(do: str) -> None:
    body = {"do": do, "idempotency_key": "c"} | ({"clear": True} if do == "close_door" else {})
    assert Caller().refused({**GO, "body": body}) == "not_possible"


@pytest.mark.parametrize("action", [{"what": "open", "body": {}}, {**GO, "body": {"do": "go_to", "floor": "L2"}}])
def test_what_begins_something_needs_an_idempotency_key(action: object) -> None:
    assert Caller().refused(action) == "malformed"


def test_the_rules_of_the_lift_refuse_as_for_every_caller() -> None:
    caller = Caller(FakeSite(refuses=Refused(Refusal.FIRE_LATCHED, "there was a fire")))
    with pytest.raises(RequestRefused, match="there was a fire"):
        caller.send(OPEN)


def ride_of(lift: str, **body: object) -> dict[str, Any]:
    return {"what": "ride", "body": {"lift": lift, "from": "L1", "to": "L2", "idempotency_key": "d", **body}}


def test_a_ride_is_begun_from_afar_in_the_name_under_which_its_robot_reports_at_the_site() -> None:
    caller = Caller()
    ride = caller.send(RIDE, lift="").ride
    (request,) = caller.site.fake_rides.requests
    assert (ride.caller, ride.robot, request.lifts, request.any_lift) == ("ride:amr/r1", "r1", ("lift",), True)
    assert caller.site.fake_rides.remote == [True]
    assert not {"guidance", "reason", "advice"} & set(ride.model_dump())
    assert caller.send(RIDE, lift="").ride.id == ride.id
    assert caller.send(RIDE, lift="", key=OPERATOR).ride.lift == "lift"
    assert caller.site.fake_rides.requests[-1].lifts == ("lift", "goods")


def test_a_plan_of_a_ride_begins_nothing_and_needs_no_idempotency_key() -> None:
    caller = Caller()
    planned = {"what": "ride", "body": {"lift": "lift", "from": "L1", "to": "L2", "dry_run": True}}
    assert caller.send(planned, lift="").plan.lift == "lift"
    assert caller.site.changes == []


def test_a_ride_needs_an_idempotency_key_a_lift_of_the_key_and_no_other_lift_beside_its_own() -> None:
    caller = Caller()
    assert caller.refused(ride_of("lift", idempotency_key=None), lift="") == "malformed"
    assert caller.refused(ride_of("goods"), lift="") == "not_allowed"
    assert caller.refused(RIDE, lift="", key=VIEWER) == "not_allowed"
    assert caller.refused(RIDE, lift="lift") == "malformed"
    assert caller.refused(OPEN, lift="") == "not_allowed"
    with pytest.raises(RequestRefused, match="no lift"):
        caller.send(ride_of("none"), lift="", key=OPERATOR)


def test_a_ride_is_cancelled_by_its_own_key_or_an_operators_and_never_as_a_report_of_its_robot() -> None:
    caller = Caller()
    caller.site.fake_rides.going_on(a_ride(Holder("ride", "amr/r1"), "r7"), a_ride(Holder("ride", "other"), "r8"))
    assert caller.refused({**CANCEL, "ride": "r8"}, lift="") == "not_your_ride"
    assert caller.refused(CANCEL, lift="", key=VIEWER) == "not_allowed"
    assert caller.send(CANCEL, lift="").ride.phase is Phase.CLEARING
    caller.send({**CANCEL, "ride": "r8"}, lift="", key=OPERATOR)
    assert caller.site.fake_rides.reports == [
        ("r7", "no order (through the hub, by amr)", None),
        ("r8", "no order (through the hub, by desk)", None),
    ]
    with pytest.raises(RequestRefused) as found:
        caller.send({**CANCEL, "ride": "none"}, lift="")
    assert found.value.code is Refusal.UNKNOWN_RIDE


@pytest.mark.parametrize("what", ["entered", "left", "here"])
def test_what_a_robot_reports_of_its_ride_is_not_taken_from_afar(what: str) -> None:
    assert Caller().refused({"what": what, "ride": "r7"}, lift="", key=OPERATOR) == "malformed"


def test_refusals_are_written_down_with_the_name_of_the_key() -> None:
    caller = Caller()
    caller.refused(OPEN, key=VIEWER)
    (away,) = caller.site.away
    assert (away.code, away.lift, away.caller) == ("not_allowed", "lift", "hub:board")
