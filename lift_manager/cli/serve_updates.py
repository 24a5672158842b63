"""What `lift-manager serve` does for a site that takes configuration updates: counts starts of a trial, and goes back where one fails."""

from __future__ import annotations

import logging
import subprocess
import sys
from collections.abc import Callable
from functools import partial

import typer

from drivers.thread import in_thread
from lift_manager.cli.common import fail
from lift_manager.hub.errors import UpdateRefused
from lift_manager.hub.update.follower import Follower
from lift_manager.hub.update.installation import Installation
from lift_manager.hub.update.installed import Installed, Version, roll_back, start

RESTART = 75
"""Exit code of a manager that is to be started again, with another configuration; EX_TEMPFAIL of sysexits.h."""
CHECK_WITHIN_S = 300.0
"""How long the check of an update may take. Chosen: a thousand lifts on a slow computer that is busy with others."""

_log = logging.getLogger("lift_manager")


def serve_installed(installation: Installation, serve_site: Callable[[Follower], None]) -> None:
    """Serve the site that is installed; a version on trial that does not come up is rolled back at once. Exits with RESTART for another one."""
    try:
        with installation.claimed():
            installed = _begin(installation)
            follower = Follower(installation, partial(_stage, installation))
            try:
                serve_site(follower)
            except (typer.Exit, Exception) as error:
                if follower.has_run or not installed.on_trial:
                    raise
                _log.exception("update %d cannot be started, and is rolled back", installed.current.number)
                installation.write(
                    roll_back(installed, "the manager did not start with it; its log of that time says why")
                )
                raise typer.Exit(RESTART) from error
            if follower.ends_for_restart:
                raise typer.Exit(RESTART)
    except UpdateRefused as error:
        raise fail(str(error)) from error


def _begin(installation: Installation) -> Installed:
    """Complete what a crash has interrupted, and count the start."""
    installed = installation.read()
    begun = start(installed)
    if begun != installed:
        installation.write(begun)
    installation.settle()
    return begun


async def _stage(installation: Installation) -> Version:
    """Check the package that has arrived in a process of its own: it takes seconds, which the lifts would miss."""
    return await in_thread(lambda: _run_stage(installation))


def _run_stage(installation: Installation) -> Version:
    command = [sys.executable, "-I", "-m", "lift_manager", "hub", "update", "stage", str(installation.folder)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=CHECK_WITHIN_S, check=False)  # noqa: S603
    except (OSError, subprocess.TimeoutExpired) as error:
        raise UpdateRefused(f"the update cannot be checked: {error}") from error
    if done.returncode != 0:
        raise UpdateRefused(done.stderr.strip() or f"the check of the update has ended with {done.returncode}")
    return Version.model_validate_json(done.stdout)
