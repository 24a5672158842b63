"""Faults that put something, or nothing, in the place of an answer or a connection, as values. Pure."""

from __future__ import annotations

import random
from dataclasses import dataclass

from register_maps import frames
from simulator.wire_faults.bases import ConnectionFault, InsteadFault, Limits, Replies, check_within, garbage


@dataclass(frozen=True, slots=True)
class DropRequest(InsteadFault):
    """The request is lost; the device never sees it."""


@dataclass(frozen=True, slots=True)
class DropAnswer(InsteadFault):
    """The answer is lost; the device has carried out the request."""

    @property
    def reaches_device(self) -> bool:
        return True


@dataclass(frozen=True, slots=True)
class AnswerWithException(InsteadFault):
    """An exception answer."""

    code: int
    """1 to 255; the specification names 1 to 6, 8, 10 and 11."""
    executed: bool = False
    """Whether the device carries the request out all the same, as with code 5 (acknowledge)."""

    def __post_init__(self) -> None:
        Limits.__post_init__(self)
        check_within("code", self.code, 1, 255)

    @property
    def reaches_device(self) -> bool:
        return self.executed

    def instead(self, request: bytes, chance: random.Random) -> Replies:
        return ((0.0, frames.exception_answer(request, self.code)),)


@dataclass(frozen=True, slots=True)
class GarbageAnswer(InsteadFault):
    """Random bytes that cannot be the head of a frame."""

    length: int = 16
    """Below 6 the client sees no fault yet: it waits for the rest of a head."""
    executed: bool = True
    """Whether the device sees the request."""

    def __post_init__(self) -> None:
        Limits.__post_init__(self)
        check_within("length", self.length, 1, 65535)

    @property
    def reaches_device(self) -> bool:
        return self.executed

    def instead(self, request: bytes, chance: random.Random) -> Replies:
        return ((0.0, garbage(self.length, chance)),)


@dataclass(frozen=True, slots=True)
class ResetConnection(InsteadFault):
    """The connection is reset when the answer is due; nothing that is sent after the request passes any more."""

    executed: bool = False
    """Whether the device carries the request out all the same."""

    @property
    def reaches_device(self) -> bool:
        return self.executed

    def instead(self, request: bytes, chance: random.Random) -> Replies:
        return ((0.0, None),)


@dataclass(frozen=True, slots=True)
class HalfOpen(InsteadFault):
    """From this request on nothing passes over this connection any more, in neither direction, not even its end.

    It stays so when the fault is over; a connection made later lives. What was on its way when it struck still arrives.
    Over TCP the proxy's host acknowledges what the client sends, so the client's own TCP notices nothing either.
    """


@dataclass(frozen=True, slots=True)
class RefuseConnections(ConnectionFault):
    """No connection is accepted. Over TCP it is made and reset at once: the proxy's host accepts it first."""


@dataclass(frozen=True, slots=True)
class AcceptAndSayNothing(ConnectionFault):
    """Connections are accepted, and nothing is ever passed on or answered there, not even when the fault is over."""


@dataclass(frozen=True, slots=True)
class ConnectionLimit(ConnectionFault):
    """The device serves so many clients at once."""

    clients: int
    silent: bool = False
    """Whether one more is left without answer; it is refused otherwise."""

    def __post_init__(self) -> None:
        Limits.__post_init__(self)
        if self.clients < 0:
            raise ValueError(f"clients {self.clients}, allowed 0 or more")
