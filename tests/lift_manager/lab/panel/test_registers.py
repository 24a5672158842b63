"""How the panel and `simulate` name places on the wire."""

from lift_manager.lab.panel.registers import wire_text
from tests.support.written_maps import written_map


def test_a_field_of_a_register_is_named_from_its_first_to_its_last_bit() -> None:
    signals = written_map(
        'signals:\n  motion: {at: "input:9", bits: [0, 2], values: {0: stopped, 1: up}}\n'
        '  car_floor: {at: "input:1", as: floor, unknown: [0]}\n  level: {at: "input:9.4"}\n'
    ).signals
    assert [wire_text(signals[name].points) for name in ("motion", "car_floor", "level")] == [
        "input 9.0 to 9.2",
        "input 1",
        "input 9.4",
    ]
