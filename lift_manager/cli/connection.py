"""Shared by commands that connect to a running manager: address, key, and messages if it does not answer."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, TypeVar

import typer

from lift_manager.cli.common import fail
from lift_manager.cli.key_file import KEY_VARIABLE, KeyFile, key_of
from lift_manager.cli.tls_options import connection_advice, tls_context
from lift_manager.client.client import LiftManagerClient
from lift_manager.client.errors import ClientError, NotAManager, Refused, Unreachable
from lift_manager.plain.http import MANAGER, Address, BadAddress

Answer = TypeVar("Answer")


def _url(text: str) -> str:
    """Parse the address of a manager: a URL, `host:port`, or a host alone."""
    try:
        return str(Address.of(text))
    except BadAddress as error:
        raise typer.BadParameter(str(error)) from None


Manager = Annotated[
    str,
    typer.Option(
        "--manager",
        metavar="ADDRESS",
        callback=_url,
        help="Where the manager runs: a URL, host:port or a host; without a key, its own computer only.",
    ),
]
__all__ = ["MANAGER", "KeyFile", "Manager", "ManagerConnection", "report_failure"]


@dataclass(frozen=True, slots=True)
class ManagerConnection:
    """Address and credentials for a manager, from the options of a command."""

    manager: str
    key_file: Path | None = None
    ca: Path | None = None
    certificate: Path | None = None
    certificate_key: Path | None = None

    def run(self, work: Callable[[LiftManagerClient], Awaitable[Answer]]) -> Answer:
        """Run `work` with a client; print a sentence and exit with 1 if it fails."""
        key, tls = key_of(self.key_file), tls_context(self.ca, self.certificate, self.certificate_key)

        async def work_once() -> Answer:
            async with LiftManagerClient(self.manager, key, tls=tls) as client:
                return await work(client)

        try:
            return asyncio.run(work_once())
        except ClientError as error:
            raise report_failure(error, self.manager) from error


def report_failure(error: ClientError, manager: str) -> typer.Exit:
    """Print what went wrong and how to fix it; raise what this returns."""
    if isinstance(error, Unreachable):
        return fail(f"no manager answers at {manager} ({error.text}); {connection_advice(manager)}")
    if isinstance(error, NotAManager):
        return fail(
            f"the server at {manager} is no lift manager (HTTP {error.status}); give its address with --manager ADDRESS"
        )
    if isinstance(error, Refused) and error.status == 401:
        return fail(f"{error}; here, with --key-file FILE or in the variable {KEY_VARIABLE}")
    # the expected body of a request is for programs only
    return fail(str(error).partition("; expected {")[0])
