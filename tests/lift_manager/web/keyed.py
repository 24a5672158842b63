"""Keys for the tests of the web face."""

from collections.abc import Mapping
from functools import cache

from lift_manager.api.keys import Key, KeyRing, digest_of, token
from lift_manager.api.roles import OF_SOME_LIFTS, Role

NAMED, OTHER = "lift", "goods"
"""The lifts of the fake manager: the first is that of the robot's key."""

_NUMBERS = {role: f"{number:08x}" for number, role in enumerate(Role)}
_SECRETS = {role: digest_of(f"a secret of {role}") for role in Role}


@cache  # nothing changes a ring, and `fake.app_of` makes an application for each
def ring(*roles: Role, open_without_keys: bool = True) -> KeyRing:
    """A live key for each of these roles, named after it."""
    entries = [
        (Key(_NUMBERS[role], f"the {role}", role, (NAMED,) if role in OF_SOME_LIFTS else ()), digest_of(_SECRETS[role]))
        for role in roles
    ]
    return KeyRing(entries, open_without_keys=open_without_keys)


def key(role: Role) -> str:
    return token(_NUMBERS[role], _SECRETS[role]).reveal()


def bearing(role: Role) -> Mapping[str, str]:
    return {"Authorization": f"Bearer {key(role)}"}
