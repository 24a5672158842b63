"""The devices of a lift: where its endpoints are, what each link has to respect, and how often a lift is polled."""

from pathlib import Path

import pytest

from drivers.modbus.settings import LinkSettings
from lift_manager.config.devices import Device, devices, strictest_needs
from lift_manager.lift.config import LiftConfig
from register_maps.schema import LinkDefaults
from tests.lift_manager.config.site_files import (
    GENERIC,
    TWO_STOP,
    Said,
    assert_says_exactly,
    edited,
    findings,
    load,
    my_map,
    said,
)
from tests.lift_manager.runtime.scripted import PLAIN

TWO_DEVICES = """\
schema: 1
name: A building
controllers:
  plc: {host: 10.0.0.5, map: generic-registers}
  box: {host: 10.0.0.6}
lifts:
  main:
    controller: plc
    endpoints: {sensor: {controller: box}}
    override:
      endpoints: {sensor: {unit_id: 7, served: {discrete: [[0, 0]]}, note: in the machine room}}
      signals: {passenger_alarm: {at: "sensor/discrete:0"}}
    floors: {L1: 1, L2: 2}
"""
POLLED = edited(GENERIC, ("generic-registers", "seer-lps3-two-stop"), ("{B1: -1, L1: 1, L2: 2}", "{L1: 0, L2: 1}"))
WATCHED_SLOWLY = edited(POLLED, ("    access: control\n", ""))


def placed(folder: Path, *edits: tuple[str, str]) -> dict[str, Device]:
    loaded = load(folder, TWO_DEVICES, *edits)
    return devices(loaded.site, loaded.site.lifts["main"], loaded.maps["main"].map)


def test_an_endpoint_has_the_unit_id_of_its_place_else_of_its_controller_else_of_the_map(tmp_path: Path) -> None:
    own = Device("plc", 1)
    assert placed(tmp_path) == {"": own, "sensor": Device("box", 7)}
    box = "box: {host: 10.0.0.6}", "box: {host: 10.0.0.6, unit_id: 9}"
    assert placed(tmp_path, box) == {"": own, "sensor": Device("box", 9)}
    place = "{sensor: {controller: box}}", "{sensor: {controller: box, unit_id: 0}}"
    assert placed(tmp_path, box, place) == {"": own, "sensor": Device("box", 0)}


def test_an_endpoint_may_be_another_unit_of_the_lifts_own_controller(tmp_path: Path) -> None:
    place = "{sensor: {controller: box}}", "{sensor: {controller: plc, unit_id: 3}}"
    assert placed(tmp_path, place) == {"": Device("plc", 1), "sensor": Device("plc", 3)}


@pytest.mark.parametrize(
    ("edits", "expected"),
    [
        pytest.param(
            [("    endpoints: {sensor: {controller: box}}\n", "")],
            [said(7, "lifts.main.endpoints", "sensor (in the machine room)", "has no place", "`controllers`")],
            id="an endpoint without a place",
        ),
        pytest.param(
            [("    endpoints: {sensor: {controller", "    endpoints: {senser: {controller")],
            [
                said(9, "lifts.main.endpoints.senser", "no endpoint senser", "did you mean `sensor`"),
                said(9, "lifts.main.endpoints", "sensor (in the machine room)", "has no place"),
            ],
            id="an endpoint with a typo",
        ),
        pytest.param(
            [("{sensor: {controller: box}}", "{sensor: {controller: bxo}}")],
            [said(9, "lifts.main.endpoints.sensor.controller", "no controller 'bxo'", "there is plc, box")],
            id="an endpoint on a controller that is not there",
        ),
        pytest.param(
            [("{sensor: {controller: box}}", "{sensor: {controller: bxo}}"), ("name: A building\n", "")],
            [
                said(8, "lifts.main.endpoints.sensor.controller", "no controller 'bxo'"),
                said(1, "name", "is missing"),
            ],
            id="an endpoint on a controller that is not there, beside a mistake in a key",
        ),
        pytest.param(
            [("{sensor: {controller: box}}", "{sensor: box}")],
            [said(9, "lifts.main.endpoints.sensor", "must be a table of keys")],
            id="an endpoint in a word",
        ),
        pytest.param(
            [("10.0.0.5, map: generic-registers}", "10.0.0.5}")],
            [said(4, "controllers.plc.map", "is missing", "main is read by it", "nothing but endpoints")],
            id="a controller of a lift without a map",
        ),
        pytest.param(
            [("    floors", "    offset: {discrete: 5}\n    floors")],
            [said(13, "lifts.main.offset.discrete", "no discrete addresses of the controller itself", "endpoint")],
            id="an offset for a table that only an endpoint has",
        ),
        pytest.param(
            [("box: {host: 10.0.0.6}", "box: {host: 10.0.0.6, timeout_s: 3}")],
            [said(9, "lifts.main.endpoints.sensor.controller", "timeout_s 3", "above max_age_s 1")],
            id="a time-out of the endpoint's controller beyond the age limit",
        ),
    ],
)
def test_a_device_that_has_no_place_is_named(
    tmp_path: Path, edits: list[tuple[str, str]], expected: list[Said]
) -> None:
    assert_says_exactly(findings(tmp_path, TWO_DEVICES, *edits), *expected)


