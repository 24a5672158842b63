"""The packet filter of a machine, as a program of its own: lets the manager reach the controllers while that has a term.

It runs with CAP_NET_ADMIN, so that the manager needs no capability, and is not stopped by what stops the manager. If it ends, the filter
stays as it is, and a permission runs out by itself.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import struct
import subprocess
from asyncio import StreamReader, StreamWriter, Task
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Protocol

from drivers.clock import boottime
from lift_manager.cluster.errors import FilterFailed
from lift_manager.cluster.filter_messages import (
    MOST_BYTES,
    BadMessage,
    PermissionAnswer,
    PermissionRequest,
    controller_names,
    decode_request,
    encode,
)
from lift_manager.cluster.filter_rules import TABLE, connection_sets, ruleset
from lift_manager.cluster.term import TERM_S

_log = logging.getLogger(__name__)

SLACK_S = 0.02
"""A permission ends so much before its term. If applying it took longer than this, it is applied again. Chosen: it takes 0.1 ms, and
8 ms at worst beside programs that took ten times what two processors have."""

_CREDENTIALS = struct.Struct("3i")


class Sets(Protocol):
    """The sets of the filter: `filter_kernel.Kernel`."""

    def permit(self, user: int, ms: int, forget: Sequence[str] = ()) -> None:
        """Permit the programs of a user, and of nobody else, for this long; first forget every connection in these sets. Raises FilterFailed."""

    def withdraw(self) -> None:
        """Permit nobody. Raises FilterFailed."""


class Filter:
    """Who is permitted, by the requests of the managers on this machine, of which one is active."""

    def __init__(
        self,
        controllers: Sequence[tuple[str, int]],
        user: int,
        sets: Sets,
        load: Callable[[], None],
        *,
        clock: Callable[[], float] = boottime,
    ) -> None:
        """`controllers` are those of the rules, by address and port; `user` is whom the manager runs as.

        `load` puts the rules in their place again if somebody has removed them, such as a firewall that is loaded. Raises FilterFailed.
        """
        self._names = controller_names(controllers)
        self._connections = connection_sets(controllers)
        self._user = user
        self._sets = sets
        self._load = load
        self._clock = clock
        self._epoch: int | None = None
        self._holder: object = None

    def request(self, holder: object, request: PermissionRequest) -> PermissionAnswer:
        """Permit what a manager requests, or say why not; `holder` is the connection over which it does. Raises FilterFailed."""
        if request.controllers != self._names:
            return PermissionAnswer(
                f"it filters {', '.join(self._names)}, and the manager has {', '.join(request.controllers)}; restart it if the site file has changed"
            )
        # what was begun in another term is forgotten in the transaction that permits this one
        forget = () if request.epoch == self._epoch else self._connections
        was_loaded = False
        while (remaining_ms := self._remaining_ms(request.until)) > 0:
            begun_at = self._clock()
            try:
                self._sets.permit(self._user, remaining_ms, forget)
            except FilterFailed as error:
                if was_loaded:
                    raise
                _log.error(
                    "%s; the rules are loaded again, and connections to the controllers have to be made again", error
                )
                self._load()
                was_loaded = True
                continue
            if request.epoch != self._epoch:
                _log.warning("the manager of epoch %d may reach the controllers", request.epoch)
            self._epoch, self._holder, forget = request.epoch, holder, ()
            if self._clock() - begun_at <= SLACK_S:
                return PermissionAnswer()
        if holder is self._holder:
            self._sets.withdraw()
        return PermissionAnswer("the term was over when it was to be permitted")

    def end(self, holder: object) -> None:
        """Withdraw what was permitted to a manager that has gone. Raises FilterFailed."""
        if holder is self._holder:
            self._holder = None
            self._sets.withdraw()
            _log.warning("the manager of epoch %s has ended its term: nobody reaches the controllers", self._epoch)

    def _remaining_ms(self, until: float) -> int:
        """Return how long a permission is from now on, rounded down; never longer than a term, whatever is requested."""
        return int(max(min(until - self._clock(), TERM_S) - SLACK_S, 0.0) * 1000)


def load_rules(controllers: Sequence[tuple[str, int]]) -> None:
    """Replace the table of the filter by one that permits nobody, in one transaction. Raises FilterFailed."""
    _nft("\n".join([*ruleset(controllers), ""]))


def remove_rules() -> None:
    """Remove the table of the filter, if it is there: everybody reaches the controllers. Raises FilterFailed."""
    _nft(f"table inet {TABLE}\ndelete table inet {TABLE}\n")


def _nft(text: str) -> None:
    try:
        done = subprocess.run(["nft", "-f", "-"], input=text, capture_output=True, text=True, check=False)  # noqa: S607  where PATH has it
    except OSError as error:
        raise FilterFailed(
            f"nft cannot be run ({error.strerror or error}); on Debian: apt-get install nftables"
        ) from error
    if done.returncode:
        reason = done.stderr.strip().splitlines()
        raise FilterFailed(f"nft refuses the rules: {reason[0] if reason else f'it has ended with {done.returncode}'}")


@contextmanager
def listening(path: Path) -> Iterator[socket.socket]:
    """Yield the socket for managers. Its file stays when the program ends, as the rules do: with both there, nobody reaches a controller.

    Raises FilterFailed, also if another filter serves there.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_CLOEXEC) as sock:
        try:
            if is_served(path):
                raise FilterFailed(f"another packet filter of this machine answers at {path}; end that one first")
            path.unlink(missing_ok=True)
            sock.bind(str(path))
            path.chmod(0o666)  # who has connected is known, and only the user of the manager is served
            sock.listen()
        except OSError as error:
            raise FilterFailed(f"{path}: {error.strerror or error}") from error
        yield sock


