"""What an update changes at a site: which lifts are only watched from then on, until when, and what no update may change."""

import os
from collections.abc import Callable
from typing import Any

import pytest
import yaml

from lift_manager.cli.serve_checks import as_served, cautions
from lift_manager.commissioning.checkout.plan import lift_digest
from lift_manager.commissioning.checkout.record import MapIdentity, Outcome, Record, Stage, record_path, save
from lift_manager.config.load import LoadedSite, load_site
from lift_manager.hub.errors import UpdateRefused
from lift_manager.hub.update.changes import changed_lifts, forbidden_changes, holds, misplaced_files
from lift_manager.hub.update.installed import apply, roll_back
from lift_manager.hub.update.package import Content, make_package
from lift_manager.hub.update.stage import stage
from lift_manager.store.place import store_path
from tests.lift_manager.commissioning.checkout.records import UNSIGNED, result, signed
from tests.lift_manager.hub.update.office import AT, OWN_MAP, Office, refusing, served, tree

Change = Callable[[dict[str, Any]], object]
SENSOR = {
    "endpoints": {"sensor": {"served": {"holding": [[7, 7]]}}},
    "signals": {"door.front": {"at": "sensor/holding:7", "values": {10: "closed", 20: "moving", 30: "open"}}},
}


def pass_test(loaded: LoadedSite, lift: str = "goods", results: int = 1) -> Record:
    """Write a record of a test that the lift has passed as the site is now."""
    plc = loaded.site.controllers["plc"]
    record = UNSIGNED.model_copy(
        update={
            "site": loaded.site.name,
            "lift": lift,
            "map": MapIdentity(name="x", sha256=loaded.maps[lift].sha256, lift_sha256=lift_digest(loaded, lift)),
            "controller": UNSIGNED.controller.model_copy(update={"host": plc.host, "port": plc.port}),
            "items": UNSIGNED.items[:1],
            "results": tuple(result("S-01", Outcome.PASSED, 3 + number) for number in range(results)),
            "punch_list": (),
        }
    )
    store = store_path(loaded.site.name, loaded.site.state, loaded.path, os.environ)
    save(record_path(store, lift, Stage.SAT), signed(record))
    return record


def lift_of(site: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = site["lifts"]["goods"]
    return found


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda site: lift_of(site).update(floors={"L1": 1, "L2": 3}), "its floors, doors or units"),
        (lambda site: lift_of(site).update(floors={"L2": 2, "L1": 1}), "its floors, doors or units"),
        (
            lambda site: lift_of(site).update(floors={"L1": 1, "L2": {"code": 2, "doors": ["front"]}}),
            "its floors, doors or units",
        ),
        (lambda site: lift_of(site).update(unit_id=7), "its floors, doors or units and its address"),
        (lambda site: lift_of(site).update(offset={"holding": 100}), "its floors, doors or units"),
        (lambda site: lift_of(site).update(access="monitor"), "its access"),
        (lambda site: site["controllers"]["plc"].update(host="192.0.2.11"), "its address"),
        (lambda site: site["controllers"]["plc"].update(port=5020), "its address"),
        (lambda site: site["controllers"]["plc"].update(unit_id=9), "its address"),
        (lambda site: lift_of(site).update(override={"commands": {"hold_door.front": {"max_hold_s": 20}}}), "its map"),
        (lambda site: site["controllers"]["plc"].update(map="generic-registers"), "its map"),
        (lambda site: lift_of(site).update(display_name="Goods", lease_s=100.0), None),
        (lambda site: site.update(timezone="Europe/Berlin", announcements="/srv/words"), None),
    ],
)
def test_a_change_of_map_floors_address_or_access_of_a_lift_is_found(
    office: Office, change: Change, what: str | None
) -> None:
    other = office.site()
    change(other)
    found = changed_lifts(office.draft(office.site()), office.draft(other))
    assert found == ({} if what is None else {"goods": what})


def test_a_change_in_the_file_of_a_map_is_found(office: Office) -> None:
    present, other = office.draft(office.site()), office.draft(office.site(), OWN_MAP + "# changed\n")
    assert changed_lifts(present, other) == {"goods": "its map"}


