"""A robot that rides as it is told, on the real spine over a simulated lift. Whatever it is told is compared with what the lift does.

The plant outlives the manager: the next rig with the same plant and memory is the manager after a restart.
"""

import asyncio
import math
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from enum import StrEnum, unique

from lift_manager.lift.events import Alarm
from lift_manager.lift.session import Holder
from lift_manager.rides.inputs import RideChanged
from lift_manager.rides.ride import OVER, Guidance, Phase, Ride, RideLimits, RideRequest, RideWord
from lift_manager.runtime.bus import Occurrence
from lift_manager.runtime.errors import RequestRefused
from lift_manager.runtime.recorder import Recorder
from lift_manager.runtime.rides import SiteRides
from lift_manager.runtime.site import Site
from register_maps import frames
from simulator.controller import Inputs
from simulator.faults import Fault
from simulator.modes import Key
from tests.support.refusals import refusal, reply
from tests.support.trip import Trip, trip
from tests.support.trip_simulator import SimulatedPlant
from tests.support.virtual_time import cancel_all, elapse

NOON = datetime(2026, 11, 21, 12, 0, tzinfo=UTC)
FLEET = Holder("ride", "fleet")
LOOK_S = 0.1
DRIVES_S = 4.0
"""What a robot needs from where it waits into the car, and out of it."""
QUICK = RideLimits(queued_s=60.0, called_s=60.0, boarding_s=60.0, riding_s=60.0, alighting_s=40.0)
READ_S = 0.3
"""A poll from its first request to its last, and the turn of the loop in which it is published."""


def clock() -> datetime:
    """The time of day, which goes on with virtual time."""
    return NOON + timedelta(seconds=asyncio.get_running_loop().time())


@unique
class Spoilt(StrEnum):
    """What becomes of a request on a bad wire."""

    REQUEST_LOST = "request lost"
    ANSWER_LOST = "answer lost"
    OTHER_TRANSACTION = "answer of another transaction"
    REFUSED = "exception 6"


class MortalPlant(SimulatedPlant):
    """A simulated lift whose controller can die and come back, behind a wire that can be bad."""

    silent = False
    spoils: Spoilt | None = None
    """What becomes of one request in three."""
    troubled = False
    """Something has happened for which nobody can leave a robot the time to clear the door."""

    def answer(self, device: str, frame: bytes, now: float) -> bytes | None:
        self._asks = getattr(self, "_asks", 0) + 1
        spoilt = self.spoils if self._asks % 3 == 0 else None
        if self.silent or spoilt is Spoilt.REQUEST_LOST:
            return None
        if spoilt is Spoilt.REFUSED:
            return frames.exception_answer(frame, 6)
        said = super().answer(device, frame, now)
        if said is None or spoilt is Spoilt.ANSWER_LOST:
            return None
        if spoilt is Spoilt.OTHER_TRANSACTION:
            return bytes((said[0], said[1] ^ 1)) + said[2:]
        return said

    def begin(self, fault: Fault) -> None:
        self.face.begin(fault, asyncio.get_running_loop().time())

    def end(self, fault: Fault) -> None:
        self.face.end(fault, asyncio.get_running_loop().time())

    def people(self, inputs: Inputs) -> None:
        self.face.people(asyncio.get_running_loop().time(), inputs)

    @property
    def key(self) -> Key:
        return self.face.inputs.key


