"""Requests made from the OpenAPI document, against a running manager with and without keys: no server error, no answer that the
document does not have, and nothing that the caller's role may not.

python -m tests.campaigns.rest --minutes 10 --seed 1
"""

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from http.cookiejar import DefaultCookiePolicy
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import httpx
import requests
import schemathesis
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from hypothesis.errors import Unsatisfiable
from pyModbusTCP.server import ModbusServer
from schemathesis import Case, GenerationMode
from schemathesis.checks import CHECKS, load_all_checks
from schemathesis.core.failures import FailureGroup
from schemathesis.core.result import Ok

from lift_manager.api.keys import Key
from lift_manager.api.roles import OF_SOME_LIFTS, Role
from lift_manager.store.keys import keys_path, make_key
from lift_manager.store.place import store_path
from lift_manager.web.access_page import COLUMNS
from tests.lift_manager.test_operate import Controller
from tests.lift_manager.web.test_access_table import cells
from tests.support.programs import HANGS_S, Program, Started, free_port

NAMED, OTHER = "east", "west"
CONFORMS = (
    "not_a_server_error",
    "status_code_conformance",
    "content_type_conformance",
    "response_headers_conformance",
    "response_schema_conformance",
)
TURNED_AWAY = {400, 401, 403, 404, 405, 431}
"""404 and 405: what was asked for became something else on the way, such as `..` in the place of a lift."""
READ_FIRST = {413, 422}
"""Where the lift is in the body, that is read before anything can be said of the lift."""


@dataclass(frozen=True)
class Caller:
    """Somebody who asks one of the two managers: the one with keys, or the one without."""

    name: str
    url: str
    key: str = field(default="", repr=False)


@dataclass
class Found:
    """What a run came to."""

    asked: Counter[tuple[str, str, int]] = field(default_factory=Counter)
    """Requests by caller, operation and status of the answer."""
    findings: list[str] = field(default_factory=list)


@dataclass
class Seen:
    """Sessions, commands and rides that the answers told, so that later requests name what there is."""

    sessions: list[dict[str, str]] = field(default_factory=list)
    """Path parameters; with the caller's name."""
    rides: list[dict[str, str]] = field(default_factory=list)
    keep: int = 40

    def learn(self, caller: str, case: Case[Any], answer: Any) -> None:
        """Take the ids of a new session, command or ride."""
        if answer.status_code not in {200, 201, 202} or case.method != "POST":
            return
        said = answer.json()
        if case.path.endswith(("/sessions", "/hand-over")):
            self.sessions.append({"caller": caller, "lift": said["lift"], "session": said["id"]})
        elif case.path.endswith("/commands"):
            place = case.path_parameters
            known = {"caller": caller, "lift": place["lift"], "session": place["session"]}
            self.sessions.append(known | {"command": said["id"]})
        elif case.path.endswith("/rides") and "id" in said:
            self.rides.append({"caller": caller, "lift": said["lift"], "ride": said["id"], "of": said["caller"]})
        del self.sessions[: -self.keep], self.rides[: -self.keep]

    def name(self, caller: str, case: Case[Any], chosen: int) -> dict[str, str]:
        """Let a request name one of them, its own more often than another's; returns what it names."""
        place = case.path_parameters
        known = self.rides if "ride" in place else self.sessions
        if "command" in place:
            known = [one for one in known if "command" in one]
        own = [one for one in known if one["caller"] == caller] if chosen % 3 else known
        if not own or not {"session", "ride"} & place.keys() or chosen % 7 == 0:
            return {}
        found = own[-1 - chosen % min(len(own), 5)]
        for name in place.keys() & found.keys():
            place[name] = found[name]
        return found


class Breach(AssertionError):
    """A caller got further than its role."""


@contextmanager
def managers() -> Iterator[tuple[list[Caller], list[Program], Path]]:
    """Two managers of two simulated lifts each; yields who may ask, the processes, and the folder of their files."""
    with TemporaryDirectory() as name, Started() as start:
        folder = Path(name)
        callers, programs = [], []
        for site in ("open", "keyed"):
            file = folder / f"{site}.yaml"
            file.write_text(json.dumps(content(site, [controller(start) for _ in (NAMED, OTHER)])), "utf-8")
            keys = {role: made(folder, site, role) for role in Role} if site == "keyed" else {}
            manager = start("serve", file, "--port", "0")
            url = manager.says(r"(http://127\.0\.0\.1:\d+)/docs")[1]
            programs.append(manager)
            callers += [
                Caller("no key" if keys else "open", url),
                *(Caller(role, url, key) for role, key in keys.items()),
            ]
        yield callers, programs, folder


