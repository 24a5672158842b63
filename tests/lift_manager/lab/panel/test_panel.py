"""The REST interface of the panel: what people and faults do to a lift, what it shows of it, and who may use it."""

import asyncio
import re
import socket
from typing import Any

import httpx
import pytest

from lift_manager.lab.bench.controls import InputChanges
from lift_manager.lab.panel.app import make_panel, panel_on
from lift_manager.lab.panel.faults import fault_kinds
from lift_manager.lab.scenario.faults import DEVICE_FAULTS, READY, WIRE
from lift_manager.web.server import listen
from register_maps import frames
from register_maps.words import Side
from simulator.modes import Key
from simulator.state import Inputs
from simulator.wire_faults import DropRequest
from tests.lift_manager.lab.panel.paneled import Desk, Json, at_desk, paneled, register
from tests.support.programs import HANGS_S, ROOT
from tests.support.rows import each_row
from tests.support.virtual_time import elapse

NOT_OF_PEOPLE = {"commands", "signs_of_life", "faults"}
"""Inputs of the network and of faults."""

NEEDED: dict[str, Json] = {
    "in_mode": {"mode": "inspection"},
    "disconnected_signal": {"signal": "fire"},
    "foreign_writer": {"command": "go_to", "floor": "L3"},
    "foreign_cell": {"table": "holding", "address": 17, "value": 1},
    "answer_with_exception": {"code": 4},
    "delay": {"seconds": 0.5},
    "uniform_delay": {"least_s": 0.1, "most_s": 0.2},
    "long_tailed_delay": {"median_s": 0.1},
    "bandwidth": {"bytes_per_s": 100.0},
    "connection_limit": {"clients": 1},
}
"""Values of the faults that need some."""


def test_a_landing_call_brings_the_car_and_its_lamp_goes_out() -> None:
    async def work(desk: Desk) -> None:
        await desk.does("press", button="landing", floor="L3")
        state = await desk.becomes(lambda state: state["car"]["landing_calls"] == ["L3"])
        assert state["car"]["floor"] == "L1"
        state = await desk.becomes(lambda state: state["car"]["doors"] == {"front": "open"})
        assert (state["car"]["floor"], state["car"]["position"], state["car"]["landing_calls"]) == ("L3", 2.0, [])
        assert register(state, "car_floor")["value"] == "L3"

    at_desk(work)


def test_the_car_is_drawn_between_two_floors_while_it_travels() -> None:
    async def work(desk: Desk) -> None:
        await desk.does("press", button="car", floor="L2")
        state = await desk.becomes(lambda state: state["car"]["floor"] is None)
        assert 0 < state["car"]["position"] < 1
        assert (state["car"]["last_floor"], state["car"]["motion"], state["car"]["destination"]) == ("L1", "up", "L2")

    at_desk(work)


def test_people_can_change_every_input_of_a_lift_that_is_not_the_networks() -> None:
    assert set(InputChanges.model_fields) == set(Inputs.__dataclass_fields__) - NOT_OF_PEOPLE

    async def work(desk: Desk) -> None:
        changed: Json = {
            "car_buttons": ["L4"],
            "landing_buttons": ["L2"],
            **{name: ["front"] for name in ("hold_door", "close_door", "obstruction")},
            **dict.fromkeys(("robot_mode_request", "fire", "emergency", "overload", "fault"), True),
            "key": "independent",
            "robots_allowed": False,
        }
        before = (await desk.state())["inputs"]
        assert changed.keys() == before.keys()
        for name, value in changed.items():
            assert before[name] != value
            assert (await desk.does("inputs", **{name: value}))["inputs"][name] == value
        assert (await desk.state())["inputs"] == changed
        assert (await desk.does("reset"))["inputs"] == before

    at_desk(work)


@each_row(
    ("inputs", "signal", "value"),
    [
        ({"obstruction": ["front"]}, "obstruction.front", "yes"),
        ({"overload": True}, "overload", "yes"),
        ({"fire": True}, "fire", "yes"),
        ({"emergency": True}, "mode", "emergency"),
        ({"fault": True}, "mode", "out_of_service"),
        *(({"key": key}, "mode", key) for key in ("independent", "inspection", "out_of_service", "robot")),
    ],
)
def test_what_people_do_shows_in_the_registers(inputs: Json, signal: str, value: str) -> None:
    async def work(desk: Desk) -> None:
        at_rest = register(await desk.state(), signal)["value"]
        assert at_rest != value
        await desk.does("inputs", **inputs)
        await desk.becomes(lambda state: register(state, signal)["value"] == value)
        await desk.does("reset")
        await desk.becomes(lambda state: register(state, signal)["value"] == at_rest)

    at_desk(work)


def test_a_button_that_is_pressed_again_in_the_meantime_is_released_once() -> None:
    async def work(desk: Desk) -> None:
        for _ in range(3):
            await desk.does("press", button="car", floor="L1")
            await elapse(0.1)
        assert desk.lift.face.inputs.car_buttons == {0}
        await elapse(0.2)
        assert desk.lift.face.inputs.car_buttons == frozenset()
        await desk.does("inputs", car_buttons=["L1"])
        await desk.does("press", button="car", floor="L1")
        await elapse(1.0)
        assert desk.lift.face.inputs.car_buttons == {0}

    at_desk(work)


