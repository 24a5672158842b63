"""What an answer says, and in words for people what it is instead of one."""

from __future__ import annotations

import json
from dataclasses import replace

from lift_manager.plain.http import NoAnswer, Reply, Server


class NotJson(ValueError):
    """The body cannot be read."""


def json_of(reply: Reply) -> object:
    """Return what the body says. Raises NotJson."""
    try:
        said: object = json.loads(reply.body)
    except (ValueError, RecursionError) as error:  # RecursionError: ten thousand brackets
        raise NotJson("it is no JSON") from error
    return said


def problem_of(reply: Reply) -> tuple[str, str]:
    """Return code and detail of a problem (RFC 9457, with a code); both empty where the answer is none."""
    try:
        said = json_of(reply) if reply.status >= 400 else None
    except NotJson:
        return "", ""
    if not isinstance(said, dict):
        return "", ""
    code, detail = said.get("code"), said.get("detail")
    return (code, detail) if isinstance(code, str) and isinstance(detail, str) else ("", "")


def refusal(server: Server, reply: Reply, key_needed: str) -> str:
    """Say why an answer is not yes. `key_needed` is added where the key does not do."""
    code, detail = (server.without_key(text) for text in problem_of(reply))
    if not code:
        return stranger(server, reply)
    if reply.status in (401, 403):
        return f"the manager at {server.address} refuses ({code}): {detail}; {key_needed}"
    if code == "no_such_path" and server.address.prefix:
        return (
            f"the manager at {replace(server.address, prefix='')} has nothing under {server.address.prefix}:"
            " leave that out of its address; only a proxy in front of a manager adds a path"
        )
    if code == "no_such_path":
        return f"the manager at {server.address} is of a version that does not know what is asked: {detail}"
    return f"the manager at {server.address} refuses ({code}): {detail}"


def stranger(server: Server, reply: Reply) -> str:
    """Say what answers in the place of a manager."""
    if 300 <= reply.status < 400:
        return (
            f"what answers at {server.address} points elsewhere (HTTP {reply.status});"
            " give the address of the manager itself"
        )
    kind = server.without_key(reply.kind)
    return f"what answers at {server.address} is no lift manager (HTTP {reply.status}, {kind})"


def nobody(server: Server, error: NoAnswer) -> str:
    """Say that nothing answers."""
    return f"no manager answers at {server.address} ({error})"
