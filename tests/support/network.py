"""`lift-manager network` in this process: a hundred short calls would wait for a hundred interpreters."""

from pathlib import Path

import typer
from typer.testing import CliRunner

from lift_manager.cli import network

_APP = typer.Typer(pretty_exceptions_enable=False)
_APP.command()(network.show)


def called(site: Path, *options: str) -> tuple[int, str, str]:
    """Return the exit code, and what went to stdout and stderr."""
    done = CliRunner().invoke(_APP, [str(site), *options], env={"COLUMNS": "200", "TERM": "dumb"})
    return done.exit_code, done.stdout, done.stderr


def printed(site: Path, *options: str) -> str:
    code, out, err = called(site, *options)
    assert code == 0, err
    return out