def test_every_fault_of_the_lab_is_begun_listed_and_ended_by_its_name() -> None:
    async def work(desk: Desk) -> None:
        for name in (*DEVICE_FAULTS, *WIRE):
            values = NEEDED.get(name, {})
            state = await desk.does("faults/begin", name=name, values=values)
            assert [(fault["name"], fault["values"]) for fault in state["faults"]] == [(name, values)]
            assert await desk.does("faults/begin", name=name, values=values) == state
            assert (await desk.does("faults/end", name=name, values=values))["faults"] == [], name

    at_desk(work)


def test_the_list_of_faults_is_that_of_the_lab_with_the_values_that_each_needs() -> None:
    kinds = {kind.name: kind for kind in fault_kinds()}
    assert kinds.keys() == DEVICE_FAULTS.keys() | WIRE.keys()
    assert {name for name, kind in kinds.items() if kind.needs} == NEEDED.keys()
    assert all(kind.about for kind in kinds.values())
    in_mode: Any = kinds["in_mode"].values["mode"]
    assert {f"in_mode.{mode}" for mode in in_mode["enum"]} == {name for name in READY if name.startswith("in_mode.")}
    wrong_floor: Any = kinds["wrong_floor"].values["by"]
    assert (wrong_floor["type"], wrong_floor["default"]) == ("integer", 1)


@each_row(
    ("control", "body", "status", "words"),
    [
        ("press", {"button": "car", "floor": "roof"}, 400, "no floor 'roof'; there is L1, L2, L3, L4"),
        ("press", {"button": "chest", "floor": "L1"}, 422, "button"),
        ("inputs", {"obstruction": ["rear"]}, 400, "no rear door; there is front"),
        ("inputs", {"landing_buttons": ["roof"]}, 400, "no floor 'roof'"),
        ("inputs", {"smoke": True}, 422, "smoke"),
        ("faults/begin", {"name": "stuck_doors"}, 400, "did you mean `stuck_door`?"),
        ("faults/begin", {"name": "delay"}, 400, "delay needs seconds"),
        ("faults/begin", {"name": "delay", "values": {"seconds": -1}}, 400, "seconds"),
        ("faults/begin", {"name": "in_mode", "values": {"mode": "normal"}}, 400, "in_mode"),
        ("faults/begin", {"name": "foreign_writer", "values": {"command": "fly"}}, 400, "fly"),
        (
            "faults/begin",
            {"name": "disconnected_signal", "values": {"signal": "smoke"}},
            400,
            "no wire for a signal smoke",
        ),
        ("faults/end", {"name": "delay", "values": {"seconds": 1}}, 400, "is not on the wire"),
        ("faults/end", {"name": "stuck_door"}, 400, "has not begun"),
    ],
)
def test_what_cannot_be_is_refused_in_words_and_changes_nothing(
    control: str, body: Json, status: int, words: str
) -> None:
    async def work(desk: Desk) -> None:
        before = await desk.state()
        code, text = await desk.refused(control, **body)
        assert code == status
        assert words in text
        after = await desk.state()
        assert (after["inputs"], after["faults"]) == (before["inputs"], before["faults"])

    at_desk(work)


def test_a_lift_that_is_not_there_is_named_with_those_that_are() -> None:
    async def work(desk: Desk) -> None:
        answer = await desk.client.get("/lifts/south")
        assert answer.status_code == 404
        assert answer.json()["detail"] == "no lift 'south'; there is generic-registers"
        assert (await desk.client.get("/lifts")).json() == {"lifts": ["generic-registers"], "manager": None}

    at_desk(work)


def test_the_registers_of_a_controller_that_does_not_answer_are_not_known() -> None:
    async def work(desk: Desk) -> None:
        state = await desk.does("faults/begin", name="power_loss")
        assert not state["is_on_network"]
        assert {one["raw"] for one in state["registers"]} == {one["value"] for one in state["registers"]} == {None}
        state = await desk.does("faults/end", name="power_loss")
        assert register(state, "car_floor")["value"] == "L1"

    at_desk(work)


def test_the_registers_show_what_is_read_and_the_car_what_is_true() -> None:
    async def work(desk: Desk) -> None:
        state = await desk.does("faults/begin", name="says_wrong_floor", values={"by": 2})
        assert (register(state, "car_floor")["value"], register(state, "car_floor")["raw"]) == ("L3", [3])
        assert state["car"]["floor"] == "L1"

    at_desk(work)


def test_a_signal_on_several_addresses_shows_each_of_them() -> None:
    async def work(desk: Desk) -> None:
        state = await desk.state()
        door, floor = register(state, "door.front"), register(state, "car_floor")
        assert (door["addresses"], door["raw"], door["value"]) == (["discrete:0", "discrete:1"], [0, 1], "closed")
        assert (floor["wire"], floor["raw"], floor["value"]) == ("discrete 2, discrete 3", [1, 0], "L1")

    at_desk(work, "two-stop-agv")


