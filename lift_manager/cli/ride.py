"""`lift-manager ride`: be a robot, to try a lift out."""

from __future__ import annotations

import asyncio
import sys
from typing import Annotated

import typer

from lift_manager.cli.common import say, say_aside
from lift_manager.cli.secured import Ca, Certificate, CertificateKey
from lift_manager.cli.speaking import MANAGER, KeyFile, Manager, Speaker
from lift_manager.client.client import LiftManagerClient
from lift_manager.client.errors import Refused
from lift_manager.client.ride import RideInHand
from lift_manager.client.ride_step import Step
from lift_manager.domain.ride import Guidance, Phase

PROMPTS = {
    Guidance.ENTER: "press ENTER once the robot is inside",
    Guidance.LEAVE: "press ENTER once the robot is outside",
}
END_WITHIN_S = 120.0
"""Chosen: so long Ctrl-C waits for a robot that may be inside to be let out; a second one ends it at once."""


def ride(  # noqa: PLR0913  each is an option of the command line
    lift: Annotated[str, typer.Argument(metavar="LIFT", help="The lift by its name, or `any`.")],
    start: Annotated[str, typer.Argument(metavar="FROM", help="The floor where the robot waits.")],
    destination: Annotated[str, typer.Argument(metavar="TO", help="The floor where it wants to be.")],
    *,
    robot: Annotated[str, typer.Option("--robot", metavar="NAME", help="Its name; others are told who has the lift.")],
    yes: Annotated[
        bool, typer.Option("--yes", help="No robot is there: say `entered` and `left` at once when they are due.")
    ] = False,
    manager: Manager = MANAGER,
    key_file: KeyFile = None,
    ca: Ca = None,
    certificate: Certificate = None,
    certificate_key: CertificateKey = None,
) -> None:
    """Ride as a robot would: print what it is to do, and say its words. Ctrl-C cancels, and waits until the robot is let out.

    Exit codes: 0 the robot is there; 1 no manager, or it said no; 3 the ride was cancelled; 4 it was given up.
    """
    if not yes and not sys.stdin.isatty():
        raise typer.BadParameter("without a terminal nobody can say that the robot is inside", param_hint="--yes")
    to = Speaker(manager, key_file, ca, certificate, certificate_key)
    rider = _Rider(says_by_itself=yes)
    last = to.ask(lambda client: rider.ride(client, lift, start, destination, robot))
    if last is None or last.ride.phase is Phase.CANCELLED:
        raise typer.Exit(3)
    if last.guidance is not Guidance.DONE:
        raise typer.Exit(4)


class _Rider:
    def __init__(self, *, says_by_itself: bool) -> None:
        self._by_itself = says_by_itself
        self._last: Step | None = None

    async def ride(self, client: LiftManagerClient, lift: str, start: str, destination: str, robot: str) -> Step | None:
        async with client.ride(lift, start, destination, robot=robot) as ride:
            try:
                await self._go(ride)
            except asyncio.CancelledError:
                # Ctrl-C: whoever is inside is let out, and the end is seen
                if (task := asyncio.current_task()) is not None:
                    task.uncancel()
                say_aside("cancelled; waiting for the end, press Ctrl-C again not to")
                await ride.cancel("Ctrl-C")
                await self._end(ride)
        return self._last

    async def _end(self, ride: RideInHand) -> None:
        try:
            async with asyncio.timeout(END_WITHIN_S):
                await self._go(ride)
        except TimeoutError:
            say_aside(
                f"the ride has not ended within {END_WITHIN_S:g} s; `lift-manager lifts` shows who holds the lift"
            )

    async def _go(self, ride: RideInHand) -> None:
        async for step in ride:
            self._last = step
            say([_line(step)])
            word = {Guidance.ENTER: ride.entered, Guidance.LEAVE: ride.left}.get(step.guidance)
            if word is None:
                continue
            if not self._by_itself:
                say_aside(PROMPTS[step.guidance])
                if not await _pressed(ride, step.guidance):
                    continue
            try:
                await word()
            except Refused as error:
                say_aside(str(error))


async def _pressed(ride: RideInHand, guidance: Guidance) -> bool:
    """Wait for ENTER for as long as the guidance stands; return whether it came."""
    loop = asyncio.get_running_loop()
    came = asyncio.Event()
    loop.add_reader(sys.stdin, came.set)
    try:
        while ride.now.guidance is guidance:
            try:
                async with asyncio.timeout(0.2):
                    await came.wait()
            except TimeoutError:
                continue
            sys.stdin.readline()
            return True
        return False
    finally:
        loop.remove_reader(sys.stdin)


def _line(step: Step) -> str:
    ride = step.ride
    where = f"{ride.lift} {ride.from_} -> {ride.to}"
    ahead = f" ({ride.ahead} ahead)" if ride.ahead else ""
    parts = [f"{where}: {step.guidance}{ahead}", step.reason, "" if step.advice is None else f"advice: {step.advice}"]
    return "; ".join(part for part in parts if part)