def test_a_place_for_an_endpoint_of_a_map_without_endpoints_is_refused(tmp_path: Path) -> None:
    place = "    floors:", "    endpoints: {sensor: {controller: plc}}\n    floors:"
    words = "no endpoint sensor", "it has none", "`override` can add one"
    assert_says_exactly(findings(tmp_path, GENERIC, place), said(9, "lifts.main.endpoints.sensor", *words))


def test_an_offset_moves_the_controllers_own_points_and_not_those_of_an_endpoint(tmp_path: Path) -> None:
    inputs = edited(
        TWO_DEVICES,
        ("map: generic-registers", "map: two-stop-agv"),
        ("{L1: 1, L2: 2}", "{L1: 0, L2: 1}"),
        ("    floors", "    offset: {discrete: 65530}\n    floors"),
    )
    assert load(tmp_path, inputs).site.lifts["main"].offset == {"discrete": 65530}
    too_far = findings(tmp_path, inputs, ("65530", "65531"))
    assert_says_exactly(too_far, said(13, "lifts.main.offset.discrete", "out of 0 to 65535"))


def test_the_strictest_of_several_maps_satisfies_each_of_them() -> None:
    one = LinkDefaults(
        timeout_s=0.3, min_gap_s=0.1, min_poll_s=1, max_connections=4, idle_timeout_s=9, max_registers_per_read=60
    )
    other = LinkDefaults(
        idle_timeout_s=5, timeout_s=0.8, reconnect_min_s=5, max_bits_per_read=16, max_connections=1, tid_echo=False
    )
    both = strictest_needs([one, other])
    assert both == strictest_needs([other, one])
    assert both == LinkDefaults(
        timeout_s=0.8,
        min_gap_s=0.1,
        min_poll_s=1,
        reconnect_min_s=5,
        max_connections=1,
        idle_timeout_s=5,
        max_registers_per_read=60,
        max_bits_per_read=16,
        tid_echo=False,
    )


def test_a_controller_without_a_map_has_the_defaults_of_every_link(tmp_path: Path) -> None:
    assert strictest_needs([]) == LinkDefaults()
    assert load(tmp_path, TWO_DEVICES).links["box"] == LinkDefaults()


def test_the_defaults_of_a_map_are_those_of_a_link() -> None:
    link, settings = LinkDefaults(), LinkSettings()
    for name in ("timeout_s", "min_gap_s", "reconnect_min_s", "max_connections", "tid_echo"):
        assert getattr(link, name) == getattr(settings, name), name


def test_a_controller_that_serves_only_endpoints_is_asked_as_its_map_says(tmp_path: Path) -> None:
    my_map(tmp_path, ("link: {unit_id: 1,", "link: {unit_id: 1, min_gap_s: 0.3, max_connections: 2,"))
    loaded = load(tmp_path, TWO_DEVICES, ("box: {host: 10.0.0.6}", "box: {host: 10.0.0.6, map: ./mine.yaml}"))
    assert (loaded.links["box"].min_gap_s, loaded.links["box"].max_connections) == (0.3, 2)
    assert loaded.links["plc"].min_gap_s == 0


def test_parameters_of_two_lifts_may_ask_for_two_gaps_and_the_controller_gets_the_longer(tmp_path: Path) -> None:
    my_map(
        tmp_path,
        (
            "link: {unit_id: 1,",
            'parameters: {gap: {default: 0, help: seconds}}\nlink: {unit_id: 1, min_gap_s: "{gap}",',
        ),
    )
    lines = """\
  second:
    controller: plc
    parameters: {gap: 0.25}
    floors: {L1: 1, L2: 2}
"""
    loaded = load(tmp_path, GENERIC + lines, ("map: generic-registers", "map: ./mine.yaml"))
    assert loaded.links["plc"].min_gap_s == 0.25


