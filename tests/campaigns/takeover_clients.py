"""Who uses the lift in the takeover campaign: a client of the workshop API, or a robot with rides of /api/v1. One pair has one of them."""

from collections.abc import Callable
from random import Random
from typing import Any, Protocol

import httpx

from lift_manager.lab.bench.simulator import LiftSimulator
from tests.campaigns.takeover_rig import DOOR_OPEN, LIFT, Machine
from tests.support.programs import HANGS_S

AGAIN = 0.1
"""How often a robot announces itself though it sees nothing that would require it: the same manager may be active in a new term."""

Found = Callable[[str], None]
"""Reports a finding."""


class Client(Protocol):
    """Requests the lift of whoever is active."""

    ridden: int
    """Rides that have ended well."""

    def act(self, machine: Machine) -> None:
        """Do the next thing."""
        ...

    def expects_session(self) -> bool:
        """Whether the lift certainly has a session now: something was pressed for it, and so after it was committed."""
        ...

    def judge(self, machine: Machine) -> None:
        """After a takeover by this machine that was expected to keep the session."""
        ...

    def unfinished(self) -> str:
        """Return what is begun and has to end well; empty if nothing is."""
        ...


class Requests:
    """Requests any floor with an open door, again and again."""

    ridden = 0

    def __init__(self, lift: LiftSimulator, dice: Random, found: Found) -> None:
        self._lift, self._dice, self._found = lift, dice, found
        self._floor = ""
        self._since: int | None = None
        """How many writes there were when the present hold was requested; None if nothing certain is known about a session."""

    def act(self, machine: Machine) -> None:
        floor = self._dice.choice(self._lift.floors)
        before, self._since = self._since, None
        seen = len(self._lift.writes)
        try:
            params, body = {"lift_name": LIFT}, {"floor": floor, "door_state": DOOR_OPEN}
            reply = machine.http.post("/open-rmf/demo-lift/lift_request", params=params, json=body).json()
        except (httpx.HTTPError, ValueError):
            return
        if reply["success"]:
            self._since = before if before is not None and floor == self._floor else seen
            self._floor = floor
        else:
            self._since = before

    def expects_session(self) -> bool:
        return self._since is not None and any(write.on for write in self._lift.writes[self._since :])

    def judge(self, machine: Machine) -> None:
        if not _has_session(machine):
            self._found(f"{machine.name} took over without the session to {self._floor}")

    def unfinished(self) -> str:
        return ""


class Robot:
    """Rides from any floor to any other, one ride after another, and repeats what had no answer or is not recorded."""

    def __init__(self, lift: LiftSimulator, dice: Random, found: Found) -> None:
        self._lift, self._dice, self._found = lift, dice, found
        self.ridden = 0
        self._begun = 0
        self._wish: dict[str, str] | None = None
        """The ride that is requested, until it is over."""
        self._ride: dict[str, Any] | None = None
        """As it was answered last."""
        self._since = 0
        self._announced_to = ""
        self._word = ""
        """What it has reported, `entered` or `left`, until that is recorded."""

    def act(self, machine: Machine) -> None:
        try:
            if self._ride is None:
                self._begin(machine)
            else:
                self._follow(machine, self._ride)
        except httpx.HTTPError:
            return

    def _begin(self, machine: Machine) -> None:
        if self._wish is None:
            self._begun += 1
            start, destination = self._dice.sample(self._lift.floors, 2)
            self._wish = {
                "lift": LIFT,
                "from": start,
                "to": destination,
                "robot": "robot",
                "idempotency_key": f"{self._begun}",
            }
            self._since = len(self._lift.writes)
        reply = machine.http.post("/api/v1/rides", json=self._wish)
        if _is_recorded(reply):
            self._ride, self._announced_to = reply.json(), machine.life

    def _follow(self, machine: Machine, ride: dict[str, Any]) -> None:
        path = f"/api/v1/rides/{ride['id']}"
        is_new = self._announced_to != machine.life or self._dice.random() < AGAIN
        if is_new and machine.http.post(f"{path}/here").is_success:
            self._announced_to = machine.life
        if self._word:
            self._say(self._word, machine, path)
        reply = machine.http.get(path)
        if reply.status_code == httpx.codes.NOT_FOUND:
            self._found(f"{machine.name} does not know the ride {self._wish}, last {ride['phase']}")
            self._ride = self._wish = None
            return
        if not reply.is_success:
            return
        self._ride = ride = reply.json()
        match str(ride["guidance"]):
            case "enter":
                self._say("entered", machine, path)
            case "leave":
                self._say("left", machine, path)
            case "done" if not self._word:
                self.ridden += 1
                self._ride = self._wish = None
            case "gave_up":
                self._found(f"{machine.name} gave the ride {self._wish} up: {ride['reason']}")
                machine.http.post(f"{path}/left")
                self._ride = self._wish = None
                self._word = ""
            case _:
                pass

    def _say(self, word: str, machine: Machine, path: str) -> None:
        self._word = word
        reply = machine.http.post(f"{path}/{word}")
        # a word that the ride does not take now was taken before, or comes again
        if _is_recorded(reply) or reply.status_code == httpx.codes.CONFLICT:
            self._word = ""

    def expects_session(self) -> bool:
        under_way = self._ride is not None and self._ride["phase"] in ("called", "boarding", "riding", "alighting")
        return under_way and any(write.on for write in self._lift.writes[self._since :])

    def judge(self, machine: Machine) -> None:
        if self._ride is None or self._wish is None:
            return
        if not _has_session(machine):
            reply = machine.http.get(f"/api/v1/rides/{self._ride['id']}", timeout=HANGS_S)
            # its last word may have ended the ride just before
            if not (reply.is_success and reply.json()["phase"] == "done"):
                self._found(
                    f"{machine.name} took over without the session of the ride {self._wish}: {reply.text[:300]}"
                )

    def unfinished(self) -> str:
        return (
            ""
            if self._wish is None
            else f"{self._wish}, answered with {self._ride}, reported {self._word or 'nothing more'}"
        )


def _is_recorded(reply: httpx.Response) -> bool:
    """Whether a change was made, and no crash can lose it any more."""
    return reply.is_success and reply.json().get("recorded", True) is True


def _has_session(machine: Machine) -> bool:
    """Whether the lift has one; True if that cannot be read now."""
    try:
        reply = machine.http.get(f"/api/v1/lifts/{LIFT}", timeout=HANGS_S)
    except httpx.HTTPError:
        return True
    return reply.status_code != httpx.codes.OK or reply.json()["session"] is not None
