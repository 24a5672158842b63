"""The key that a command sends to a manager, from a file or the environment."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from lift_manager.api.keys import Secret, is_token
from lift_manager.cli.common import fail

KEY_VARIABLE = "LIFT_MANAGER_KEY"

KeyFile = Annotated[
    Path | None,
    typer.Option(
        "--key-file",
        metavar="FILE",
        help=f"A file with your key and nothing else; or set {KEY_VARIABLE}.",
        show_default=False,
    ),
]


def key_of(file: Path | None) -> Secret | None:
    """Return the key to send. It never comes from the command line, which every user of the computer can read."""
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