def test_what_the_site_says_of_a_controller_comes_before_its_map(tmp_path: Path) -> None:
    said_here = "port: 502,", "port: 502, min_gap_s: 0, timeout_s: 0.7, max_bits_per_read: 8, tid_echo: false,"
    my_map(tmp_path, ("link: {unit_id: 1,", "link: {unit_id: 1, min_gap_s: 0.3, max_registers_per_read: 20,"))
    link = load(tmp_path, GENERIC, said_here, ("map: generic-registers", "map: ./mine.yaml")).links["plc"]
    assert (link.min_gap_s, link.timeout_s, link.max_bits_per_read, link.tid_echo) == (0, 0.7, 8, False)
    assert link.max_registers_per_read == 20


def test_a_lift_is_polled_five_times_a_second_unless_its_map_wants_it_slower(tmp_path: Path) -> None:
    assert load(tmp_path, GENERIC).poll_s("main") == 0.2
    assert load(tmp_path, WATCHED_SLOWLY).poll_s("main") == 0.5
    assert load(tmp_path, WATCHED_SLOWLY, ("    floors:", "    poll_s: 0.6\n    floors:")).poll_s("main") == 0.6


def test_a_slow_device_at_an_endpoint_slows_the_poll_of_the_lift(tmp_path: Path) -> None:
    my_map(tmp_path, ("link: {unit_id: 1,", "link: {unit_id: 1, min_poll_s: 0.4,"))
    assert load(tmp_path, TWO_DEVICES, ("box: {host: 10.0.0.6}", "box: {host: 10.0.0.6, map: ./mine.yaml}")).poll_s(
        "main"
    ) == pytest.approx(0.4)


def test_a_poll_that_is_faster_than_the_controller_takes_it_is_refused(tmp_path: Path) -> None:
    found = findings(tmp_path, WATCHED_SLOWLY, ("    floors:", "    poll_s: 0.4\n    floors:"))
    assert_says_exactly(found, said(8, "lifts.main.poll_s", "every 0.4 s is faster", "0.5 s is the least"))


def test_a_lift_that_a_session_has_is_polled_twenty_times_a_second_unless_its_map_wants_it_slower(
    tmp_path: Path,
) -> None:
    assert load(tmp_path, GENERIC).poll_ridden_s("main") == 0.05
    assert load(tmp_path, WATCHED_SLOWLY).poll_ridden_s("main") == 0.5
    assert load(tmp_path, GENERIC, ("    floors:", "    poll_s: 0.03\n    floors:")).poll_ridden_s("main") == 0.03
    assert load(tmp_path, GENERIC, ("    floors:", "    poll_ridden_s: 0.1\n    floors:")).poll_ridden_s("main") == 0.1


def test_a_lift_that_a_session_has_is_polled_neither_faster_than_its_controller_takes_it_nor_slower_than_at_rest(
    tmp_path: Path,
) -> None:
    found = findings(tmp_path, WATCHED_SLOWLY, ("    floors:", "    poll_ridden_s: 0.4\n    floors:"))
    assert_says_exactly(found, said(8, "lifts.main.poll_ridden_s", "every 0.4 s is faster", "0.5 s is the least"))
    found = findings(tmp_path, WATCHED_SLOWLY, ("    floors:", "    poll_ridden_s: 0.6\n    floors:"))
    assert_says_exactly(found, said(8, "lifts.main.poll_ridden_s", "every 0.6 s", "less often than at rest"))


def test_an_age_limit_that_the_slowest_allowed_poll_cannot_keep_is_refused_at_the_limit(tmp_path: Path) -> None:
    found = findings(tmp_path, WATCHED_SLOWLY, ("    floors:", "    max_age_s: 0.8\n    floors:"))
    assert_says_exactly(found, said(8, "lifts.main.max_age_s", "every 0.5 s is too slow for max_age_s 0.8"))


def test_what_a_lift_leaves_unsaid_is_what_the_manager_takes_for_it(tmp_path: Path) -> None:
    lift = load(tmp_path, TWO_STOP).site.lifts["goods"]
    config = LiftConfig(name="goods", source="by hand", floors=(), doors_at={}, control=False, capabilities=PLAIN)
    own = ("robot_hours", "between_sessions_s", "fire_release_delay_s")
    for name in ("lease_s", "max_session_hold_s", "infer_occupancy", "board_min_s", *own):
        assert getattr(lift, name) == getattr(config, name), name
    assert load(tmp_path, TWO_STOP).poll_s("goods") == config.poll_s
