"""The tree of driver errors, and what each says about the wire."""

import re

import pytest

import drivers.errors
from drivers.errors import ControllerException, Delivery, DriverError, LinkDown, UnitOffline


def tree(root: type[Exception], depth: int = 0) -> list[tuple[int, str]]:
    found = [(depth, root.__name__)]
    for each in (each for each in root.__subclasses__() if each.__module__ == drivers.errors.__name__):
        found += tree(each, depth + 1)
    return found


def test_the_docstring_shows_the_tree_as_it_is() -> None:
    shown = re.findall(r"^( *)(\w+)(?:$| {2,})", drivers.errors.__doc__ or "", re.MULTILINE)
    assert [(len(indent) // 4, name) for indent, name in shown] == tree(DriverError)


@pytest.mark.parametrize(("code", "sent"), [(1, Delivery.YES), (4, Delivery.YES), (5, Delivery.YES), (6, Delivery.NO)])
def test_a_controllers_exception_says_whether_it_may_have_been_carried_out(code: int, sent: Delivery) -> None:
    assert ControllerException("lobby", "write coil 9 := on, unit 1", code).sent is sent


def test_a_silent_unit_behind_a_gateway_may_have_heard_us() -> None:
    assert UnitOffline("lobby", "write coil 9 := on, unit 1", 0x0A).sent is Delivery.NO
    assert UnitOffline("lobby", "write coil 9 := on, unit 1", 0x0B).sent is Delivery.UNKNOWN


def test_a_message_names_the_link_the_time_and_the_reason() -> None:
    error = LinkDown("lobby", "connection refused", 3.24)
    assert str(error) == "lobby: no connection for 3.2 s: connection refused"
    assert (error.sent, error.reason, error.down_for_s) == (Delivery.NO, "connection refused", 3.24)
