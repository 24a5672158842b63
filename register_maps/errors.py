"""Every error this package raises.

RegisterMapError
    MapFileError           a map or site file with mistakes; `findings` has all of them
    FrameError             bytes that are not the Modbus/TCP frame they should be
        BadRequest         a request the specification does not allow; `code` is what a device answers to it
        Mismatch           an answer that does not fit its request
        ExceptionAnswer    the device answered with an exception code
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

EXCEPTION_NAMES = {
    1: "illegal function",
    2: "illegal data address",
    3: "illegal data value",
    4: "server device failure",
    5: "acknowledge",
    6: "server device busy",
    8: "memory parity error",
    0x0A: "gateway path unavailable",
    0x0B: "gateway target device failed to respond",
}
"""Exception codes by their names in Modbus Application Protocol V1.1b3, section 7."""


class RegisterMapError(Exception):
    """Base of all errors that register_maps raises on purpose."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One mistake (or warning) in a file, at its place."""

    file: str
    line: int | None
    """Counted from 1; None for the file as a whole."""
    key: str
    """Where in the file, such as `lifts.lift.floors`; empty for the file as a whole."""
    message: str

    def __str__(self) -> str:
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        return ": ".join(part for part in (place, self.key, self.message) if part)


@dataclass(frozen=True, slots=True)
class Problem:
    """A mistake in a map or, as a warning, a possible one, with its remedy."""

    path: tuple[str | int, ...]
    """The path of keys in the map."""
    message: str
    warning: bool = False


class MapFileError(RegisterMapError):
    """A map or site file cannot be used; `findings` lists all mistakes in the order of their lines."""

    def __init__(self, findings: Iterable[Finding]) -> None:
        self.findings = tuple(sorted(findings, key=lambda finding: (finding.file, finding.line or 0)))
        super().__init__("\n".join(map(str, self.findings)))


class FrameError(RegisterMapError):
    """The bytes are not a Modbus/TCP frame, or not the expected one."""


class BadRequest(FrameError):
    """The specification does not allow this request."""

    def __init__(self, text: str, code: int = 3) -> None:
        super().__init__(text)
        self.code = code
        """The exception code a device gives for it: 1 function, 2 address, 3 count or value."""


class Mismatch(FrameError):
    """An answer does not fit its request."""

    def __init__(self, request: str, expected: str, received: str) -> None:
        super().__init__(f"{request}: expected {expected}, received {received}")
        self.request = request
        self.expected = expected
        self.received = received


class ExceptionAnswer(FrameError):
    """The device answered with an exception code."""

    def __init__(self, function: int, code: int) -> None:
        self.function = function
        self.code = code
        self.name = EXCEPTION_NAMES.get(code, "not in the specification")
        super().__init__(f"function {function} answered with exception {code:02X} ({self.name})")
