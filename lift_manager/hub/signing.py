"""The signature of a command by its user, with a key of the site. The hub passes it on, and cannot make one."""

from __future__ import annotations

import base64
import hashlib
import hmac

from lift_manager.api.keys import Secret, digest_of, parts_of


def signed_text(site: str, lift: str, ticket: str, action: str) -> bytes:
    """Return what is signed: no line holds a line break but the last one, which is JSON."""
    return f"lift-manager command\n{site}\n{lift}\n{ticket}\n{action}".encode()


def signature(digest: str, text: bytes) -> str:
    """Return the signature by the digest of a key's secret, which is what the site keeps of it."""
    mac = hmac.digest(bytes.fromhex(digest), text, hashlib.sha256)
    # not in hex, which looks like the secret of a key: see `holds_key`
    return base64.urlsafe_b64encode(mac).rstrip(b"=").decode()


def sign(key: Secret, text: bytes) -> tuple[str, str]:
    """Return the id of a key and its signature. Raises ValueError for a text that is no key."""
    key_id, secret = parts_of(key)
    return key_id, signature(digest_of(secret), text)