@dataclass
class Rig:
    """Rides on one lift, and everything they were told."""

    made: Trip
    plant: MortalPlant
    site: Site
    told: list[Ride] = field(default_factory=list)
    alarms: list[str] = field(default_factory=list)
    lies: list[str] = field(default_factory=list)
    judged: int = 0
    invited: int = 0
    clear_s: float = 0.0
    """How long before a release of ours its robot is no longer invited."""
    invited_at: float = -math.inf
    """When its robot last saw that it may drive."""
    open_at: int | None = None
    """Where the car stood open at the last look."""

    @property
    def now(self) -> float:
        return asyncio.get_running_loop().time()

    @property
    def rides(self) -> SiteRides:
        return self.site.rides

    def begin(
        self, start: str, destination: str, *, robot: str = "amr-7", key: str = "", limits: RideLimits = QUICK
    ) -> Ride:
        request = RideRequest(
            lifts=("lift",),
            any_lift=False,
            start=start,
            destination=destination,
            robot=robot,
            caller=FLEET,
            key=key,
            limits=limits,
        )
        return self.rides.begin(request).ride

    def look(self, ride: str) -> Ride:
        """What the robot is told when it asks."""
        found = self.rides.ride(ride)
        self.judge(found)
        return found

    def say(self, ride: str, word: RideWord) -> Ride:
        reported = self.rides.report(ride, word, FLEET)
        self.judge(reported)
        return reported

    def refuse(self, ride: str, word: RideWord) -> RequestRefused:
        return refusal(lambda: self.rides.report(ride, word, FLEET))

    def cancel(self, ride: str, caller: Holder | None = FLEET) -> Ride:
        cancelled = self.rides.cancel(ride, caller, "no order")
        self.judge(cancelled)
        return cancelled

    async def until(self, ride: str, true: Callable[[Ride], bool], within_s: float = 120.0) -> Ride:
        """Wait until a ride is like this."""
        end = self.now + within_s
        while not true(found := self.look(ride)):
            assert self.now < end, f"after {within_s:g} s still {found}"
            await elapse(LOOK_S)
        return found

    async def guided(self, ride: str, guidance: Guidance, within_s: float = 120.0) -> Ride:
        return await self.until(ride, lambda one: one.guidance is guidance, within_s)

    def hear(self, occurrence: Occurrence) -> None:
        match occurrence.event:
            case RideChanged(ride=ride):
                self.told.append(ride)
                self.judge(ride)
            case Alarm(text=text):
                self.alarms.append(text)
            case _:
                pass

    def judge(self, ride: Ride) -> None:
        """Compare what a robot is told at this moment with what the lift did when it was read last, and does."""
        self.judged += 1
        if ride.guidance not in (Guidance.ENTER, Guidance.LEAVE):
            return
        self.invited += 1
        state = self.made.state
        floors = tuple(self.made.site.floors)
        said = f"at {self.now:.2f} s {ride.phase} {ride.guidance}"
        wanted = {Phase.BOARDING: ride.start, Phase.ALIGHTING: ride.destination}.get(ride.phase, state.floor)
        if state.age_s is None or state.age_s > self.made.driver.capabilities.max_age_s:
            self.lies.append(f"{said} of an offline lift: {state}")
            return
        since = self.now - state.age_s - READ_S
        seen = {one.truth.open_at for one in self.made.exchanges if one.at >= since and not one.is_write}
        if wanted is None or floors.index(wanted) not in seen:
            self.lies.append(f"{said} at {wanted}, and it was open at {seen}: {state}")
        if state.holder is None or state.holder.face != "ride":
            self.lies.append(f"{said} without a session")
        opens_at = self.plant.truth(self.now).open_at
        fresh_s = self.made.driver.capabilities.max_age_s + READ_S
        recent = {one.truth.open_at for one in self.made.exchanges if one.at >= self.now - fresh_s}
        if wanted is not None and floors.index(wanted) not in {opens_at, *recent}:
            self.lies.append(f"{said} long after the door was open")

    def watch_door(self) -> None:
        """See whether the door falls on a robot that saw a moment ago that it may drive."""
        before, self.open_at = self.open_at, self.plant.truth(self.now).open_at
        ago_s = self.now - self.invited_at
        if before is not None and self.open_at is None and ago_s < self.clear_s and not self.plant.troubled:
            self.lies.append(f"at {self.now:.2f} s the door fell, {ago_s:.1f} s after its robot was invited")

    def true(self) -> None:
        """Fail with the first lies."""
        assert not self.lies, "\n".join(self.lies[:5])


@asynccontextmanager
async def rig(
    plant: MortalPlant, *, recorder: Recorder | None = None, start_s: float = 2.5, in_words: bool = True
) -> AsyncIterator[Rig]:
    """The manager of one lift with its rides; its end is a `kill -9`."""
    async with trip(plant.site, plant, recorder=recorder, start_s=0.0, in_words=in_words) as made:
        site = Site([made.actor], made.bus, made.recorder, clock=clock)
        found = Rig(made, plant, site)
        with site.tap(found.hear):
            await elapse(0)
            running = asyncio.ensure_future(site.rides.run())
            await elapse(start_s)
            try:
                yield found
            finally:
                await cancel_all([running])


@dataclass
class Robot:
    """Does what it is told, at the speed of a robot. It knows where it is, and nothing of the lift."""

    ride: str
    inside: bool = False
    driving_since: float | None = None
    speaks: bool = True
    """Says its words; one that is lost says nothing."""
    entered_at: float = math.inf

    def act(self, made: Rig) -> Ride:
        """Look, and drive on; once it is through the door, say so. What cannot be said yet is said again."""
        told = made.look(self.ride)
        made.watch_door()
        if told.phase in OVER:
            return told
        wants = Guidance.LEAVE if self.inside else Guidance.ENTER
        if told.guidance is wants:
            made.invited_at = made.now
        if told.guidance is wants and self.driving_since is None:
            self.driving_since = made.now
        elif self.driving_since is not None and made.now - self.driving_since >= DRIVES_S:
            # half way there is no turning round: it goes through whatever it hears meanwhile
            self.inside, self.driving_since = not self.inside, None
            made.made.aboard = self.inside
            made.invited_at = -math.inf  # it is through the door
        return self._speak(made, told)

    def _speak(self, made: Rig, told: Ride) -> Ride:
        if not self.speaks or self.driving_since is not None:
            return told
        boarding = told.phase in (Phase.CALLED, Phase.BOARDING) or (told.phase is Phase.CLEARING)
        if self.inside and boarding:
            reply(lambda: made.rides.report(self.ride, RideWord.ENTERED, FLEET))
        elif not self.inside and told.phase in (Phase.RIDING, Phase.ALIGHTING, Phase.CLEARING):
            reply(lambda: made.rides.report(self.ride, RideWord.LEFT, FLEET))
        return made.look(self.ride)

    async def ride_out(self, made: Rig, within_s: float = 600.0) -> Ride:
        """Go on until the ride is over."""
        end = made.now + within_s
        while (told := self.act(made)).phase not in OVER:
            assert made.now < end, f"after {within_s:g} s still {told}"
            await elapse(LOOK_S)
        return told
