"""What a site says about people: hours, turns, fire, and where their words are kept."""

from pathlib import Path

from lift_manager.app import lift_config
from lift_manager.lift.hours import RobotHours, read_hours
from tests.lift_manager.config.site_files import GENERIC, findings, load, said
from tests.lift_manager.runtime.scripted import AT_L2, PLAIN, ScriptedDriver
from tests.support.rows import each_row

FLOORS = "    floors: {B1: -1, L1: 1, L2: 2}\n"


def with_line(line: str) -> tuple[str, str]:
    return FLOORS, f"    {line}\n{FLOORS}"


def test_what_is_said_reaches_the_lift(tmp_path: Path) -> None:
    lines = 'robot_hours: ["Mon-Fri 20:00-06:00", "Sat-Sun 00:00-24:00"]\n    between_sessions_s: 0\n    fire_release_delay_s: 2'
    loaded = load(
        tmp_path,
        GENERIC,
        with_line(lines),
        ("name: A building\n", "name: A building\ntimezone: Asia/Singapore\nstate: kept\n"),
    )
    config = lift_config("main", loaded, ScriptedDriver(PLAIN, AT_L2))
    assert config.robot_hours == RobotHours((read_hours("Mon-Fri 20:00-06:00"), read_hours("Sat-Sun 00:00-24:00")))
    assert (config.between_sessions_s, config.fire_release_delay_s) == (0, 2)
    assert (loaded.site.timezone, loaded.site.state) == ("Asia/Singapore", "kept")


@each_row(
    ("line", "key", "words"),
    [
        ('robot_hours: ["Mon-Fri 20-6"]', "robot_hours[0]", "write `Mon-Fri 20:00-06:00`"),
        ('robot_hours: ["Foo 20:00-06:00"]', "robot_hours[0]", "there is no day 'Foo'"),
        (
            'robot_hours: ["Mon 20:00-06:00", "Mon 21:00-22:00"]',
            "robot_hours[1]",
            "adds nothing, because Mon 20:00-06:00",
        ),
        ("robot_hours: []", "robot_hours", "names no hours; leave it out"),
        ("robot_hours: Mon 20:00-06:00", "robot_hours", "list"),
        ("between_sessions_s: -1", "between_sessions_s", "at least 0"),
        ("between_sessions_s: 601", "between_sessions_s", "at most 600"),
        ("fire_release_delay_s: 11", "fire_release_delay_s", "at most 10"),
    ],
)
def test_what_makes_no_sense_is_found_at_its_place(tmp_path: Path, line: str, key: str, words: str) -> None:
    (found,) = findings(tmp_path, GENERIC, with_line(line))
    assert found.key == f"lifts.main.{key}"
    assert words in found.message


@each_row("zone", ["Europe/Berlim", "Europe", "../etc/localtime", "/etc/localtime", "CEST+2"])
def test_a_zone_that_does_not_exist_is_refused_with_two_that_do(tmp_path: Path, zone: str) -> None:
    found = findings(tmp_path, GENERIC, ("name: A building\n", f"name: A building\ntimezone: {zone}\n"))
    assert said(3, "timezone", repr(zone), "Europe/Berlin", "Asia/Singapore").fits(found[0])
    assert len(found) == 1
