"""A roll-out to some sites, in virtual time: folders, packages, checks, the desk of the hub and the followers are real; NATS is not."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from lift_manager.config.load import load_site
from lift_manager.hub.errors import UpdateRefused
from lift_manager.hub.update.desk import Desk, UpdateFiles, standing
from lift_manager.hub.update.follower import MOST_WAIT_S
from lift_manager.hub.update.messages import REQUEST_EVERY_S
from lift_manager.hub.update.trial import FIRST_READINGS_S, OFFLINE_S, TRIAL_S
from lift_manager.lift.events import Alarm
from lift_manager.lift.session import Holder
from tests.lift_manager.hub.update.office import Office, refusing
from tests.lift_manager.hub.update.running import Hub, RunningSite, lose_the_lift
from tests.support.virtual_time import cancel_all, elapse, run_virtual

HEALTHY_S = 1200.0


@dataclass
class Field:
    """Some sites and a hub."""

    office: Office
    hub: Hub
    sites: dict[str, RunningSite]

    def offer(self, number: int, *canaries: str, at_once: int = 20) -> None:
        folder = self.office.folder / f"update-{number}"
        if not folder.exists():
            folder.mkdir()
            for site in self.sites:
                package = self.office.package(number, self.office.site(site, timezone="Europe/Berlin"), of=site)
                (folder / f"{site}.update").write_bytes(package)
        self.hub.files.begin(
            sorted(folder.glob("*")), canaries, list(self.sites), "M. Weber", healthy_s=HEALTHY_S, at_once=at_once
        )

    def progress(self) -> dict[str, str]:
        rollout = self.hub.files.rollout()
        assert rollout is not None
        return {one.site: one.progress.value for one in standing(rollout, self.hub.files.reports())}

    def numbers(self) -> dict[str, int]:
        return {name: site.number for name, site in self.sites.items()}


def play(office: Office, names: str, story: Callable[[Field], Awaitable[None]], *, limit_s: float = 200_000.0) -> Field:
    """Run sites and a hub, and let a story happen to them."""
    hub = Hub(UpdateFiles(office.folder / "hub"))
    sites = {name: RunningSite(name, office.installation(name), hub) for name in names.split()}
    field = Field(office, hub, sites)

    async def main() -> None:
        tasks = [asyncio.create_task(site.run(10.0 * number)) for number, site in enumerate(sites.values())]
        try:
            await story(field)
        finally:
            await cancel_all(tasks)

    run_virtual(main, limit_s=limit_s)
    return field


def test_a_roll_out_with_one_bad_site_leaves_the_others_served_and_that_site_on_its_old_version(office: Office) -> None:
    async def story(field: Field) -> None:
        field.sites["paris"].breaks = lose_the_lift
        field.offer(8, "berlin", at_once=2)
        await elapse(2 * REQUEST_EVERY_S + 10.0)
        assert field.numbers() == {"berlin": 8, "london": 0, "paris": 0, "rome": 0}
        await elapse(TRIAL_S)
        assert field.numbers() == {"berlin": 8, "london": 0, "paris": 0, "rome": 0}
        assert field.progress()["berlin"] == "done"
        await elapse(HEALTHY_S + 3 * REQUEST_EVERY_S)
        assert field.numbers() == {"berlin": 8, "london": 8, "paris": 0, "rome": 0}
        assert field.sites["paris"].starts == [0, 8, 0]
        await elapse(3600.0)

    field = play(office, "berlin london paris rome", story)
    assert field.numbers() == {"berlin": 8, "london": 8, "paris": 0, "rome": 0}
    assert field.progress() == {"berlin": "done", "london": "done", "paris": "rolled back", "rome": "not yet"}
    rollout = field.hub.files.rollout()
    assert rollout is not None
    assert rollout.stopped is not None
    assert "paris has rolled it back: goods could be read before, and cannot be read now" in rollout.stopped.why
    assert load_site(field.sites["paris"].installation.site_file).site.timezone is None
    told = [(one.site, one.progress) for one in field.hub.happened if one.site == "paris"]
    assert told == [("paris", word) for word in ("offered", "waiting", "on trial", "rolled back", "stopped")]
    rows = [row for row in field.sites["paris"].rows if "is checked" not in row]
    assert "update 8, made by M. Weber and signed with office.pub" in rows[0]
    assert rows[1].startswith(
        "configuration update 8 is rolled back, and the configuration before all updates is in its place"
    )


def test_the_update_is_not_taken_during_a_session_and_not_after_a_day(office: Office) -> None:
    async def story(field: Field) -> None:
        site = field.sites["berlin"]
        site.busy["goods"] = "a session"
        field.offer(8, "berlin")
        await elapse(3600.0)
        assert (site.starts, field.progress()) == ([0], {"berlin": "waiting"})
        assert "goods: a session" in site.follower.report().text
        await elapse(MOST_WAIT_S)
        assert field.progress() == {"berlin": "refused"}
        site.busy.clear()
        await elapse(600.0)
        assert site.starts == [0]
        field.offer(8, "berlin")  # again, by a person
        await elapse(2 * REQUEST_EVERY_S)
        assert site.starts == [0, 8]

    play(office, "berlin", story)


def test_nothing_is_changed_if_a_session_begins_at_the_last_moment(office: Office) -> None:
    async def story(field: Field) -> None:
        site = field.sites["berlin"]
        installed = site.installation.read()
        site.at_the_end = lambda: site.busy.update(goods="a session")
        field.offer(8, "berlin")
        await elapse(60.0)
        assert site.starts == [0, 0]
        assert site.installation.read() == installed
        site.at_the_end = lambda: None
        site.busy.clear()
        await elapse(2 * REQUEST_EVERY_S)
        assert site.starts == [0, 0, 8]

    play(office, "berlin", story)


def test_an_alarm_during_the_trial_brings_the_old_version_back_and_one_about_a_robot_does_not(office: Office) -> None:
    async def story(field: Field) -> None:
        site = field.sites["berlin"]
        field.offer(8, "berlin")
        await elapse(100.0)
        assert site.starts == [0, 8]
        site.lifts.bus.publish(Alarm("goods", "silent_holder: ...", Holder("fleet", "r2")))
        await elapse(100.0)
        assert site.starts == [0, 8]
        site.lifts.bus.publish(Alarm("goods", "fire: everything is released"))
        await elapse(100.0)
        assert site.starts == [0, 8, 0]
        assert any("an alarm: goods: fire: everything is released" in row for row in site.rows)

    play(office, "berlin", story)


def test_a_trial_that_has_failed_waits_for_quiet_before_it_goes_back(office: Office) -> None:
    async def story(field: Field) -> None:
        site = field.sites["berlin"]
        site.breaks = lose_the_lift
        field.offer(8, "berlin")
        await elapse(20.0)
        site.busy["goods"] = "a fire"
        await elapse(FIRST_READINGS_S + OFFLINE_S + 3600.0)
        assert site.starts == [0, 8]
        assert "goods could be read before, and cannot be read now" in site.follower.report().text
        site.busy.clear()
        await elapse(60.0)
        assert site.starts == [0, 8, 0]

    play(office, "berlin", story)


def test_a_site_that_is_cut_off_judges_its_trial_by_itself(office: Office) -> None:
    async def story(field: Field) -> None:
        site = field.sites["berlin"]
        site.breaks = lose_the_lift
        field.offer(8, "berlin")
        while site.starts != [0, 8]:
            await elapse(1.0)
        field.hub.is_cut_off = True
        await elapse(600.0)
        assert site.starts == [0, 8, 0]
        field.hub.is_cut_off = False
        await elapse(2 * REQUEST_EVERY_S)
        assert field.progress() == {"berlin": "rolled back"}

    play(office, "berlin", story)


def test_an_update_that_waits_is_dropped_if_the_roll_out_is_stopped_or_the_hub_no_longer_repeats_it(
    office: Office,
) -> None:
    async def story(field: Field) -> None:
        site = field.sites["berlin"]
        site.busy["goods"] = "a session"
        field.offer(8, "berlin")
        await elapse(REQUEST_EVERY_S + 10.0)
        field.hub.is_cut_off = True
        await elapse(10 * REQUEST_EVERY_S)
        site.busy.clear()
        await elapse(600.0)
        assert site.starts == [0]
        field.hub.files.stop("M. Weber", "wrong floors")
        field.hub.is_cut_off = False
        await elapse(600.0)
        assert site.starts == [0]
        assert any("update 8 is no longer offered, and is not applied" in row for row in site.rows)
        assert (site.installation.folder / "current").readlink() == Path("0")

    play(office, "berlin", story)


def test_a_site_that_refuses_an_update_says_why_and_is_not_asked_to_again(office: Office) -> None:
    async def story(field: Field) -> None:
        site = field.sites["berlin"]
        site.obstacles = refusing("the certificate is missing")
        field.offer(8, "berlin")
        await elapse(600.0)
        assert site.starts == [0]
        assert field.progress() == {"berlin": "refused"}
        assert len([row for row in site.rows if "is refused" in row]) == 1
        assert "api.host: the certificate is missing" in site.rows[0]

    play(office, "berlin", story)


def test_a_package_that_the_hub_has_changed_is_refused(office: Office) -> None:
    async def story(field: Field) -> None:
        folder = office.folder / "update-8"
        folder.mkdir()
        package = office.package(8, office.site(timezone="Europe/Rome"))
        head, _, body = package.partition(b"\n")
        (folder / "berlin.update").write_bytes(head + b"\n" + body.replace(b'"number":8', b'"number":9'))
        field.hub.files.begin([folder / "berlin.update"], ["berlin"], ["berlin"], "somebody", healthy_s=HEALTHY_S)
        await elapse(600.0)
        assert field.sites["berlin"].starts == [0]
        assert any("not signed with a key that this site trusts" in row for row in field.sites["berlin"].rows)

    play(office, "berlin", story)


def test_a_hub_that_starts_again_goes_on_with_the_roll_out(office: Office) -> None:
    async def story(field: Field) -> None:
        field.sites["rome"].breaks = lose_the_lift
        field.offer(8, "berlin")
        await elapse(TRIAL_S + 3 * REQUEST_EVERY_S)
        field.hub.desk = Desk(field.hub.files)
        await elapse(HEALTHY_S - 2 * REQUEST_EVERY_S)
        assert field.numbers()["rome"] == 0  # it has to see the canary well for the whole time
        await elapse(4 * REQUEST_EVERY_S)
        assert 8 in field.sites["rome"].starts
        await elapse(600.0)
        assert field.progress() == {"berlin": "done", "rome": "rolled back"}
        field.hub.desk = Desk(field.hub.files)
        await elapse(600.0)
        rollout = field.hub.files.rollout()
        assert rollout is not None
        assert rollout.stopped is not None

    play(office, "berlin rome", story)


@pytest.mark.parametrize(
    ("packages", "canaries", "sites", "healthy_s", "message"),
    [
        (["berlin"], [], ["berlin"], 600.0, "name the sites that have it first with --canary: some of berlin"),
        (["berlin"], ["rome"], ["berlin", "rome"], 600.0, "name the sites that have it first"),
        (["berlin"], ["berlin"], ["rome"], 600.0, "this hub has no site berlin"),
        (["berlin"], ["berlin"], ["berlin"], 10.0, "for 5 minutes at least"),
        ([], ["berlin"], ["berlin"], 600.0, "offer the packages of one update"),
        (["none"], ["berlin"], ["berlin"], 600.0, "cannot be read"),
    ],
)
def test_an_offer_that_makes_no_sense_is_refused(
    office: Office, packages: list[str], canaries: list[str], sites: list[str], healthy_s: float, message: str
) -> None:
    (office.folder / "berlin.update").write_bytes(office.package(8))
    files = UpdateFiles(office.folder / "hub")
    with pytest.raises(UpdateRefused, match=message):
        files.begin(
            [office.folder / f"{name}.update" for name in packages], canaries, sites, "M. Weber", healthy_s=healthy_s
        )
    assert files.rollout() is None
    with pytest.raises(UpdateRefused, match="no roll-out is under way"):
        files.stop("M. Weber", "x")


def test_a_site_gets_parts_of_what_is_offered_to_it_and_of_nothing_else(office: Office) -> None:
    files = UpdateFiles(office.folder / "hub")
    for site in ("berlin", "rome"):
        (office.folder / f"{site}.update").write_bytes(office.package(8, of=site))
    files.begin(
        [office.folder / f"{site}.update" for site in ("berlin", "rome")],
        ["berlin"],
        ["berlin", "rome"],
        "M. Weber",
    )
    desk = Desk(files)
    report = b'{"installed": 0, "phase": "idle", "text": "", "healthy": true}'
    assert desk.offer("rome", report, 0.0)[0].number is None
    with pytest.raises(UpdateRefused, match="update 8 is not offered to rome"):
        desk.part("rome", b'{"number": 8, "at": 0}')
    assert desk.offer("berlin", report, 0.0)[0].number == 8
    assert desk.part("berlin", b'{"number": 8, "at": 0}') == (office.folder / "berlin.update").read_bytes()
    for number in (7, 9):
        with pytest.raises(UpdateRefused, match="is not offered"):
            desk.part("berlin", b'{"number": %d, "at": 0}' % number)
