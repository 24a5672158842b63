"""Keys: how one is spelt, how it is recognised without being kept, and how it is kept out of everything written."""

from __future__ import annotations

import hashlib
import hmac
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

from lift_manager.api.roles import Role

PREFIX = "lm"
"""Tells secret scanners, and people, whose key it is."""

_TOKEN = re.compile(rf"{PREFIX}_([0-9a-f]{{8}})_([0-9a-f]{{64}})")
_LOOKS_LIKE = re.compile(rf"{PREFIX}_[0-9a-z]{{4,16}}_[0-9a-z]{{12,}}", re.IGNORECASE)
_BARE = re.compile(r"(?<![0-9a-z])[0-9a-f]{60,68}(?![0-9a-z])", re.IGNORECASE)
"""A secret that lost what stands before it, give or take a few digits."""


class Secret:
    """Text that shows itself only to who asks for it by name; neither `repr`, `str`, a format nor a traceback has it."""

    __slots__ = ("_text",)

    def __init__(self, text: str) -> None:
        self._text = text

    def reveal(self) -> str:
        """Return the text."""
        return self._text

    def __repr__(self) -> str:
        return "Secret(...)"


def digest_of(secret: str) -> str:
    """Return what is kept in the place of a key's secret.

    No slow hash: those make up for passwords that people choose. 256 random bits cannot be guessed at any speed, and a slow hash on
    every request would let anybody keep the manager busy.
    """
    return hashlib.sha256(secret.encode()).hexdigest()


def token(key_id: str, secret: str) -> Secret:
    """Return the key as it is handed out: the id (8 hex digits) and the secret (64 of them)."""
    return Secret(f"{PREFIX}_{key_id}_{secret}")


def is_token(text: str) -> bool:
    """Whether this is spelt as a key is."""
    return _TOKEN.fullmatch(text) is not None


def holds_key(text: str) -> bool:
    """Whether a text seems to hold a key, or the better part of a mistyped one."""
    return bool(_LOOKS_LIKE.search(text) or _BARE.search(text))


def redacted(text: str) -> str:
    """Return a text without the keys in it. A secret that lost its beginning stays: it cannot be told from the hash of a file."""
    return _LOOKS_LIKE.sub(f"{PREFIX}_...", text)


@dataclass(frozen=True, slots=True)
class Key:
    """A live key, as those who judge requests know it: without its secret."""

    id: str
    name: str
    """Of whoever bears it; also the name of its sessions."""
    role: Role
    lifts: tuple[str, ...] = ()
    """Those that a robot commands, or RMF; empty for the other roles."""


class Keys(Protocol):
    """The live keys of a site; they may change at any time."""

    @property
    def are_required(self) -> bool:
        """Whether a request needs a key."""
        ...

    def find(self, secret: Secret) -> Key | None:
        """Return the live key that this is; None where there is none, whatever is wrong with it."""
        ...

    def find_by_name(self, name: str) -> Key | None:
        """Return the live key of this name."""
        ...

    def admits(self, key: Key | None) -> bool:
        """Whether a caller that was let in with this key would be let in still; None is a caller without one."""
        ...


class KeyRing:
    """Keys in memory."""

    def __init__(self, keys: Iterable[tuple[Key, str]] = (), *, open_without_keys: bool = True) -> None:
        """Take live keys, each with the digest of its secret; `open_without_keys` lets everybody in while there is no key."""
        self._keys = {key.id: (key, digest) for key, digest in keys}
        self._open_without = open_without_keys

    @property
    def are_required(self) -> bool:
        """Whether a request needs a key."""
        return bool(self._keys) or not self._open_without

    def find(self, secret: Secret) -> Key | None:
        """Return the live key that this is. Takes as long for an id that is not known as for one that is."""
        match = _TOKEN.fullmatch(secret.reveal())
        if match is None:
            return None
        key, digest = self._keys.get(match[1], (None, "0" * 64))
        return key if hmac.compare_digest(digest_of(match[2]), digest) else None

    def find_by_name(self, name: str) -> Key | None:
        """Return the live key of this name."""
        return next((key for key, _ in self._keys.values() if key.name == name), None)

    def admits(self, key: Key | None) -> bool:
        """Whether a caller that was let in with this key, or without one, would be let in still."""
        if key is None:
            return not self.are_required
        return key.id in self._keys and self._keys[key.id][0] == key
