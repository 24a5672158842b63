"""`lift-manager checkout`: the acceptance test of a lift, with a record that people sign."""

from __future__ import annotations

import json
import platform
import socket
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from drivers.errors import ConnectFailed, ControllerTaken, LockUnusable
from lift_manager.cli.active_machine import WithoutEtcd, require_no_active_machine
from lift_manager.cli.checkout_access import SiteAccess, hold_door
from lift_manager.cli.checkout_phone import PhonePage, open_socket, print_code, serve_page
from lift_manager.cli.checkout_terminal import HELP, EndOfInput, TerminalPerson
from lift_manager.cli.common import SiteFile, fail, load_site_or_exit, out, print_lines, report_mistakes, store_path_of
from lift_manager.cli.own_manager import run_to_end
from lift_manager.commissioning.checkout.engine import Checkout
from lift_manager.commissioning.checkout.person import Prompt, Question
from lift_manager.commissioning.checkout.plan import TRIPS, lift_digest, make_plan
from lift_manager.commissioning.checkout.record import (
    Controller,
    Fingerprint,
    Item,
    MapIdentity,
    Outcome,
    People,
    Person,
    Record,
    RecordUnusable,
    Stage,
    archive_path,
    load,
    now,
    record_path,
    save,
    verdict,
)
from lift_manager.commissioning.checkout.registers import ReadFailed
from lift_manager.commissioning.doctor.evidence import Probe
from lift_manager.commissioning.doctor.probes import RISKS
from lift_manager.commissioning.wording import identity_text
from lift_manager.config.devices import devices
from lift_manager.config.load import LoadedSite
from lift_manager.plain.text import counted
from lift_manager.plain.version import running_version
from register_maps.errors import MapFileError

NOT_COMPLETE, NOT_PASSED = 3, 4
RULES = (
    "Only the lift technician disconnects or simulates an input, never in the safety chain and never in the shaft. Nothing moves before a yes."
    " This is a test of the interface between lift and manager, and no examination under EN 81-20."
)


