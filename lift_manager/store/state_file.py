"""What outlives the manager, in one small file per site."""

from __future__ import annotations

import asyncio
import logging
import os
from asyncio import Future
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from weakref import finalize

from pydantic import ValidationError

from drivers.own_files import is_shared, read_own
from drivers.thread import in_thread
from lift_manager.core.memory import Trouble
from lift_manager.domain.service import Remembered
from lift_manager.store.errors import StateUnusable
from lift_manager.store.form import FORMS, VERSION, AnyForm, Head, LiftForm, StateForm
from lift_manager.store.place import SHARED, claim, replace_file, unshared

_log = logging.getLogger(__name__)

RETRY_S = (1.0, 60.0)
"""First and longest pause after a write that failed. Chosen: somebody who makes room on the disk sees it taken up within a minute."""

SLOW_S = 3.0
"""After this a write that has not ended is told as one that fails. Chosen: a busy card takes a second or two."""

Write = Callable[[Path, bytes], None]


class StateFile:
    """The Memory of a site on disk. Nothing waits for the disk but `run` and `settled`."""

    def __init__(
        self, path: Path, site: str, lifts: Collection[str], kept: Mapping[str, Remembered], write: Write
    ) -> None:
        """Begin with what `opened` has read; what it holds of lifts that the site does not have any more is carried on."""
        self.path = path
        self._site = site
        self._kept = dict(kept)
        self._write = write
        self._changed = asyncio.Event()
        self._changed.set()  # written once at the start, so that a folder that cannot be written is known before it is needed
        self._settled = asyncio.Event()
        self._unwritten = set(lifts)
        self._reported: set[str] = set()
        """Lifts whose trouble has been told."""
        self._why = ""
        """Why nothing is written."""
        self._words = 0
        """How often anything was kept."""
        self._word_of: dict[str, int] = {}
        """Which of these was the newest of each lift."""
        self._written_words = 0
        """Up to which of these everything is on the disk."""
        self._waiting: list[tuple[int, Future[None]]] = []

    @property
    def trouble(self) -> str:
        """Why nothing can be written now, in words with what to do; empty while it can."""
        if not self._why:
            return ""
        return f"the sessions and people's words cannot be written to {self.path} ({self._why}); {_MEND}"

    def written(self, lift: str) -> Future[None] | None:
        """Return what is done once everything kept of a lift so far is on the disk; None where it is already."""
        word = self._word_of.get(lift, 0)
        if word <= self._written_words:
            return None
        future: Future[None] = asyncio.get_running_loop().create_future()
        self._waiting.append((word, future))
        return future

    def recall(self, lift: str) -> Remembered:
        """Return what was kept last."""
        return self._kept.get(lift, Remembered())

    def keep(self, lift: str, remembered: Remembered) -> None:
        """Remember this, and write it soon."""
        self._kept[lift] = remembered
        self._words += 1
        self._word_of[lift] = self._words
        self._unwritten.add(lift)
        self._settled.clear()
        self._changed.set()

    async def run(self, trouble: Trouble) -> None:
        """Write what is to be kept until cancelled, one write after the other."""
        pause_s = RETRY_S[0]
        _log.info("sessions, and what people said about the lifts, are kept in %s", self.path)
        while True:
            await self._changed.wait()
            self._changed.clear()
            taken, self._unwritten = self._unwritten, set()
            words = self._words
            slow = asyncio.get_running_loop().call_later(
                SLOW_S, self._report, taken, "the disk does not answer", trouble
            )
            try:
                await in_thread(partial(self._write, self.path, self._data()))
            except OSError as error:
                self._unwritten |= taken
                self._report(taken, error.strerror or str(error), trouble)
                with suppress(TimeoutError):
                    async with asyncio.timeout(pause_s):
                        await self._changed.wait()
                pause_s = min(2 * pause_s, RETRY_S[1])
                self._changed.set()
            else:
                self._written(words)
                pause_s = RETRY_S[0]
            finally:
                slow.cancel()

    async def settled(self) -> None:
        """Return once everything kept so far is on the disk."""
        await self._settled.wait()

    def _data(self) -> bytes:
        lifts = {lift: LiftForm.of(kept) for lift, kept in self._kept.items() if kept != Remembered()}
        return StateForm(site=self._site, lifts=lifts).model_dump_json(indent=2).encode() + b"\n"

    def _written(self, words: int) -> None:
        if self._reported:
            _log.warning("%s is written again", self.path)
            self._reported.clear()
        self._why, self._written_words = "", words
        for word, future in self._waiting:
            if word <= words and not future.done():
                future.set_result(None)
        self._waiting = [(word, future) for word, future in self._waiting if word > words and not future.done()]
        if not self._unwritten:
            self._settled.set()

    def _report(self, lifts: Collection[str], why: str, trouble: Trouble) -> None:
        self._why = why
        for lift in sorted(set(lifts) - self._reported):
            text = (
                f"state: who holds {lift}, and what people said about it, cannot be written to {self.path} ({why}); it is in"
                f" force, but a restart would forget it; {_MEND}"
            )
            _log.error("%s", text)
            trouble(lift, text)
            self._reported.add(lift)


