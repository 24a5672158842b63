"""What is told about a map: in a list of all, and point by point."""

from dataclasses import asdict
from pathlib import Path

from lift_manager.commissioning import maps_list, maps_text
from lift_manager.commissioning.maps_list import WIDTH, MapSummary, shipped_maps, summarize_map
from lift_manager.commissioning.maps_show import MapSheet, map_sheet, side_by_side
from register_maps.codec import compile_map
from register_maps.load import MapChanges, load, shipped
from tests.support.rows import each_row

each_map = each_row("name", shipped())

FEATURES: dict[str, dict[str, object]] = {
    "generic-registers": {
        "trust": "template",
        "position": "number",
        "at_floor": "level signal",
        "doors": "front (closed, opening, open, closing, fault)",
        "calls": "go_to",
        "door_commands": "hold_door.front, close_door.front",
        "permissions": "none",
        "handshake": "none",
        "robot_mode": "requested and granted",
        "fire": "visible (fire, mode word)",
        "needs": (),
        "to_set": (),
        "may_set": (),
    },
    "two-stop-agv": {
        "trust": "integration-code",
        "position": "one bit for each of 2 floors",
        "doors": "front (two limits)",
        "robot_mode": "granted by the lift, cannot be requested",
        "fire": "NOT VISIBLE: the interface has no fire signal; only a withdrawn AGV mode may be seen",
        "may_set": ("first_input", "first_output"),
    },
    "adam-pushbutton": {
        "position": "NONE",
        "at_floor": "nothing, until a site adds car_floor",
        "doors": "none",
        "needs": ("car_floor", "door.front"),
        "may_set": ("base",),
    },
    "seer-siemens-chengdu-block": {
        "calls": "call, go",
        "door_commands": "none",
        "permissions": "may_enter, may_leave",
        "handshake": "robot_in_place, robot_left (the car waits for it)",
        "to_set": ("first",),
    },
    "seer-lps3-two-stop": {
        "doors": "front (open limits, one per floor)",
        "at_floor": "fully-open limit of that floor",
        "handshake": "robot_in_place (the car waits for it)",
    },
    "robotnik-il-eth": {"robot_mode": "requested, and nothing shows whether it is granted"},
    "thingweb-elevator": {"trust": "simulation", "at_floor": "the car does not move", "doors": "none"},
}


def sheet(name: str) -> MapSheet:
    return map_sheet(load(name))


def text_of(name: str) -> str:
    return "\n".join(maps_text.lines(sheet(name)))


def test_every_shipped_map_is_listed_once() -> None:
    assert tuple(line.name for line in shipped_maps()) == shipped()


@each_row("name", FEATURES)
def test_the_features_of_a_map_are_told_in_words(name: str) -> None:
    line = asdict(summarize_map(load(name)))
    assert {key: line[key] for key in FEATURES[name]} == FEATURES[name]


def test_the_list_is_a_block_of_lines_per_map_that_fits_the_terminal() -> None:
    lines = list(maps_list.lines(shipped_maps()))
    assert max(map(len, lines)) <= WIDTH
    for name in shipped():
        assert sum(line.startswith(f"{name}  [") for line in lines) == 1
    assert "    A SECOND DEVICE must give: car_floor, door.front" in lines
    assert "    every site must set: first" in lines
    assert lines[-2].startswith(f"{len(shipped())} maps")


def test_a_map_that_only_looks_is_listed_as_one(tmp_path: Path) -> None:
    path = tmp_path / "looks.yaml"
    path.write_text(
        "schema: 1\nname: looks\ntitle: It only looks\nprovenance: {trust: template, sources: [this test]}\n"
        "addressing: {base: 0}\nserved: {input: [[0, 9]]}\n"
        "signals:\n  car_floor: {at: 'input:1', bits: [0, 4], code: gray, as: floor}\n"
        "  mode: {at: 'input:2', values: {1: normal, 2: inspection}}\n"
        "at_floor_evidence: {kind: position_stable, for_s: 2}\nnot_visible: {fire: no bit for it}\n"
    )
    line: MapSummary = summarize_map(load(path))
    assert (line.calls, line.door_commands) == ("none: the map only looks", "none")
    assert line.position == "gray code of 5 bits"
    assert line.at_floor == "floor unchanged for 2 s"
    assert line.fire == "NOT VISIBLE: no bit for it"
    assert "none: this map only looks" in "\n".join(maps_text.lines(map_sheet(load(path))))