def checkout(  # noqa: PLR0913  each is an option of the command line
    site: SiteFile,
    lift: Annotated[str, typer.Argument(metavar="LIFT", help="The lift, by its name in the site file.")],
    *,
    by: Annotated[str, typer.Option("--by", metavar="NAME", help="Who runs the test; a company after a comma.")] = "",
    stage: Annotated[
        Stage,
        typer.Option(
            help="fat: in the factory, against a simulator; sat: at the lift; proof: the yearly test of fire and watchdog."
        ),
    ] = Stage.SAT,
    technician: Annotated[
        str,
        typer.Option(
            "--technician", metavar="NAME", help="The lift technician, who alone disconnects and simulates inputs."
        ),
    ] = "",
    witness: Annotated[str, typer.Option("--witness", metavar="NAME", help="Who watches the test.")] = "",
    identity: Annotated[
        str,
        typer.Option("--identity", metavar="TEXT", help="Maker, serial number and program version of the controller."),
    ] = "",
    probe_identity: Annotated[
        bool,
        typer.Option(
            "--probe-identity",
            help="Also ask the controller what it is, as `doctor --probe identity` does at the same risk.",
        ),
    ] = False,
    phone: Annotated[
        str,
        typer.Option(
            "--phone",
            metavar="HOST",
            help="An address of this computer, on which a second person may confirm results from a phone; a port after a colon.",
            show_default=False,
        ),
    ] = "",
    failed: Annotated[bool, typer.Option("--failed", help="Do failed items again, and nothing else.")] = False,
    item: Annotated[
        list[str] | None, typer.Option("--item", metavar="ID", help="Do this item, such as S-07; repeat it for more.")
    ] = None,
    trips: Annotated[int, typer.Option(min=1, max=100, help="How many whole trips.")] = TRIPS,
    baseline: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Keep the findings of `doctor --json` in the record, as the state as left."),
    ] = None,
    conditions: Annotated[
        bool,
        typer.Option(
            "--conditions",
            help="Ask again what has to be so before the test: on another day, under another permit, or after a wrong answer.",
        ),
    ] = False,
    new: Annotated[
        bool, typer.Option("--new", help="Begin another test; the record of the last one is kept beside it.")
    ] = False,
    show_list: Annotated[bool, typer.Option("--list", help="Only list the items with their results, and end.")] = False,
    without_etcd: WithoutEtcd = False,
    hold_door_at: Annotated[str, typer.Option(hidden=True)] = "",
) -> None:
    """Test a lift item by item, for a record that people sign.

    A person at the doors of the lift answers what it asks. With `--phone 192.0.2.20` a second person confirms results on the page whose
    QR code is shown.

    Ctrl-C ends it at any time: outputs are released, every answer is kept, and the same command goes on. Stop the manager first.

    Exit codes: 0 passed; 1 cannot be done; 2 a mistake in a file; 3 not complete yet; 4 not passed.

    Example: lift-manager checkout site.yaml main --by "Ana Silva, Integrator Ltd" --technician "Bo Berg, Lifts Ltd"
    """
    loaded = load_site_or_exit(site)
    if loaded.unusable:
        raise report_mistakes(MapFileError(loaded.unusable))
    if lift not in loaded.site.lifts:
        raise fail(f"{site} has no lift {lift}; it has {', '.join(loaded.site.lifts)}")
    if hold_door_at:
        hold_door(loaded, lift, hold_door_at)
        return
    path = record_path(store_path_of(loaded), lift, stage)
    try:
        record = load(path)
        if new and record is not None:
            save(archive_path(path, record), record)
            record = None
        plan = make_plan(loaded, lift, stage, trips=_trips(record, trips))
        if show_list:
            _show_list(plan, record)
            return
        require_no_active_machine(loaded, without_etcd=without_etcd)
        people = _people(by, technician, witness, record)
        access = SiteAccess(loaded, lift)
        how = _Manner(probe_identity, conditions, open_socket(phone) if phone else None)
        if record is None:
            record = _begin(loaded, lift, stage, plan, people, identity)
        else:
            record = _resumed(loaded, lift, record, plan, people, identity)
        if baseline is not None:
            record = record.model_copy(update={"baseline": _json_of(baseline)})
        items = _chosen(record, failed=failed, ids=item or ())
        if items:
            record = record.model_copy(update={"ended_at": None, "hand_back": None})
        save(path, record)
    except RecordUnusable as error:
        raise fail(str(error)) from error
    record = _run(record, path, items, access, loaded, how)
    _report_end(record, path)


@dataclass(frozen=True, slots=True)
class _Manner:
    """How a test is run."""

    probe_identity: bool
    renew_conditions: bool
    """Whether to ask for the preconditions although the record has them."""
    phone: socket.socket | None
    """Where the page for a second person is served; None for no page."""


def _run(
    record: Record, path: Path, items: Sequence[Item], access: SiteAccess, loaded: LoadedSite, how: _Manner
) -> Record:
    """Run the test; returns the record as far as it came."""
    person = TerminalPerson(sys.stdin.fileno())
    test = Checkout(
        record,
        lambda changed: save(path, changed),
        person,
        access,
        loaded.codecs[record.lift],
        access.links,
    )

    async def work() -> None:
        for text in (_heading(record, len(items)), RULES, HELP):
            out.print(text, markup=False, highlight=False)
        try:
            await _identify(test, access, probe_identity=how.probe_identity)
            if how.renew_conditions:
                await test.renew_conditions()
            if how.phone is None:
                await test.run(items)
            else:
                await _run_with_phone(test, items, person, how.phone)
            if not verdict(test.record).remaining:
                await test.close()
        except (ConnectFailed, ReadFailed, LockUnusable) as error:
            raise fail(str(error)) from error
        except ControllerTaken as error:
            raise fail(f"{error}, because a checkout runs a manager of its own") from error

    with suppress(EndOfInput):
        try:
            run_to_end(work())
        except KeyboardInterrupt:
            print_lines(["", "interrupted"])
        except RecordUnusable as error:
            raise fail(str(error)) from error
    return test.record


