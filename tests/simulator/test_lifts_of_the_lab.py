"""Every shipped map makes a simulated lift with floors of its own, and the lines that `simulate` prints are right."""

import asyncio
import re
import shlex
from collections.abc import Mapping
from functools import partial
from pathlib import Path

import pytest
from pymodbus.client import AsyncModbusTcpClient

from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.wire import PymodbusWire
from lift_manager.lab import tryout
from lift_manager.lab.plant import blind_spots, controllers, default_floors, simulated_lift
from register_maps import frames
from register_maps.codec import Codec, compile_map
from register_maps.load import load
from register_maps.words import Side, Table
from simulator.controller import Parameters
from tests.support.good_map import GOOD, HANDSHAKE, loaded
from tests.support.rows import each_row
from tests.support.shipped_maps import compiled
from tests.support.virtual_time import cancel_all
from tests.support.written_maps import HEAD, written_map

MAPS = sorted(path.stem for path in (Path(__file__).parents[2] / "register_maps" / "maps").glob("*.yaml"))
GO_TO = """\
commands:
  go_to: {at: "holding:100", as: floor, action: pulse, width_s: 0.5, rest: REST, confirm: {any_of: [effect], within_s: 30}}
"""
WHERE = {"": "127.0.0.1:5020", "sensor": "127.0.0.1:5021"}


def handshake(folder: Path) -> Codec:
    path = folder / "handshake.yaml"
    path.write_text(HANDSHAKE)
    return compile_map(load(path).map)


# -- floors


@each_row("name", MAPS)
def test_every_shipped_map_has_floors_of_its_own_and_a_lift_that_stands_there(name: str) -> None:
    codec = compiled(name)
    floors = default_floors(codec.map)
    lift = simulated_lift(codec, floors)
    lift.advance(5.0)
    assert len(floors) >= 2
    assert lift.picture.level_floor == 0


@each_row(
    ("name", "floors"),
    [
        ("generic-registers", {"L1": 1, "L2": 2, "L3": 3, "L4": 4}),
        ("two-stop-agv", {"L1": 0, "L2": 1}),
        ("robotnik-il-eth", {"L1": 0, "L2": 1, "L3": 2}),
        ("adam-pushbutton", {"L1": 0, "L2": 1, "L3": 2}),
        ("generic-coils", {f"L{floor}": floor - 1 for floor in range(1, 9)}),
        ("thingweb-elevator", {"L1": 1, "L2": 2, "L3": 3, "L4": 4}),
    ],
)
def test_floors_are_as_many_as_the_points_of_the_map_and_four_where_it_may_choose(
    name: str, floors: Mapping[str, int]
) -> None:
    assert default_floors(load(name).map) == floors


@each_row(
    ("signal", "rest", "floors"),
    [
        # the reserved codes 1 and 3, and rest, are no floors
        ('{at: "input:1", as: floor, unknown: [1], none: [3]}', 5, {"L2": 2, "L4": 4, "L6": 6, "L7": 7}),
        # two bits, of which one code is reserved
        ('{code_of: ["discrete:1", "discrete:2"], none: [3]}', 999, {"L1": 0, "L2": 1, "L3": 2}),
        ('{code_of: ["discrete:1", "discrete:2"], code: gray, unknown: [0]}', 999, {"L1": 1, "L2": 2, "L3": 3}),
        ('{at: "input:1", bits: [0, 1], as: floor}', 0, {"L1": 1, "L2": 2, "L3": 3}),
    ],
)
def test_codes_that_a_map_reserves_are_no_floors(signal: str, rest: int, floors: Mapping[str, int]) -> None:
    text = f'signals:\n  car_floor: {signal}\n  door.front: {{at: "discrete:20"}}\n{GO_TO.replace("REST", str(rest))}'
    assert default_floors(written_map(text).map) == floors


def test_a_map_that_cannot_tell_two_floors_apart_says_so() -> None:
    text = 'signals:\n  car_floor: {at: "input:1", bits: [0, 0], as: floor, unknown: [0]}\n'
    with pytest.raises(ValueError, match="fewer than two floors"):
        default_floors(written_map(text, HEAD).map)


def test_calls_and_position_have_to_have_room_for_a_floor() -> None:
    text = """\
signals:
  car_floor: {one_of: ["discrete:0", "discrete:1", "discrete:2", "discrete:3"]}
commands:
  go_to: {one_of: ["coil:0", "coil:1", "coil:2"], action: pulse, width_s: 0.5, confirm: {any_of: [effect], within_s: 30}}
"""
    assert default_floors(written_map(text).map) == {"L1": 0, "L2": 1, "L3": 2}


