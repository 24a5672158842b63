"""Requests made from the OpenAPI document, against a running manager with and without keys: no server error, no answer that the
document does not have, and nothing that the caller's role may not.

python -m tests.campaigns.rest --minutes 10 --seed 1
"""

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
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

from lift_manager.domain.access import Role
from lift_manager.domain.keys import Key
from lift_manager.store.keys import keys_path, make_key
from lift_manager.store.place import state_path
from lift_manager.web.access_table import COLUMNS
from tests.lift_manager.test_operate import Controller
from tests.lift_manager.web.test_access_table import cells
from tests.support.programs import Program, Started, free_port

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
    path = keys_path(state_path(site, "kept", folder / "site.yaml", {}))
    lifts = (NAMED,) if role is Role.ROBOT else ()
    return make_key(path, site, Key("", f"the {role}", role, lifts), by="the campaign", at=datetime.now(UTC)).reveal()


def allowed() -> dict[tuple[str, str, str], bool]:
    """What the table of ACCESS.md says, by method, path as in the document, and column."""
    return {(method, path.replace(":path}", "}"), column): may for method, path, column, may in cells(COLUMNS)}


def campaign(*, seconds: float, first_seed: int, examples: int) -> Found:
    """Ask for so long, at least every operation once in each way of making requests."""
    load_all_checks()
    found = Found()
    with managers() as (callers, programs, folder), requests.Session() as session:
        session.trust_env = False
        document = httpx.get(f"{callers[0].url}/openapi.json", trust_env=False).json()
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

    def ways(self, document: dict[str, Any]) -> Iterator[tuple[str, st.SearchStrategy[Case[Any]]]]:
        """Yield each operation with right and with wrong requests."""
        for result in schemathesis.openapi.from_dict(document).get_all_operations():
            if not isinstance(result, Ok):
                self._found.findings.append(f"the document: {result.err()}")
                continue
            operation = result.ok()
            for mode in GenerationMode:
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
        @given(case=cases, lift=st.sampled_from([NAMED, NAMED, OTHER, ""]))
        def once(case: Case[Any], lift: str) -> None:
            for caller in self._callers:
                self._judge(caller, case, lift)

        try:
            once()
        except Unsatisfiable:
            return  # nothing in this operation can be wrong
        except Breach as error:
            self._found.findings.append(f"{label}, seed {number}: {error}")
        except FailureGroup as group:
            self._found.findings += [f"{label}, seed {number}: {error}" for error in group.exceptions]

    def _judge(self, caller: Caller, case: Case[Any], lift: str) -> None:
        if lift:
            for place, name in ((case.path_parameters, "lift"), (case.query, "lift_name")):
                if name in place:
                    place[name] = lift
        headers = {"Authorization": f"Bearer {caller.key}"} if caller.key else None
        answer = case.call(base_url=caller.url, session=self._session, headers=headers)
        self._found.asked[caller.name, case.operation.label, answer.status_code] += 1
        case.validate_response(answer, checks=self._checks)  # type: ignore[arg-type]  # the older form of check is one too
        if not self._may(caller, case) and answer.status_code not in TURNED_AWAY:
            raise Breach(f"{caller.name} asked {case.method} {answer.request.url} and was told {answer.status_code}")

    def _may(self, caller: Caller, case: Case[Any]) -> bool:
        if caller.name == "open":
            return True  # from this computer
        column = caller.name
        if caller.name == Role.ROBOT:
            lift = case.path_parameters.get("lift", case.query.get("lift_name"))
            column = "robot, its lift" if lift in (NAMED, [NAMED]) else "robot, another lift"
        return self._allowed[case.method, case.path, column]


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
