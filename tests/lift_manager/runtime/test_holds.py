"""Which holds the driver is to have on, and which of their beginnings are written down first."""

from collections.abc import Mapping

from drivers.model import Command, CommandKind, OutputState
from lift_manager.lift.outputs import Hold
from lift_manager.runtime.hold_beginnings import Holds
from register_maps.words import Side

DOOR = Command(CommandKind.HOLD_DOOR, side=Side.FRONT)
MODE = Command(CommandKind.ROBOT_MODE)
NAME = DOOR.name
GO1, GO2 = Command(CommandKind.GO_TO, "L1"), Command(CommandKind.GO_TO, "L2")


class Desk:
    """Holds whose beginnings are committed by hand."""

    def __init__(self) -> None:
        self.holds = Holds()
        self.commit = 0

    def wants(self, *commands: Command, until: float = 30.0, begin: bool = True, pressed: str = "") -> list[str]:
        """Want these on; returns what is written down."""
        wanted = {command: Hold(begin, until) for command in commands}
        beginnings = self.holds.update(wanted, {pressed} - {""}, may_begin=True)
        self.commit += 1
        self.holds.handed_over(self.commit)
        return [f"{one.command}{' again' if one.again else ''}" for one in beginnings]

    def state(self, state: OutputState, name: str = NAME) -> None:
        self.holds.states[name] = state

    def written(self) -> None:
        """Everything that waits is on the disk."""
        self.holds.committed(self.commit)

    @property
    def declared(self) -> Mapping[str, tuple[int, float]]:
        return {str(command): (hold.begin, hold.until) for command, hold in self.holds.declared.items()}

    def on(self) -> None:
        """Have the door held."""
        self.wants(DOOR)
        self.written()
        self.wants(DOOR)
        self.holds.put_on(NAME)
        self.state(OutputState.HELD)


def test_a_beginning_is_declared_once_it_is_written_down_and_until_the_newest_time() -> None:
    desk = Desk()
    assert desk.wants(DOOR, until=30.0) == [NAME]
    assert desk.declared == {}
    assert desk.holds.shown(()) == {NAME: OutputState.REQUESTED}
    assert desk.wants(DOOR, until=31.0) == []
    desk.written()
    assert desk.wants(DOOR, until=32.0) == []
    assert desk.declared == {NAME: (1, 32.0)}


def test_a_later_commit_covers_the_ones_before_it() -> None:
    desk = Desk()
    desk.wants(DOOR)
    desk.wants(DOOR, MODE)
    desk.written()
    desk.wants(DOOR, MODE)
    assert desk.declared == {NAME: (1, 30.0), MODE.name: (2, 30.0)}


def test_what_waits_is_not_put_on_once_it_is_only_kept_or_wanted_no_more() -> None:
    for wanted in ((DOOR,), ()):
        desk = Desk()
        desk.wants(DOOR)
        desk.wants(*wanted, begin=False)
        desk.written()
        desk.wants(*wanted, begin=False)
        assert desk.declared == dict.fromkeys(map(str, wanted), (0, 30.0))


def test_a_commit_that_failed_is_asked_for_again() -> None:
    desk = Desk()
    desk.wants(DOOR)
    assert desk.holds.not_committed(desk.commit) == (NAME,)
    assert desk.wants(DOOR) == [NAME]


def test_nothing_begins_while_nothing_can_be_written_down_and_what_is_on_stays() -> None:
    desk = Desk()
    desk.on()
    wanted = {DOOR: Hold(True, 40.0), MODE: Hold(True, 40.0)}
    assert desk.holds.update(wanted, (), may_begin=False) == ()
    assert desk.declared == {NAME: (1, 40.0)}


def test_a_renewal_needs_no_row_and_a_hold_that_was_released_does() -> None:
    desk = Desk()
    desk.on()
    assert desk.wants(DOOR, until=31.0) == []
    assert desk.declared == {NAME: (1, 31.0)}
    desk.wants()
    assert desk.declared == {}
    desk.state(OutputState.AT_REST)
    assert desk.wants(DOOR) == [NAME]


def test_a_hold_that_was_found_off_is_written_down_again_and_has_a_higher_number() -> None:
    desk = Desk()
    desk.on()
    desk.state(OutputState.LOST)
    assert desk.holds.shown(())[NAME] is OutputState.REQUESTED
    assert desk.wants(DOOR) == [f"{NAME} again"]
    assert desk.declared == {NAME: (1, 30.0)}
    desk.written()
    desk.wants(DOOR)
    assert desk.declared == {NAME: (2, 30.0)}


def test_a_hold_that_could_not_leave_needs_no_second_row() -> None:
    desk = Desk()
    desk.wants(DOOR)
    desk.written()
    desk.wants(DOOR)
    desk.state(OutputState.AT_REST)
    assert desk.wants(DOOR) == []
    assert desk.declared == {NAME: (2, 30.0)}
    # one that was sent was put on, whatever the controller answered
    desk.holds.put_on(NAME)
    assert desk.wants(DOOR) == [NAME]


def test_a_hold_that_is_only_kept_is_declared_without_a_beginning_and_goes_on_under_its_number() -> None:
    desk = Desk()
    desk.on()
    desk.wants(DOOR, begin=False)
    assert desk.declared == {NAME: (0, 30.0)}
    assert desk.wants(DOOR) == []
    assert desk.declared == {NAME: (1, 30.0)}


def test_a_hold_that_was_lost_while_it_was_only_kept_begins_again_with_a_row() -> None:
    desk = Desk()
    desk.on()
    desk.wants(DOOR, begin=False)
    desk.state(OutputState.AT_REST)
    assert desk.wants(DOOR) == [NAME]


def test_a_hold_that_a_restart_found_on_stays_on_while_it_is_written_down_for_its_holder() -> None:
    desk = Desk()
    desk.wants(DOOR, begin=False)
    desk.state(OutputState.HELD)
    assert desk.wants(DOOR) == [NAME]
    assert desk.declared == {NAME: (0, 30.0)}
    assert desk.holds.shown(()) == {NAME: OutputState.HELD}
    desk.written()
    desk.wants(DOOR)
    assert desk.declared == {NAME: (1, 30.0)}


def test_a_press_that_waits_keeps_what_is_on_for_the_same_command_and_releases_what_is_on_for_another() -> None:
    desk = Desk()
    desk.wants(GO1, begin=False)
    desk.state(OutputState.HELD, "go_to")
    desk.wants(GO1, begin=False, until=60.0, pressed="go_to")
    assert desk.declared == {"go_to L1": (0, 30.0)}
    assert desk.holds.shown({"go_to"})["go_to"] is OutputState.REQUESTED
    desk.wants(GO2, begin=False, pressed="go_to")
    assert desk.declared == {}