# -- lifts


def test_a_lift_has_the_doors_that_its_map_says_or_moves(tmp_path: Path) -> None:
    codec = handshake(tmp_path)
    lift = simulated_lift(codec, default_floors(codec.map))
    assert set(lift.picture.doors) == set(Side)
    assert set(simulated_lift(compiled("adam-pushbutton"), {"L1": 0, "L2": 1}).picture.doors) == {Side.FRONT}


def test_a_lift_stands_at_its_lowest_floor_above_ground_and_takes_further_settings() -> None:
    lift = simulated_lift(
        compiled("generic-registers"), {"B2": -2, "B1": -1, "L1": 1}, speed=7.0, like=Parameters(scan_s=0.2)
    )
    assert lift.picture.level_floor == 2
    assert (lift.parameters.speed, lift.parameters.scan_s) == (7.0, 0.2)


@pytest.mark.parametrize(
    ("name", "on"), [("two-stop-agv", True), ("generic-registers", False), ("seer-siemens-chengdu", False)]
)
def test_a_lift_is_in_robot_mode_from_the_start_only_if_its_map_needs_it_and_cannot_ask(name: str, *, on: bool) -> None:
    lift = simulated_lift(compiled(name), default_floors(load(name).map))
    assert lift.picture.robot_mode_on is on


@each_row(
    ("name", "blind"),
    [
        ("adam-pushbutton", ("where the car is", "whether its door is open")),
        ("waveshare-relay", ("where the car is", "whether its door is open")),
        ("thingweb-elevator", ("whether its door is open",)),
        ("seer-lps3-two-stop", ()),
        ("wago-750", ()),
    ],
)
def test_what_nobody_can_see_of_a_lift_is_named(name: str, blind: tuple[str, ...]) -> None:
    assert blind_spots(compiled(name)) == blind


def test_each_device_of_a_lift_gets_a_server_on_the_ports_after_the_first(tmp_path: Path) -> None:
    codec = handshake(tmp_path)
    lift = simulated_lift(codec, default_floors(codec.map))
    named = controllers(codec.map, lift, port=40500)
    assert {name: server.port for name, server in named.items()} == {"": 40500, "sensor": 40501}
    assert {server.port for server in controllers(codec.map, lift).values()} == {0}


def test_the_controller_of_a_map_demands_of_its_clients_what_its_link_says(tmp_path: Path) -> None:
    text = GOOD.replace("served:", "link: {max_connections: 1, min_gap_s: 0.05, idle_timeout_s: 60}\nserved:", 1)
    codec = compile_map(loaded(tmp_path, text).map)
    (server,) = controllers(codec.map, simulated_lift(codec, {"L1": 1, "L2": 2})).values()

    async def check() -> None:
        await server.start()
        settings = LinkSettings(min_gap_s=0.05, max_connections=1)
        link = Link(partial(PymodbusWire, "127.0.0.1", server.port), settings, name="plc")
        running = asyncio.create_task(link.run())
        try:
            async with asyncio.timeout(60):
                await link.wait_up()
                for _ in range(20):
                    await link.read(frames.read(Table.HOLDING, 0, 4))
            reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
            with pytest.raises(ConnectionResetError):
                await reader.read(1)
            writer.close()
            assert (link.epoch, link.stats.losses) == (1, 0)
        finally:
            await cancel_all([running])
            await server.stop()

    asyncio.run(check())


# -- the lines


def lines_of(codec: Codec) -> list[str]:
    return [line.strip() for line in tryout.lines(codec, default_floors(codec.map), WHERE)[2:]]


