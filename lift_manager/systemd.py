"""Reports to systemd: ready, stopping, a status line, and that the polls advance.

The protocol is one datagram to a unix socket (sd_notify(3), sd_watchdog_enabled(3)). Without systemd nothing is sent.
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
"""How often the status is sent without a watchdog."""


class Notifier:
    """Sends states to systemd. Never waits and never raises: no lift depends on it."""

    def __init__(self, address: str, watchdog_s: float | None) -> None:
        """`address` as in $NOTIFY_SOCKET, empty for none; `watchdog_s` is how long systemd waits for a watchdog message."""
        self.watchdog_s = watchdog_s
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._failed = False

    @property
    def is_enabled(self) -> bool:
        """Whether there is an address to send to."""
        return bool(self._address)

    def send(self, *states: str) -> bool:
        """Send assignments such as `READY=1` together; returns whether they were sent."""
        if not self._address:
            return False
        try:
            with socket.socket(
                socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC
            ) as sender:
                sender.sendto("\n".join(states).encode(), self._address)
        except OSError as error:
            if not self._failed:
                _log.warning("cannot send %s to systemd over %r: %s", " ".join(states), self._address, error)
            self._failed = True
        else:
            self._failed = False
        return not self._failed


def notifier(environ: Mapping[str, str] = os.environ) -> Notifier:
    """Make the notifier for the environment of this process."""
    address = environ.get("NOTIFY_SOCKET", "")
    if address and address[0] not in "/@":
        _log.warning("NOTIFY_SOCKET is %r, expected a path or an abstract name; nothing is sent to systemd", address)
        address = ""
    return Notifier(address, _watchdog_s(environ) if address else None)


async def report_to_systemd(
    systemd: Notifier,
    patience_s: Mapping[str, float],
    polls: Callable[[], Mapping[str, int]],
    status: Callable[[], str],
) -> None:
    """Report ready, then send watchdog messages while the polls of every lift advance, until cancelled.

    `polls` returns how many polls of each lift have ended, successful or not; `patience_s` is how long each number may stay the same.
    """
    if not systemd.is_enabled:
        return
    loop = asyncio.get_running_loop()
    progress = Progress(patience_s, loop.time())
    # half of what systemd waits, as sd_watchdog_enabled(3) recommends
    every_s = STATUS_EVERY_S if systemd.watchdog_s is None else systemd.watchdog_s / 2
    reported: tuple[str, ...] = ()
    ready = False
    while True:
        stuck = progress.stuck(polls(), loop.time())
        if stuck and stuck != reported:
            names = ", ".join(stuck)
            _log.error("the polls of %s no longer advance, and no controller is the cause; systemd is notified", names)
        reported = stuck
        states = [f"STATUS=polls stand still: {', '.join(stuck)}" if stuck else f"STATUS={status()}"]
        if systemd.watchdog_s is not None and not stuck:
            states.insert(0, "WATCHDOG=1")
        # until it is sent: systemd aborts a start that is not reported in time
        if not ready:
            states.insert(0, "READY=1")
        ready = systemd.send(*states) or ready
        await asyncio.sleep(every_s)


def _watchdog_s(environ: Mapping[str, str]) -> float | None:
    reported, process = environ.get("WATCHDOG_USEC", ""), environ.get("WATCHDOG_PID", "")
    if not reported or (process and process != str(os.getpid())):
        return None
    if not reported.isascii() or not reported.isdigit() or int(reported) == 0:
        _log.warning("WATCHDOG_USEC is %r, expected a number of microseconds; no watchdog messages are sent", reported)
        return None
    return int(reported) / 1_000_000
