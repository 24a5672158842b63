"""Roll-outs of a configuration update to many sites of which one may be bad, in virtual time: who had which version when.

    python -m tests.campaigns.rollouts --rollouts 200 --seed 1

Real: the desk of the hub with its files, the signed packages, what a site checks and keeps on its disk, and the followers. Simulated: the
lifts, NATS and the clock. Meanwhile sites are cut off, busy or killed, lose their power while they change their configuration, and the hub is
started again.

Judged by the bytes of the configuration with which each manager started, and by what a reader of the hub's events and of the sites' journals
sees, with the limits that docs/reference/hub.md promises: nothing of the program that decides is asked.
"""

import argparse
import asyncio
import os
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import pairwise
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

from lift_manager.hub.update.desk import Desk, UpdateFiles
from lift_manager.hub.update.installation import Installation
from lift_manager.hub.update.installed import Installed
from lift_manager.lift.events import Alarm
from tests.lift_manager.hub.update.office import Office, refusing
from tests.lift_manager.hub.update.running import Hub, RunningSite, lose_the_lift
from tests.support.virtual_time import cancel_all, elapse, run_virtual

NUMBER = 8
OLD, NEW = "old", "new"

# what docs/reference/hub.md and docs/how-to/update-sites.md promise
TRIAL_S, ASKS_EVERY_S, UNCONFIRMED_S = 600.0, 60.0, 180.0
QUIET_S = 20.0
"""Longer than a site looks for quiet, and than it takes to end and start."""
LONGEST_S = 12 * 3600.0


class Bad(StrEnum):
    """What the update does to the bad site."""

    NOTHING = "nothing: no site is bad"
    LIFT_LOST = "a lift cannot be read"
    ALARM = "an alarm"
    NO_START = "the manager does not stay up"
    REFUSED = "it is refused"


class PowerLost(Exception):
    """The computer of a site lost its power while it wrote."""


class _Disk(Installation):
    """The folder of a site whose computer may lose its power between two steps of a change."""

    lost_after: int | None = None

    def write(self, installed: Installed) -> None:
        for step, _ in enumerate(self.writing(installed)):
            if step == self.lost_after:
                self.lost_after = None
                raise PowerLost


class _Site(RunningSite):
    def finish(self) -> None:
        with suppress(PowerLost):
            super().finish()


@dataclass
class Record:
    """What happened in one roll-out, as the judge reads it."""

    bad: str
    canaries: tuple[str, ...]
    healthy_s: float
    at_once: int
    starts: dict[str, list[tuple[float, str]]] = field(default_factory=dict)
    """By site: when a manager started, and whether its configuration was OLD or NEW; anything else is neither."""
    rows: dict[str, list[str]] = field(default_factory=dict)
    """By site: what is in its journal."""
    events: list[tuple[float, str, str, str]] = field(default_factory=list)
    """When, which site, the word and the text, of every event of the hub."""
    busy: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    """By site: from when until when something was under way."""
    cut_off: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    must_fail: bool = True


def judge(record: Record) -> Iterator[str]:
    """Yield what is wrong."""
    first = {site: next((at for at, what in starts if what == NEW), None) for site, starts in record.starts.items()}
    yield from _judge_starts(record)
    yield from _judge_order(record, first)
    stops = [(at, text) for at, _, word, text in record.events if word == "stopped"]
    if record.must_fail:
        yield from _judge_bad(record)
        if len(stops) == 1 and record.bad in stops[0][1]:
            yield from _judge_after_stop(record, first, stops[0][0])
        else:
            yield f"the roll-out did not stop once, because of {record.bad}: {stops}"
    elif stops:
        yield f"the roll-out stopped, and nothing was wrong: {stops[0][1]}"
    for site, starts in record.starts.items():
        has_had_it = first[site] is not None
        must_have_it = site != record.bad and has_had_it if record.must_fail else True
        if must_have_it and starts[-1][1] != NEW:
            yield f"{site} does not run by it: {starts}"


def _judge_starts(record: Record) -> Iterator[str]:
    for site, starts in record.starts.items():
        if between := [what for _, what in starts if what not in (OLD, NEW)]:
            yield f"{site} started with a configuration in between: {between[0]}"
        for (_, before), (at, what) in pairwise(starts):
            if before != what and any(begin < at < end for begin, end in record.busy.get(site, ())):
                yield f"{site} changed its configuration at {at:.0f} s while it was busy"


