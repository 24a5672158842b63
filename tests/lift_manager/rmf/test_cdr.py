"""The bytes of the messages, against bytes typed by hand and against another encoder (open-rmf 1.1, 5.2, 5.3)."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lift_manager.rmf import messages
from lift_manager.rmf.dds_types import (
    TYPE_HASHES,
    WireBool,
    WireClock,
    WireEmergencySignal,
    WireLiftRequest,
    WireLiftState,
    WireTime,
    request_of,
    seconds_of,
    state_of,
    wire_request,
    wire_state,
)
from lift_manager.rmf.messages import LiftRequest, LiftState, Time
from tests.support.dds_oracle import (
    BOOL,
    CLOCK,
    EMERGENCY_SIGNAL,
    LIFT_REQUEST,
    LIFT_STATE,
    TIME,
    Oracle,
)
from tests.support.rows import each_row

ORACLE = Oracle()

# Written down from rosbags, cyclonedds 11.0.1 and pycdr2, which agreed
STATE = LiftState(Time(1, 2), "lift1", ("L1", "L2"), "L1", "", 2, 0, (1, 2), 2, "fleet/robot1")
STATE_BYTES = bytes.fromhex(
    "000100000100000002000000060000006c6966743100000002000000030000004c310000030000004c320000030000004c310000"
    "010000000002000002000000010202000d000000666c6565742f726f626f743100"
)
REQUEST = LiftRequest("lift1", Time(1, 2), "fleet/robot1", 1, "L2", 2)
REQUEST_BYTES = bytes.fromhex(
    "00010000060000006c6966743100000001000000020000000d000000666c6565742f726f626f743100010000030000004c320002"
)

texts = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=40)
octets = st.integers(0, 255)
times = st.builds(Time, st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1))
requests = st.builds(LiftRequest, texts, times, texts, octets, texts, octets)
states = st.builds(
    LiftState,
    lift_time=times,
    lift_name=texts,
    available_floors=st.lists(texts, max_size=9).map(tuple),
    current_floor=texts,
    destination_floor=texts,
    door_state=octets,
    motion_state=octets,
    available_modes=st.lists(octets, max_size=9).map(tuple),
    current_mode=octets,
    session_id=texts,
)


def test_a_state_has_the_bytes_that_were_written_down() -> None:
    assert wire_state(STATE).serialize() == STATE_BYTES
    assert ORACLE.state(STATE) == STATE_BYTES
    assert state_of(WireLiftState.deserialize(STATE_BYTES)) == STATE


def test_a_request_has_the_bytes_that_were_written_down() -> None:
    assert wire_request(REQUEST).serialize() == REQUEST_BYTES
    assert ORACLE.request(REQUEST) == REQUEST_BYTES
    assert request_of(WireLiftRequest.deserialize(REQUEST_BYTES)) == REQUEST


@given(states)
def test_any_state_has_the_bytes_of_the_other_encoder_and_comes_back_the_same(state: LiftState) -> None:
    assert wire_state(state).serialize() == ORACLE.state(state)
    assert state_of(WireLiftState.deserialize(ORACLE.state(state))) == state


@given(requests)
def test_any_request_has_the_bytes_of_the_other_encoder_and_comes_back_the_same(request: LiftRequest) -> None:
    assert wire_request(request).serialize() == ORACLE.request(request)
    assert request_of(WireLiftRequest.deserialize(ORACLE.request(request))) == request


@each_row("on", [True, False])
@each_row("fleets", [[], ["blue"], ["blue", "red"]])
def test_alarms_have_the_bytes_of_the_other_encoder(on: bool, fleets: list[str]) -> None:
    assert WireBool(on).serialize() == ORACLE.encoded(BOOL, on)
    assert WireEmergencySignal(fleets, on).serialize() == ORACLE.encoded(EMERGENCY_SIGNAL, fleets, on)


def test_the_clock_of_a_simulation_is_read_to_the_nanosecond() -> None:
    assert seconds_of(WireClock.deserialize(ORACLE.clock(12, 500_000_000))) == 12.5


@each_row(
    ("wire", "name", "digest"),
    [
        (WireLiftState, LIFT_STATE, "ce0553cd08eeeb321bdae554efdb6d2ebb2be9755df2e34895cbef55b51f4c06"),
        (WireLiftRequest, LIFT_REQUEST, "e8f1e0aa4d172703d0d7840c1876448c6c5d75ab58955faf7de7dddc17c096ac"),
        (WireTime, TIME, "b106235e25a4c5ed35098aa0a61a3ee9c9b18d197f398b0e4206cea9acf9c197"),
        (WireBool, BOOL, "feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9"),
        (WireEmergencySignal, EMERGENCY_SIGNAL, "2bcead0701ac71c292f12ba705ad9164b796b2660ae48cbf74204515fe5156e0"),
        (WireClock, CLOCK, "692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564"),
    ],
)
def test_a_type_has_the_hash_that_ros_gives_it(wire: Any, name: str, digest: str) -> None:
    assert TYPE_HASHES[wire] == f"RIHS01_{digest}"
    assert ORACLE.hash_of(name) == f"RIHS01_{digest}"


@pytest.mark.parametrize(("ours", "name"), [(LiftRequest, LIFT_REQUEST), (LiftState, LIFT_STATE)])
def test_a_message_has_the_fields_of_its_msg_file_in_their_order(ours: Any, name: str) -> None:
    assert list(ours.__dataclass_fields__) == ORACLE.fields_of(name)


@pytest.mark.parametrize("name", [LIFT_REQUEST, LIFT_STATE])
def test_the_numbers_are_those_of_the_msg_file(name: str) -> None:
    for constant, value in ORACLE.constants_of(name).items():
        assert getattr(messages, constant.removeprefix("REQUEST_")) == value


def test_every_number_of_ours_is_one_of_the_msg_files() -> None:
    known = {name.removeprefix("REQUEST_") for kind in (LIFT_REQUEST, LIFT_STATE) for name in ORACLE.constants_of(kind)}
    assert {name for name in vars(messages) if name.isupper() and isinstance(getattr(messages, name), int)} == {
        *known,
        "_NS",
    }
