"""What `check` says about the things a robot's safety rests on, and what it only warns about."""

from pathlib import Path

import pytest

from register_maps.check import Problem, check
from tests.support.good_map import GOOD, HANDSHAKE, Mistake, changed, expect_only, findings_of, loaded
from tests.support.rows import each_row

LIMITS = 'door.front: {open_limits: ["discrete:0", "discrete:1", "discrete:2"]}'
FLOOR = 'car_floor: {one_of: ["discrete:0", "discrete:1", "discrete:2"]}'
MAY_ENTER = '  may_enter: {at: "discrete:10"}\n'
OCCUPANCY = "needs_occupancy: true\n"
TIMED = "    refresh_s: 1\n    on_link_loss: timed_by_device\n"

MISTAKES: list[Mistake] = [
    ("limits that are not the floor switches", LIMITS, LIMITS.replace("discrete:2", "discrete:30"), "at_floor_evidence", "give a door `open_limits` and car_floor `one_of` with the same addresses"),
    ("a floor that is no switch", FLOOR, 'car_floor: {at: "holding:1", as: floor, unknown: [7]}', "at_floor_evidence", "door_limit means that the open limit of each floor is also its floor switch"),
    ("a need of nothing", OCCUPANCY, OCCUPANCY + "needs: {levle: by a second device}\n", "needs.levle", "did you mean `level`?"),
    ("a need of nobody", OCCUPANCY, OCCUPANCY + "needs: {qqq: by a second device}\n", "needs.qqq", "signals are car_floor"),
    ("a need without a reason", OCCUPANCY, OCCUPANCY + 'needs: {level: " "}\n', "needs.level", "give the reason why a site has to add it"),
    ("a hold that the device ends while we hold on", TIMED, "    on_link_loss: timed_by_device\n", "commands.hold_door.rear.on_link_loss", "even while we still hold: use `refresh_s`, shorter than max_hold_s, 5 s"),
    ("a hold that the device ends before it is written again", TIMED, TIMED.replace("1", "5"), "commands.hold_door.rear.refresh_s", "5 s is not before max_hold_s, 5 s; refresh sooner"),
    ("a watchdog that hears no heartbeat", TIMED, "    on_link_loss: device_watchdog\n", "commands.hold_door.rear.on_link_loss", "the heartbeat goes to another device; declare the heartbeat at this device if its table names a register"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "key", "words"),
    [pytest.param(*case[1:], id=case[0]) for case in MISTAKES],
)
def test_a_claim_that_the_map_cannot_show_is_refused(tmp_path: Path, old: str, new: str, key: str, words: str) -> None:
    expect_only(tmp_path, changed(HANDSHAKE, old, new)[0], key, words)


def test_what_a_map_declares_itself_is_no_need(tmp_path: Path) -> None:
    model = loaded(tmp_path, HANDSHAKE).map.model_copy(update={"needs": {"motion": "a second device"}})
    assert check(model) == [Problem(("needs", "motion"), "the map declares this signal itself; remove this line")]


def test_a_fire_signal_that_the_site_adds_is_visible(tmp_path: Path) -> None:
    text, _ = changed(HANDSHAKE, '  fire: {at: "holding:11.3", active: low}\n', "")
    assert [finding.key for finding in findings_of(tmp_path, text)] == ["not_visible"]
    needing = text + "needs: {fire: a contact of the building}\n"
    assert loaded(tmp_path, needing).warnings == ()
    expect_only(tmp_path, needing + "not_visible: {fire: none}\n", "not_visible.fire", "remove this line")


def test_evidence_may_be_for_the_site_to_add(tmp_path: Path) -> None:
    text, _ = changed(HANDSHAKE, "{kind: door_limit}", "{kind: level}")
    assert [finding.key for finding in findings_of(tmp_path, text)] == ["at_floor_evidence"]
    assert loaded(tmp_path, text + "needs: {level: a switch of the second device}\n").warnings == ()
    limits, _ = changed(HANDSHAKE, f"  {FLOOR}\n", "")
    limits, _ = changed(limits, f"  {LIMITS}\n", "")
    assert loaded(tmp_path, limits + "needs: {car_floor: not here, door.front: not here}\n").warnings == ()


def test_a_map_that_only_says_what_a_site_must_add_is_accepted(tmp_path: Path) -> None:
    signals = GOOD[GOOD.index("signals:") : GOOD.index("at_floor_evidence")]
    outputs = """\
commands:
  go_to: {one_of: ["coil:1", "coil:2"], action: pulse, width_s: 0.5, confirm: {any_of: [effect], within_s: 9}}
needs: {car_floor: no input here, door.front: no input here, fire: no input here}
"""
    text = changed(GOOD, signals, outputs)[0].replace("{kind: level}", "{kind: position_stable, for_s: 1}")
    assert loaded(tmp_path, text + "at_same_floor: call\n").warnings == ()


def test_a_watchdog_is_fed_by_a_heartbeat_at_its_own_device(tmp_path: Path) -> None:
    text, _ = changed(HANDSHAKE, TIMED, "    on_link_loss: device_watchdog\n")
    assert loaded(tmp_path, changed(text, '"holding:21", action', '"sensor/holding:2", action')[0]).warnings == ()