@each_map
def test_every_point_of_a_map_is_shown_with_its_printed_address_and_that_on_the_wire(name: str) -> None:
    source = load(name).map
    codec = compile_map(source)
    shown = sheet(name)
    assert [signal.name for signal in shown.signals] == list(source.signals)
    assert [command.name for command in shown.commands] == list(source.commands)
    for signal in shown.signals:
        points = codec.signals[signal.name].points
        assert {(place.table, place.address) for place in signal.places} == {(p.table, p.address) for p in points}
        assert {place.printed for place in signal.places} == set(source.signals[signal.name].addresses)
    for command in shown.commands:
        spec = source.commands[command.name]
        assert [place.printed for place in command.places] == list(spec.addresses)
        assert [place.address for place in command.places] == [p.address for p in codec.commands[command.name].points]
        assert len(command.read_back) == len(codec.commands[command.name].read_points)


@each_map
def test_the_text_of_a_map_fits_the_terminal_and_leaves_nothing_out(name: str) -> None:
    source, text = load(name).map, text_of(name)
    lines = text.splitlines()
    assert max(map(len, lines)) <= WIDTH
    flat = " ".join(text.split())
    for entry in (*source.signals, *source.commands):
        assert any(line.startswith(f"  {entry}: ") for line in lines), entry
    for parameter in source.parameters.values():
        assert " ".join(parameter.help.split()) in flat
    for told in (*source.provenance.sources, source.provenance.notes, *source.needs.values()):
        assert " ".join(told.split()) in flat
    notes = [signal.note for signal in source.signals.values()] + [command.note for command in source.commands.values()]
    assert all(" ".join(note.split()) in flat for note in notes)
    assert f"unit id{' ' * 2}" in text
    assert load(name).sha256 in text


def test_generic_registers_is_shown_in_these_words() -> None:
    lines = text_of("generic-registers").splitlines()
    start = lines.index("  car_floor: the floor at which the car stands, or which it passed last")
    assert lines[start : start + 4] == [
        "  car_floor: the floor at which the car stands, or which it passed last",
        "      holding:1   on the wire: holding 1   FC03 (read holding registers)",
        "      signed; the code of a floor, 0 = not known",
        "      note: the floor the car stands at or last passed",
    ]
    start = lines.index("  hold_door.front: opens the front door and keeps it open, as the door-open button does")
    assert lines[start + 1 : start + 10] == [
        "      holding:17   on the wire: holding 17   FC06 (write one register), read back with FC03",
        "      1 = on, 0 = released",
        "      held until released, at most 30 s unless renewed; written again every 1 s; cleared by the",
        "        controller after 27 s, to see it written again",
        "      close_door.front is released first",
        "      proof: the output reads back as written, within 2 s",
        "      when the link is lost: the watchdog of the controller releases it",
        "      note: 1 = open the door and hold it; the controller releases it 3 s after the last write.",
        "        After 27 s it clears the point, and keeps holding if it is written again",
    ]


def test_a_printed_number_that_counts_from_1_is_shown_beside_the_one_on_the_wire() -> None:
    text = text_of("adam-pushbutton")
    assert "coil:17 to coil:19   on the wire: coil 16 to 18   FC05" in text
    assert "counting from 1: the number minus 1 is the address on the wire" in text


def test_an_output_that_is_read_elsewhere_is_shown_with_both_addresses() -> None:
    lines = text_of("wago-750").splitlines()
    assert "      coil:2   on the wire: coil 2   FC05 (write one coil)" in lines
    assert "      read back: coil:514   on the wire: coil 514   FC01" in lines


def test_a_site_s_parameters_move_what_is_shown() -> None:
    moved = map_sheet(load("two-stop-agv", changes=MapChanges(parameters={"first_input": 100})))
    (door,) = [signal for signal in moved.signals if signal.name == "door.front"]
    assert list(side_by_side(door.places)) == [("discrete:100 to discrete:101", "discrete 100 to 101")]


def test_a_32_bit_number_is_one_line_with_both_of_its_registers() -> None:
    (floor,) = [signal for signal in sheet("thingweb-elevator").signals if signal.name == "car_floor"]
    assert list(side_by_side(floor.places)) == [("holding:40001", "holding 40001 to 40002")]
    assert "32 bits, high word first" in floor.coding
    assert floor.coding.endswith("counts only while motion says stopped")


def test_what_a_device_needs_of_its_link_is_told() -> None:
    text = text_of("thingweb-elevator")
    assert "at least 1.1 s from poll to poll" in text
    assert "serves discrete  10001 (on the wire)" in text
    assert "the controller ends it by itself" in text


def test_a_parameter_without_a_default_says_that_every_site_must_set_it() -> None:
    assert "first  EVERY SITE MUST SET IT; here 1 (0 to 65528): " in text_of("seer-siemens-chengdu-block")
    assert "base  default 0 (0 to 1): " in text_of("seer-siemens-chengdu")
    assert "not_closed      default moving (moving or open): " in text_of("robotnik-il-eth")