def _judge_bad(record: Record) -> Iterator[str]:
    site, words = record.bad, {word for _, of, word, _ in record.events if of == record.bad}
    if record.starts[site][-1][1] != OLD:
        yield f"{site} is bad, and has not gone back"
    if not words & {"rolled back", "refused"}:
        yield f"no event of the hub says that {site} has gone back: {words}"
    if not any(
        f"update {NUMBER} is rolled back" in row or f"update {NUMBER} is refused" in row for row in record.rows[site]
    ):
        yield f"the journal of {site} does not say that it has gone back: {record.rows[site]}"


def _judge_after_stop(record: Record, first: dict[str, float | None], stopped_at: float) -> Iterator[str]:
    """A site drops what the hub no longer offers: when it asks next, or once the hub is silent for long."""
    for site, at in first.items():
        was_cut_off = any(end > stopped_at for _, end in record.cut_off.get(site, ()))
        within_s = QUIET_S + (UNCONFIRMED_S if was_cut_off else ASKS_EVERY_S)
        if at is not None and at > stopped_at + within_s:
            yield f"{site} got it {at - stopped_at:.0f} s after the roll-out was stopped"


def _judge_order(record: Record, first: dict[str, float | None]) -> Iterator[str]:
    well_since = [first[site] for site in record.canaries]
    for site, at in first.items():
        if at is None or site in record.canaries:
            continue
        if any(since is None or at < since + TRIAL_S + record.healthy_s for since in well_since):
            yield f"{site} got it at {at:.0f} s, before the canaries had run well by it: they have it since {well_since}"
    trials = []
    for site, starts in record.starts.items():
        if (begin := first[site]) is not None:
            back = next((at for at, what in starts if at > begin and what == OLD), begin + TRIAL_S)
            trials.append((begin, min(back, begin + TRIAL_S)))
    most = max((sum(begin <= at < end for begin, end in trials) for at, _ in trials), default=0)
    if most > max(record.at_once, len(record.canaries)):
        yield f"{most} sites were on trial at once, and {record.at_once} may be"


