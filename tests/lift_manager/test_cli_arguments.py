"""What people write on the command line, and what it is read as."""

from lift_manager.cli.common import controller_address, duration_s
from tests.support.rows import each_row


@each_row(
    "text, address",
    [
        ("plc", ("plc", 502)),
        ("192.0.2.10:1502", ("192.0.2.10", 1502)),
        ("[2001:db8::1]", ("2001:db8::1", 502)),
        ("[2001:db8::1]:65535", ("2001:db8::1", 65535)),
        ("", None),
        ("plc:0", None),
        ("plc:65536", None),
        ("plc:x", None),
        ("2001:db8::1", None),
        ("[2001:db8::1", None),
        ("a b", None),
        ("a/b", None),
    ],
)
def test_a_controller_is_a_host_with_or_without_a_port(text: str, address: tuple[str, int] | None) -> None:
    assert controller_address(text) == address


@each_row(
    "text, seconds",
    [("90s", 90.0), ("10m", 600.0), ("1.5 m", 90.0), ("10", None), ("1h", None), ("-5s", None), ("5 minutes", None)],
)
def test_a_time_has_a_number_and_one_of_the_units_that_it_may_have(text: str, seconds: float | None) -> None:
    assert duration_s(text, ("s", "m")) == seconds


def test_a_number_alone_is_seconds_only_where_that_is_allowed() -> None:
    assert duration_s("30", ("", "s")) == 30.0
