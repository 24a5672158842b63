"""A simulated lift behind the server, byte by byte: frames are typed by hand, time is a number."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

from simulator.server import Device, SimulatedController
from tests.simulator.faces import Faced, faced
from tests.support.written_maps import HEAD, written_map

SHARED_WORD = """\
signals:
  car_floor: {one_of: ["input:3.8", "input:3.9"]}
  door.front: {at: "discrete:0"}
commands:
  go_to:
    one_of: ["holding:32.4", "holding:32.5"]
    action: pulse
    width_s: 0.5
    shared_word: mask_write
    confirm: {any_of: [effect], within_s: 30}
  hold_door.front:
    at: "holding:32.0"
    action: hold
    max_hold_s: 30
    refresh_s: 2
    on_link_loss: latches
    shared_word: mask_write
    confirm: {any_of: [readback], within_s: 2}
"""
SENSOR_HEAD = HEAD.replace(
    "at_floor_evidence", "endpoints: {sensor: {unit_id: 9, served: {discrete: [[0, 3]]}}}\nat_floor_evidence"
)
SENSOR = """\
signals:
  car_floor: {one_of: ["sensor/discrete:0", "sensor/discrete:1"]}
  door.front: {at: "sensor/discrete:2"}
commands:
  go_to: {one_of: ["coil:0", "coil:1"], action: pulse, width_s: 0.5, confirm: {any_of: [effect], within_s: 30}}
