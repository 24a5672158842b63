"""What a person is told about a good site file at every start."""

from pathlib import Path

from tests.lift_manager.config.site_files import GENERIC, TWO_STOP, edited, load, my_map
from tests.support.rows import each_row

WATCHED = edited(GENERIC, ("    access: control\n", ""))
DEMO = edited(
    WATCHED, ("map: generic-registers", "map: thingweb-elevator"), ("{B1: -1, L1: 1, L2: 2}", "{L0: 0, L1: 1}")
)


def about(folder: Path, text: str, words: str, *edits: tuple[str, str]) -> list[str]:
    return [caution for caution in load(folder, text, *edits).cautions() if words in caution]


BUTTONS = """\
    override:
      commands:
        go_to: {as: null, one_of: ["coil:0", "coil:1", "coil:2", "coil:3"], CODES, action: pulse, width_s: 1, confirm: {any_of: [effect], within_s: 10}}
      served: {coil: [[0, 9]]}
"""


@each_row(
    ("codes", "expected"),
    [
        (
            "codes: [-3, 1, 2, 3]",
            ["main: codes -3, 3 of go_to belong to no floor of this lift"],
        ),
        (
            "note: no codes",
            [
                "main: codes 0, 3 of go_to belong to no floor of this lift; without `codes`, the first entry of go_to has code 0: if it is that of the lowest floor here, give `codes`"
            ],
        ),
        ("codes: [1, 2, 3, 4]", ["main: codes 3 to 4 of go_to belong to no floor of this lift"]),
        ("codes: [7, 2, 1, 5]", ["main: codes 5, 7 of go_to belong to no floor of this lift"]),
    ],
)
def test_a_code_that_belongs_to_no_floor_is_cautioned_about(tmp_path: Path, codes: str, expected: list[str]) -> None:
    two = GENERIC.replace("{B1: -1, L1: 1, L2: 2}", "{L1: 1, L2: 2}") + BUTTONS.replace("CODES", codes)
    assert about(tmp_path, two, "of this lift") == expected


def test_a_lift_whose_codes_are_its_floors_needs_no_word_about_them(tmp_path: Path) -> None:
    four = GENERIC.replace("{B1: -1, L1: 1, L2: 2}", "{B1: -1, L1: 1, L2: 2, L3: 3}")
    assert about(tmp_path, four + BUTTONS.replace("CODES", "codes: [-1, 1, 2, 3]"), "of this lift") == []


def test_a_lift_that_is_only_watched_says_that_its_requests_are_refused(tmp_path: Path) -> None:
    assert about(tmp_path, WATCHED, "watched") == [
        "main: is only watched, and requests for it are refused; `access: control` would command it"
    ]
    assert about(tmp_path, GENERIC, "watched") == []


@each_row(("host", "cautions"), [("0.0.0.0", 1), ("10.0.0.7", 1), ("127.0.0.1", 0), ("localhost", 0)])
def test_an_api_that_others_on_the_network_can_reach_is_cautioned_about(
    tmp_path: Path, host: str, cautions: int
) -> None:
    assert len(about(tmp_path, f"{GENERIC}api: {{host: {host}}}\n", "the API listens on")) == cautions


def test_an_address_that_others_reach_needs_keys_or_a_reason_that_is_said_at_every_start(tmp_path: Path) -> None:
    (needs,) = about(tmp_path, f"{GENERIC}api: {{host: 10.0.0.7}}\n", "the API listens on")
    assert "every request needs a key (`lift-manager keys make`), and keys cross the network as they are" in needs
    open_to_all = f"{GENERIC}api: {{host: 10.0.0.7, without_keys: a closed network}}\n"
    (accepted,) = about(tmp_path, open_to_all, "the API listens on")
    assert accepted.endswith("anybody who reaches it can command the lifts; accepted: a closed network")
    local = f"{GENERIC}api: {{without_keys: a closed network}}\n"
    assert about(tmp_path, local, "the API listens on") == []


def test_a_commanded_lift_with_everything_visible_on_a_map_taken_from_a_lift_needs_no_caution(
    tmp_path: Path,
) -> None:
    my_map(tmp_path, ("trust: template", "trust: vendor-manual"))
    assert list(load(tmp_path, GENERIC, ("map: generic-registers", "map: ./mine.yaml")).cautions()) == []