def is_served(path: Path) -> bool:
    """Whether a packet filter answers there."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_CLOEXEC) as probe:
        try:
            probe.connect(str(path))
        except OSError:
            return False
    return True


async def serve(packet_filter: Filter, sock: socket.socket, user: int, stop: asyncio.Event) -> None:
    """Answer managers that run as this user until `stop` is set; then nobody is permitted."""
    strangers: set[int] = set()
    answering: dict[Task[None] | None, StreamWriter] = {}

    async def answer(reader: StreamReader, writer: StreamWriter) -> None:
        answering[asyncio.current_task()] = writer
        if (peer := _user_of(writer)) == user:
            with suppress(OSError, ValueError):  # a manager that has gone, and a line that is too long
                await _answer(packet_filter, reader, writer)
        else:
            if peer not in strangers:
                text = "a program of user %d has requested to reach the controllers, and only those of user %d may"
                _log.warning(text, peer, user)
            strangers.add(peer)
            writer.write(encode(PermissionAnswer(f"it serves user {user}, and this one is {peer}")))
        del answering[asyncio.current_task()]
        writer.close()

    # not start_unix_server, which removes the file of the socket at its end in some versions of Python
    async with await asyncio.start_server(answer, sock=sock, limit=MOST_BYTES):
        await stop.wait()
        while tasks := [task for task in answering if task is not None]:
            for writer in answering.values():
                writer.close()  # which ends its task
            await asyncio.wait(tasks)


async def _answer(packet_filter: Filter, reader: StreamReader, writer: StreamWriter) -> None:
    holder, logged = object(), ""
    try:
        while line := await reader.readline():
            try:
                answer = packet_filter.request(holder, decode_request(line))
            except (FilterFailed, BadMessage) as error:
                answer = PermissionAnswer(str(error))
            if answer.refused and answer.refused != logged:
                _log.warning("nobody reaches the controllers: %s", answer.refused)
            logged = answer.refused
            writer.write(encode(answer))
            await writer.drain()
    finally:
        try:
            packet_filter.end(holder)
        except FilterFailed as error:
            _log.error("%s; what is permitted ends within %g s", error, TERM_S)


def _user_of(writer: StreamWriter) -> int:
    connected = writer.get_extra_info("socket")
    credentials = connected.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    return int(_CREDENTIALS.unpack(credentials)[1])
