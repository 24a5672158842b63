"""Does the judge see anything? Each rule is taken out of a copy of the program in turn, and the campaign must find it,
by a seed that passes with the rule in place.

    python -m tests.campaigns.mutants

The program has no switch for a rule, so a copy of its source is changed, and the campaign runs against the copy.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("lift_manager", "drivers", "register_maps", "simulator", "tests")
WITHIN = 250
"""Schedules in which each of them must be found. Chosen: the rarest, robot mode under way, is found by schedule 221."""
RMF = "tests.campaigns.rmf"
"""The campaign for what only an adapter can do wrong."""


@dataclass(frozen=True)
class Edit:
    """One place in the source; the text must be there exactly once."""

    file: str
    old: str
    new: str


@dataclass(frozen=True)
class Mutant:
    """One rule taken out."""

    rule: str
    edits: tuple[Edit, ...]
    campaign: str = "tests.campaigns.truth"
    """Which one must find it."""


MUTANTS: tuple[Mutant, ...] = (
    Mutant(
        "age check",
        (
            Edit(
                "lift_manager/lift/freshness.py",
                "return moment.now <= fresh_until(capabilities, moment.read_at)",
                "return True",
            ),
        ),
    ),
    Mutant(
        "two-reading rule",
        (
            Edit(
                "lift_manager/lift/observation.py",
                "agreed = capabilities.one_block or (same_evidence and reading.at - evidence_since >= apart_s)",
                "agreed = True",
            ),
        ),
    ),
    Mutant(
        "answer check",
        (
            Edit(
                "drivers/modbus/transactions.py",
                "if job is None or (self._tid_echo and (answer[0] << 8 | answer[1]) != self.last_tid):",
                "if job is None:",
            ),
        ),
    ),
    Mutant(
        "release retry",
        (
            Edit(
                "drivers/modbus/output.py",
                "self.try_at = now + min(LONGEST_RETRY_S, RETRY_S * 2.0 ** min(self.failures, 10))",
                "self.try_at = math.inf",
            ),
        ),
    ),
    Mutant(
        "mode check",
        (
            Edit("lift_manager/lift/inhibits.py", "if robots_forbidden(values.mode):", "if False:"),
            Edit(
                "lift_manager/lift/observation.py",
                "is_safe = is_believed and is_permitted and not robots_forbidden(observation.values.mode)",
                "is_safe = is_believed and is_permitted",
            ),
            Edit(
                "lift_manager/lift/endings.py",
                "if not robots_forbidden(mode) or mode is Mode.UNKNOWN:",
                "if mode is not Mode.FIRE:",
            ),
        ),
    ),
    Mutant(
        "outcome check",
        (
            Edit(
                "drivers/modbus/confirm.py",
                "    for name in expected.any_of:\n",
                "    if expected.any_of:\n        return Proof.EFFECT\n    for name in expected.any_of:\n",
            ),
        ),
    ),
    Mutant(
        "fire latch",
        (
            Edit(
                "lift_manager/lift/endings.py",
                "        draft.change_durable(fire_since=draft.moment.clock)\n",
                "",
            ),
        ),
    ),
    Mutant(
        "fire latch at the door word",
        (
            Edit(
                "lift_manager/lift/robot_door.py",
                "is_kept_out = record.durable.fire_since is not None or record.restriction(RestrictionKind.LOCKOUT) is not None",
                "is_kept_out = record.restriction(RestrictionKind.LOCKOUT) is not None",
            ),
        ),
    ),
    Mutant(
        "lockout at the door word",
        (
            Edit(
                "lift_manager/lift/robot_door.py",
                "is_kept_out = record.durable.fire_since is not None or record.restriction(RestrictionKind.LOCKOUT) is not None",
                "is_kept_out = record.durable.fire_since is not None",
            ),
        ),
    ),
    Mutant(
        "rule of one holder",
        (
            Edit(
                "lift_manager/lift/requests.py",
                "    if session is not None and session.holder != request.holder:\n",
                "    if False:\n",
            ),
        ),
    ),
    Mutant(
        "turn of people",
        (
            Edit(
                "lift_manager/lift/advance.py",
                "if draft.session is None or people_have_their_turn(draft.record, draft.moment):",
                "if draft.session is None:",
            ),
        ),
    ),
    Mutant(
        "robot mode under way",
        (
            Edit(
                "lift_manager/lift/robot_mode_output.py",
                "under_way = last is not None and may_be_moving(last) and robot_mode_granted(last, config.capabilities)",
                "under_way = False",
            ),
        ),
    ),
    Mutant(
        "hold behind an open door",
        (
            Edit(
                "lift_manager/lift/robot_door.py",
                "return RobotDoor.OPEN if is_granted and is_held else RobotDoor.MOVING",
                "return RobotDoor.OPEN",
            ),
        ),
    ),
    Mutant(
        "rule of one press for a call",
        (Edit("lift_manager/lift/requests.py", "request_call(call, floor, now)", "request_call(None, floor, now)"),),
    ),
    Mutant(
        "row before a press",
        (
            Edit(
                "lift_manager/runtime/outputs.py",
                "        if answer.done():\n            self._answered(",
                "        answer = answer.get_loop().create_future()\n        answer.set_result(None)\n"
                "        if answer.done():\n            self._answered(",
            ),
        ),
    ),
    Mutant(
        "session before a press",
        (
            Edit(
                "lift_manager/store/committer.py",
                "return _Batch(self.unwritten, list(self._queue), self._number)",
                "return _Batch({}, list(self._queue), self._number)",
            ),
        ),
    ),
    Mutant(
        "workshop's door word",
        (Edit("lift_manager/web/workshop.py", '"door_state": DOOR_STATE[state.robot_door],', '"door_state": 2,'),),
    ),
    Mutant(
        "inspection among the forbidden modes",
        (
            Edit(
                "register_maps/words.py",
                "{Mode.INDEPENDENT, Mode.ATTENDANT, Mode.INSPECTION, Mode.FIRE,",
                "{Mode.INDEPENDENT, Mode.ATTENDANT, Mode.FIRE,",
            ),
        ),
    ),
    Mutant(
        "mode that is published",
        (
            Edit(
                "lift_manager/lift/state.py",
                "mode=Mode.UNKNOWN if values is None else values.mode,",
                "mode=Mode.UNKNOWN if values is None else Mode.NORMAL,",
            ),
        ),
    ),
    Mutant(
        "floor under way",
        (
            Edit(
                "lift_manager/lift/state.py",
                "    floor = reported_floor(config, record, moment)\n",
                "    wanted = None if session is None else session.floor\n"
                "    floor = None if observation is None else observation.floor\n"
                "    floor = floor if observation is None or observation.is_standing else wanted or floor\n",
            ),
        ),
    ),
    Mutant(
        "permission to enter and to leave",
        (
            Edit(
                "lift_manager/lift/observation.py",
                "is_permitted = not needed or any(flags.get(flag, False) for flag in needed)",
                "is_permitted = True",
            ),
        ),
    ),
    Mutant(
        "key switch, ready and watchdog flags",
        (
            Edit(
                "lift_manager/lift/inhibits.py",
                "for flag, lets, otherwise in _DECIDING_FLAGS:",
                "for flag, lets, otherwise in ():",
            ),
        ),
    ),
    Mutant(
        "proof beyond our own read-back",
        (
            Edit(
                "drivers/modbus/presses.py",
                "found = find_proof(press.expected, values, read_back=press.read_back)",
                "found = Proof.READBACK",
            ),
        ),
    ),
    Mutant(
        "evidence that the car stands",
        (
            Edit(
                "lift_manager/lift/observation.py",
                "    if values.motion not in (None, Motion.STOPPED):\n        return False\n    match",
                "    if values.floor is not None:\n        return True\n    match",
            ),
        ),
    ),
    Mutant(
        "every door of a floor",
        (
            Edit(
                "lift_manager/lift/observation.py",
                "is_open = bool(doors_here) and all(",
                "is_open = bool(doors_here) and any(",
            ),
        ),
    ),
    Mutant(
        "call of before a restart",
        (
            Edit(
                "lift_manager/lift/call.py",
                "    if pressed:\n        return Call(floor, CallPhase.CONFIRMED, now)\n",
                "    if pressed:\n        return Call(floor, CallPhase.FAILED, now)\n",
            ),
        ),
    ),
    Mutant(
        "reading from after the hold",
        (
            Edit(
                "lift_manager/lift/robot_door.py",
                "return since is not None and moment.read_at > since + OBEYS_WITHIN_S",
                "return since is not None",
            ),
        ),
    ),
    Mutant(
        "release of a door at once",
        (
            Edit(
                "lift_manager/runtime/outputs.py",
                "            self._driver.declare(self._holds.declared)\n",
                "            late = self.__dict__.setdefault('late', {})\n"
                "            gone = {one: before[one] for one in before.keys() - self._holds.declared.keys()}\n"
                "            late |= {one: hold for one, hold in gone.items() if one.kind == 'hold_door'}\n"
                "            self._driver.declare({**late, **self._holds.declared})\n"
                "            release = lambda: (late.clear(), self._driver.declare(self._holds.declared))\n"
                "            late and __import__('asyncio').get_running_loop().call_later(5.0, release)\n",
            ),
        ),
    ),
    Mutant(
        "door of a lift that was taken",
        (
            Edit(
                "lift_manager/lift/doors.py",
                "if is_taken and record.observation is not None and not has_no_open_door(record.observation.doors):",
                "if False:",
            ),
        ),
    ),
    Mutant(
        "wait for the row of a press",
        (
            Edit(
                "lift_manager/runtime/outputs.py",
                "if pending.sequence <= record.committed and (press := self._waiting.get(pending.id)) is not None:",
                "if (press := self._waiting.get(pending.id)) is not None:",
            ),
        ),
    ),
    Mutant(
        "lockout for RMF",
        (
            Edit(
                "lift_manager/lift/inhibits.py",
                "    shown = restriction_text(record, RestrictionKind.LOCKOUT, moment)\n    if not shown:\n",
                "    if True:\n",
            ),
            Edit(
                "lift_manager/lift/inhibits.py",
                "if lockout is not None and not (record.session is not None and record.session.end_is_announced):",
                "if False:",
            ),
        ),
        campaign=RMF,
    ),
    Mutant(
        "renewal of a hold while nothing changes",
        (
            Edit(
                "lift_manager/lift/step.py",
                "    return min([renewed_by, *(at for at in times if at >= moment.now - PAST_S)])\n",
                "    return min((at for at in times if at >= moment.now - PAST_S and at not in (\n"
                "        hold.until for hold in holds.values())), default=renewed_by)\n",
            ),
        ),
    ),
    Mutant(
        "end of a hold behind an open door",
        (
            Edit(
                "lift_manager/lift/step.py",
                "    is_held = doors.door_is_held(config, record)\n",
                "    is_held, seen = doors.door_is_held(config, record), _note_door_held.__dict__\n"
                "    if is_held:\n        seen[config.name] = moment.now\n"
                "    elif record.door_held_since is not None and moment.now - seen[config.name] <= 2.5:\n        return record\n",
            ),
            Edit(
                "lift_manager/lift/robot_door.py",
                "and is_read and doors.door_is_held(config, record)",
                "and is_read",
            ),
        ),
    ),
)


@dataclass(frozen=True)
class Verdict:
    """What the campaign said of one copy."""

    mutant: Mutant
    found_after: int | None
    """Schedules until the first finding; None: it found nothing."""
    finding: str


def changed_copy(mutant: Mutant, where: Path) -> Path:
    """Copy the program and take the rule out. Raises ValueError if the source no longer reads like that."""
    for package in PACKAGES:
        # with what Python has compiled, or each copy takes seconds to start; half-written files and those of pytest stay
        shutil.copytree(ROOT / package, where / package, ignore=shutil.ignore_patterns("*.pyc.*", "*-pytest-*"))
    for edit in mutant.edits:
        path = where / edit.file
        source = path.read_text()
        if source.count(edit.old) != 1:
            raise ValueError(f"{mutant.rule}: {edit.file} has {source.count(edit.old)} times {edit.old!r}, not once")
        path.write_text(source.replace(edit.old, edit.new))
        for compiled in path.parent.glob(f"__pycache__/{path.stem}.*"):
            compiled.unlink()
    return where


def judge(mutant: Mutant, *, first: int, schedules: int) -> Verdict:
    """Run the campaign against a copy without this rule until a seed fails there that passes with the rule in place."""
    said, start, end = "", first, first + schedules
    with tempfile.TemporaryDirectory() as folder:
        copy = changed_copy(mutant, Path(folder))
        while start < end:
            failures, said = _played(mutant, copy, start, end - start)
            if not failures:
                break
            seed, text = failures[0]
            with_the_rule, _ = _played(mutant, ROOT, seed, 1)
            if not with_the_rule:
                return Verdict(mutant, seed - first + 1, text)
            start = seed + 1
    return Verdict(mutant, None, said)


def _played(mutant: Mutant, tree: Path, first: int, schedules: int) -> tuple[list[tuple[int, str]], str]:
    """Play schedules against a tree; return what failed by seed, and what was printed to standard error."""
    command = [sys.executable, "-m", mutant.campaign, "--processes", "1", "--stop-at", "1"]
    command += ["--seed", str(first), "--schedules", str(schedules)]
    environment = os.environ | {"PYTHONPATH": str(tree), "PYTHONHASHSEED": "0"}
    ended = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)
    failures = re.findall(r"FAILED seed (\d+): (.*)", ended.stdout)
    return sorted((int(seed), text) for seed, text in failures), ended.stderr.strip()


def verdicts(mutants: Sequence[Mutant], *, first: int, schedules: int) -> Iterator[Verdict]:
    """Judge mutants, two at a time."""
    with ThreadPoolExecutor(2) as pool:
        yield from pool.map(lambda mutant: judge(mutant, first=first, schedules=schedules), mutants)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--schedules", type=int, default=WITHIN)
    parser.add_argument("--rules", nargs="*", help="only these")
    given = parser.parse_args()
    began, missed = time.monotonic(), 0
    chosen = [mutant for mutant in MUTANTS if given.rules is None or mutant.rule in given.rules]
    for verdict in verdicts(chosen, first=given.seed, schedules=given.schedules):
        missed += verdict.found_after is None
        place = "NOT FOUND" if verdict.found_after is None else f"found by schedule {verdict.found_after}"
        sys.stdout.write(f"without the {verdict.mutant.rule}: {place}: {verdict.finding}\n")
    sys.stdout.write(f"{len(chosen)} rules, {missed} not found, {time.monotonic() - began:.0f} s\n")
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
