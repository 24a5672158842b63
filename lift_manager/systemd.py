"""What systemd is told about this process: ready, stopping, how it stands, and that its polls advance.

The protocol is one datagram to a unix socket (sd_notify(3), sd_watchdog_enabled(3)). Outside systemd nothing is sent.
"""

from __future__ import annotations

import asyncio
import logging
import os
import socket
from collections.abc import Callable, Mapping

from lift_manager.runtime.progress import Progress

_log = logging.getLogger(__name__)

STATUS_EVERY_S = 10.0
"""How often the status is renewed where no watchdog sets the pace."""


class Notifier:
    """Sends states to systemd. Never waits and never raises: no lift depends on who watches us."""

    def __init__(self, address: str, watchdog_s: float | None) -> None:
        """`address` as in $NOTIFY_SOCKET, empty for nobody; `watchdog_s` is how long systemd waits for a sign of life."""
        self.watchdog_s = watchdog_s
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._failed = False

    @property
    def is_heard(self) -> bool:
        """Whether there is anybody to tell."""
        return bool(self._address)

    def send(self, *states: str) -> bool:
        """Send assignments such as `READY=1`, together; returns whether they are on their way."""
        if not self._address:
            return False
        try:
            with socket.socket(
                socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC
            ) as sender:
                sender.sendto("\n".join(states).encode(), self._address)
        except OSError as error:
            if not self._failed:
                _log.warning("systemd cannot be told %s over %r: %s", " ".join(states), self._address, error)
            self._failed = True
        else:
            self._failed = False
        return not self._failed


def notifier(environ: Mapping[str, str] = os.environ) -> Notifier:
    """Make the notifier that the environment asks for."""
    address = environ.get("NOTIFY_SOCKET", "")
    if address and address[0] not in "/@":
        _log.warning("NOTIFY_SOCKET is %r, expected a path or an abstract name; systemd is told nothing", address)
        address = ""
    return Notifier(address, _watchdog_s(environ) if address else None)


async def watch(
    systemd: Notifier,
    patience_s: Mapping[str, float],
    polls: Callable[[], Mapping[str, int]],
    status: Callable[[], str],
) -> None:
    """Say that we are ready, then give a sign of life for as long as the polls of every lift advance. Until cancelled.

    `polls` tells how many polls of each lift have ended, well or not; `patience_s` how long each number may stand still.
    """
    if not systemd.is_heard:
        return
    loop = asyncio.get_running_loop()
    progress = Progress(patience_s, loop.time())
    # half of what systemd waits, as sd_watchdog_enabled(3) recommends
    every_s = STATUS_EVERY_S if systemd.watchdog_s is None else systemd.watchdog_s / 2
    told: tuple[str, ...] = ()
    ready = False
    while True:
        stuck = progress.stuck(polls(), loop.time())
        if stuck and stuck != told:
            names = ", ".join(stuck)
            _log.error(
                "the polls of %s do not advance any more, through no fault of a controller; systemd is told", names
            )
        told = stuck
        states = [f"STATUS=polls stand still: {', '.join(stuck)}" if stuck else f"STATUS={status()}"]
        if systemd.watchdog_s is not None and not stuck:
            states.insert(0, "WATCHDOG=1")
        # until it is on its way: a start that systemd has not heard of is ended when its time is over
        if not ready:
            states.insert(0, "READY=1")
        ready = systemd.send(*states) or ready
        await asyncio.sleep(every_s)


def _watchdog_s(environ: Mapping[str, str]) -> float | None:
    told, process = environ.get("WATCHDOG_USEC", ""), environ.get("WATCHDOG_PID", "")
    if not told or (process and process != str(os.getpid())):
        return None
    if not told.isascii() or not told.isdigit() or int(told) == 0:
        _log.warning("WATCHDOG_USEC is %r, expected a number of microseconds; systemd gets no sign of life", told)
        return None
    return int(told) / 1_000_000