async def _run_with_phone(test: Checkout, items: Sequence[Item], person: TerminalPerson, sock: socket.socket) -> None:
    """Carry out items while a second person may confirm results from a phone; nothing waits for that but the last result."""
    page = PhonePage(test, person.interrupt)
    host, port, *_ = sock.getsockname()
    base = f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"

    def show_code() -> None:
        page.renew()
        print_code(base + page.path)

    print_code(base + page.path)
    person.actions["phone"] = show_code
    async with serve_page(page, sock, person.interrupt):
        await test.run(items)
        result = test.confirmable
        if page.name and result is not None and not test.record.confirmations_of(result):
            await person.answer(
                Question(
                    f"{page.name} can still confirm {result.item} on the phone. Go on, confirmed or not?",
                    Prompt.CLOSING,
                )
            )
    del person.actions["phone"]


async def _identify(test: Checkout, access: SiteAccess, *, probe_identity: bool) -> None:
    """Take the fingerprint of the controller, and compare it with that of the beginning."""
    if probe_identity:
        out.print(f"probe identity: {RISKS[Probe.IDENTITY]}", markup=False, highlight=False)
    out.print("reading the fingerprint of the controller; some seconds", markup=False, highlight=False)
    async with access.registers() as registers:
        found = await registers.fingerprint(probe_identity=probe_identity)
    if probe_identity:
        says = (
            f"says that it is: {identity_text(found.identity)}" if found.identity else "gives no identity; many do not"
        )
        out.print(f"the controller {says}", markup=False, highlight=False)
    before = test.record.controller.fingerprint
    if before is None:
        test.keep_fingerprint(found)
        return
    if (text := _difference(before, found)) and test.record.results:
        out.print(f"caution: {text}", markup=False, highlight=False)
    if not before.identity and found.identity:
        test.keep_fingerprint(before.model_copy(update={"identity": found.identity}))


def _difference(before: Fingerprint, found: Fingerprint) -> str:
    """Return why this may be another controller than at the beginning; empty if nothing says so."""
    if before.identity and found.identity and before.identity != found.identity:
        return (
            f"the controller said that it is {identity_text(before.identity)} when this checkout began, and says"
            f" {identity_text(found.identity)} now; with another controller or firmware use --new"
        )
    if before.served != found.served:
        return "the controller answers for other addresses than when this checkout began; with another controller use --new"
    constants = {(one.table, one.address): one.value for one in found.constants}
    other = [one for one in before.constants if constants.get((one.table, one.address), one.value) != one.value]
    if other:
        first = other[0]
        return f"{first.table} {first.address} on the wire is no longer {first.value}: if this is another controller or program, use --new"
    return ""


def _begin(
    loaded: LoadedSite, lift: str, stage: Stage, plan: tuple[Item, ...], people: People, identity: str
) -> Record:
    return Record(
        stage=stage,
        site=loaded.site.name,
        lift=lift,
        floors={name: floor.code for name, floor in loaded.site.lifts[lift].floors.items()},
        map=_map_identity(loaded, lift),
        controller=_controller(loaded, lift, identity),
        versions=_versions(),
        people=people,
        items=plan,
        started_at=now(),
    )


def _resumed(
    loaded: LoadedSite, lift: str, record: Record, plan: tuple[Item, ...], people: People, identity: str
) -> Record:
    """Return a record with the plan as it is now, and print what has to be done again because of it.

    A controller with another address is the same one as long as its fingerprint is.
    """
    before = record.controller
    renewed = record.model_copy(
        update={
            "items": plan,
            "map": _map_identity(loaded, lift),
            "floors": {name: floor.code for name, floor in loaded.site.lifts[lift].floors.items()},
            "versions": _versions(),
            "people": people,
            "controller": _controller(loaded, lift, identity or before.identity, before.fingerprint),
        }
    )
    if renewed.map != record.map:
        again = [one.id for one in plan if renewed.changed_since(one)]
        what = f"to be done again: {', '.join(again)}" if again else "no item that was done depends on it"
        print_lines([f"the map or the site file has changed since; {what}"])
    return renewed


