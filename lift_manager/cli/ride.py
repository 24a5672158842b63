"""`lift-manager ride`: act as a robot, to try out a lift."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Annotated

import typer

from lift_manager.cli.common import print_lines, print_stderr
from lift_manager.cli.connection import KeyFile, Manager, ManagerConnection
from lift_manager.cli.keyboard import EnterResult, wait_for_enter
from lift_manager.cli.tls_options import Ca, Certificate, CertificateKey
from lift_manager.client.client import LiftManagerClient
from lift_manager.client.errors import Refused, Unreachable
from lift_manager.client.ride import ActiveRide
from lift_manager.client.ride_step import Step
from lift_manager.plain.http import MANAGER
from lift_manager.plain.paths import API, ride_path
from lift_manager.rides.ride import Guidance, Phase

PROMPTS = {
    Guidance.ENTER: "press ENTER once the robot is inside",
    Guidance.LEAVE: "press ENTER once the robot is outside",
}
END_WITHIN_S = 120.0
"""How long to wait for the end of a cancelled ride, in which a robot that may be inside can leave. Chosen."""
AGAIN_S = 1.0
"""Between two attempts to cancel a ride while no manager answers. Chosen."""
SIGNALS: dict[int, str] = {
    getattr(signal, name): name_of_signal
    for name, name_of_signal in (
        ("SIGINT", "Ctrl-C"),
        ("SIGTERM", "SIGTERM"),
        ("SIGHUP", "SIGHUP: the terminal was closed"),
    )
    if hasattr(signal, name)
}
"""Signals that end a ride safely, with their names for people. Windows has no SIGHUP."""


def ride(  # noqa: PLR0913  each is an option of the command line
    lift: Annotated[str, typer.Argument(metavar="LIFT", help="The lift by its name, or `any`.")],
    start: Annotated[str, typer.Argument(metavar="FROM", help="The floor where the robot waits.")],
    destination: Annotated[str, typer.Argument(metavar="TO", help="The floor to which it rides.")],
    *,
    robot: Annotated[
        str, typer.Option("--robot", metavar="NAME", help="Its name; others see it as the holder of the lift.")
    ],
    yes: Annotated[
        bool, typer.Option("--yes", help="Without a robot: report `entered` and `left` as soon as they are due.")
    ] = False,
    manager: Manager = MANAGER,
    key_file: KeyFile = None,
    ca: Ca = None,
    certificate: Certificate = None,
    certificate_key: CertificateKey = None,
) -> None:
    """Ride a lift as a robot would.

    It prints the guidance of the manager, and reports when the robot has entered and left. Ctrl-C cancels, and waits until the robot is
    out. SIGTERM, SIGHUP and Ctrl-D do the same; a second one ends the command at once, and the ride goes on.

    Exit codes: 0 the robot has arrived; 1 no manager, or it refused; 3 the ride was cancelled; 4 it was given up; 5 the ride goes on.

    Example: lift-manager ride any L1 L2 --robot demo --yes
    """
    if not yes and (sys.platform == "win32" or not sys.stdin.isatty()):
        raise typer.BadParameter("without a terminal nobody can confirm that the robot is inside", param_hint="--yes")
    connection = ManagerConnection(manager, key_file, ca, certificate, certificate_key)
    rider = Rider(None if yes else sys.stdin.fileno())
    last = connection.run(lambda client: rider.ride(client, lift, start, destination, robot))
    if last is None or not last.over:
        raise typer.Exit(5)
    if last.ride.phase is Phase.CANCELLED:
        raise typer.Exit(3)
    if last.guidance is not Guidance.DONE:
        raise typer.Exit(4)


class Rider:
    """Runs one ride, once."""

    def __init__(self, terminal: int | None) -> None:
        """At `terminal` a person confirms that the robot is inside and outside; without one both are reported as soon as they are due."""
        self._terminal = terminal
        self._id = ""
        self._last: Step | None = None
        self._why = ""
        self._stop, self._end_now = asyncio.Event(), asyncio.Event()

    def stop(self, why: str) -> None:
        """Cancel the ride and wait for its end; the second time, end at once."""
        if self._stop.is_set():
            self._end_now.set()
        self._why = self._why or why
        self._stop.set()

    async def ride(self, client: LiftManagerClient, lift: str, start: str, destination: str, robot: str) -> Step | None:
        """Return the last known step: it is not over if the ride goes on, and None if nothing is known of it."""
        with _call_on_signals(self.stop):
            if not await _run_until(self._end_now, self._ride(client, lift, start, destination, robot)):
                self._report_unfinished(client, "ended at once")
        return self._last

    async def _ride(self, client: LiftManagerClient, lift: str, start: str, destination: str, robot: str) -> None:
        async with client.ride(lift, start, destination, robot=robot) as ride:
            self._id = ride.id
            if await _run_until(self._stop, self._follow(ride)):
                return
            self._print(print_stderr, f"cancelled ({self._why}); waiting for the end; repeat it to end at once")
            try:
                async with asyncio.timeout(END_WITHIN_S):
                    await self._end(ride)
            except TimeoutError:
                self._report_unfinished(client, f"the ride has not ended within {END_WITHIN_S:g} s")

    async def _end(self, ride: ActiveRide) -> None:
        """Cancel the ride, and wait until the robot is out and the ride has ended."""
        previous = self._last
        while not ride.over:
            try:
                await ride.cancel(self._why)
                break
            except Unreachable as error:
                self._print(print_stderr, f"{error}; trying again")
                await asyncio.sleep(AGAIN_S)
        if previous is not None and previous.ride.phase is ride.now.ride.phase:
            # the robot was leaving already, and its prompt was interrupted
            await self._act_on(ride, ride.now)
        await self._follow(ride)

    async def _follow(self, ride: ActiveRide) -> None:
        async for step in ride:
            await self._act_on(ride, step)

    async def _act_on(self, ride: ActiveRide, step: Step) -> None:
        self._last = step
        self._print(_print_line, _line(step))
        report = {Guidance.ENTER: ride.entered, Guidance.LEAVE: ride.left}.get(step.guidance)
        if report is None:
            return
        if self._terminal is not None and not await self._pressed(ride, step.guidance, self._terminal):
            return
        try:
            await report()
        except Refused as error:
            self._print(print_stderr, str(error))

    async def _pressed(self, ride: ActiveRide, guidance: Guidance, terminal: int) -> bool:
        answer = await wait_for_enter(PROMPTS[guidance], lambda: ride.now.guidance is guidance, terminal)
        if answer is EnterResult.WITHDRAWN:
            self._print(
                print_stderr,
                f"the robot is not to {guidance} at the moment; ENTER has no effect until the next prompt",
            )
        elif answer is EnterResult.ENDED:
            self.stop("nobody can press ENTER any more")
        return answer is EnterResult.PRESSED

    def _report_unfinished(self, client: LiftManagerClient, why: str) -> None:
        if not self._id:
            text = f"{why}; a ride may have begun: `curl {client.url}{API}/rides` shows it"
        else:
            ride = f"curl -X POST {client.url}{ride_path(self._id)}"
            text = (
                f"{why}; the manager goes on with ride {self._id}: `{ride}/cancel` cancels it, and `{ride}/left` reports that the"
                " robot is outside"
            )
        self._print(print_stderr, text)

    def _print(self, print_text: Callable[[str], None], text: str) -> None:
        try:
            print_text(text)
        except OSError:
            # a closed terminal: nobody reads this, but the robot still has to get out
            _discard_output()
            if not self._stop.is_set():
                self.stop("the terminal was closed")


def _discard_output() -> None:
    """Discard output that cannot be printed: Python would retry it at exit, and fail."""
    with Path(os.devnull).open("w", encoding="utf-8") as nowhere:
        for stream in (sys.stdout, sys.stderr):
            try:
                stream.flush()
            except OSError:
                os.dup2(nowhere.fileno(), stream.fileno())


async def _run_until(ends: asyncio.Event, work: Coroutine[None, None, None]) -> bool:
    """Run `work` until it completes or `ends` is set; return whether it has completed."""
    working, ending = asyncio.create_task(work), asyncio.create_task(ends.wait())
    try:
        await asyncio.wait((working, ending), return_when=asyncio.FIRST_COMPLETED)
    finally:
        is_complete = working.done()
        for task in (working, ending):
            while not task.done():
                # repeatedly: leaving a ride cancels it at the manager, which may take a while
                task.cancel()
                await asyncio.sleep(0)
    if not working.cancelled():
        working.result()
    return is_complete


@contextmanager
def _call_on_signals(stop: Callable[[str], None]) -> Iterator[None]:
    """Call `stop` on signals, except those that the caller of the program has set to be ignored (`nohup`)."""
    loop = asyncio.get_running_loop()

    def on_signal(number: int, _: FrameType | None) -> None:
        loop.call_soon_threadsafe(stop, SIGNALS[number])

    previous = {number: signal.getsignal(number) for number in SIGNALS}
    handled = {number: handler for number, handler in previous.items() if handler is not signal.SIG_IGN}
    try:
        for number in handled:
            signal.signal(number, on_signal)
        yield
    finally:
        for number, handler in handled.items():
            signal.signal(number, handler)


def _print_line(text: str) -> None:
    print_lines([text])


def _line(step: Step) -> str:
    ride = step.ride
    where = f"{ride.lift} {ride.from_} -> {ride.to}"
    ahead = f" ({ride.ahead} ahead)" if ride.ahead else ""
    report = ride.phase if ride.phase is Phase.CANCELLED else step.guidance
    parts = [f"{where}: {report}{ahead}", step.reason, "" if step.advice is None else f"advice: {step.advice}"]
    return "; ".join(part for part in parts if part)