def opened(path: Path, site: str, lifts: Collection[str], write: Write = replace_file) -> StateFile:
    """Read what was kept of a site; a file that is not there yet holds nothing. Raises StateUnusable.

    No other process may open it for as long as the StateFile lives.
    """
    _require_own_folder(path)
    lock = claim(path)
    try:
        memory = StateFile(path, site, lifts, read_state(path, site, lifts), write)
    except StateUnusable:
        if lock is not None:
            os.close(lock)
        raise
    if lock is not None:
        finalize(memory, os.close, lock)
    return memory


def _require_own_folder(path: Path) -> None:
    if is_shared(path.parent):
        raise _unusable(path, SHARED, unshared(path.parent))


def read_state(path: Path, site: str, lifts: Collection[str]) -> dict[str, Remembered]:
    """Return what was kept of a site, and change nothing. Raises StateUnusable."""
    _require_own_folder(path)
    try:
        text, _ = read_own(path)
    except FileNotFoundError as error:
        for other, name, lift in _keeping_out(path, lifts):
            what = f"is not there, and {other} beside it keeps robots off lift {lift!r} of the site {name!r}"
            advice = (
                f"if that is the former name of this site, write {site!r} into that file as its `site` and rename it to"
                f" {path.name}; if it is another building, move it to a folder of its own"
            )
            raise _unusable(path, what, advice) from error
        return {}
    except OSError as error:
        raise _unusable(
            path, f"cannot be read ({error.strerror or error})", "make it readable for this user"
        ) from error
    kept = {lift: form.read() for lift, form in _read(path, text, site).lifts.items()}
    for lift in kept.keys() - set(lifts):
        if kept[lift].keeps_robots_out:
            what = f"keeps robots off lift {lift!r}, which the site file does not have"
            advice = f"if it has another name, change it there too; if it is gone, take its entry out. The lifts are {', '.join(lifts)}"
            raise _unusable(path, what, advice)
    return kept


def _keeping_out(path: Path, lifts: Collection[str]) -> Iterator[tuple[Path, str, str]]:
    """Yield the states of other sites in the folder that keep robots off a lift of such a name, with site and lift."""
    for other in sorted(path.parent.glob("*.json")):
        try:
            text = other.read_bytes()
            form = FORMS[Head.model_validate_json(text).version].model_validate_json(text)
        except (OSError, ValidationError, KeyError):
            continue  # whose ever it is, it is no state that could be ours
        for lift in sorted(form.lifts.keys() & set(lifts)):
            if form.lifts[lift].read().keeps_robots_out:
                yield other, form.site, lift


def _read(path: Path, text: bytes, site: str) -> AnyForm:
    try:
        head = Head.model_validate_json(text)
    except ValidationError as error:
        raise _unusable(path, f"is no state of a lift manager, or is damaged ({_first(error)})", _CURE) from error
    if head.version not in FORMS:
        advice = f"start the version that wrote it; this one reads versions up to {VERSION}"
        raise _unusable(path, f"is version {head.version} of that file", advice)
    if head.site != site:
        advice = f"name another folder with `state:` in the site file of {site!r}, or move that file away"
        raise _unusable(path, f"belongs to the site {head.site!r}", advice)
    try:
        return FORMS[head.version].model_validate_json(text)
    except ValidationError as error:
        raise _unusable(path, f"is damaged ({_first(error)})", _CURE) from error


_MEND = "see to it that this folder can be written, it is tried again by itself"
_CURE = (
    "put back a copy of it; if there is none, let a person check every lift for a fire, a lockout and a robot in its car, and"
    " then move the file away"
)


def _unusable(path: Path, what: str, advice: str) -> StateUnusable:
    return StateUnusable(
        f"{path} {what}; it says which lifts were locked out or had a fire, so nothing starts without it: {advice}"
    )


def _first(error: ValidationError) -> str:
    found = error.errors(include_url=False)[0]
    place = ".".join(str(part) for part in found["loc"])
    return f"{place}: {found['msg']}" if place else str(found["msg"])