def _controller(loaded: LoadedSite, lift: str, identity: str, fingerprint: Fingerprint | None = None) -> Controller:
    device = devices(loaded.site, loaded.site.lifts[lift], loaded.maps[lift].map)[""]
    place = loaded.site.controllers[device.controller]
    return Controller(
        name=device.controller,
        host=place.host,
        port=place.port,
        unit=device.unit_id,
        identity=identity,
        fingerprint=fingerprint,
    )


def _chosen(record: Record, *, failed: bool, ids: Sequence[str]) -> list[Item]:
    """Return the items to do now: those named, those that failed, or those without a result that counts."""
    known = {one.id: one for one in record.items}
    if unknown := [one for one in ids if one not in known]:
        raise fail(f"there is no item {unknown[0]}; `--list` shows all of them")
    if ids:
        return [known[one] for one in ids]
    newest = record.newest
    if failed:
        return [one for one in record.items if one.id in newest and newest[one.id].outcome is Outcome.FAILED]
    return [one for one in record.items if one.id not in newest]


def _people(by: str, technician: str, witness: str, record: Record | None) -> People:
    """Return who takes part: those given now, otherwise those of the record."""
    if not by and record is None:
        raise typer.BadParameter("who runs the test? Give your name", param_hint="--by")
    before = record.people if record is not None else None
    return People(
        run_by=_person(by) or (before.run_by if before is not None else Person(name=by)),
        technician=_person(technician) or (before.technician if before is not None else None),
        witness=_person(witness) or (before.witness if before is not None else None),
    )


def _person(text: str) -> Person | None:
    name, _, company = text.partition(",")
    return Person(name=name.strip(), company=company.strip()) if name.strip() else None


def _trips(record: Record | None, given: int) -> int:
    """Return how many trips: those of the record, unless others are asked for."""
    if record is not None and given == TRIPS:
        return next((int(one.subject) for one in record.items if one.id == "T-01"), given)
    return given


def _map_identity(loaded: LoadedSite, lift: str) -> MapIdentity:
    found = loaded.maps[lift]
    return MapIdentity(
        name=found.map.name, title=found.map.title, sha256=found.sha256, lift_sha256=lift_digest(loaded, lift)
    )


def _versions() -> dict[str, str]:
    return {
        "lift-manager": running_version(),
        "Python": platform.python_version(),
        "system": f"{platform.system()} {platform.release()}",
    }


def _json_of(path: Path) -> dict[str, Any]:
    try:
        data = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise fail(f"{path} cannot be read as JSON ({error})") from error
    return data if isinstance(data, dict) else {"findings": data}


def _heading(record: Record, count: int) -> str:
    done = len(record.newest)
    minutes = sum(one.estimate_s for one in record.items if one.id not in record.newest) / 60
    return (
        f"checkout of {record.lift}, {record.stage}: {counted(count, 'item')} now, {done} of {len(record.items)} have a result,"
        f" about {minutes:.0f} min left"
    )


def _show_list(plan: tuple[Item, ...], record: Record | None) -> None:
    newest = {} if record is None else record.model_copy(update={"items": plan}).newest
    table = Table("No.", "Item", "Result", "Note", box=None)
    for one in plan:
        result = newest.get(one.id)
        table.add_row(
            one.id, one.title, "" if result is None else result.outcome, "" if result is None else result.note
        )
    out.print(table, markup=False, highlight=False)


def _report_end(record: Record, path: Path) -> None:
    found = verdict(record)
    out.print(f"{record.lift}, {record.stage}: {found.text}", markup=False, highlight=False)
    for one in (*found.failed, *found.skipped):
        out.print(Padding(Text(f"{one}: {record.newest[one].note}"), (0, 0, 0, 2)))
    print_lines([f"record: {path}, sha256 {record.sha256[:16]}"])
    if found.remaining:
        print_lines(["the same command continues; `--failed` does failed items again"])
    elif not found.is_signed:
        print_lines(["not signed as it is now; the same command asks for what is left"])
    if found.remaining:
        raise typer.Exit(NOT_COMPLETE)
    if not found.passed:
        raise typer.Exit(NOT_PASSED)
