"""A manager that a tool runs for itself while it lasts, so that its commands obey the same rules as those of any robot."""

from __future__ import annotations

import asyncio
import logging
import secrets
import signal
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Collection, Coroutine, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from drivers.errors import ControllerTaken, LockUnusable
from lift_manager import app
from lift_manager.api.keys import Key, KeyRing, Secret, digest_of, token
from lift_manager.api.roles import Role
from lift_manager.cli.active_machine import require_no_active_machine
from lift_manager.cli.common import fail, load_site_or_exit, open_store_or_exit, print_stderr, report_mistakes
from lift_manager.cli.logs import HumanFormatter
from lift_manager.cli.loop import cancel_on_signals
from lift_manager.client.client import LiftManagerClient
from lift_manager.client.errors import ClientError
from lift_manager.config.check_outputs import check_outputs
from lift_manager.config.load import LoadedSite
from lift_manager.config.site import Api
from lift_manager.lift.journal import Row
from lift_manager.runtime.links import WireFrame
from lift_manager.runtime.recorder import Recorder
from lift_manager.web.server import listen
from register_maps.errors import MapFileError

Answer = TypeVar("Answer")

HOST = "127.0.0.1"
KEPT_LINES = 100
"""How many lines of the manager's log are kept for a tool that fails. Chosen: several screens."""

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
    loaded: LoadedSite,
    *,
    name: str,
    may_command: Collection[str] = (),
    recorder: Recorder | None = None,
    on_frame: Callable[[WireFrame], None] | None = None,
) -> AsyncIterator[LiftManagerClient]:
    """Run a manager of this site on a free port of this computer, and stop it in order: yields a client, called `name`.

    Not one byte is written to any lift but those of `may_command`, whatever the site file says. Nobody else has the key. Without a
    recorder nothing is written down. What the manager logs is not part of what a tool prints: warnings appear on stderr at the end,
    those about the release of outputs always, others if the block raises an error. `on_frame` is as of `app.Faces`.

    Raises OutputsShared before anything is sent, where one of `may_command` writes what another lift of the site writes; ControllerTaken
    where another process of this computer talks to a controller of the site already, LockUnusable, and NotReleased; an ExceptionGroup
    for a bug. The block must not hold up the event loop: outputs are refreshed on it.
    """
    _check_outputs_of(loaded, may_command)
    lifts = {
        lift: entry.model_copy(update={"access": "control" if lift in may_command else "monitor"})
        for lift, entry in loaded.site.lifts.items()
    }
    private = replace(loaded, site=loaded.site.model_copy(update={"lifts": lifts, "api": Api(host=HOST)}))
    secret, keys = _new_key(name)
    stop, ready = asyncio.Event(), asyncio.Event()
    with _hold_log_back() as log_lines, listen(HOST, 0) as sock:
        port = sock.getsockname()[1]
        running = asyncio.ensure_future(
            app.run(
                private,
                sock,
                stop=stop,
                ready=ready.set,
                recorder=recorder,
                faces=app.Faces(keys, on_frame=on_frame),
            )
        )
        running.add_done_callback(lambda _: ready.set())
        has_failed = True
        try:
            await ready.wait()
            if not running.done():
                async with LiftManagerClient(f"http://{HOST}:{port}", secret) as client:
                    yield client
            has_failed = False
        except asyncio.CancelledError:
            has_failed = False
            raise
        finally:
            if not has_failed:
                log_lines.clear()
            stop.set()
            if not await _result_of(running):
                raise NotReleased(
                    "not every output could be verified as released: look at the lift; a hold that its controller latches stays on"
                )


def _check_outputs_of(loaded: LoadedSite, lifts: Collection[str]) -> None:
    """Raise OutputsShared: `check` finds this only for lifts whose `access` is `control`."""
    commanded = {name: lift.model_copy(update={"access": "control"}) for name, lift in loaded.site.lifts.items()}
    site = loaded.site.model_copy(update={"lifts": commanded})
    for lift in lifts:
        for other in commanded:
            both = {name: loaded.maps[name] for name in commanded if name in (lift, other)}
            if (problem := next(check_outputs(site, both), None)) is not None:
                raise OutputsShared(f"{problem.key[-1]} {problem.message}; nothing was sent")