def test_another_address_of_a_further_device_is_found_although_a_test_of_the_lift_would_still_fit(
    office: Office,
) -> None:
    def site(host: str) -> LoadedSite:
        lift = {
            **lift_of(office.site()),
            "override": SENSOR,
            "endpoints": {"sensor": {"controller": "door"}},
        }
        controllers = {"plc": {"host": "192.0.2.10", "map": "own.yaml"}, "door": {"host": host}}
        return office.draft(office.site(controllers=controllers, lifts={"goods": lift}))

    present, other = site("192.0.2.20"), site("192.0.2.21")
    assert changed_lifts(present, other) == {"goods": "its address"}
    pass_test(present)
    held = holds(present, other, 8, {})
    assert held["goods"].tested  # it fits, and another one is needed


def test_a_new_lift_is_only_watched_and_one_that_the_site_file_only_watches_needs_no_hold(office: Office) -> None:
    present = office.draft(office.site())
    new = {"goods": lift_of(office.site()), "bed": {**lift_of(office.site()), "offset": {"holding": 100}}}
    more = office.draft(office.site(lifts={**new, "bed": {**new["bed"], "access": "control"}}), OWN_MAP)
    assert holds(present, more, 8, {})["bed"].why == "update 8 changes the site: it is new"
    watched = office.draft(office.site(lifts={"goods": {**new["goods"], "access": "monitor"}}))
    assert holds(present, watched, 8, {}) == {}
    assert holds(watched, present, 9, {})["goods"].why == "update 9 changes its access"


def installed_at(office: Office, *updates: dict[str, Any]) -> LoadedSite:
    """Let a site apply these updates one after the other; return it as its file is now."""
    installation = office.installation()
    for number, site in enumerate(updates, start=8):
        staged = stage(office.package(number, site), installation, served)
        installation.write(apply(installation.read(), staged, ("goods",), "r1"))
    return load_site(installation.site_file)


def access(loaded: LoadedSite) -> str:
    return as_served(loaded).site.lifts["goods"].access


def test_a_lift_that_an_update_has_changed_is_only_watched_until_it_is_tested(office: Office) -> None:
    moved = office.site(controllers={"plc": {"host": "192.0.2.11", "map": "own.yaml"}})
    loaded = installed_at(office, moved)
    assert loaded.site.lifts["goods"].access == "control"
    assert access(loaded) == "monitor"
    assert any(
        "goods: is only watched, whatever the site file says, because update 8 changes" in one
        for one in cautions(loaded)
    )
    pass_test(loaded)
    assert access(loaded) == "control"
    assert not any("only watched, whatever" in one for one in cautions(loaded))


def test_a_test_from_before_an_update_that_fits_it_does_not_count(office: Office) -> None:
    before = office.installation().site_file
    pass_test(load_site(before), results=1)
    moved = office.site(controllers={"plc": {"host": "192.0.2.11", "map": "own.yaml"}})
    (office.folder / "berlin").rename(office.folder / "other")
    loaded = installed_at(office, moved, office.site())
    assert access(loaded) == "monitor"  # where the test was made, but things have happened since
    pass_test(loaded, results=2)
    assert access(loaded) == "control"


def test_a_lift_stays_only_watched_over_updates_that_do_not_change_it(office: Office) -> None:
    moved = office.site(controllers={"plc": {"host": "192.0.2.11", "map": "own.yaml"}})
    loaded = installed_at(office, moved, moved | {"timezone": "Europe/Berlin"})
    assert access(loaded) == "monitor"
    assert any("because update 8 changes its address" in one for one in cautions(loaded))
    pass_test(loaded)
    assert access(loaded) == "control"


