"""Removes secrets and names of people from texts and data. Pure."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any

from lift_manager.api.keys import redacted as without_tokens

LEFT_OUT = "(left out)"
SHORTEST_NAME = 3
"""A shorter name is replaced only where it stands alone, not inside of texts, in which it may be any word."""

_PRIVATE_KEY = re.compile(
    r"-----BEGIN [A-Z0-9 ]*PRIVATE KEY-----.*?(?:-----END [A-Z0-9 ]*PRIVATE KEY-----|\Z)", re.DOTALL
)
_URL_PASSWORD = re.compile(r"(?P<scheme>[a-zA-Z][a-zA-Z0-9+.-]*://)(?P<login>[^\s/@\"']+)@")
_HEADER = re.compile(r"(?P<what>\b(?:Bearer|Basic)\s+)[A-Za-z0-9+/=._~-]{8,}", re.IGNORECASE)
_SENSITIVE = "password|passwd|passphrase|secret|token|api[_-]?key|lift_manager_key"
_SECRET_KEY = re.compile(_SENSITIVE, re.IGNORECASE)
_ASSIGNED = re.compile(
    rf"(?P<what>[\"']?[\w.-]*(?:{_SENSITIVE})[\w-]*[\"']?\s*[:=]\s*)"
    r"(?P<value>\"[^\"\n]*\"|'[^'\n]*'|[^\s,;}\]]+)",
    re.IGNORECASE,
)
_HEXADECIMAL = re.compile(r"(?<![0-9a-zA-Z])[0-9a-fA-F]{60,68}(?![0-9a-zA-Z])")
"""Secrets of keys and their digests; hashes of maps look the same, so that those have to be named."""
_DECIDED_BY = re.compile(r"(?P<what>\b(?:locked out|lockout|drained|drains?|acknowledged|taken|released) by )[^;\n]+")
"""A text about what a person decided: the name, and mostly a reason in that person's words."""
PEOPLE_KEYS = frozenset(
    {"by", "holder", "caller", "robot", "to", "made_by", "revoked_by", "maybe_occupied_by", "said_by"}
)
"""Keys of data under which a name stands."""
WORDS_KEYS = frozenset({"reason", "lockout", "drain", "without_keys", "accept_latching", "words"})
"""Keys of data under which a text of a person stands, with names in it or not."""


SHORTEST_PASSWORD = 6
"""A shorter one is not looked for elsewhere: it may be part of any word."""


def passwords(text: str) -> set[str]:
    """Return the passwords that a text names as such, so that they can be removed where nothing says that they are."""
    found = {match["login"].rpartition(":")[2] for match in _URL_PASSWORD.finditer(text)}
    found |= {match["value"].strip("\"'") for match in _ASSIGNED.finditer(text)}
    return {password for password in found if len(password) >= SHORTEST_PASSWORD}


class Redactor:
    """Removes known secrets and what looks like one, and counts them."""

    def __init__(self, *, with_names: bool = False, hashes: Collection[str] = (), keep: Collection[str] = ()) -> None:
        """`hashes` are no secrets; `keep` are words, such as names of lifts, that are kept although a person has that name too."""
        self.counts: Counter[str] = Counter()
        self.with_names = with_names
        self._hashes = {text.lower() for text in hashes}
        self._keep = set(keep)
        self._names: dict[str, str] = {}
        self._secrets: list[str] = []

    def learn_secrets(self, secrets: Iterable[str]) -> None:
        """Remove these wherever they stand."""
        self._secrets = sorted({*self._secrets, *(text for text in secrets if text.strip())}, key=len, reverse=True)

    def learn_names(self, names: Iterable[str]) -> None:
        """Replace these names, or `<face>:<name>`, by a number, the same one everywhere."""
        for given in names:
            name = given.partition(":")[2] or given
            if name and name not in self._names and not self.with_names:
                self._names[name] = f"name-{len(self._names) + 1}"

    def name(self, text: str) -> str:
        """Return what stands for a name, or for `<face>:<name>`."""
        if self.with_names or not text:
            return self.text(text)
        self.learn_names([text])
        face, colon, name = text.partition(":")
        self.counts["a name"] += 1
        return f"{face}{colon}{self._names[name]}" if colon and name else self._names[text]

    def text(self, text: str) -> str:
        """Return a text without secrets, and without the names that are known."""
        for secret in self._secrets:
            text = self._counted("a secret of this computer", text.replace(secret, LEFT_OUT), text)
        text = self._counted("a key token", without_tokens(text), text)
        text = self._substituted("a private key", _PRIVATE_KEY, LEFT_OUT, text)
        text = self._substituted("a password in a URL", _URL_PASSWORD, rf"\g<scheme>{LEFT_OUT}@", text)
        text = self._substituted("a login header", _HEADER, rf"\g<what>{LEFT_OUT}", text)
        text = self._substituted("a password or token", _ASSIGNED, rf"\g<what>{LEFT_OUT}", text)
        text = self._substituted("a hexadecimal secret or digest", _HEXADECIMAL, self._hash, text)
        return text if self.with_names else self._without_names(text)

    def data(self, value: Any, key: str = "") -> Any:
        """Return data without secrets, names and texts of people."""
        if isinstance(value, Mapping):
            return {self.text(str(name)): self.data(item, str(name)) for name, item in value.items()}
        if isinstance(value, list | tuple):
            return [self.data(item, key) for item in value]
        if not isinstance(value, str):
            return value
        if value and _SECRET_KEY.search(key):
            self.counts["a password or token"] += 1
            return LEFT_OUT
        if not self.with_names and value and key in WORDS_KEYS:
            self.counts["a text of a person"] += 1
            return LEFT_OUT
        if not self.with_names and key in PEOPLE_KEYS:
            return self.name(value)
        return self.text(value)

    def _without_names(self, text: str) -> str:
        text = self._substituted("a text of a person", _DECIDED_BY, rf"\g<what>{LEFT_OUT}", text)
        known = [name for name in self._names if len(name) >= SHORTEST_NAME and name not in self._keep]
        if not known:
            return text
        pattern = "|".join(re.escape(name) for name in sorted(known, key=len, reverse=True))
        return self._substituted(
            "a name", re.compile(rf"(?<!\w)(?:{pattern})(?!\w)"), lambda match: self._names[match[0]], text
        )

    def _hash(self, match: re.Match[str]) -> str:
        return match[0] if match[0].lower() in self._hashes else LEFT_OUT

    def _substituted(
        self, what: str, pattern: re.Pattern[str], to: str | Callable[[re.Match[str]], str], text: str
    ) -> str:
        return self._counted(what, pattern.sub(to, text), text)

    def _counted(self, what: str, after: str, before: str) -> str:
        if after != before:
            self.counts[what] += 1
        return after