"""


@dataclass
class Line:
    """A lift, its clock and one connection to each of its devices."""

    lift: Faced
    lines: dict[int, tuple[asyncio.StreamReader, asyncio.StreamWriter]] = field(default_factory=dict)
    """By unit id."""

    async def says(self, frame: str, *, at_s: float | None = None) -> str:
        """Send a frame at a time and return the answer; both without transaction id, protocol id and length."""
        self.lift.now = self.lift.now if at_s is None else at_s
        body = bytes.fromhex(frame)
        reader, writer = self.lines[body[0]]
        writer.write(b"\0\1\0\0" + len(body).to_bytes(2, "big") + body)
        async with asyncio.timeout(60):
            head = await reader.readexactly(6)
            return (await reader.readexactly(head[5])).hex(" ").upper()


def with_lift(lift: Faced, devices: dict[int, Device], check: Callable[[Line], Awaitable[None]]) -> None:
    """Run a check against the devices of a lift, each on a port of its own."""

    @asynccontextmanager
    async def served(unit: int, device: Device) -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
        server = SimulatedController({unit: device}, clock=lambda: lift.now)
        await server.start()
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        try:
            yield reader, writer
        finally:
            writer.close()
            await writer.wait_closed()
            await server.stop()

    async def main() -> None:
        line = Line(lift)
        if len(devices) == 1:
            ((unit, device),) = devices.items()
            async with served(unit, device) as line.lines[unit]:
                await check(line)
        else:
            (one, first), (other, second) = devices.items()
            async with served(one, first) as line.lines[one], served(other, second) as line.lines[other]:
                await check(line)

    asyncio.run(main())


def test_a_mask_write_of_one_bit_calls_the_lift_and_the_hold_beside_it_stays() -> None:
    lift = faced(written_map(SHARED_WORD), (0, 1))

    async def check(line: Line) -> None:
        hold, call = "01 16 00 20 FF FE 00 01", "01 16 00 20 FF DF 00 20"
        assert await line.says(hold) == hold
        assert await line.says("01 03 00 20 00 01", at_s=3.0) == "01 03 02 00 01"
        assert await line.says("01 02 00 00 00 01") == "01 02 01 01"
        assert await line.says(call) == call
        assert await line.says("01 03 00 20 00 01") == "01 03 02 00 21"
        assert await line.says("01 16 00 20 FF DF 00 00", at_s=3.5) == "01 16 00 20 FF DF 00 00"
        assert await line.says("01 03 00 20 00 01", at_s=60.0) == "01 03 02 00 01"
        assert await line.says("01 04 00 03 00 01") == "01 04 02 01 00"
        assert await line.says("01 16 00 20 FF FE 00 00") == "01 16 00 20 FF FE 00 00"
        assert await line.says("01 04 00 03 00 01", at_s=90.0) == "01 04 02 02 00"

    with_lift(lift, {1: lift.face}, check)


def test_a_relay_closes_for_the_time_in_its_frame() -> None:
    # elevator-interfaces 2, Waveshare: 0x0200 + relay, duration in units of 100 ms
    lift = faced("waveshare-relay", (0, 1))

    async def check(line: Line) -> None:
        assert await line.says("01 05 02 01 00 07") == "01 05 02 01 00 07"
        assert await line.says("01 01 02 00 00 02", at_s=0.69) == "01 01 01 02"
        assert await line.says("01 01 02 00 00 02", at_s=0.70) == "01 01 01 00"
        assert lift.face.picture.car_calls == {1}
        # a relay that is not timed, and a value that is no duration
        assert await line.says("01 05 00 01 00 07") == "01 85 03"
        assert await line.says("01 05 02 01 80 00") == "01 85 03"
        assert await line.says("01 05 02 01 FF 00") == "01 85 03"
        assert await line.says("01 05 00 02 FF 00") == "01 05 00 02 FF 00"
        assert await line.says("01 01 00 00 00 08") == "01 01 01 04"

    with_lift(lift, {1: lift.face}, check)


def test_a_lift_without_timed_coils_refuses_a_duration() -> None:
    lift = faced("two-stop-agv", (0, 1))

    async def check(line: Line) -> None:
        assert await line.says("01 05 00 00 00 07") == "01 85 03"
        assert await line.says("01 01 00 00 00 04") == "01 01 01 00"

    with_lift(lift, {1: lift.face}, check)


def test_wago_shows_inputs_and_outputs_where_its_manual_says() -> None:
    lift = faced("wago-750", (0, 1))

    async def check(line: Line) -> None:
        # car at the lower stop, door closed, no fire: inputs 1, 2 and 4
        assert await line.says("01 02 00 00 00 05") == "01 02 01 16"
        assert await line.says("01 05 00 02 FF 00") == "01 05 00 02 FF 00"
        assert await line.says("01 01 02 00 00 03") == "01 01 01 04"
        assert await line.says("01 02 00 00 00 05", at_s=3.0) == "01 02 01 15"
        # answered with what was written, whatever reading the same number shows: input 2 is on
        assert await line.says("01 05 00 02 00 00") == "01 05 00 02 00 00"

    with_lift(lift, {1: lift.face}, check)


def test_a_write_where_the_lift_speaks_is_answered_with_its_own_value_and_does_not_last() -> None:
    lift = faced("generic-registers", (1, 2))

    async def check(line: Line) -> None:
        assert await line.says("01 06 00 01 00 63") == "01 06 00 01 00 63"
        assert await line.says("01 03 00 01 00 01") == "01 03 02 00 01"

    with_lift(lift, {1: lift.face}, check)


def test_the_devices_of_one_lift_answer_on_their_own_ports_and_units() -> None:
    lift = faced(written_map(SENSOR, SENSOR_HEAD), (0, 1))

    async def check(line: Line) -> None:
        assert await line.says("09 02 00 00 00 03") == "09 02 01 01"
        assert await line.says("01 05 00 01 FF 00") == "01 05 00 01 FF 00"
        assert await line.says("09 02 00 00 00 03", at_s=8.0) == "09 02 01 06"
        assert await line.says("09 05 00 01 FF 00") == "09 85 01"

    with_lift(lift, {1: lift.face, 9: lift.face.endpoint("sensor")}, check)


def test_the_block_of_seer_is_written_and_read_as_its_source_does() -> None:
    # elevator-interfaces 1.1, V2: call, go, in place, left, may enter, may leave, door, floor; the example puts them at 1
    lift = faced("seer-siemens-chengdu-block", (1, 2, 3))

    async def check(line: Line) -> None:
        assert await line.says("00 10 00 01 00 04 08 00 03 00 00 00 00 00 00") == "00 10 00 01 00 04"
        asked = "00 03 00 01 00 08"
        assert await line.says(asked, at_s=20.0) == "00 03 10 00 03 00 00 00 00 00 00 00 01 00 00 00 01 00 03"
        assert await line.says("00 10 00 01 00 04 08 00 00 00 01 00 01 00 00") == "00 10 00 01 00 04"
        assert await line.says(asked, at_s=20.1) == "00 03 10 00 00 00 01 00 01 00 00 00 00 00 00 00 01 00 03"
        assert await line.says(asked, at_s=60.0) == "00 03 10 00 00 00 01 00 01 00 00 00 00 00 01 00 01 00 01"

    with_lift(lift, {0: lift.face}, check)