def test_what_a_lift_does_not_show_and_what_was_accepted_are_cautioned_about(tmp_path: Path) -> None:
    cautions = list(load(tmp_path, TWO_STOP).cautions())
    assert [caution.split(":")[1].strip() for caution in cautions] == [
        "fire is not visible on this interface",
        "outputs stay on when this manager is lost; accepted",
    ]
    assert cautions[-1].endswith("accepted: a person stands beside it")


def test_a_map_that_was_taken_from_no_lift_is_cautioned_about(tmp_path: Path) -> None:
    assert about(tmp_path, GENERIC, "template and") == [
        "main: map generic-registers is a template and was not taken from a real lift; compare every signal with the real lift"
    ]
    assert about(tmp_path, TWO_STOP, "compare every signal") == []
    assert len(about(tmp_path, DEMO, "map thingweb-elevator describes a simulation")) == 1


def test_every_change_of_a_map_is_listed_by_its_key(tmp_path: Path) -> None:
    changed = "access: control\n    override: {signals: {overload: {active: low}}, door_opens_within_s: 20}"
    assert about(tmp_path, GENERIC, "changed", ("access: control", changed)) == [
        "main: map generic-registers is changed at this site: signals.overload, door_opens_within_s"
    ]


def test_a_map_that_only_has_its_parameters_set_is_not_called_changed(tmp_path: Path) -> None:
    assert about(tmp_path, TWO_STOP, "changed", ("access:", "parameters: {first_input: 100}\n    access:")) == []


def test_a_warning_of_a_map_is_said_once_for_all_its_lifts(tmp_path: Path) -> None:
    loaded = load(tmp_path, DEMO + DEMO[DEMO.index("  main:") :].replace("main:", "second:"))
    warnings = {warning for lift in loaded.maps.values() for warning in lift.warnings}
    assert warnings
    told = [caution for caution in loaded.cautions() if "thingweb-elevator.yaml" in caution]
    assert len(told) == len(warnings)
    assert all(caution.startswith("main, second: ") for caution in told)


def test_a_lift_that_may_be_commanded_and_cannot_be_called_is_cautioned_about(tmp_path: Path) -> None:
    no_call = "access: control\n    override: {commands: {go_to: null}}"
    assert about(tmp_path, GENERIC, "no command that calls the car", ("access: control", no_call))
    assert not about(tmp_path, GENERIC, "no command that calls the car")


def test_a_controller_that_nothing_is_on_is_left_alone_and_one_that_serves_an_endpoint_is_not(tmp_path: Path) -> None:
    more = "lifts:\n", "  spare: {host: 10.0.0.9, map: two-stop-agv}\n  box: {host: 10.0.0.8}\nlifts:\n"
    lines = """\
    endpoints: {sensor: {controller: box}}
    override:
      endpoints: {sensor: {served: {discrete: [[0, 0]]}}}
      signals: {passenger_alarm: {at: "sensor/discrete:0"}}
"""
    endpoint = "    floors:", f"{lines}    floors:"
    assert about(tmp_path, GENERIC, "left alone", more, endpoint) == [
        "spare: no lift is on this controller; it is left alone"
    ]
    assert list(load(tmp_path, GENERIC, more, endpoint).controllers) == ["plc", "box"]


def test_recordings_are_found_by_name_and_a_folder_without_any_is_cautioned_about(tmp_path: Path) -> None:
    text = f"{GENERIC}announcements: sounds\n"
    assert len(about(tmp_path, text, "cannot be read")) == 1
    assert load(tmp_path, text).announcements() == {}
    sounds = tmp_path / "sounds"
    sounds.mkdir()
    assert len(about(tmp_path, text, "has no recording")) == 1
    for name in ("enters.mp3", "stopped.wav", "stopped.txt", "other.mp3", "leaves"):
        (sounds / name).touch()
    assert about(tmp_path, text, "announcements") == []
    found = load(tmp_path, text).announcements()
    assert found == {"enters": sounds / "enters.mp3", "stopped": sounds / "stopped.wav"}
    assert load(tmp_path, GENERIC).announcements() == {}
