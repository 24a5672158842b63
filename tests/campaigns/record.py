"""Records what the manager does in seeded minutes of every map, and compares it with what another version of it did.

python -m tests.campaigns.record --out /tmp/before                                (200 minutes, about a minute on two cores)
python -m tests.campaigns.record --compare /tmp/before                            (records this tree, and compares)
python -m tests.campaigns.record --compare /tmp/before --against /tmp/after
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

from register_maps.load import shipped
from tests.campaigns.comparing import Accepted, Difference, accepted, differences
from tests.campaigns.recorder import record
from tests.campaigns.recordings import Folder, Recording, RecordingError, hashes_of
from tests.campaigns.schedules import Schedule, draw
from tests.campaigns.truth import maps
from tests.campaigns.visits import with_visits

ACCEPTED = Path(__file__).with_name("accepted.yaml")
MINUTES = 200
VISITS = 60
AT_A_TIME = 5
"""Minutes that a process is given at once."""
SHOWN = 3
"""Differences of one recording that are shown in full."""


def names_of(first: int, minutes: int, visits: int, *, every_map: bool = True) -> list[str]:
    """Return the recordings to make: a minute for each seed, one on every map that none of them drew, and minutes with visits."""
    found = [f"minute-{seed:05d}" for seed in range(first, first + minutes)]
    drawn = {schedule_of(name).map for name in found} if every_map else set(shipped())
    found += [f"minute-{first:05d}-{name}" for name in sorted(set(shipped()) - drawn)]
    return found + [f"visit-{seed:05d}" for seed in range(first, first + visits)]


def recorded(name: str) -> Recording:
    """Make the recording of this name. Raises RecordingError."""
    visited = name.startswith("visit-")
    schedule = schedule_of(name)
    return record(with_visits(schedule) if visited else schedule, visited=visited)


def schedule_of(name: str) -> Schedule:
    """Return the schedule of a recording by its name. Raises RecordingError."""
    _, seed, *other = name.split("-", 2)
    if not seed.isdigit():
        raise RecordingError(f"{name} is the name of no recording")
    schedule = draw(int(seed), maps())
    return replace(schedule, map=other[0]) if other else schedule


def record_to(folder: Folder, names: Sequence[str], *, processes: int) -> None:
    """Record these minutes into a folder."""
    chunks = [names[start : start + AT_A_TIME] for start in range(0, len(names), AT_A_TIME)]
    hashes: dict[str, dict[str, str]] = {}
    with ProcessPoolExecutor(processes) as pool:
        for done in pool.map(_record, [folder] * len(chunks), chunks):
            hashes |= done
    folder.seal(hashes)


def _record(folder: Folder, names: Iterable[str]) -> dict[str, dict[str, str]]:
    hashes = {}
    for name in names:
        recording = recorded(name)
        folder.write(name, recording)
        hashes[name] = hashes_of(recording)
    return hashes


@dataclass
class Comparison:
    """What a number of recordings came to."""

    compared: int = 0
    differing: dict[str, list[Difference]] = field(default_factory=dict)
    """By recording, in the order of time; accepted ones apart."""
    put_aside: list[Accepted] = field(default_factory=list)

    @property
    def failed(self) -> bool:
        return bool(self.differing)


def compare(before: Folder, now: Folder, put_aside: list[Accepted], *, texts: bool = False) -> Comparison:
    """Compare every recording of the first folder with that of the second. Raises RecordingError."""
    ours, theirs = before.hashes(), now.hashes()
    if absent := sorted(ours.keys() - theirs.keys()):
        raise RecordingError(f"{now.path} has no recording of {', '.join(absent[:5])}")
    found = Comparison(len(ours), put_aside=put_aside)
    for name, hashes in ours.items():
        if hashes == theirs[name]:
            continue
        left = [
            one for one in differences(name, before.read(name), now.read(name), texts=texts) if not _put(one, put_aside)
        ]
        if left:
            found.differing[name] = left
    return found


def _put(difference: Difference, put_aside: Iterable[Accepted]) -> bool:
    """Put a difference aside if one of these covers it."""
    for one in put_aside:
        if one.covers(difference):
            one.seen += 1
            return True
    return False


def report(found: Comparison, *, show: int = SHOWN) -> Iterator[str]:
    """Yield what differs, for people: each recording with the first difference of each channel, then all of them by sort."""
    for name, every in found.differing.items():
        firsts: dict[str, Difference] = {}
        for one in every:
            firsts.setdefault(one.channel, one)
        yield f"{name}: {len(every)} differences; what comes after the first may follow from it"
        for number, one in enumerate(firsts.values()):
            yield f"  {one}"
            yield from (f"    {line}" for line in one.lines) if number < show else ()
    yield f"{found.compared} recordings, {len(found.differing)} differ"
    first = Counter(every[0].sort for every in found.differing.values())
    total = Counter(one.sort for every in found.differing.values() for one in every)
    for (channel, kind, about), count in first.most_common():
        yield f"first of {count:3d} recordings, {total[channel, kind, about]:4d} in all  {channel}: {kind} {', '.join(about)}"
    later = sum(count for sort, count in total.items() if sort not in first)
    if later:
        yield f"{later} others of {len(total.keys() - first.keys())} sorts, never first"
    for judged in found.put_aside:
        seen = f"accepted {judged.seen} times" if judged.seen else "accepted and NOT SEEN, take it out"
        yield f"{seen}: {judged.reason}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--out", type=Path, metavar="FOLDER", help="record into this folder")
    what.add_argument(
        "--compare", type=Path, metavar="FOLDER", help="compare the recordings of this folder with this tree"
    )
    parser.add_argument("--against", type=Path, metavar="FOLDER", help="with other recordings, and not with this tree")
    parser.add_argument("--seeds", type=int, default=MINUTES)
    parser.add_argument("--visits", type=int, default=VISITS, help="minutes with robots and people over HTTP")
    parser.add_argument("--no-more-maps", action="store_true", help="leave out maps that no seed has drawn")
    parser.add_argument("--seed", type=int, default=1, help="of the first minute; the others follow")
    parser.add_argument("--texts", action="store_true", help="compare the texts too, but for times and numbers in them")
    parser.add_argument("--show", type=int, default=SHOWN, help="channels of each recording that are shown in full")
    parser.add_argument("--accepted", type=Path, default=ACCEPTED, help="the list of accepted differences")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    given = parser.parse_args()
    if os.environ.get("PYTHONHASHSEED") != "0":
        # sets of words have another order in every process otherwise, and two recordings of one tree must be the same
        command = [sys.executable, "-m", "tests.campaigns.record", *sys.argv[1:]]
        return subprocess.run(command, env=os.environ | {"PYTHONHASHSEED": "0"}, check=False).returncode
    try:
        return _run(given)
    except RecordingError as error:
        sys.stderr.write(f"{error}\n")
        return 2


def _run(given: argparse.Namespace) -> int:
    began = time.monotonic()
    if given.out is not None:
        names = names_of(given.seed, given.seeds, given.visits, every_map=not given.no_more_maps)
        record_to(Folder(given.out), names, processes=given.processes)
        sys.stdout.write(f"{len(names)} recordings in {given.out}, {time.monotonic() - began:.0f} s\n")
        return 0
    before = Folder(given.compare)
    with tempfile.TemporaryDirectory() as name:
        now = Folder(given.against or Path(name))
        if given.against is None:
            record_to(now, list(before.names()), processes=given.processes)
        found = compare(before, now, accepted(given.accepted), texts=given.texts)
    sys.stdout.write("\n".join([*report(found, show=given.show), ""]))
    return 1 if found.failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
