"""The parser of event streams, whatever the pieces are that it gets."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lift_manager.plain.sse import EventParser, Message, TooLong
from tests.support.rows import each_row

LINES = st.sampled_from(
    [
        "data: one",
        "data:two",
        "data",
        "data:  two blanks",
        'data: {"text": "a\u2028b\u0085c\x0bd"}',
        "id: a-7",
        "id",
        "id: null\0",
        "event: state",
        ": a comment",
        "retry: 5000",
        "unknown: field",
        "data: Güter \U0001f6d7",
        "",
        "",
    ]
)
ENDS = st.sampled_from(["\n", "\r", "\r\n"])


def whole(stream: bytes) -> list[Message]:
    return EventParser().feed(stream)


@given(st.lists(st.tuples(LINES, ENDS), max_size=20), st.data())
def test_the_same_events_come_out_wherever_the_bytes_are_cut(lines: list[tuple[str, str]], data: st.DataObject) -> None:
    stream = "".join(line + end for line, end in lines).encode()
    cuts = sorted(data.draw(st.sets(st.integers(0, len(stream)), max_size=12)))
    pieces = [stream[start:end] for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True)]
    parser = EventParser()
    found = [message for piece in pieces for message in parser.feed(piece)]
    assert found == whole(stream)


@given(st.lists(LINES, max_size=12))
def test_each_of_the_three_line_ends_means_the_same(lines: list[str]) -> None:
    unix, mac, dos = (whole("".join(line + end for line in lines).encode()) for end in ("\n", "\r", "\r\n"))
    assert unix == mac == dos


@each_row(
    ("stream", "found"),
    [
        ("data: one\ndata: two\n\n", [Message("message", "one\ntwo", "")]),
        ("\ufeffdata: one\n\n", [Message("message", "one", "")]),
        ("data\n\n", [Message("message", "", "")]),
        (
            "event: state\nid: a-1\ndata: x\n\ndata: y\n\n",
            [Message("state", "x", "a-1"), Message("message", "y", "a-1")],
        ),
        ("id: a-1\n\ndata: x\n\n", [Message("message", "x", "a-1")]),
        ("id: a-1\ndata: x\n\nid\ndata: y\n\n", [Message("message", "x", "a-1"), Message("message", "y", "")]),
        ("event: state\n\ndata: x\n\n", [Message("message", "x", "")]),
        (": nothing\n\n", []),
        ("data: not whole\n", []),
        ("data: a\u2028b\n\n", [Message("message", "a\u2028b", "")]),
    ],
)
def test_the_rules_of_the_specification_hold(stream: str, found: list[Message]) -> None:
    assert whole(stream.encode()) == found


@pytest.mark.parametrize("endless", [b"data: " + b"x" * 10, b"data: xxx\n", b": comment " + b"x" * 10])
def test_an_event_without_end_is_refused(endless: bytes) -> None:
    parser = EventParser(limit=100)

    def feed_on() -> None:
        for _ in range(200):
            parser.feed(endless)

    with pytest.raises(TooLong, match="more than 100 characters"):
        feed_on()
