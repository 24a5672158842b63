"""Device identification against the example of the specification (V1.1b3, 6.21), typed by hand, and what devices make of it."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from register_maps import identification
from register_maps.errors import ExceptionAnswer, FrameError, Mismatch
from register_maps.identification import BASIC, REGULAR, parse_answer, request_body, texts
from tests.support.rows import each_row


def adu(pdu: bytes, unit: int = 1) -> bytes:
    return bytes((0, 7, 0, 0, 0, 1 + len(pdu), unit)) + pdu


COMPANY = b"\x00\x16Company identification"
PRODUCT = b"\x01\x0fProduct code XX"
REVISION = b"\x02\x05V2.11"


def test_a_request_is_that_of_the_specification() -> None:
    assert request_body(1, BASIC, 0) == bytes.fromhex("0000 0005 01 2B 0E 01 00")
    assert request_body(17, REGULAR, 3) == bytes.fromhex("0000 0005 11 2B 0E 02 03")


def test_the_objects_of_one_answer_are_read() -> None:
    page = parse_answer(1, BASIC, adu(bytes.fromhex("2B 0E 01 01 00 00 03") + COMPANY + PRODUCT + REVISION))
    assert page.objects == {0: b"Company identification", 1: b"Product code XX", 2: b"V2.11"}
    assert (page.has_regular, page.next_object) == (False, None)
    assert texts(page.objects) == {
        "vendor": "Company identification",
        "product_code": "Product code XX",
        "revision": "V2.11",
    }


def test_an_answer_in_parts_says_where_the_next_one_begins() -> None:
    page = parse_answer(1, BASIC, adu(bytes.fromhex("2B 0E 01 82 FF 02 02") + COMPANY + PRODUCT))
    assert (len(page.objects), page.has_regular, page.next_object) == (2, True, 2)


def test_a_device_without_an_identity_answers_with_an_exception() -> None:
    with pytest.raises(ExceptionAnswer) as refusal:
        parse_answer(1, BASIC, bytes.fromhex("0007 0000 0003 01 AB 01"))
    assert (refusal.value.function, refusal.value.code) == (0x2B, 1)


@each_row(
    ("pdu", "unit"),
    [
        ("2B 0E 01 01 00 00 03 00 16 43", 1),  # cut short within an object
        ("2B 0E 01 01 00 00 02 00 01 43 01", 1),  # and within the head of one
        ("2B 0E 01 01", 1),
        ("2B 0E 02 01 00 00 00", 1),  # another category
        ("2B 0D 01 01 00 00 00", 1),
        ("03 02 00 00", 1),
        ("2B 0E 01 01 00 00 00", 2),
    ],
)
def test_an_answer_that_does_not_fit_is_refused(pdu: str, unit: int) -> None:
    with pytest.raises(Mismatch):
        parse_answer(1, BASIC, adu(bytes.fromhex(pdu), unit))


@given(st.binary(max_size=252))
def test_bytes_of_any_kind_are_read_or_refused(pdu: bytes) -> None:
    try:
        page = parse_answer(1, BASIC, adu(b"\x2b" + pdu))
    except FrameError:
        return
    for text in texts(page.objects).values():
        assert text.isprintable()


def test_texts_are_for_people() -> None:
    objects = {6: b"lift 3\0\0", 2: b" V1\x1b[2J ", 1: b"\0\0", 0: b"Schei\xdfler", 0x80: b"private"}
    assert texts(objects) == {"vendor": "Schei?ler", "revision": "V1?[2J", "application": "lift 3"}
    assert len(identification.OBJECTS) == 7