def test_going_back_gives_robots_the_lift_again_that_they_had_before(office: Office) -> None:
    installation = office.installation()
    site = office.site(controllers={"plc": {"host": "192.0.2.11", "map": "own.yaml"}})
    staged = stage(office.package(8, site), installation, served)
    installation.write(apply(installation.read(), staged, (), "r1"))
    assert access(load_site(installation.site_file)) == "monitor"
    installation.write(roll_back(installation.read(), "a test"))
    assert access(load_site(installation.site_file)) == "control"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda site: site.update(name="Elsewhere"), "name: the journal and the state of the lifts belong to"),
        (lambda site: site["hub"].update(updates=["/etc/passwd"]), "hub: who may send updates is decided at the site"),
        (lambda site: site["hub"].update(commands=True), "hub: who may send updates"),
        (lambda site: site.pop("hub"), "hub: who may send updates"),
        (lambda site: site.update(state="/elsewhere"), "state: the state of the lifts stays where it is"),
        (lambda site: site.update(state="elsewhere"), "state: 'elsewhere' is a file of the site's own computer"),
        (lambda site: site["hub"].update(password="p"), "hub.password: 'p' is a file of the site's own computer"),
        (lambda site: site.update(lifts={}), "lifts: "),
        (lambda site: site["controllers"]["plc"].update(map="none"), "map"),
    ],
)
def test_an_update_that_changes_what_belongs_to_the_site_is_refused_and_leaves_nothing(
    office: Office, change: Change, message: str
) -> None:
    installation = office.installation()
    before = tree(installation.folder)
    site = office.site()
    change(site)
    content = office.content(8, office.site())
    files = {**content.unpacked(), "site.yaml": yaml.safe_dump(site, sort_keys=False).encode()}
    package = make_package(Content.of(site="berlin", number=8, made_by="A", made_at=AT, files=files), office.key)
    with pytest.raises(UpdateRefused, match=message):
        stage(package, installation, served)
    assert tree(installation.folder) == before


def test_only_a_person_at_the_site_may_do_without_tests(office: Office) -> None:
    strict, lax = office.draft(office.site(require_checkout=True)), office.draft(office.site())
    assert forbidden_changes(strict, lax) == [
        "require_checkout: only a person at the site may end it; an update cannot change that"
    ]
    assert forbidden_changes(lax, strict) == []


def test_certificates_are_files_of_the_computer_of_the_site(office: Office) -> None:
    tls = {"certificate": "/etc/lift/m.pem", "key": "tls/m.key"}
    loaded = office.draft(office.site(api={"tls": {**tls, "key": "/etc/lift/m.key"}}))
    assert misplaced_files(loaded) == []
    relative = office.draft(office.site(api={"tls": tls}))
    assert [line.partition(" ")[0] for line in misplaced_files(relative)] == ["api.tls.key:"]


def test_what_closes_a_fence_and_the_certificates_for_etcd_are_its_own_files_too(office: Office) -> None:
    cluster = {
        "machines": {"north": {"address": "http://192.0.2.1:5003"}, "south": {"address": "http://192.0.2.2:5003"}},
        "etcd": ["https://192.0.2.1:2379"],
        "tls": {"ca": "/etc/lift/ca.pem", "certificate": "/etc/lift/m.pem", "key": "etcd.key"},
        "fence": {"plc": {"command": ["./close-port", "tls/x"]}},
    }
    lines = misplaced_files(office.draft(office.site(cluster=cluster)))
    assert [line.partition(" ")[0] for line in lines] == ["cluster.fence.plc.command:", "cluster.tls.key:"]


@pytest.mark.parametrize(("number", "of"), [(7, "berlin"), (8, "berlin"), (9, "rome")])
def test_an_update_for_another_site_or_one_that_is_not_newer_is_refused(office: Office, number: int, of: str) -> None:
    installation = office.installation()
    installation.write(apply(installation.read(), stage(office.package(8), installation, served), (), "r1"))
    installation.write(roll_back(installation.read(), "a test"))
    before = tree(installation.folder)
    with pytest.raises(UpdateRefused, match=r"is not newer than 8, which this site has had|is for the site 'rome'"):
        stage(office.package(number, of=of), installation, served)
    assert tree(installation.folder) == before


def test_what_keeps_the_site_from_being_served_refuses_the_update(office: Office) -> None:
    installation = office.installation()
    with pytest.raises(
        UpdateRefused, match=r"update 8 cannot be served at this site: api.host: a; api.host: b; .*; and 1 more"
    ):
        stage(office.package(8), installation, refusing(*"abcdef"))
    assert not (installation.folder / "8").exists()