def controller(start: Started) -> int:
    """An idle lift on a port of its own."""
    port = free_port()
    server = ModbusServer("127.0.0.1", port, no_block=True, data_bank=Controller())
    server.start()
    start.callback(server.stop)
    return port


def content(name: str, ports: Sequence[int]) -> dict[str, object]:
    """A site file: JSON is YAML."""
    controllers = {f"plc {port}": {"host": "127.0.0.1", "port": port, "map": "generic-registers"} for port in ports}
    lifts = {
        lift: {"controller": f"plc {port}", "access": "control", "floors": {"L1": 1, "L2": 2}}
        for lift, port in zip((NAMED, OTHER), ports, strict=True)
    }
    return {"schema": 1, "name": name, "state": "kept", "controllers": controllers, "lifts": lifts}


def made(folder: Path, site: str, role: Role) -> str:
    path = keys_path(store_path(site, "kept", folder / "site.yaml", {}))
    lifts = (NAMED,) if role in OF_SOME_LIFTS else ()
    return make_key(path, site, Key("", f"the {role}", role, lifts), by="the campaign", at=datetime.now(UTC)).reveal()


def allowed() -> dict[tuple[str, str, str], bool]:
    """What the table of ACCESS.md says, by method, path as in the document, and column."""
    return {(method, path.replace(":path}", "}"), column): may for method, path, column, may in cells(COLUMNS)}


def campaign(*, seconds: float, first_seed: int, examples: int) -> Found:
    """Ask for so long, at least every operation once in each way of making requests."""
    load_all_checks()
    found = Found()
    with managers() as (callers, programs, folder), requests.Session() as session:
        # the callers share its connections, and a login of one must not become that of the others
        session.cookies.set_policy(DefaultCookiePolicy(allowed_domains=[]))
        session.trust_env = False
        document = httpx.get(f"{callers[0].url}/openapi.json", trust_env=False, timeout=HANGS_S).json()
        asking = Asking(found, callers, session)
        ends_at, number = time.monotonic() + seconds, first_seed
        ways = list(asking.ways(document))
        while number == first_seed or time.monotonic() < ends_at:
            for way in ways:
                asking.ask(*way, number, examples)
            number += 1
        for manager in programs:
            found.findings += [f"the log: {line}" for line in manager.err.splitlines() if " ERROR " in line]
        found.findings += leaks(callers, programs, folder)
    return found