class OutputsShared(Exception):
    """Two lifts of a site write the same registers: a command for one would move the other."""


class NotReleased(Exception):
    """Outputs that were on may still be on."""


async def _result_of(running: asyncio.Future[bool]) -> bool:
    """Wait for the end of the manager, and only then obey a cancellation: nothing else releases its outputs."""
    is_cancelled = False
    while not running.done():
        try:
            await asyncio.wait([running])
        except asyncio.CancelledError:
            is_cancelled = True
    released = running.result()
    if is_cancelled and released:
        raise asyncio.CancelledError
    return released


@contextmanager
def _hold_log_back() -> Iterator[deque[str]]:
    """Keep warnings and errors of the log while the context lasts, the newest ones, and print what is kept at its end."""
    lines: deque[str] = deque(maxlen=KEPT_LINES)
    handler = logging.Handler(logging.WARNING)
    handler.setFormatter(HumanFormatter())
    handler.emit = lambda record: lines.append(handler.format(record))  # type: ignore[method-assign]  # a handler of one line
    logging.getLogger().addHandler(handler)
    try:
        yield lines
    finally:
        logging.getLogger().removeHandler(handler)
        for line in lines:
            print_stderr(line)


def _new_key(name: str) -> tuple[Secret, KeyRing]:
    """Return a key that is valid for this process alone."""
    key_id, secret = secrets.token_hex(4), secrets.token_hex(32)
    key = Key(key_id, name, Role.COMMISSIONER)
    return token(key_id, secret), KeyRing([(key, digest_of(secret))], open_without_keys=False)


def run_directly(  # noqa: PLR0913  each is needed by one tool or another
    site: Path,
    work: Callable[[LiftManagerClient], Awaitable[Answer]],
    *,
    name: str,
    may_command: Collection[str] = (),
    is_recorded: bool = False,
    change: Callable[[LoadedSite], LoadedSite] = lambda loaded: loaded,
    decision: Row | None = None,
    on_frame: Callable[[WireFrame], None] | None = None,
    without_etcd: bool = False,
) -> Answer:
    """Run `work` with an own manager of a site file, and release everything at its end, Ctrl-C, SIGTERM and SIGHUP included.

    `is_recorded`: with the store of the site, so that presses are in its journal and an earlier lockout counts. `change` is made to
    the loaded site, and `decision` of a person is on the disk before `work` begins. `on_frame` is as of `app.Faces`; `without_etcd` is
    as of `active_machine_problem`. Prints a sentence and exits with 1 where that fails.
    """
    loaded = load_site_or_exit(site)
    if loaded.unusable:
        raise report_mistakes(MapFileError(loaded.unusable))
    require_no_active_machine(loaded, without_etcd=without_etcd)
    try:
        loaded = change(loaded)
    except MapFileError as error:
        raise report_mistakes(error) from error
    recorder = open_store_or_exit(loaded) if is_recorded else None

    async def work_once() -> Answer:
        async with own_manager(
            loaded, name=name, may_command=may_command, recorder=recorder, on_frame=on_frame
        ) as client:
            if (
                decision is not None
                and recorder is not None
                and (why := await recorder.commit_now(decision)) is not None
            ):
                raise fail(f"nothing was sent, because it could not be written down: {why}")
            return await work(client)

    return run_to_end(work_once())


def run_to_end(work: Coroutine[Any, Any, Answer]) -> Answer:
    """Run work with managers of its own; signals cancel it, and what it held is released.

    Prints a sentence and exits with 1 where it fails.
    """
    received: list[int] = []
    try:
        return asyncio.run(cancel_on_signals(work, received))
    except asyncio.CancelledError:
        if signal.SIGINT in received:
            raise KeyboardInterrupt from None  # as from any other command
        raise typer.Exit(1) from None
    except ControllerTaken as error:
        raise fail(f"{error}; without --site this works through the running manager") from error
    except (ClientError, LockUnusable, NotReleased, OutputsShared) as error:
        raise fail(str(error)) from error