class Rollout:
    """One roll-out, drawn from a seed."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.dice = Random(seed)
        self.office = Office(folder / "office")
        names = [f"site-{number}" for number in range(1, self.dice.randint(3, 9))]
        self.how = self.dice.choice(list(Bad))
        self.record = Record(
            bad=self.dice.choice(names),
            canaries=tuple(self.dice.sample(names, self.dice.randint(1, 2))),
            healthy_s=self.dice.choice([300.0, 900.0, 1800.0]),
            at_once=self.dice.choice([1, 2, 20]),
            must_fail=self.how is not Bad.NOTHING,
        )
        self.hub = Hub(UpdateFiles(folder / "hub"))
        self._bytes: dict[str, dict[str, dict[str, bytes]]] = {}
        """By site and version, the files as a person has written them."""
        self.sites = {name: self._site(name) for name in names}

    def _site(self, name: str) -> _Site:
        disk = _Disk(self.office.installation(name).folder)
        site = _Site(name, disk, self.hub)
        record, bad = self.record, name == self.record.bad
        site.on_start = lambda: record.starts.setdefault(name, []).append((_now(), self._version(site)))
        record.rows[name] = site.rows
        if bad and self.how is Bad.LIFT_LOST:
            site.breaks = lose_the_lift
        elif bad and self.how is Bad.REFUSED:
            site.obstacles = refusing("the certificate is missing")
        return site

    def _version(self, site: _Site) -> str:
        found = _files(site.installation.folder / "current")
        known = [version for version, files in self._bytes[site.name].items() if files == found]
        return known[0] if known else f"{sorted(found)}"

    def play(self) -> Record:
        folder = self.office.folder / "packages"
        folder.mkdir()
        for name, site in self.sites.items():
            changed = self.office.site(name, timezone="Europe/Berlin")
            new = self.office.draft(changed).path.parent
            self._bytes[name] = {OLD: _files(site.installation.folder / "current"), NEW: _files(new)}
            (folder / f"{name}.update").write_bytes(self.office.package(NUMBER, changed, of=name))
        run_virtual(self._run, limit_s=LONGEST_S + 3600.0)
        return self.record

    async def _run(self) -> None:
        tasks = [asyncio.create_task(site.run(self.dice.uniform(0.0, ASKS_EVERY_S))) for site in self.sites.values()]
        tasks += [asyncio.create_task(self._trouble(site)) for site in self.sites.values()]
        try:
            await elapse(self.dice.uniform(70.0, 120.0))
            self.hub.files.begin(
                sorted((self.office.folder / "packages").iterdir()),
                self.record.canaries,
                list(self.sites),
                "M. Weber",
                healthy_s=self.record.healthy_s,
                at_once=self.record.at_once,
            )
            restart_at = self.dice.uniform(0.0, 7200.0)
            seen, still_s = 0, 0.0
            while still_s < 3 * 3600.0 and _now() < LONGEST_S:
                await elapse(5.0)
                still_s += 5.0
                if seen < (count := len(self.hub.happened)):
                    new = self.hub.happened[seen:count]
                    self.record.events += [(_now(), one.site, one.progress, one.text) for one in new]
                    seen, still_s = count, 0.0
                if _now() > restart_at:
                    restart_at, self.hub.desk = LONGEST_S, Desk(self.hub.files)
        finally:
            await cancel_all(tasks)

    async def _trouble(self, site: _Site) -> None:
        """Let happen to one site what a computer and a building may bring."""
        dice = Random(self.dice.random())
        if site.name == self.record.bad and self.how in (Bad.ALARM, Bad.NO_START):
            await self._break(site, dice)
            return
        # around the offer to the canaries, or around that to the others
        await elapse(dice.uniform(0.0, 200.0) if site.name in self.record.canaries else dice.uniform(0.0, 3600.0))
        match dice.randrange(5):
            case 0:
                await self._be_busy(site, dice.uniform(60.0, 3600.0))
            case 1:
                await self._be_cut_off(site, dice.uniform(60.0, 3600.0))
            case 2:
                # an update that waits there is perhaps withdrawn meanwhile
                busy_s = dice.uniform(1800.0, 5400.0)
                async with asyncio.TaskGroup() as both:
                    both.create_task(self._be_busy(site, busy_s))
                    await elapse(dice.uniform(60.0, busy_s))
                    both.create_task(self._be_cut_off(site, 5400.0))
            case 3:
                site.kill()
            case _:
                assert isinstance(site.installation, _Disk)
                disk, steps = site.installation, dice.randrange(3)

                def lose_power() -> None:
                    disk.lost_after = steps

                site.at_the_end = lose_power

    async def _be_busy(self, site: _Site, seconds: float) -> None:
        with self._noted(self.record.busy, site):
            site.busy["goods"] = "a session"
            await elapse(seconds)
            site.busy.clear()

    async def _be_cut_off(self, site: _Site, seconds: float) -> None:
        with self._noted(self.record.cut_off, site):
            self.hub.cut_off.add(site.name)
            await elapse(seconds)
            self.hub.cut_off.discard(site.name)

    async def _break(self, site: _Site, dice: Random) -> None:
        """Do to the bad site, whenever it runs by the update, what the update does to it."""
        while True:
            await elapse(1.0)
            if self.record.starts.get(site.name, [(0.0, OLD)])[-1][1] == NEW:
                await elapse(dice.uniform(1.0, 100.0))
                if self.how is Bad.ALARM:
                    site.lifts.bus.publish(Alarm("goods", "the door contradicts itself"))
                    return
                site.kill()

    @contextmanager
    def _noted(self, where: dict[str, list[tuple[float, float]]], site: _Site) -> Iterator[None]:
        began = _now()
        times = where.setdefault(site.name, [])
        times.append((began, LONGEST_S))
        yield
        times[-1] = (began, _now())


def _files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def _now() -> float:
    return asyncio.get_running_loop().time()


def play(seed: int) -> tuple[str, list[str]]:
    """Play a roll-out; return what it was about, and what was wrong."""
    with TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as folder:
        before = os.environ.get("XDG_STATE_HOME")
        os.environ["XDG_STATE_HOME"] = f"{folder}/state"
        try:
            rollout = Rollout(Path(folder), seed)
            record = rollout.play()
        finally:
            if before is None:
                del os.environ["XDG_STATE_HOME"]
            else:
                os.environ["XDG_STATE_HOME"] = before
    where = "a canary" if record.bad in record.canaries else "another site"
    return f"{rollout.how}{f', at {where}' if record.must_fail else ''}", list(judge(record))


def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rollouts", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args(words)
    played: Counter[str] = Counter()
    failed = 0
    for seed in range(given.seed, given.seed + given.rollouts):
        about, wrong = play(seed)
        played[about] += 1
        failed += bool(wrong)
        for one in wrong:
            sys.stdout.write(f"seed {seed} ({about}): {one}\n")
    for about, count in sorted(played.items()):
        sys.stdout.write(f"{count} x {about}\n")
    sys.stdout.write(f"{given.rollouts} roll-outs, {failed} failed\n")
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