def leaks(callers: Sequence[Caller], programs: Sequence[Program], folder: Path) -> Iterator[str]:
    """Yield where a key was written down."""
    written = {str(file): file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    written |= {f"the log of {number}": program.err.encode() for number, program in enumerate(programs)}
    for caller in callers:
        secret = caller.key.rpartition("_")[2].encode()
        yield from (
            f"the key of {caller.name} is in {name}" for name, text in written.items() if secret and secret in text
        )


class Asking:
    """Makes requests, and judges their answers."""

    def __init__(self, found: Found, callers: Sequence[Caller], session: requests.Session) -> None:
        self._found = found
        self._callers = callers
        self._session = session
        self._allowed = allowed()
        self._checks = [CHECKS.get_one(name) for name in CONFORMS]
        self._seen = {url: Seen() for url in {caller.url for caller in callers}}

    def ways(self, document: dict[str, Any]) -> Iterator[tuple[str, st.SearchStrategy[Case[Any]]]]:
        """Yield each operation with right and with wrong requests."""
        for result in schemathesis.openapi.from_dict(document).get_all_operations():
            if not isinstance(result, Ok):
                self._found.findings.append(f"the document: {result.err()}")
                continue
            operation = result.ok()
            if any("text/event-stream" in str(said) for said in operation.definition.raw["responses"].values()):
                continue  # an answer that does not end; its own tests read it
            # a name in a path, or a header, is never wrong: looking for a wrong one takes seconds and finds none
            can_be_wrong = operation.body or operation.query
            for mode in GenerationMode if can_be_wrong else [GenerationMode.POSITIVE]:
                yield operation.label, operation.as_strategy(generation_mode=mode)

    def ask(self, label: str, cases: st.SearchStrategy[Case[Any]], number: int, examples: int) -> None:
        """Ask one operation as every caller, about both lifts and about what is none."""

        @seed(number)
        @settings(
            max_examples=examples,
            derandomize=False,
            database=None,
            deadline=None,
            suppress_health_check=list(HealthCheck),
            phases=[Phase.explicit, Phase.generate],
        )
        @given(case=cases, lift=st.sampled_from([NAMED, NAMED, OTHER, ""]), chosen=st.integers(0, 1000))
        def once(case: Case[Any], lift: str, chosen: int) -> None:
            for caller in self._callers:
                self._judge(caller, case, lift, chosen)

        if "{session}" in label:
            self._begin(number)
        try:
            once()
        except Unsatisfiable:
            return  # nothing in this operation can be wrong
        except Breach as error:
            self._found.findings.append(f"{label}, seed {number}: {error}")
        except FailureGroup as group:
            self._found.findings += [f"{label}, seed {number}: {error}" for error in group.exceptions]

    def _begin(self, number: int) -> None:
        """Give one caller of each manager a session with a command in it, as far as the lift can be had."""
        lift = f"/api/v1/lifts/{NAMED}"
        for url, seen in self._seen.items():
            here = {caller.name: caller for caller in self._callers if caller.url == url}
            person = here.get(Role.OPERATOR) or here["open"]
            robots = [here[name] for name in (Role.ROBOT, Role.OPERATOR, "open") if name in here]
            robot = robots[number % len(robots)]
            for said in ("lockout/end", "session/force-release", "acknowledge"):
                words = {"by": "the campaign"} | ({"reason": "begin"} if "force" in said else {})
                self._post(person, f"{lift}/{said}", words)
            opened = self._post(robot, f"{lift}/sessions", {})
            if opened.status_code != 201:
                continue
            known = {"caller": robot.name, "lift": NAMED, "session": opened.json()["id"]}
            asked = self._post(robot, f"{lift}/sessions/{known['session']}/commands", {"do": "go_to", "floor": "L2"})
            seen.sessions += [known, known | {"command": asked.json()["id"]}] if asked.status_code == 202 else [known]

    def _post(self, caller: Caller, path: str, body: Mapping[str, str]) -> requests.Response:
        headers = {"Authorization": f"Bearer {caller.key}"} if caller.key else {}
        return self._session.post(caller.url + path, json=body, headers=headers, timeout=60)

    def _judge(self, caller: Caller, case: Case[Any], lift: str, chosen: int) -> None:
        if lift:
            for place, name in ((case.path_parameters, "lift"), (case.query, "lift_name")):
                if name in place:
                    place[name] = lift
            name_in_body(case, lift, chosen)
        if "wait" in case.query and isinstance(case.query["wait"], int | float):
            case.query["wait"] = min(case.query["wait"], 0.05)
        seen = self._seen[caller.url]
        named = seen.name(caller.name, case, chosen)
        headers = {"Authorization": f"Bearer {caller.key}"} if caller.key else None
        answer = case.call(base_url=caller.url, session=self._session, headers=headers)
        self._found.asked[caller.name, case.operation.label, answer.status_code] += 1
        case.validate_response(answer, checks=self._checks)  # type: ignore[arg-type]  # the older form of check is one too
        turned_away = TURNED_AWAY | (READ_FIRST if case.path == "/api/v1/rides" else set())
        if not self._may(caller, case, named) and answer.status_code not in turned_away:
            raise Breach(f"{caller.name} asked {case.method} {answer.request.url} and was told {answer.status_code}")
        seen.learn(caller.name, case, answer)

    def _may(self, caller: Caller, case: Case[Any], named: Mapping[str, str]) -> bool:
        if caller.name == "open":
            return True  # from this computer
        column = caller.name
        if caller.name in OF_SOME_LIFTS:
            lift = named.get("lift", case.path_parameters.get("lift", case.query.get("lift_name")))
            if case.path == "/api/v1/rides" and isinstance(case.body, dict):
                lift = case.body.get("lift")
            column = f"{caller.name}, {'its' if lift in (NAMED, [NAMED], 'any') else 'another'} lift"
        if not self._allowed[case.method, case.path, column]:
            return False
        if "session" in case.path_parameters:
            return named.get("caller", caller.name) == caller.name
        return not (
            "ride" in case.path_parameters
            and case.method == "POST"
            and caller.name == Role.ROBOT
            and named.get("caller", caller.name) != caller.name
        )


def name_in_body(case: Case[Any], lift: str, chosen: int) -> None:
    """Let a body name a lift and floors that there are."""
    if not isinstance(case.body, dict):
        return
    there = {"lift": lift if chosen % 4 else "any", "from": "L1", "to": "L2", "floor": ("L1", "L2")[chosen % 2]}
    case.body |= {name: there[name] for name in there.keys() & case.body.keys() if isinstance(case.body[name], str)}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    said = parser.parse_args()
    found = campaign(seconds=said.minutes * 60, first_seed=said.seed, examples=100)
    for (caller, label, status), count in sorted(found.asked.items()):
        sys.stdout.write(f"{caller:13} {label:55} {status} {count:7}\n")
    sys.stdout.write(f"{found.asked.total()} requests, {len(found.findings)} findings\n")
    for finding in found.findings:
        sys.stdout.write(f"{finding}\n")
    return 1 if found.findings else 0


if __name__ == "__main__":
    sys.exit(main())