@each_row(
    ("name", "line"),
    [
        # bits of a register: the whole word
        ("robotnik-il-eth", "mbpoll -m tcp -a 1 -p 5020 -0 -t 4 -r 385 127.0.0.1 8   # robot_mode; writes the whole register"),
        ("robotnik-il-eth", "mbpoll -m tcp -a 1 -p 5020 -0 -t 4 -r 384 127.0.0.1 4   # go_to L3; writes the whole register"),
        # written at 1, read back at 512
        ("wago-750", "mbpoll -m tcp -a 1 -p 5020 -0 -t 0 -r 1 127.0.0.1 1   # go_to L2"),
        ("wago-750", "mbpoll -m tcp -a 1 -p 5020 -0 -1 -t 0 -r 512 -c 3 127.0.0.1"),
        # the value is a time
        ("seer-generic", "mbpoll -m tcp -a 1 -p 5020 -0 -t 4 -r 1 127.0.0.1 5   # hold_door.front"),
        # unit 0, and numbers that go on the wire as they are
        ("seer-siemens-chengdu", "mbpoll -m tcp -a 0 -p 5020 -0 -t 4 -r 1 127.0.0.1 4   # call L4"),
        ("thingweb-elevator", "mbpoll -m tcp -a 1 -p 5020 -0 -1 -t 1 -r 10001 -c 1 127.0.0.1"),
        (
            "generic-registers",
            "mbpoll -m tcp -a 1 -p 5020 -0 -t 4 -r 17 127.0.0.1 1   # hold_door.front, falls 3 s after the last write",
        ),
        # a lift that obeys no write without an epoch: all of it in one
        (
            "generic-registers-cluster",
            "mbpoll -m tcp -a 1 -p 5020 -0 -t 4 -r 16 127.0.0.1 0 0 1 0 1 0 0   # hold_door.front, falls 8 s after the last write; in epoch 1",
        ),
        (
            "generic-registers-cluster",
            "mbpoll -m tcp -a 1 -p 5020 -0 -t 4 -r 16 127.0.0.1 0 0 1 4 0 1 0   # go_to L4, only while robot_mode_on is on; in epoch 1",
        ),
        ("generic-registers-cluster", "mbpoll -m tcp -a 1 -p 5020 -0 -t 4 -r 16 127.0.0.1 0 0 1 0 0 1 0   # releases it"),
    ],
)  # fmt: skip
def test_a_line_gives_what_it_says(name: str, line: str) -> None:
    assert line in lines_of(compiled(name))


def test_a_command_on_another_device_names_its_port(tmp_path: Path) -> None:
    lines = lines_of(handshake(tmp_path))
    assert "mbpoll -m tcp -a 1 -p 5021 -0 -t 4 -r 0 127.0.0.1 5   # hold_door.rear" in lines
    assert "mbpoll -m tcp -a 1 -p 5021 -0 -1 -t 1 -r 0 -c 1 127.0.0.1" in lines
    beat = "# heartbeat, another value every 0.5 s"
    assert f"mbpoll -m tcp -a 1 -p 5020 -0 -t 4 -r 21 127.0.0.1 1   {beat}" in lines


def test_a_timed_coil_gets_its_bytes_because_mbpoll_cannot_write_a_duration() -> None:
    (line,) = [line for line in lines_of(compiled("waveshare-relay")) if "go_to" in line]
    octal = re.search(r"printf '(.*?)' \|", line)
    assert octal is not None
    sent = bytes(int(number, 8) for number in octal[1].split("\\")[1:])
    assert sent == bytes.fromhex("0001 0000 0006 01 05 0201 0005")
    assert "| nc -w 1 127.0.0.1 5020 |" in line


@each_row("name", MAPS)
def test_every_line_for_mbpoll_is_answered_by_the_lift_it_is_printed_for(name: str) -> None:
    codec = compiled(name)
    floors = default_floors(codec.map)
    (server,) = controllers(codec.map, simulated_lift(codec, floors)).values()

    async def main() -> None:
        await server.start()
        modbus = AsyncModbusTcpClient("127.0.0.1", port=server.port, retries=0, reconnect_delay=0)
        assert await modbus.connect()
        try:
            for line in tryout.lines(codec, floors, {"": f"127.0.0.1:{server.port}"})[2:]:
                if line.strip().startswith("mbpoll"):
                    assert not await refused(modbus, line), line
        finally:
            modbus.close()
            await server.stop()

    asyncio.run(main())


async def refused(modbus: AsyncModbusTcpClient, line: str) -> bool:
    """Do what mbpoll would do for this line; returns whether the device refused it."""
    words = shlex.split(line, comments=True)
    option = {name: int(words[words.index(name) + 1]) for name in ("-a", "-t", "-r", "-c") if name in words}
    unit, table, address = option["-a"], option["-t"], option["-r"]
    if "-1" in words:
        read = {
            0: modbus.read_coils,
            1: modbus.read_discrete_inputs,
            3: modbus.read_input_registers,
            4: modbus.read_holding_registers,
        }[table]
        return (await read(address, count=option["-c"], device_id=unit)).isError()
    values = [int(word) for word in words[words.index("127.0.0.1") + 1 :]]
    if len(values) > 1 and table == 0:
        return (await modbus.write_coils(address, list(map(bool, values)), device_id=unit)).isError()
    if len(values) > 1:
        return (await modbus.write_registers(address, values, device_id=unit)).isError()
    (value,) = values
    if table == 0:
        return (await modbus.write_coil(address, bool(value), device_id=unit)).isError()
    return (await modbus.write_register(address, value, device_id=unit)).isError()
