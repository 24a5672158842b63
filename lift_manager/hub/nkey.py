"""Makes NKEYs: Ed25519 keys in the notation of NATS."""

from __future__ import annotations

import base64
import binascii
from typing import NamedTuple

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

_SEED, _USER = 18 << 3, 20 << 3
"""Prefixes, which make the first letter S or U."""


class Nkey(NamedTuple):
    """The key of a NATS user."""

    public: str
    seed: str
    """The secret."""

    def __repr__(self) -> str:
        return f"Nkey({self.public})"


def make_nkey() -> Nkey:
    """Return a new key."""
    private = Ed25519PrivateKey.generate()
    public = _encode(bytes([_USER]), private.public_key().public_bytes_raw())
    seed = _encode(bytes([_SEED | _USER >> 5, (_USER & 31) << 3]), private.private_bytes_raw())
    return Nkey(public, seed)


def _encode(prefix: bytes, key: bytes) -> str:
    data = prefix + key
    return base64.b32encode(data + binascii.crc_hqx(data, 0).to_bytes(2, "little")).rstrip(b"=").decode()
