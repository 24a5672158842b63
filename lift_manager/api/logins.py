"""Logins: browsers that act as a key without holding it. They are in memory alone, so a restart of the manager ends them."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from pydantic import Field

from lift_manager.api.fields import Answer, Seconds
from lift_manager.api.keys import Key, Keys, Secret, digest_of
from lift_manager.api.roles import Role

LOGIN_S = 12 * 3600.0
"""How long a login lasts. Chosen: a shift, so that a browser that was left open does not act for the next one."""
READER_LOGIN_S = 30 * 86400.0
"""The same for a key that may only read. Chosen: nobody walks to the screen on a wall every day."""
LOGINS_PER_KEY = 64
"""Chosen: more screens than share a key; then the oldest ends. What one key does never ends the login of another."""


@dataclass(frozen=True, slots=True)
class Login:
    """One browser that is logged in."""

    key: Key
    digest: str
    """Of its token."""
    csrf: str = field(repr=False)
    """Proves that a request comes from a page that could read an answer of the manager, as no page of another site can."""
    ends_at: float
    """By the clock of its `Logins`."""


class Logins:
    """The logins of a site."""

    def __init__(self, keys: Keys, clock: Callable[[], float] = time.monotonic) -> None:
        self._keys = keys
        self._clock = clock
        self._logins: dict[str, Login] = {}
        """By the digest of the token, the oldest first. Neither tokens nor secrets of keys are kept."""

    def begin(self, key: Key) -> tuple[Secret, Login]:
        """Log in with a live key; returns the token that stands for it from now on."""
        for login in [login for login in self._logins.values() if not self.is_live(login)]:
            self.end(login)
        of_key = [login for login in self._logins.values() if login.key == key]
        if len(of_key) >= LOGINS_PER_KEY:
            self.end(of_key[0])
        token, csrf = secrets.token_urlsafe(32), secrets.token_urlsafe(32)
        lasts_s = READER_LOGIN_S if key.role is Role.VIEWER else LOGIN_S
        login = Login(key, digest_of(token), csrf, self._clock() + lasts_s)
        self._logins[login.digest] = login
        return Secret(token), login

    def find(self, token: Secret) -> Login | None:
        """Return the live login with this token."""
        login = self._logins.get(digest_of(token.reveal()))
        return login if login is not None and self.is_live(login) else None

    def is_live(self, login: Login) -> bool:
        """Whether a login still counts: nobody logged out, it is not too old, and its key is neither revoked nor changed."""
        is_known = self._logins.get(login.digest) is login
        return is_known and self._clock() < login.ends_at and self._keys.admits(login.key)

    def remaining_s(self, login: Login) -> float:
        """Return for how long a live login lasts."""
        return login.ends_at - self._clock()

    def end(self, login: Login) -> None:
        """Log out."""
        self._logins.pop(login.digest, None)


class LoginAnswer(Answer):
    """As whom the caller acts."""

    key: str | None = Field(description="The name of the key; null where the site has no keys.")
    role: Role | None = Field(description="The role of the key.")
    csrf: str | None = Field(
        description="What a request that changes something sends in the header `x-csrf-token`, beside the cookie; null without a login."
    )
    ends_in_s: Seconds | None = Field(description="For how long the login lasts; null without one.")
