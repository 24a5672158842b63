"""What may be on a disk after the power failed: rebuilt from what a program under strace wrote and flushed."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

SECTOR = 512
"""What a disk writes whole or not at all."""

TRACED = "trace=pwrite64,write,ftruncate,fdatasync,fsync,unlink,unlinkat,rename,renameat,renameat2,openat"

_LINE = re.compile(r"^(\d+) +(?:<\.\.\. \w+ resumed>(?P<rest>.*)|(?P<call>\w+\(.*))$")
_CALL = re.compile(r"^(?P<name>\w+)\((?P<arguments>.*)\) += (?P<result>-?\d+)")
_OF_FILE = re.compile(r"^(?P<fd>\d+)<(?P<path>[^>]*)>(?:, (?P<rest>.*))?$")
_QUOTED = re.compile(r'"((?:\\x[0-9a-f]{2})*)"')


class CannotTrace(Exception):
    """strace is not permitted here, or its output is not understood; the message says which."""


@dataclass(frozen=True)
class Said:
    """What the program printed: whatever it says has to be true from then on."""

    text: str


@dataclass(frozen=True)
class Wrote:
    name: str
    offset: int
    data: bytes


@dataclass(frozen=True)
class CutTo:
    name: str
    length: int


@dataclass(frozen=True)
class Flushed:
    name: str
    """Of the file; empty for the folder."""


@dataclass(frozen=True)
class Made:
    name: str


@dataclass(frozen=True)
class Removed:
    name: str


@dataclass(frozen=True)
class Renamed:
    name: str
    to: str


Event = Said | Wrote | CutTo | Flushed | Made | Removed | Renamed


def traced(command: list[str], folder: Path, cwd: Path) -> list[Event]:
    """Run a program to its end; returns in order what it printed, and what it did to the files in a folder."""
    trace = folder.with_name(f"{folder.name}.trace")
    options = ["-f", "-y", "-xx", "-s", "10000000", "-e", TRACED, "-o", str(trace)]
    try:
        done = subprocess.run(
            ["strace", *options, *command], cwd=cwd, capture_output=True, text=True, timeout=120, check=False
        )
        if done.returncode != 0:
            raise CannotTrace(
                f"the program under strace ended with {done.returncode}; where it says that ptrace is not permitted, give this"
                f" machine or container the right to trace (SYS_PTRACE): {done.stderr[-2000:]}"
            )
        return list(_events(trace, folder))
    finally:
        trace.unlink(missing_ok=True)


def _events(trace: Path, folder: Path) -> Iterator[Event]:
    halves: dict[str, str] = {}
    with trace.open(encoding="ascii") as lines:
        for line in lines:
            found = _LINE.match(line)
            if found is None:
                continue  # a signal, or the end of a thread
            thread, call = found[1], found["call"]
            if call is not None and call.endswith("<unfinished ...>"):
                halves[thread] = call.removesuffix("<unfinished ...>").rstrip()
                continue
            whole = call if call is not None else halves.pop(thread) + found["rest"]
            parts = _CALL.match(whole)
            if parts is None:
                raise CannotTrace(f"a line of strace is not understood: {whole[:200]}")
            if int(parts["result"]) >= 0:
                yield from _event(parts["name"], parts["arguments"], folder)


def _event(call: str, arguments: str, folder: Path) -> Iterator[Event]:
    match call:
        case "openat" if "O_CREAT" in arguments:
            path = Path(_bytes(arguments).decode())
            if path.parent == folder:
                yield Made(path.name)
        case "unlink" | "unlinkat":
            path = Path(_bytes(arguments).decode())
            if path.parent == folder:
                yield Removed(path.name)
        case "rename" | "renameat" | "renameat2":
            old, new = (Path(bytes.fromhex(name.replace("\\x", "")).decode()) for name in _QUOTED.findall(arguments))
            if old.parent == folder:
                yield Renamed(old.name, new.name)
        case "write" | "pwrite64" | "ftruncate" | "fsync" | "fdatasync":
            yield from _of_file(call, arguments, folder)
        case _:
            pass  # a file that is only read


def _of_file(call: str, arguments: str, folder: Path) -> Iterator[Event]:
    found = _OF_FILE.match(arguments)
    if found is None:
        raise CannotTrace(f"strace names no file: {call}({arguments[:200]}")
    path, rest = Path(_text(found["path"])), found["rest"] or ""
    if call == "write" and found["fd"] == "1":
        yield Said(_bytes(rest).decode())
    elif path == folder:
        yield Flushed("")
    elif path.parent != folder:
        return
    elif call == "pwrite64":
        yield Wrote(path.name, int(rest.rsplit(", ", 1)[1]), _bytes(rest))
    elif call == "ftruncate":
        yield CutTo(path.name, int(rest))
    elif call == "write":
        raise CannotTrace(f"a write without a place: {path}")
    else:
        yield Flushed(path.name)


def _bytes(arguments: str) -> bytes:
    found = _QUOTED.search(arguments)
    if found is None:
        raise CannotTrace(f"strace shows no text: {arguments[:200]}")
    return bytes.fromhex(found[1].replace("\\x", ""))


def _text(escaped: str) -> str:
    return re.sub(r"\\x([0-9a-f]{2})", lambda found: chr(int(found[1], 16)), escaped)


@dataclass
class _File:
    safe: bytearray = field(default_factory=bytearray)
    unsafe: list[Wrote | CutTo] = field(default_factory=list)

    def flush(self) -> None:
        for event in self.unsafe:
            _apply(self.safe, event)
        self.unsafe.clear()

    def after(self, luck: Random) -> bytearray:
        """Return the content with what luck leaves of what is not safe, sector by sector."""
        content = bytearray(self.safe)
        kept = luck.choice((0.0, 0.1, 0.5, 0.9, 1.0))
        for event in self.unsafe:
            for piece in _sectors(event):
                if luck.random() < kept:
                    _apply(content, piece)
        return content


def _sectors(event: Wrote | CutTo) -> Iterator[Wrote | CutTo]:
    if isinstance(event, CutTo):
        yield event
        return
    for start in range(0, len(event.data), SECTOR):
        yield Wrote(event.name, event.offset + start, event.data[start : start + SECTOR])


def _apply(content: bytearray, event: Wrote | CutTo) -> None:
    length = event.length if isinstance(event, CutTo) else event.offset
    if len(content) < length:
        content.extend(bytes(length - len(content)))
    if isinstance(event, CutTo):
        del content[length:]
    else:
        content[length : length + len(event.data)] = event.data


class LossyDisk:
    """The files of one folder; a name, too, is safe only after its folder was flushed."""

    def __init__(self, folder: Path) -> None:
        """Begin with what is in a folder, all of it safe. What SQLite shares in memory (`-shm`) is made anew after a crash."""
        self._names: dict[str, list[_File | None]] = {
            path.name: [_File(bytearray(path.read_bytes()))] for path in folder.iterdir() if _counts(path.name)
        }
        """Under each name what may be found there; the last is what is there now, and the rest what a power loss may bring back."""

    def take(self, event: Event) -> None:
        """Let this happen."""
        match event:
            case Made(name) if _counts(name):
                under = self._names.setdefault(name, [None])
                if under[-1] is None:
                    under.append(_File())
            case Removed(name) if _counts(name):
                self._names[name].append(None)
            case Renamed(name, to) if (file := self._at(name)) is not None:
                self._names.setdefault(to, [None]).append(file)
                self._names[name].append(None)
            case Flushed(""):
                self._names = {name: under[-1:] for name, under in self._names.items()}
            case Flushed(name) if (file := self._at(name)) is not None:
                file.flush()
            case (Wrote(name) | CutTo(name)) as change if (file := self._at(name)) is not None:
                file.unsafe.append(change)
            case _:
                pass

    def fail(self, luck: Random, folder: Path) -> None:
        """Write into an empty folder what may be found after the power failed now."""
        for name, under in self._names.items():
            file = luck.choice(under)
            if file is not None:
                (folder / name).write_bytes(file.after(luck))

    def _at(self, name: str) -> _File | None:
        return self._names[name][-1] if _counts(name) else None


def _counts(name: str) -> bool:
    return not name.endswith("-shm")