def test_an_output_that_is_read_elsewhere_shows_both() -> None:
    async def work(desk: Desk) -> None:
        hold = register(await desk.state(), "hold_door.front")
        assert (hold["raw"], hold["read_back"]) == ([0], [0])
        assert register(await desk.state(), "door.front")["read_back"] is None

    at_desk(work, "wago-750")


def test_a_command_shows_who_wrote_it_and_whether_the_controller_obeys() -> None:
    async def main() -> None:
        lift = paneled()
        async with lift.running() as ports:
            reader, writer = await asyncio.open_connection("127.0.0.1", ports[""])
            client = ":".join(map(str, writer.get_extra_info("sockname")))

            async def sent(address: int, value: int) -> None:
                request = frames.frame(frames.write_register(address, value), 1)
                writer.write(request)
                async with asyncio.timeout(60):
                    assert await reader.readexactly(len(request)) == request

            await sent(16, 3)
            await sent(17, 1)
            rows = {row.name: row for row in lift.state().registers}
            # a call of this map needs robot mode, which nobody has requested
            assert (rows["go_to"].value, rows["go_to"].raw, rows["go_to"].is_obeyed) == ("L3", (3,), False)
            assert (rows["hold_door.front"].value, rows["hold_door.front"].written_by) == ("on", client)
            assert rows["robot_mode"].written_by is None
            assert rows["robot_mode"].value == "at rest"
            writer.close()
            await writer.wait_closed()

    asyncio.run(main())


def test_a_deaf_controller_gives_no_answer_and_the_panel_counts_what_was_lost() -> None:
    async def main() -> None:
        lift = paneled()
        async with lift.running() as ports:
            reader, writer = await asyncio.open_connection("127.0.0.1", ports[""])
            request = frames.frame(frames.write_register(17, 1), 1)
            async with asyncio.timeout(60):
                lift.begin(DropRequest())
                writer.write(request)
                while lift.state().faults[0].struck != 1:  # noqa: ASYNC110  it is on its way
                    await asyncio.sleep(0.01)
                lift.reset()
                assert lift.state().faults == ()
                writer.write(request)
                assert await reader.readexactly(len(request)) == request
            assert {row.written_s for row in lift.state().registers if row.name == "go_to"} == {None}
            writer.close()
            await writer.wait_closed()

    asyncio.run(main())


def test_a_panel_is_served_while_the_context_lasts_and_not_longer() -> None:
    async def main() -> None:
        sock = listen("127.0.0.1", 0)
        port = sock.getsockname()[1]
        async with panel_on(sock, [paneled()], "http://127.0.0.1:5003") as address:
            assert address == f"http://127.0.0.1:{port}/"
            async with httpx.AsyncClient(base_url=address, trust_env=False, timeout=HANGS_S) as client:
                assert (await client.get("lifts")).json()["manager"] == "http://127.0.0.1:5003"
        with pytest.raises(ConnectionRefusedError), socket.create_connection(("127.0.0.1", port)):
            pass

    asyncio.run(main())


# -- who may use it


@each_row(
    ("method", "headers", "status"),
    [
        ("GET", {}, 200),
        ("GET", {"host": "localhost:5004"}, 200),
        ("GET", {"host": "rebound.example:5004"}, 403),
        ("POST", {}, 200),
        ("POST", {"sec-fetch-site": "same-origin"}, 200),
        ("POST", {"origin": "http://127.0.0.1:5004"}, 200),
        ("POST", {"sec-fetch-site": "cross-site"}, 403),
        ("POST", {"sec-fetch-site": "same-site"}, 403),
        ("POST", {"origin": "http://evil.example"}, 403),
        ("POST", {"host": "rebound.example"}, 403),
    ],
)
def test_a_page_of_another_site_can_neither_read_nor_press(method: str, headers: dict[str, str], status: int) -> None:
    async def work(desk: Desk) -> None:
        path = f"/lifts/{desk.lift.name}" + ("/reset" if method == "POST" else "")
        answer = await desk.client.request(method, path, headers=headers)
        assert answer.status_code == status

    at_desk(work)


PAGE = (ROOT / "docs" / "reference" / "simulator.md").read_text("utf-8")


def test_the_description_and_the_page_have_every_path() -> None:
    description: Any = make_panel([paneled()]).openapi()
    operations = {
        f"{method.upper()} {path}": operation
        for path, methods in description["paths"].items()
        for method, operation in methods.items()
    }
    rows = re.findall(r"^\| `((?:GET|POST) /[^`]+)` \|", PAGE, re.MULTILINE)
    assert sorted(operations) == sorted(rows)
    assert all(operation["description"] and operation["tags"] for operation in operations.values())


def test_the_page_has_every_input_with_its_values() -> None:
    table = PAGE.partition("| input | value |\n|---|---|\n")[2].partition("\n\n")[0]
    named = {name for row in table.splitlines() for name in re.findall(r"`(\w+)`", row.split("|")[1])}
    assert named == set(InputChanges.model_fields)
    assert set(re.findall(r"`(\w+)`", table)) - named == {*Key, *Side, "true", "false"}
