"""Reads and writes etcd over the JSON gateway that every member has, with or without TLS.

A request reaches one member and is never repeated here: whoever sends it knows what a repetition would mean. A member to which
there is no connection is passed over; after one that did not answer, the next request goes to the next.
"""

from __future__ import annotations

import ssl
from base64 import b64decode, b64encode
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import httpx

from lift_manager.cluster.errors import EtcdRefused, EtcdUnavailable

Json = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Entry:
    """A key with its value."""

    key: str
    value: bytes
    revision: int
    """Of its newest change."""


@dataclass(frozen=True, slots=True)
class Result:
    """What became of a transaction."""

    succeeded: bool
    """Whether every comparison was true."""
    revision: int
    """Of the store after it: that of every key that it has put."""
    ranges: tuple[tuple[Entry, ...], ...]
    """The keys that its reads found, read by read."""


class Etcd:
    """The members of one etcd cluster. Methods block; one thread at a time calls them."""

    def __init__(
        self,
        members: Sequence[str],
        *,
        tls: Callable[[], ssl.SSLContext] | None = None,
        timeout_s: float,
        connect_s: float | None = None,
    ) -> None:
        """`members` are the URLs of their client ports; one that is silent for `timeout_s` has not answered.

        One that has not accepted a connection within `connect_s` is passed over; by default that is as long.

        `tls` is called for each request; once it returns another context, new connections replace the present ones.
        """
        self._members = list(members)
        self._tls = tls
        self._context: ssl.SSLContext | None = None
        """That of the present connections."""
        self._timeout = httpx.Timeout(timeout_s, connect=connect_s or timeout_s)
        self._client: httpx.Client | None = None

    def transact(self, compare: Sequence[Json], then: Sequence[Json], otherwise: Sequence[Json] = ()) -> Result:
        """Carry out `then` if every comparison is true, and `otherwise` if not, in one step. Raises EtcdError."""
        reply = self._post("kv/txn", {"compare": list(compare), "success": list(then), "failure": list(otherwise)})
        ranges = tuple(
            tuple(_entry(found) for found in response["response_range"].get("kvs", ()))
            for response in reply.get("responses", ())
            if "response_range" in response
        )
        return Result(bool(reply.get("succeeded", False)), int(reply["header"]["revision"]), ranges)

    def close(self) -> None:
        """Close the connections; the next request opens them again."""
        client, self._client = self._client, None
        if client is not None:
            client.close()

    def _post(self, path: str, body: Json) -> Json:
        unreached: list[str] = []
        for member in tuple(self._members):
            try:
                return self._answer(member, self._send(f"{member}/v3/{path}", body))
            except (httpx.ConnectError, httpx.ConnectTimeout) as error:
                # nothing was sent
                unreached.append(f"{member} ({str(error) or type(error).__name__})")
                self._skip()
            except httpx.HTTPError as error:
                self._skip()
                raise EtcdUnavailable(
                    f"etcd does not answer at {member} ({str(error) or type(error).__name__})"
                ) from error
        raise EtcdUnavailable(f"etcd cannot be reached at {', '.join(unreached)}")

    def _send(self, url: str, body: Json) -> httpx.Response:
        if self._tls is not None and self._context is not (context := self._tls()):
            self.close()
            self._context = context
        if self._client is None:
            self._client = httpx.Client(verify=self._context or True, timeout=self._timeout, trust_env=False)
        return self._client.post(url, json=body)

    def _answer(self, member: str, reply: httpx.Response) -> Json:
        if reply.status_code == httpx.codes.OK:
            answer: Json = reply.json()
            return answer
        if reply.status_code < httpx.codes.INTERNAL_SERVER_ERROR:
            raise EtcdRefused(f"etcd at {member} refuses a request: {_reason(reply)}")
        # no leader, too busy, shutting down: it may have been carried out all the same
        self._skip()
        raise EtcdUnavailable(f"etcd at {member} cannot answer: {_reason(reply)}")

    def _skip(self) -> None:
        """Send the next request to the next member."""
        self._members.append(self._members.pop(0))


def put(key: str, value: bytes) -> Json:
    """Write a key."""
    return {"request_put": {"key": _text(key), "value": _bytes(value)}}


def read(key: str, *, local: bool = False) -> Json:
    """Read a key; `local` takes what the member itself has, which needs no majority and may be old."""
    return {"request_range": {"key": _text(key), "serializable": local}}


def read_all(prefix: str, *, after: str = "", limit: int = 0, local: bool = False) -> Json:
    """Read the keys that begin with a prefix in their order, those behind `after`, and no more than `limit`."""
    first = f"{after}\0" if after else prefix
    request: Json = {"key": _text(first), "range_end": _end(prefix), "serializable": local}
    return {"request_range": request | ({"limit": limit} if limit else {})}


def remove(key: str) -> Json:
    """Remove a key."""
    return {"request_delete_range": {"key": _text(key)}}


def remove_all(prefix: str) -> Json:
    """Remove the keys that begin with a prefix."""
    return {"request_delete_range": {"key": _text(prefix), "range_end": _end(prefix)}}


def remove_upto(prefix: str, last: str) -> Json:
    """Remove the keys that begin with a prefix, as far as `last`."""
    return {"request_delete_range": {"key": _text(prefix), "range_end": _text(f"{last}\0")}}


def has_revision(key: str, revision: int) -> Json:
    """Compare: the newest change of a key has this number; 0 for a key that does not exist."""
    return {"key": _text(key), "target": "MOD", "result": "EQUAL", "mod_revision": revision}


def has_value(key: str, value: bytes) -> Json:
    """Compare: a key has this value."""
    return {"key": _text(key), "target": "VALUE", "result": "EQUAL", "value": _bytes(value)}


def _entry(found: Mapping[str, Any]) -> Entry:
    # the gateway leaves out what is empty
    value = b64decode(found.get("value", ""))
    return Entry(b64decode(found["key"]).decode(), value, int(found["mod_revision"]))


def _reason(reply: httpx.Response) -> str:
    try:
        body = reply.json()
    except ValueError:
        return f"HTTP {reply.status_code}"
    return str(body.get("error") or body.get("message")) if isinstance(body, dict) else f"HTTP {reply.status_code}"


def _text(text: str) -> str:
    return _bytes(text.encode())


def _bytes(value: bytes) -> str:
    return b64encode(value).decode("ascii")


def _end(prefix: str) -> str:
    """Return the first key behind all that begin with a prefix."""
    raw = prefix.encode()
    return _bytes(raw[:-1] + bytes([raw[-1] + 1]))
