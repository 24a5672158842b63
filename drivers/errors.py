"""Every error a driver raises; each says what reached the wire (`sent`).

DriverError
    LinkDown                 there is no connection; nothing was sent
    ConnectFailed            the connection could not be made; `problem` says why
    ConnectionLost           the connection went away while the answer was awaited
    AnswerTimeout            no answer in time
    AnswerMismatch           the answer does not fit its request: the stream is out of step
    ControllerException      the controller answered with an exception code
        UnitOffline          a gateway answered for a unit that it cannot reach (0A, 0B)
        PointsRefused        the answer to a poll, with the signals that it is about
    PressRefused             the permit refused immediately before the bytes left
    HeartbeatStopped         the controller answers, but its program stands still
        HeartbeatAwaited     the connection is new, and its program has not been shown to run yet
    ControllerTaken          another process on this machine drives this controller
    LockUnusable             the lock against other processes cannot be relied on
"""

from __future__ import annotations

from enum import StrEnum, unique

from register_maps.errors import EXCEPTION_NAMES

ILLEGAL_FUNCTION = 1
ILLEGAL_ADDRESS = 2
ACCEPTED = 5
"""Not an error: the controller has taken the command and needs time for it."""
BUSY = 6
PATH_UNAVAILABLE = 0x0A
TARGET_SILENT = 0x0B


@unique
class Delivery(StrEnum):
    """Whether the request reached the controller, so whether it may have been carried out."""

    NO = "no"
    YES = "yes"
    UNKNOWN = "unknown"


@unique
class ConnectProblem(StrEnum):
    """Why a connection could not be made."""

    REFUSED = "refused"
    """Nothing listens on that port, or the host rejects the connection."""
    TIMED_OUT = "timed out"
    HOST_NOT_FOUND = "host not found"
    TLS = "tls"
    """The certificates do not fit, or one side speaks TLS and the other does not."""
    OTHER = "other"


class DriverError(Exception):
    """Base of all errors that a driver raises on purpose."""

    def __init__(self, text: str, sent: Delivery) -> None:
        super().__init__(text)
        self.sent = sent


class LinkDown(DriverError):
    """There is no connection, so nothing was sent."""

    def __init__(self, link: str, reason: str, down_for_s: float) -> None:
        super().__init__(f"{link}: no connection for {down_for_s:.1f} s: {reason}", Delivery.NO)
        self.reason = reason
        self.down_for_s = down_for_s


class ConnectFailed(DriverError):
    """The connection could not be made."""

    def __init__(self, peer: str, problem: ConnectProblem, detail: str) -> None:
        super().__init__(f"{peer}: {detail}", Delivery.NO)
        self.problem = problem


class ConnectionLost(DriverError):
    """The connection went away while the answer was awaited."""

    def __init__(self, link: str, request: str, reason: str) -> None:
        super().__init__(f"{link}: {request}: connection lost before the answer: {reason}", Delivery.UNKNOWN)
        self.reason = reason


class AnswerTimeout(DriverError):
    """No answer came in time."""

    def __init__(self, link: str, request: str, timeout_s: float) -> None:
        super().__init__(f"{link}: {request}: no answer within {timeout_s:g} s", Delivery.UNKNOWN)
        self.timeout_s = timeout_s


class AnswerMismatch(DriverError):
    """The answer does not fit its request: answers and requests are out of step."""

    def __init__(self, link: str, detail: str) -> None:
        super().__init__(f"{link}: {detail}", Delivery.UNKNOWN)


class ControllerException(DriverError):
    """The controller answered with an exception code.

    Code 5 (acknowledge) means accepted and still at work; code 6 (busy) means not carried out, so `sent` is no.
    """

    def __init__(
        self, link: str, request: str, code: int, sent: Delivery | None = None, about: str = "", *, tls: bool = False
    ) -> None:
        """`about` names what the request was for: signals or a command, with addresses as printed.

        Over `tls` 01 is also the answer to a role that may not do this (Modbus/TCP Security).
        """
        self.link = link
        self.request = request
        self.code = code
        self.name = EXCEPTION_NAMES.get(code, "not in the specification")
        if tls and code == ILLEGAL_FUNCTION:
            self.name += ", or the role in our certificate does not allow it"
        self.tls = tls
        if sent is None:
            sent = Delivery.NO if code == BUSY else Delivery.YES
        details = f": {about}" if about else ""
        super().__init__(f"{link}: {request}: exception {code:02X} ({self.name}){details}", sent)


class UnitOffline(ControllerException):
    """A gateway answered for a unit that it cannot reach; other units on the same link may be well.

    0A: nothing was passed on. 0B: it was passed on but not answered, so it may have been carried out.
    """

    def __init__(self, link: str, request: str, code: int) -> None:
        super().__init__(link, request, code, Delivery.NO if code == PATH_UNAVAILABLE else Delivery.UNKNOWN)


class PointsRefused(ControllerException):
    """The controller answered a poll with an exception; the text names the signals and their printed addresses."""

    def __init__(self, error: ControllerException, about: str) -> None:
        super().__init__(error.link, error.request, error.code, error.sent, about, tls=error.tls)


class PressRefused(DriverError):
    """The permit refused immediately before the bytes would have left."""

    def __init__(self, link: str, request: str, reason: str) -> None:
        super().__init__(f"{link}: {request}: not sent: {reason}", Delivery.NO)
        self.reason = reason


class HeartbeatStopped(DriverError):
    """The controller answers, but its alive counter stands still: its values may be old."""

    def __init__(self, link: str, still_for_s: float, limit_s: float, hint: str = "", text: str = "") -> None:
        """`hint` names another possible cause; `text` replaces the standard message."""
        details = text or f"its alive counter has not changed for {still_for_s:.1f} s (limit {limit_s:g} s)"
        super().__init__(f"{link}: {details}{hint}", Delivery.NO)
        self.still_for_s = still_for_s
        self.limit_s = limit_s


class HeartbeatAwaited(HeartbeatStopped):
    """The connection is new, and the alive counter has not changed on it yet."""

    def __init__(self, link: str, still_for_s: float, limit_s: float, hint: str = "") -> None:
        """`hint` names another possible cause."""
        text = f"waits for the first change of its alive counter, {still_for_s:.1f} s so far (limit {limit_s:g} s)"
        super().__init__(link, still_for_s, limit_s, hint, text)


class ControllerTaken(DriverError):
    """Another process on this machine drives this controller: two managers would press against each other."""

    def __init__(self, peer: str, process: str) -> None:
        super().__init__(
            f"{peer} is driven by process {process} on this machine already; stop that one first", Delivery.NO
        )
        self.peer = peer


class LockUnusable(DriverError):
    """The lock that keeps other processes off a controller cannot be relied on; the message says why."""

    def __init__(self, peer: str, why: str) -> None:
        super().__init__(f"nothing keeps another manager on this machine off {peer}: {why}", Delivery.NO)
        self.peer = peer
