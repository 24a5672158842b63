"""Carries out the steps of a scenario in a running world."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable
from dataclasses import replace

from lift_manager.lab.scenario.matching import Match
from lift_manager.lab.scenario.schema import Inputs as Pressed
from lift_manager.lab.scenario.schema import Robot
from lift_manager.lab.scenario.steps import PlannedStep
from lift_manager.lab.scenario.trace import Entry, Recorder, holder_of, reply_fields
from lift_manager.lab.scenario.vocabulary import OperatorAction, RequestedDoor, RobotProgress
from lift_manager.lab.world.witness import FloorRequest
from lift_manager.lab.world.world import World
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.session import Holder
from lift_manager.runtime.errors import RequestRefused
from simulator.people import People
from simulator.state import Inputs

REQUEST_EVERY_S = 1.0
"""How often a robot repeats its request: as clients of the workshop API do."""
CHECK_STATE_EVERY_S = 0.25
"""How often a robot checks the state between two requests."""


class Stage:
    """Carries out the steps of one run."""

    def __init__(self, world: World, recorder: Recorder, seed: int) -> None:
        self._world = world
        self._recorder = recorder
        self._seed = seed
        self._waits: list[tuple[str, Match, asyncio.Future[None]]] = []
        self._pressed: dict[str, list[Inputs]] = {name: [] for name in world.lifts}
        self._started: list[PlannedStep] = []
        recorder.on_entry = self._on_entry

    async def act(self, planned: PlannedStep) -> None:
        """Carry out one step at its time; may be cancelled at any time."""
        step, when = planned.step, planned.parts.when
        await asyncio.sleep(step.at or 0.0)
        if when is not None:
            try:
                async with asyncio.timeout(step.within_s):
                    await self._wait_for(planned.lift, when)
            except TimeoutError:
                return
            await asyncio.sleep(step.wait_s or 0.0)
        self._started.append(planned)
        await self._carry_out(planned)

    def problems(self, steps: Iterable[PlannedStep]) -> list[str]:
        """Return the steps that were not carried out because their condition did not occur."""
        return [
            f"line {one.line}: {one.action} was not carried out: {one.parts.when} did not occur"
            + (f" within {one.step.within_s:g} s" if one.step.within_s is not None else " in time")
            for one in steps
            if one not in self._started
        ]

    # -- waiting

    async def _wait_for(self, lift: str, match: Match) -> None:
        if match.lasts and any(match.fits(entry) for entry in self._recorder.holding(lift, match.kind)):
            return
        future: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        entry_wait = (lift, match, future)
        self._waits.append(entry_wait)
        try:
            await future
        finally:
            self._waits.remove(entry_wait)

    def _on_entry(self, entry: Entry) -> None:
        for lift, match, future in self._waits:
            if entry.lift == lift and match.fits(entry) and not future.done():
                future.set_result(None)

    # -- steps

    async def _carry_out(self, planned: PlannedStep) -> None:
        step, parts, world = planned.step, planned.parts, self._world
        if step.request is not None:
            await self._request(planned)
        elif step.robot is not None:
            await _SimulatedRobot(world, self._recorder, planned.lift, step.robot).go()
        elif parts.fault is not None:
            world.begin(planned.lift, parts.fault)
            if step.for_s is not None:
                await asyncio.sleep(step.for_s)
                world.end(planned.lift, parts.fault)
        elif parts.wire is not None:
            await self._apply_wire_fault(planned)
        elif parts.people is not None:
            seed, traffic = parts.people
            floors = len(world.lifts[planned.lift].floors)
            world.populate(planned.lift, People(self._seed if seed is None else seed, floors, traffic))
        elif step.inputs is not None:
            await self._press(planned, step.inputs)
        else:
            self._send_operator_action(planned)

    async def _request(self, planned: PlannedStep) -> None:
        step, requested = planned.step, planned.step.request
        assert requested is not None  # noqa: S101  true for this step
        opens = requested.door is RequestedDoor.OPEN
        request = FloorRequest(planned.lift, holder_of(requested.holder), requested.floor, opens, requested.robot)
        if step.every_s is None:
            self._world.request(request)
            return
        try:
            async with asyncio.timeout(step.for_s):
                await self._repeat(request, step.every_s, planned.parts.until)
        except TimeoutError:
            return

    async def _repeat(self, request: FloorRequest, every_s: float, until: Match | None) -> None:
        async with asyncio.TaskGroup() as tasks:
            repeating = tasks.create_task(self._repeat_until_cancelled(request, every_s))
            if until is not None:
                await self._wait_for(request.lift, until)
                repeating.cancel()

    async def _repeat_until_cancelled(self, request: FloorRequest, every_s: float) -> None:
        while True:
            self._world.request(request)
            await asyncio.sleep(every_s)

    async def _apply_wire_fault(self, planned: PlannedStep) -> None:
        wire = planned.parts.wire
        assert wire is not None  # noqa: S101  true for this step
        own_controllers = self._world.lifts[planned.lift].controllers
        where = own_controllers if wire.controller is None else (wire.controller,)
        for controller in where:
            self._world.begin_wire_fault(controller, wire.fault)
        if planned.step.for_s is not None:
            await asyncio.sleep(planned.step.for_s)
            for controller in where:
                self._world.end_wire_fault(controller, wire.fault)

    async def _press(self, planned: PlannedStep, pressed: Pressed) -> None:
        lift = self._world.lifts[planned.lift]

        def indices(floors: tuple[str, ...]) -> frozenset[int]:
            return frozenset(map(lift.floors.index, floors))

        added = Inputs(
            car_buttons=indices(pressed.car_buttons),
            landing_buttons=indices(pressed.landing_buttons),
            hold_door=frozenset(pressed.hold_door),
            close_door=frozenset(pressed.close_door),
            obstruction=frozenset(pressed.obstruction),
        )
        self._set_inputs(planned.lift, [*self._pressed[planned.lift], added])
        if planned.step.for_s is not None:
            await asyncio.sleep(planned.step.for_s)
            remaining = list(self._pressed[planned.lift])
            remaining.remove(added)
            self._set_inputs(planned.lift, remaining)

    def _set_inputs(self, lift: str, pressed: list[Inputs]) -> None:
        """Replace the inputs of the steps; the inputs of simulated people stay."""
        inputs = self._world.lifts[lift].inputs
        before, after = _combined(self._pressed[lift]), _combined(pressed)
        self._pressed[lift] = pressed
        changed = replace(
            inputs,
            car_buttons=inputs.car_buttons - before.car_buttons | after.car_buttons,
            landing_buttons=inputs.landing_buttons - before.landing_buttons | after.landing_buttons,
            hold_door=inputs.hold_door - before.hold_door | after.hold_door,
            close_door=inputs.close_door - before.close_door | after.close_door,
            obstruction=inputs.obstruction - before.obstruction | after.obstruction,
        )
        self._world.set_inputs(lift, changed)

    def _send_operator_action(self, planned: PlannedStep) -> None:
        site, step, lift = self._world.site, planned.step, planned.lift
        if (one := step.acknowledge) is not None:
            by = one.by
            self._send(lift, OperatorAction.ACKNOWLEDGE, by, lambda: site.acknowledge(lift, by))
        elif (lockout := step.lock_out) is not None:
            by, reason = lockout.by, lockout.reason
            self._send(lift, OperatorAction.LOCK_OUT, by, lambda: site.lock_out(lift, by, reason))
        elif (one := step.end_lockout) is not None:
            by = one.by
            self._send(lift, OperatorAction.END_LOCKOUT, by, lambda: site.end_lockout(lift, by))
        elif (drain := step.drain) is not None:
            by, reason = drain.by, drain.reason
            self._send(lift, OperatorAction.DRAIN, by, lambda: site.begin_drain(lift, by, reason))
        elif (one := step.end_drain) is not None:
            by = one.by
            self._send(lift, OperatorAction.END_DRAIN, by, lambda: site.end_drain(lift, by))

    def _send(self, lift: str, action: OperatorAction, by: str, send: Callable[[], object]) -> None:
        refused = None
        try:
            send()
        except RequestRefused as error:
            refused = error
        now = asyncio.get_running_loop().time()
        self._recorder.note(now, lift, "person", {"says": action, "by": by, **reply_fields(refused)})


def _combined(pressed: Iterable[Inputs]) -> Inputs:
    every = list(pressed)
    return Inputs(
        car_buttons=frozenset().union(*(one.car_buttons for one in every)),
        landing_buttons=frozenset().union(*(one.landing_buttons for one in every)),
        hold_door=frozenset().union(*(one.hold_door for one in every)),
        close_door=frozenset().union(*(one.close_door for one in every)),
        obstruction=frozenset().union(*(one.obstruction for one in every)),
    )


class _SimulatedRobot:
    """A robot that calls, waits, enters, rides, waits and leaves; it relies only on the published state."""

    def __init__(self, world: World, recorder: Recorder, lift: str, robot: Robot) -> None:
        self._world = world
        self._recorder = recorder
        self._lift = lift
        self._robot = robot
        self._holder = holder_of(robot.holder)

    async def go(self) -> None:
        robot = self._robot
        in_place = RobotWord.IN_PLACE if robot.in_words else None
        try:
            async with asyncio.timeout(robot.gives_up_after_s):
                self._record_progress(RobotProgress.CALLS, robot.from_)
                await self._until_open(robot.from_, None)
                self._record_progress(RobotProgress.ENTERS, robot.from_)
                await self._walk(robot.from_)
                self._record_progress(RobotProgress.RIDES, robot.to)
                await self._until_open(robot.to, in_place)
                self._record_progress(RobotProgress.LEAVES, robot.to)
                await self._walk(robot.to)
                self._record_progress(RobotProgress.DONE, robot.to)
        except TimeoutError:
            self._record_progress(RobotProgress.GIVES_UP, robot.to)
            in_place = None
        if robot.releases:
            report = RobotWord.LEFT if in_place is not None else None
            self._world.request(FloorRequest(self._lift, self._holder, robot.to, hold_door=False, robot=report))

    async def _until_open(self, floor: str, report: RobotWord | None) -> None:
        while True:
            self._world.request(FloorRequest(self._lift, self._holder, floor, hold_door=True, robot=report))
            for _ in range(round(REQUEST_EVERY_S / CHECK_STATE_EVERY_S)):
                await asyncio.sleep(CHECK_STATE_EVERY_S)
                if self._invited(self._holder, floor):
                    return

    def _invited(self, holder: Holder, floor: str) -> bool:
        state = self._world.site.state(self._lift)
        return (state.holder, state.floor, state.robot_door) == (holder, floor, RobotDoor.OPEN)

    async def _walk(self, floor: str) -> None:
        remaining_s = self._robot.boards_s
        while remaining_s > 0:
            self._world.request(FloorRequest(self._lift, self._holder, floor, hold_door=True))
            await asyncio.sleep(min(REQUEST_EVERY_S, remaining_s))
            remaining_s -= REQUEST_EVERY_S

    def _record_progress(self, what: RobotProgress, floor: str) -> None:
        now = asyncio.get_running_loop().time()
        self._recorder.note(now, self._lift, "robot", {"holder": self._holder, "does": what, "floor": floor})