def test_an_open_door_alone_as_proof_of_a_hold_that_can_be_read_back_is_warned_about(tmp_path: Path) -> None:
    text, _ = changed(HANDSHAKE, "[effect, readback]", "[effect]")
    (warning,) = loaded(tmp_path, text).warnings
    assert warning.key == "commands.hold_door.rear.confirm"
    assert "the door may be open by itself, and then `effect` does not show that we hold it" in warning.message
    pulses = changed(text, "    refresh_s: 1\n", "    repeat_pulse_s: 1\n    width_s: 0.5\n")[0]
    assert loaded(tmp_path, pulses).warnings == ()


def test_a_way_out_that_needs_permission_and_a_way_in_that_does_not_are_warned_about(tmp_path: Path) -> None:
    (warning,) = loaded(tmp_path, changed(HANDSHAKE, MAY_ENTER, "")[0]).warnings
    assert "may_leave without may_enter" in warning.message


ZEROS_LOOK_HEALTHY = """\
schema: 1
name: good
title: A lift that looks healthy while its controller serves zeros
provenance: {trust: template, sources: [this test]}
addressing: {base: 0}
served: {holding: [[0, 20]], discrete: [[0, 20]]}
signals:
  car_floor: {at: "holding:0", bits: [0, 3], as: floor}
  motion: {up: "discrete:8", down: "discrete:9"}
  door.front: {open_limits: ["discrete:0", "discrete:1"]}
  fire: {at: "discrete:3"}
  overload: {at: "holding:2", means_yes: 7}
at_floor_evidence: {kind: motion_stopped}
"""


def test_zeros_that_pass_for_a_healthy_lift_are_warned_about(tmp_path: Path) -> None:
    (warning,) = loaded(tmp_path, ZEROS_LOOK_HEALTHY).warnings
    assert "a controller that serves only zeros would pass for a healthy lift" in warning.message


@each_row(
    ("old", "new"),
    [
        ('{at: "holding:0", bits: [0, 3], as: floor}', '{at: "holding:0", bits: [0, 3], as: floor, code: gray, none: [0]}'),
        ('{at: "holding:0", bits: [0, 3], as: floor}', '{code_of: ["holding:0.0", "holding:0.1"], active: low, none: [3]}'),
        ('{at: "holding:0", bits: [0, 3], as: floor}', '{one_of: ["holding:0.0", "holding:0.1"]}'),
        ('{at: "holding:0", bits: [0, 3], as: floor}', '{one_of: ["holding:0.0", "holding:0.1"], active: low}'),
        ('["discrete:0", "discrete:1"]}', '["discrete:0", "discrete:1"], active: low}'),
        ('fire: {at: "discrete:3"}', 'fire: {at: "holding:3", means_yes: 7, active: low}'),
        ('fire: {at: "discrete:3"}', 'fire: {at: "discrete:3"}\n  alive: {at: "holding:4", type: counter, must_change_within_s: 9}'),
        ('fire: {at: "discrete:3"}', 'fire: {at: "discrete:3"}\n  may_enter: {at: "holding:4.1"}\n  may_leave: {at: "holding:4.2"}'),
        ('fire: {at: "discrete:3"}', 'fire: {at: "discrete:3"}\n  mode: {at: "holding:4", values: {1: normal}}'),
    ],
)  # fmt: skip
def test_one_signal_that_keeps_robots_out_at_zero_is_enough(tmp_path: Path, old: str, new: str) -> None:
    assert loaded(tmp_path, changed(ZEROS_LOOK_HEALTHY, old, new)[0]).warnings == ()


@each_row(
    ("old", "new"),
    [
        ('{at: "holding:0", bits: [0, 3], as: floor}', '{code_of: ["holding:0.0", "holding:0.1"], active: low, none: [0]}'),
        ('fire: {at: "discrete:3"}', 'fire: {at: "discrete:3"}\n  may_enter: {at: "holding:4.1"}'),
        ('fire: {at: "discrete:3"}', 'fire: {at: "discrete:3"}\n  may_enter: {at: "holding:4.1", active: low}\n  may_leave: {at: "holding:4.2", active: low}'),
        ('fire: {at: "discrete:3"}', 'fire: {at: "discrete:3"}\n  robots_allowed: {at: "holding:4.1", active: low}'),
        ('fire: {at: "discrete:3"}', 'fire: {at: "discrete:3"}\n  mode: {at: "holding:4", values: {0: robot}}'),
    ],
)  # fmt: skip
def test_what_says_nothing_at_zero_does_not_help(tmp_path: Path, old: str, new: str) -> None:
    (warning,) = loaded(tmp_path, changed(ZEROS_LOOK_HEALTHY, old, new)[0]).warnings
    assert "only zeros" in warning.message


def test_what_a_site_has_yet_to_add_is_not_judged_by_zeros(tmp_path: Path) -> None:
    assert loaded(tmp_path, ZEROS_LOOK_HEALTHY + "needs: {level: a switch}\n").warnings == ()
