"""Keys: their format, how they are recognised without being stored, and how they are kept out of logs."""

from __future__ import annotations

import hashlib
import hmac
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

from lift_manager.api.roles import Role

PREFIX = "lm"
"""Shows secret scanners and people that a key belongs to the lift manager."""

_TOKEN = re.compile(rf"{PREFIX}_([0-9a-f]{{8}})_([0-9a-f]{{64}})")
_LOOKS_LIKE = re.compile(rf"{PREFIX}_[0-9a-z]{{4,16}}_[0-9a-z]{{12,}}", re.IGNORECASE)
_BARE = re.compile(r"(?<![0-9a-z])[0-9a-f]{60,68}(?![0-9a-z])", re.IGNORECASE)
"""A secret without its prefix, give or take a few digits."""


class Secret:
    """Text that only `reveal` returns. It does not appear in `repr`, `str`, formatted text or tracebacks."""

    __slots__ = ("_text",)

    def __init__(self, text: str) -> None:
        self._text = text

    def reveal(self) -> str:
        """Return the text."""
        return self._text

    def __repr__(self) -> str:
        return "Secret(...)"


def digest_of(secret: str) -> str:
    """Return the digest that is stored instead of the secret of a key.

    A slow hash is not needed: it protects passwords that people choose. 256 random bits cannot be guessed at any speed, and a slow hash on
    every request would let anybody overload the manager.
    """
    return hashlib.sha256(secret.encode()).hexdigest()


def token(key_id: str, secret: str) -> Secret:
    """Return a key as it is issued: the id (8 hex digits) and the secret (64 hex digits)."""
    return Secret(f"{PREFIX}_{key_id}_{secret}")


def is_token(text: str) -> bool:
    """Whether a text has the format of a key."""
    return _TOKEN.fullmatch(text) is not None


def parts_of(key: Secret) -> tuple[str, str]:
    """Return the id and the secret of a key. Raises ValueError for a text that is no key."""
    match = _TOKEN.fullmatch(key.reveal())
    if match is None:
        raise ValueError("this is not a key of a lift manager")
    return match[1], match[2]


def holds_key(text: str) -> bool:
    """Whether a text seems to contain a key, or most of a mistyped one."""
    return bool(_LOOKS_LIKE.search(text) or _BARE.search(text))


def redacted(text: str) -> str:
    """Return a text without the keys in it. A secret without its prefix stays: it looks like the hash of a file."""
    return _LOOKS_LIKE.sub(f"{PREFIX}_...", text)


@dataclass(frozen=True, slots=True)
class Key:
    """A live key for checking requests, without its secret."""

    id: str
    name: str
    """The name of its bearer; also the name of its sessions."""
    role: Role
    lifts: tuple[str, ...] = ()
    """The lifts that a robot or RMF commands; empty for the other roles."""


class Keys(Protocol):
    """The live keys of a site; they may change at any time."""

    @property
    def are_required(self) -> bool:
        """Whether a request needs a key."""
        ...

    def find(self, secret: Secret) -> Key | None:
        """Return the live key for a token; None if it is not valid for any reason."""
        ...

    def find_by_name(self, name: str) -> Key | None:
        """Return the live key with this name."""
        ...

    def admits(self, key: Key | None) -> bool:
        """Whether a caller that was admitted with this key would still be admitted; None for a caller without a key."""
        ...


class KeyRing:
    """Keys in memory."""

    def __init__(self, keys: Iterable[tuple[Key, str]] = (), *, open_without_keys: bool = True) -> None:
        """Hold live keys, each with the digest of its secret. `open_without_keys` admits everybody while there is no key."""
        self._keys = {key.id: (key, digest) for key, digest in keys}
        self._open_without = open_without_keys

    @property
    def are_required(self) -> bool:
        """Whether a request needs a key."""
        return bool(self._keys) or not self._open_without

    def find(self, secret: Secret) -> Key | None:
        """Return the live key for a token. Takes the same time for known and unknown ids."""
        match = _TOKEN.fullmatch(secret.reveal())
        if match is None:
            return None
        key, digest = self._keys.get(match[1], (None, "0" * 64))
        return key if hmac.compare_digest(digest_of(match[2]), digest) else None

    def find_by_id(self, key_id: str) -> tuple[Key, str] | None:
        """Return the live key with this id, and the digest of its secret."""
        return self._keys.get(key_id)

    def find_by_name(self, name: str) -> Key | None:
        """Return the live key with this name."""
        return next((key for key, _ in self._keys.values() if key.name == name), None)

    def admits(self, key: Key | None) -> bool:
        """Whether a caller that was admitted with this key, or without one, would still be admitted."""
        if key is None:
            return not self.are_required
        return key.id in self._keys and self._keys[key.id][0] == key
