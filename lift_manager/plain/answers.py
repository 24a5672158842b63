"""Reads answers of a manager, and explains in words for people what is wrong with one."""

from __future__ import annotations

import json
from dataclasses import replace

from lift_manager.plain.http import NoAnswer, Reply, Server


class NotJson(ValueError):
    """The body is not JSON."""


def parse_json(reply: Reply) -> object:
    """Return the body as JSON. Raises NotJson."""
    try:
        data: object = json.loads(reply.body)
    except (ValueError, RecursionError) as error:  # RecursionError: ten thousand brackets
        raise NotJson("it is not JSON") from error
    return data


def parse_problem(reply: Reply) -> tuple[str, str]:
    """Return code and detail of a problem (RFC 9457, with a code); both are empty if the answer is not one."""
    try:
        data = parse_json(reply) if reply.status >= 400 else None
    except NotJson:
        return "", ""
    if not isinstance(data, dict):
        return "", ""
    code, detail = data.get("code"), data.get("detail")
    return (code, detail) if isinstance(code, str) and isinstance(detail, str) else ("", "")


def describe_refusal(server: Server, reply: Reply, key_needed: str) -> str:
    """Explain why a request was refused. `key_needed` is added if the key does not permit it."""
    code, detail = (server.without_key(text) for text in parse_problem(reply))
    if not code:
        return describe_stranger(server, reply)
    if reply.status in (401, 403):
        return f"the manager at {server.address} refuses ({code}): {detail}; {key_needed}"
    if code == "no_such_path" and server.address.prefix:
        return (
            f"the manager at {replace(server.address, prefix='')} has nothing under {server.address.prefix}:"
            " leave the path out of its address; only a proxy in front of a manager adds one"
        )
    if code == "no_such_path":
        return f"the manager at {server.address} is of a version that does not know this request: {detail}"
    return f"the manager at {server.address} refuses ({code}): {detail}"


def describe_stranger(server: Server, reply: Reply) -> str:
    """Explain that something other than a manager answers."""
    if 300 <= reply.status < 400:
        return (
            f"the server at {server.address} redirects elsewhere (HTTP {reply.status});"
            " give the address of the manager itself"
        )
    kind = server.without_key(reply.kind)
    return f"the server at {server.address} is no lift manager (HTTP {reply.status}, {kind})"


def describe_no_answer(server: Server, error: NoAnswer) -> str:
    """Explain that nothing answers."""
    return f"no manager answers at {server.address} ({error})"
