"""Frames against the worked examples of the specification, typed by hand, and the rules that hold for all of them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from register_maps import frames
from register_maps.errors import BadRequest, ExceptionAnswer, FrameError, Mismatch, RegisterMapError
from register_maps.frames import Request
from register_maps.words import Table
from tests.support.rows import each_row

# Modbus Application Protocol V1.1b3, sections 6.1 to 6.6, 6.11, 6.12 and 6.16: request PDU and answer PDU as printed there.
EXAMPLES = {
    "read coils 20 to 38": (
        frames.read(Table.COIL, 19, 19, unit=17),
        "01 00 13 00 13",
        "01 03 CD 6B 05",
    ),
    "read discrete inputs 197 to 218": (
        frames.read(Table.DISCRETE, 196, 22, unit=17),
        "02 00 C4 00 16",
        "02 03 AC DB 35",
    ),
    "read registers 108 to 110": (
        frames.read(Table.HOLDING, 107, 3, unit=17),
        "03 00 6B 00 03",
        "03 06 02 2B 00 00 00 64",
    ),
    "read input register 9": (
        frames.read(Table.INPUT, 8, 1, unit=17),
        "04 00 08 00 01",
        "04 02 00 0A",
    ),
    "write coil 173 on": (
        frames.write_coil(172, True, unit=17),
        "05 00 AC FF 00",
        "05 00 AC FF 00",
    ),
    "write register 2": (
        frames.write_register(1, 3, unit=17),
        "06 00 01 00 03",
        "06 00 01 00 03",
    ),
    "write coils 20 to 29": (
        frames.write_coils(19, [bit == "1" for bit in "1011001110"], unit=17),
        "0F 00 13 00 0A 02 CD 01",
        "0F 00 13 00 0A",
    ),
    "write registers 2 and 3": (
        frames.write_registers(1, [0x000A, 0x0102], unit=17),
        "10 00 01 00 02 04 00 0A 01 02",
        "10 00 01 00 02",
    ),
    "mask write register 5": (
        frames.mask_write(4, 0x00F2, 0x0025, unit=17),
        "16 00 04 00 F2 00 25",
        "16 00 04 00 F2 00 25",
    ),
}
examples = each_row(("request_", "asked", "answered"), EXAMPLES.values())


def adu(pdu: str, *, tid: int = 0x1501, unit: int = 17) -> bytes:
    data = bytes.fromhex(pdu)
    return tid.to_bytes(2, "big") + bytes(2) + (1 + len(data)).to_bytes(2, "big") + bytes([unit]) + data


@examples
def test_a_request_is_framed_as_the_specification_prints_it(request_: Request, asked: str, answered: str) -> None:
    assert frames.frame(request_, 0x1501) == adu(asked)


@examples
def test_the_printed_answer_passes_the_check(request_: Request, asked: str, answered: str) -> None:
    payload = bytes.fromhex(answered)[2:] if not request_.is_write else b""
    assert frames.check(request_, adu(answered)) == payload
    assert frames.check(request_, adu(answered), tid=0x1501) == payload


@examples
def test_the_printed_request_is_read_back_as_the_same_request(request_: Request, asked: str, answered: str) -> None:
    assert frames.parse_request(adu(asked)) == request_


@examples
def test_the_printed_answer_is_built_from_its_payload(request_: Request, asked: str, answered: str) -> None:
    payload = bytes.fromhex(answered)[2:] if not request_.is_write else b""
    assert frames.answer(request_, 0x1501, payload) == adu(answered)


def test_the_whole_frame_of_the_messaging_guide_is_built_byte_for_byte() -> None:
    # Messaging on TCP/IP guide V1.0b, 4.4.2.1: read one register at 4, transaction id 15 01, unit FF.
    request = frames.read(Table.HOLDING, 4, 1, unit=0xFF)
    assert frames.frame(request, 0x1501) == bytes.fromhex("15 01 00 00 00 06 FF 03 00 04 00 01")
    assert frames.check(request, bytes.fromhex("15 01 00 00 00 05 FF 03 02 00 05"), tid=0x1501) == b"\x00\x05"


def test_bits_are_unpacked_lowest_first() -> None:
    # V1.1b3, 6.1: coils 27 to 20 are CD, 1100 1101; 38 to 36 are the low bits of 05.
    bits = frames.unpack_bits(bytes.fromhex("CD 6B 05"), 19)
    assert bits == (1, 0, 1, 1, 0, 0, 1, 1, 1, 1, 0, 1, 0, 1, 1, 0, 1, 0, 1)
    assert frames.pack_bits(bits) == bytes.fromhex("CD 6B 05")


def test_an_exception_answer_is_told_with_the_name_of_its_code() -> None:
    # V1.1b3, section 7: a read of a coil at 04A1 that does not exist.
    request = frames.read(Table.COIL, 0x04A1, 1)
    with pytest.raises(ExceptionAnswer, match=r"exception 02 \(illegal data address\)") as caught:
        frames.check(request, adu("81 02", unit=1))
    assert (caught.value.function, caught.value.code) == (1, 2)


def test_an_exception_code_outside_the_specification_is_still_an_exception_answer() -> None:
    with pytest.raises(ExceptionAnswer, match="exception 7F"):
        frames.check(frames.read(Table.HOLDING, 0), adu("83 7F", unit=1))


@each_row(
    ("request_", "answer", "what"),
    [
        (frames.read(Table.HOLDING, 0, 4), adu("03 02 00 07", unit=1), "fewer registers than asked for"),
        (frames.read(Table.HOLDING, 0, 1), adu("03 04 00 07 00 08", unit=1), "more registers than asked for"),
        (frames.read(Table.HOLDING, 0, 1), adu("04 02 00 07", unit=1), "another function"),
        (frames.read(Table.HOLDING, 0, 1), adu("84 02", unit=1), "an exception to another function"),
        (frames.read(Table.HOLDING, 0, 1), adu("03 02 00 07", unit=255), "another unit"),
        (frames.read(Table.HOLDING, 0, 1, unit=255), adu("03 02 00 07", unit=0), "unit 0 when asked 255"),
        (frames.read(Table.HOLDING, 0, 1), adu("83 02", unit=2), "an exception of another unit"),
        (frames.read(Table.HOLDING, 0, 1), adu("03 01 00 07", unit=1), "a byte count that lies"),
        (frames.read(Table.HOLDING, 0, 1), adu("03", unit=1), "nothing but the function"),
        (frames.read(Table.COIL, 0, 9), adu("01 01 FF", unit=1), "fewer bits than asked for"),
        (frames.write_register(3, 1), adu("06 00 09 00 01", unit=1), "the echo of another address"),
        (frames.write_register(3, 1), adu("06 00 03 00 09", unit=1), "the echo of another value"),
        (frames.write_coil(3, True), adu("05 00 03 00 00", unit=1), "the echo of the opposite"),
        (frames.write_registers(3, [1, 2]), adu("10 00 04 00 02", unit=1), "another start"),
        (frames.write_registers(3, [1, 2]), adu("10 00 03 00 01", unit=1), "another count"),
        (frames.write_coils(3, [True]), adu("0F 00 03 00 02", unit=1), "another count of coils"),
    ],
)
def test_an_answer_that_does_not_fit_is_refused(request_: Request, answer: bytes, what: str) -> None:
    with pytest.raises(Mismatch, match=r"expected .*, received "):
        frames.check(request_, answer)


def test_a_wrong_transaction_id_is_refused_only_where_one_is_expected() -> None:
    request = frames.read(Table.HOLDING, 0)
    answer = adu("03 02 00 07", unit=1, tid=8)
    assert frames.check(request, answer) == b"\x00\x07"
    with pytest.raises(Mismatch, match="expected transaction id 7, received 8"):
        frames.check(request, answer, tid=7)


def test_a_mismatch_says_what_was_asked_in_plain_words() -> None:
    with pytest.raises(Mismatch, match="read 4 holding registers from 0, unit 1: expected unit 1, received unit 2"):
        frames.check(frames.read(Table.HOLDING, 0, 4), adu("03 02 00 07", unit=2))


@each_row(
    ("table", "most"),
    [(Table.COIL, 2000), (Table.DISCRETE, 2000), (Table.HOLDING, 125), (Table.INPUT, 125)],
)
def test_a_read_of_more_than_the_specification_allows_is_refused(table: Table, most: int) -> None:
    assert frames.read(table, 0, most).count == most
    assert frames.read(table, 65536 - most, most).address == 65536 - most
    for address, count, unit in [(0, most + 1, 1), (0, 0, 1), (65537 - most, most, 1), (-1, 1, 1), (0, 1, 256)]:
        with pytest.raises(BadRequest):
            frames.read(table, address, count, unit)


def test_a_write_of_more_than_the_specification_allows_is_refused() -> None:
    assert frames.write_registers(0, [0] * 123).count == 123
    assert frames.write_coils(0, [False] * 1968).count == 1968
    assert len(frames.frame(frames.write_registers(0, [0] * 123), 1)) <= frames.MAX_FRAME
    with pytest.raises(BadRequest, match="count 124"):
        frames.write_registers(0, [0] * 124)
    with pytest.raises(BadRequest, match="count 1969"):
        frames.write_coils(0, [False] * 1969)
    with pytest.raises(BadRequest, match="count 0"):
        frames.write_registers(0, [])
    with pytest.raises(BadRequest, match="value 65536"):
        frames.write_register(0, 65536)
    with pytest.raises(BadRequest, match="value -1"):
        frames.write_registers(0, [-1])
    with pytest.raises(BadRequest, match="not within 0 to 65535") as caught:
        frames.write_registers(65535, [1, 2])
    assert caught.value.code == 2


def test_frame_errors_belong_to_the_package() -> None:
    assert issubclass(FrameError, RegisterMapError)
    assert {BadRequest, Mismatch, ExceptionAnswer} <= set(FrameError.__subclasses__())


any_request = st.one_of(
    st.builds(frames.read, st.sampled_from(Table), st.integers(0, 60000), st.integers(1, 125), st.integers(0, 255)),
    st.builds(frames.write_coil, st.integers(0, 65535), st.booleans(), st.integers(0, 255)),
    st.builds(frames.write_register, st.integers(0, 65535), st.integers(0, 65535), st.integers(0, 255)),
    st.builds(frames.write_coils, st.integers(0, 60000), st.lists(st.booleans(), min_size=1, max_size=1968)),
    st.builds(frames.write_registers, st.integers(0, 60000), st.lists(st.integers(0, 65535), min_size=1, max_size=123)),
)


@given(any_request, st.integers(1, 65535))
def test_every_request_survives_the_way_to_the_device(request_: Request, tid: int) -> None:
    sent = frames.frame(request_, tid)
    assert len(sent) <= frames.MAX_FRAME
    assert frames.tid_of(sent) == tid
    assert frames.parse_request(sent) == request_
    assert frames.describe(sent) == str(request_)


@given(any_request, st.integers(1, 65535), st.randoms(use_true_random=False))
def test_one_flipped_bit_in_the_head_of_an_answer_never_passes(request_: Request, tid: int, random: object) -> None:
    assert hasattr(random, "randrange")
    payload = bytes(request_.answer_length - 2 - len(request_.answer_head))
    right = frames.answer(request_, tid, payload)
    place = random.randrange((2 + len(request_.answer_head)) * 8)
    wrong = bytearray(right)
    wrong[place // 8] ^= 1 << place % 8
    with pytest.raises((Mismatch, ExceptionAnswer)):
        frames.check(request_, bytes(wrong), tid=tid)


@given(st.lists(any_request, max_size=5), st.lists(st.integers(1, 600), max_size=20))
def test_a_stream_cut_anywhere_gives_the_same_frames(requests: list[Request], cuts: list[int]) -> None:
    whole = [frames.frame(request, tid) for tid, request in enumerate(requests, start=1)]
    stream = b"".join(whole)
    found: list[bytes] = []
    rest = b""
    while stream:
        size = cuts.pop() if cuts else len(stream)
        piece, stream = stream[:size], stream[size:]
        taken, rest = frames.split(rest + piece)
        found += taken
    assert found == whole
    assert rest == b""


@each_row(
    "garbage",
    ["00 01 00 01 00 06", "00 01 00 00 00 01", "00 01 00 00 00 FF", "00 01 00 00 01 00", "48 54 54 50 2F 31"],
)
def test_a_stream_that_cannot_be_modbus_is_refused_as_soon_as_its_header_is_there(garbage: str) -> None:
    good = adu("03 02 00 07")
    with pytest.raises(FrameError):
        frames.split(good + bytes.fromhex(garbage))
    assert frames.split(good + bytes.fromhex(garbage)[:5]) == ([good], bytes.fromhex(garbage)[:5])


@each_row(
    ("pdu", "code"),
    [
        ("2B 0E 01 00", 1),
        ("00", 1),
        ("03 00", 3),
        ("03 00 00 00 00", 3),
        ("03 00 00 00 7E", 3),
        ("03 FF FF 00 02", 2),
        ("03 00 00 00 01 00", 3),
        ("05 00 00 12 34", 3),
        ("0F 00 00 00 09 01 FF", 3),
        ("10 00 00 00 02 04 00 01", 3),
        ("10 00 00 00 00 00", 3),
        ("10 00 00 00 01", 3),
    ],
)
def test_a_bad_request_says_which_exception_a_device_answers(pdu: str, code: int) -> None:
    with pytest.raises(BadRequest) as caught:
        frames.parse_request(adu(pdu))
    assert caught.value.code == code
    assert frames.exception_answer(adu(pdu), code)[7:] == bytes([int(pdu[:2], 16) | 0x80, code])


def test_half_a_frame_is_no_request() -> None:
    with pytest.raises(FrameError, match="not one whole frame"):
        frames.parse_request(adu("03 00 00 00 01")[:-1])


def test_an_answer_of_the_wrong_size_is_not_built() -> None:
    with pytest.raises(FrameError, match="1 bytes of payload"):
        frames.answer(frames.read(Table.HOLDING, 0, 1), 1, b"\x00")


@each_row(
    ("request_", "words"),
    [
        (frames.read(Table.HOLDING, 0, 20), "read 20 holding registers from 0, unit 1"),
        (frames.read(Table.DISCRETE, 7, 1, 255), "read 1 discrete input from 7, unit 255"),
        (frames.write_coil(8, True), "write coil 8 := on, unit 1"),
        (frames.write_register(40, 3), "write holding register 40 := 3, unit 1"),
        (frames.write_coils(8, [True, False]), "write 2 coils from 8 := on off, unit 1"),
        (frames.write_registers(8, [1, 2]), "write 2 holding registers from 8 := 1 2, unit 1"),
    ],
)
def test_a_request_is_put_into_plain_words(request_: Request, words: str) -> None:
    assert frames.describe(frames.frame(request_, 9)) == words


@each_row(
    ("pdu", "words"),
    [
        ("03 04 00 01 00 02", "4 bytes of holding registers: 00 01 00 02, unit 17"),
        ("06 00 28 00 03", "holding register 40 written := 3, unit 17"),
        ("10 00 08 00 02", "2 holding registers written from 8, unit 17"),
        ("83 06", "function 3 answered with exception 06 (server device busy), unit 17"),
        ("03 04 00 01", "not an answer: 15 01 00 00 00 05 11 03 04 00 01"),
    ],
)
def test_an_answer_is_put_into_plain_words(pdu: str, words: str) -> None:
    assert frames.describe_answer(adu(pdu)) == words


@given(st.binary(max_size=40))
def test_putting_bytes_into_words_never_fails(data: bytes) -> None:
    assert frames.describe(data)
    assert frames.describe_answer(data)


# The relay module's own example: relay 1 on for 700 ms, in counts of 100 ms (elevator-interfaces 2, Waveshare).
TIMED = "05 02 00 00 07"


def test_a_coil_is_set_for_a_time_that_the_module_keeps() -> None:
    request = frames.pulse_coil(0x200, 7, unit=17)
    assert frames.frame(request, 0x1501) == adu(TIMED)
    assert frames.check(request, adu(TIMED)) == b""
    assert frames.parse_request(adu(TIMED), timed_coils=True) == request
    assert str(request) == "write coil 512 := on for 7 counts, unit 17"


def test_a_device_that_times_no_coils_refuses_a_duration() -> None:
    with pytest.raises(BadRequest, match="coil value 0007") as caught:
        frames.parse_request(adu(TIMED))
    assert caught.value.code == 3


@each_row("duration", [0, 0x8000, -1])
def test_a_duration_that_a_module_would_take_for_something_else_is_refused(duration: int) -> None:
    with pytest.raises(BadRequest, match="duration"):
        frames.pulse_coil(0, duration)


def test_on_and_off_are_no_durations() -> None:
    for word, value in (("FF 00", 1), ("00 00", 0)):
        request = frames.parse_request(adu(f"05 00 01 {word}"), timed_coils=True)
        assert (request.values, request.duration) == ((value,), None)


def test_a_mask_write_says_which_bits_it_keeps_and_sets() -> None:
    assert str(frames.mask_write(4, 0xFFFE, 1)) == "write holding register 4 := itself AND FFFE OR 0001, unit 1"
    with pytest.raises(BadRequest, match="5 bytes of data"):
        frames.parse_request(adu("16 00 04 00 F2 00"))
