"""What commands share that speak to a running manager: where it is, as whom, and what is said when it does not answer."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, TypeVar

import typer

from lift_manager.cli.common import fail
from lift_manager.cli.secured import advice, verified
from lift_manager.client.client import MANAGER, LiftManagerClient
from lift_manager.client.errors import ClientError, NotAManager, Refused, Unreachable
from lift_manager.domain.keys import Secret, is_token

Answer = TypeVar("Answer")

KEY_VARIABLE = "LIFT_MANAGER_KEY"

Manager = Annotated[
    str,
    typer.Option("--manager", metavar="URL", help="Where the manager runs; without a key, its own computer only."),
]
KeyFile = Annotated[
    Path | None,
    typer.Option(
        "--key-file",
        metavar="FILE",
        help=f"A file that holds your key and nothing else; or set {KEY_VARIABLE}.",
        show_default=False,
    ),
]

__all__ = ["KEY_VARIABLE", "MANAGER", "KeyFile", "Manager", "Speaker", "failure"]


@dataclass(frozen=True, slots=True)
class Speaker:
    """Where a manager is, and as whom it is spoken to; from the options of a command."""

    manager: str
    key_file: Path | None = None
    ca: Path | None = None
    certificate: Path | None = None
    certificate_key: Path | None = None

    def ask(self, work: Callable[[LiftManagerClient], Awaitable[Answer]]) -> Answer:
        """Do something with a manager; one sentence and exit 1 where that fails."""
        key, tls = _key(self.key_file), verified(self.ca, self.certificate, self.certificate_key)

        async def once() -> Answer:
            async with LiftManagerClient(self.manager, key, tls=tls) as client:
                return await work(client)

        try:
            return asyncio.run(once())
        except ClientError as error:
            raise failure(error, self.manager) from error


def failure(error: ClientError, manager: str) -> typer.Exit:
    """Print what went wrong and what helps; raise what this returns."""
    if isinstance(error, Unreachable):
        return fail(f"no manager answers at {manager} ({error.text}); {advice(manager)}")
    if isinstance(error, NotAManager):
        return fail(
            f"what answers at {manager} is no lift manager (HTTP {error.status}); say where it runs with --manager URL"
        )
    if isinstance(error, Refused) and error.status == 401:
        return fail(f"{error}; here, with --key-file FILE or in the variable {KEY_VARIABLE}")
    return fail(str(error))


def _key(file: Path | None) -> Secret | None:
    """Return the key to send. Never from the command line itself: every user of the computer can read that."""
    if file is None:
        source, text = KEY_VARIABLE, os.environ.get(KEY_VARIABLE, "")
        if not text:
            return None
    else:
        source = str(file)
        try:
            text, mode = file.read_text("utf-8"), file.stat().st_mode
        except (OSError, UnicodeDecodeError) as error:
            why = error.strerror if isinstance(error, OSError) else "it is not text"
            raise fail(f"{source} cannot be read: {why}") from None
        if mode & 0o007:
            raise fail(f"every user of this computer may use the key in {source}; `chmod 600 {source}` first")
    if not is_token(text.strip()):
        raise fail(f"{source} holds no key; a key begins with lm_, and `lift-manager keys make` prints it once")
    return Secret(text.strip())
