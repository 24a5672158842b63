"""For how long, and to whom, the packet filter gives permission: over sets that write down what they are given, on a clock of the test."""

from collections.abc import Callable, Sequence

import pytest

from lift_manager.cluster.errors import FilterFailed
from lift_manager.cluster.filter_helper import SLACK_S, Filter
from lift_manager.cluster.filter_messages import (
    BadMessage,
    PermissionAnswer,
    PermissionRequest,
    controller_names,
    decode_answer,
    decode_request,
    encode,
)
from lift_manager.cluster.term import TERM_S
from tests.support.rows import each_row

CONTROLLERS = [("10.0.0.5", 502), ("fd00::5", 502)]
NAMES = ("10.0.0.5:502", "[fd00::5]:502")
USER = 990
SETS = ("connections4", "connections6")
MS = 1000
SLACK_MS = int(SLACK_S * MS)


class World:
    """A filter, and its sets in a kernel in which time passes only where a test lets it."""

    def __init__(self) -> None:
        self.now = 100.0
        self.changes: list[tuple[int, tuple[str, ...]] | None] = []
        """For how many milliseconds, and which connections were forgotten; None for a withdrawal."""
        self.apply: Callable[[], None] = lambda: None
        """What happens while the kernel applies a change."""
        self.are_rules_there = self.can_load = True
        self.filter = Filter(CONTROLLERS, USER, self, self.load, clock=lambda: self.now)

    def permit(self, user: int, ms: int, forget: Sequence[str] = ()) -> None:
        assert user == USER
        if not self.are_rules_there:
            raise FilterFailed("there is no such table")
        self.changes.append((ms, tuple(forget)))
        self.apply()

    def load(self) -> None:
        if not self.can_load:
            raise FilterFailed("nft is not there")
        self.are_rules_there = True

    def withdraw(self) -> None:
        self.changes.append(None)

    def request(
        self, remaining_s: float, *, epoch: int = 7, holder: object = "a", names: tuple[str, ...] = NAMES
    ) -> PermissionAnswer:
        return self.filter.request(holder, PermissionRequest(epoch, self.now + remaining_s, names))

    def pass_time(self, s: float) -> None:
        self.now += s


@each_row(
    ("remaining_s", "ms"),
    [
        (1.5, 1500),
        (0.75, 750),
        (TERM_S, int(TERM_S * MS)),
        (3600.0, int(TERM_S * MS)),
        (float("inf"), int(TERM_S * MS)),
    ],
)
def test_permission_ends_a_little_before_the_term_and_never_lasts_longer_than_one(remaining_s: float, ms: int) -> None:
    world = World()
    assert world.request(remaining_s) == PermissionAnswer()
    assert world.changes == [(ms - SLACK_MS, SETS)]


@each_row("remaining_s", [0.0, -3600.0, float("-inf"), SLACK_S])
def test_a_term_that_is_over_permits_nobody(remaining_s: float) -> None:
    world = World()
    world.request(1.5)
    assert world.request(remaining_s).refused == "the term was over when it was to be permitted"
    assert world.changes[-1] is None


def test_a_manager_that_requests_it_too_late_takes_nothing_from_another_one() -> None:
    world = World()
    world.request(1.5, holder="b", epoch=8)
    assert world.request(-1.0, holder="a").refused
    assert len(world.changes) == 1


def test_connections_of_an_earlier_term_are_forgotten_with_the_first_permission_of_the_next() -> None:
    world = World()
    for epoch in (7, 7, 8, 8, 7):
        world.request(1.5, epoch=epoch)
    assert [change and change[1] for change in world.changes] == [SETS, (), SETS, (), SETS]


def test_a_permission_that_was_applied_late_is_applied_again_and_shorter() -> None:
    world = World()
    delays = iter([0.5, 0.25, 0.0])
    world.apply = lambda: world.pass_time(next(delays))
    assert world.request(1.0) == PermissionAnswer()
    assert [change and change[0] for change in world.changes] == [980, 480, 230]
    assert [change and change[1] for change in world.changes] == [SETS, (), ()]


def test_one_that_was_applied_after_the_term_is_withdrawn() -> None:
    world = World()
    world.apply = lambda: world.pass_time(5.0)
    assert world.request(1.0).refused
    assert world.changes == [(980, SETS), None]


def test_rules_that_somebody_has_removed_are_loaded_again() -> None:
    world = World()
    world.request(1.5)
    world.are_rules_there = False
    assert world.request(1.5) == PermissionAnswer()
    assert len(world.changes) == 2
    world.are_rules_there = world.can_load = False
    with pytest.raises(FilterFailed, match="nft is not there"):
        world.request(1.5)


def test_a_manager_of_another_site_file_is_refused() -> None:
    world = World()
    refused = world.request(1.5, names=("10.0.0.5:502", "10.0.0.6:502")).refused
    assert (
        refused
        == "it filters 10.0.0.5:502, [fd00::5]:502, and the manager has 10.0.0.5:502, 10.0.0.6:502; restart it if the site file has changed"
    )
    assert world.changes == []


def test_what_was_permitted_to_a_manager_ends_with_its_connection_unless_another_one_was_permitted_since() -> None:
    world = World()
    world.request(1.5, holder="a")
    world.request(1.5, holder="b", epoch=8)
    world.filter.end("a")
    assert None not in world.changes
    world.filter.end("b")
    assert world.changes[-1] is None


def test_controllers_are_named_alike_however_an_address_is_written() -> None:
    assert controller_names([("FD00:0::5", 502), ("10.0.0.5", 502), ("fd00::5", 502)]) == NAMES


def test_messages_come_back_as_they_were() -> None:
    request = PermissionRequest(7, 1234.5, NAMES)
    assert decode_request(encode(request)) == request
    assert decode_answer(encode(PermissionAnswer("no"))) == PermissionAnswer("no")


@each_row("line", [b"", b"no json\n", b"[]\n", b'{"epoch": 7}\n', b'{"refused": 1}\n', b"\xff\n"])
def test_a_line_of_another_program_is_no_message(line: bytes) -> None:
    for decode in (decode_request, decode_answer):
        with pytest.raises(BadMessage):
            decode(line)
