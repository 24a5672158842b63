"""A manager that a tool runs for itself while it lasts, so that its commands obey the same rules as those of any robot."""

from __future__ import annotations

import asyncio
import secrets
import signal
from collections.abc import AsyncIterator, Awaitable, Callable, Collection
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, TypeVar, cast

import typer

from drivers.errors import ControllerTaken, LockUnusable
from lift_manager import app
from lift_manager.api.keys import Key, KeyRing, Secret, digest_of, token
from lift_manager.api.roles import Role
from lift_manager.cli.common import fail, load_site_or_exit, report_mistakes, store_path_of
from lift_manager.client.client import LiftManagerClient
from lift_manager.client.errors import ClientError
from lift_manager.config.load import LoadedSite
from lift_manager.config.site import Api
from lift_manager.runtime.recorder import Recorder
from lift_manager.store.errors import StoreError
from lift_manager.store.retention import Limits
from lift_manager.store.site import open_store
from lift_manager.web.server import listen
from register_maps.errors import MapFileError

Answer = TypeVar("Answer")

HOST = "127.0.0.1"

SiteOption = Annotated[
    Path | None,
    typer.Option(
        "--site",
        metavar="SITE",
        help="Talk to the controllers of this site file directly, while no manager runs; otherwise through the running one.",
        show_default=False,
    ),
]


@asynccontextmanager
async def own_manager(
    loaded: LoadedSite, *, name: str, may_command: Collection[str] = (), recorder: Recorder | None = None
) -> AsyncIterator[LiftManagerClient]:
    """Run a manager of this site on a free port of this computer, and stop it in order: yields a client, called `name`.

    Not one byte is written to any lift but those of `may_command`, whatever the site file says. Nobody else has the key. Without a
    recorder nothing is written down. Raises ControllerTaken where another process of this computer talks to a controller of the site
    already, and LockUnusable; an ExceptionGroup for a bug.
    """
    lifts = {
        lift: entry.model_copy(update={"access": "control" if lift in may_command else "monitor"})
        for lift, entry in loaded.site.lifts.items()
    }
    private = replace(loaded, site=loaded.site.model_copy(update={"lifts": lifts, "api": Api(host=HOST)}))
    secret, keys = _new_key(name)
    stop, ready = asyncio.Event(), asyncio.Event()
    with listen(HOST, 0) as sock:
        port = sock.getsockname()[1]
        running = asyncio.ensure_future(
            app.run(private, sock, stop=stop, ready=ready.set, recorder=recorder, faces=app.Faces(keys))
        )
        running.add_done_callback(lambda _: ready.set())
        try:
            await ready.wait()
            if not running.done():
                async with LiftManagerClient(f"http://{HOST}:{port}", secret) as client:
                    yield client
        finally:
            stop.set()
            await asyncio.shield(running)


def _new_key(name: str) -> tuple[Secret, KeyRing]:
    """Return a key that is valid for this process alone."""
    key_id, secret = secrets.token_hex(4), secrets.token_hex(32)
    key = Key(key_id, name, Role.COMMISSIONER)
    return token(key_id, secret), KeyRing([(key, digest_of(secret))], open_without_keys=False)


def run_directly(
    site: Path,
    work: Callable[[LiftManagerClient], Awaitable[Answer]],
    *,
    name: str,
    may_command: Collection[str] = (),
    is_recorded: bool = False,
) -> Answer:
    """Run `work` with an own manager of a site file, and release everything at its end, Ctrl-C, SIGTERM and SIGHUP included.

    `is_recorded`: with the store of the site, so that presses are in its journal and a lockout of before counts. Prints a sentence and
    exits with 1 where that fails.
    """
    loaded = load_site_or_exit(site)
    if loaded.unusable:
        raise report_mistakes(MapFileError(loaded.unusable))
    recorder = _open_store(loaded) if is_recorded else None

    async def work_once() -> Answer:
        loop, task = asyncio.get_running_loop(), asyncio.current_task()
        for number in (signal.SIGTERM, signal.SIGHUP):
            loop.add_signal_handler(number, cast("asyncio.Task[Answer]", task).cancel)
        async with own_manager(loaded, name=name, may_command=may_command, recorder=recorder) as client:
            return await work(client)

    try:
        return asyncio.run(work_once())
    except asyncio.CancelledError:
        raise typer.Exit(1) from None
    except ClientError as error:
        raise fail(str(error)) from error
    except ControllerTaken as error:
        raise fail(f"{error}; without --site this works through the running manager") from error
    except LockUnusable as error:
        raise fail(str(error)) from error


def _open_store(loaded: LoadedSite) -> Recorder:
    limits = Limits(loaded.site.journal.keep_days, loaded.site.journal.max_mb)
    try:
        return open_store(store_path_of(loaded), loaded.site.name, loaded.site.lifts.keys(), limits)
    except StoreError as error:
        raise fail(str(error)) from error
