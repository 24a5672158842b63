import json
import math
from functools import cache

from fastapi import FastAPI
from hypothesis import given
from hypothesis import strategies as st

from lift_manager.web.app import make_app
from tests.lift_manager.web.fake import REQUEST, STATE, FakeSite, Requested, ask_app
from tests.support.examples import examples

BOUNDED = examples(40)

scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.sampled_from(["L1", "L2", 0, 1, 2])
values = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4), max_leaves=8
)
near_requests = st.fixed_dictionaries(
    {}, optional={"floor": st.sampled_from(["L1", "L2"]) | values, "door_state": st.sampled_from([0, 2]) | values}
)


@cache
def served() -> tuple[FakeSite, FastAPI]:
    """One for all examples, because making an application takes longer than its answer."""
    manager = FakeSite()
    return manager, make_app(manager)


def answered(body: bytes, url: str = REQUEST) -> list[Requested]:
    manager, app = served()
    manager.requests.clear()
    answer = ask_app(app, "POST", url, content=body)
    assert answer.status_code == 200
    envelope = json.loads(answer.content)
    assert list(envelope) == ["data", "success", "msg"]
    assert envelope["data"] == {}
    assert envelope["success"] is bool(manager.requests)
    assert bool(envelope["msg"]) is not envelope["success"]
    return manager.requests


def is_request(value: object) -> bool:
    """Said once more in other words, to be compared with the code."""
    if not isinstance(value, dict):
        return False
    door = value.get("door_state")
    floor = value.get("floor")
    return type(door) in (int, float) and door in (0, 2) and isinstance(floor, str) and len(floor) <= 200


@given(st.binary(max_size=200))
@BOUNDED
def test_arbitrary_bytes_get_an_envelope_and_reach_nobody(body: bytes) -> None:
    assert answered(body) == []


@given(values | near_requests)
@BOUNDED
def test_arbitrary_json_reaches_the_manager_only_when_it_is_a_request(value: object) -> None:
    text = json.dumps(value)
    has_nan = any(word in text for word in ("NaN", "Infinity")) and not is_plain(value)
    asked = answered(text.encode())
    assert bool(asked) is (is_request(value) and not has_nan and not has_surrogate(value))


def is_plain(value: object) -> bool:
    match value:
        case float():
            return math.isfinite(value)
        case list():
            return all(map(is_plain, value))
        case dict():
            return all(map(is_plain, value.values()))
        case _:
            return True


def has_surrogate(value: object) -> bool:
    floor = value.get("floor") if isinstance(value, dict) else None
    return isinstance(floor, str) and any("\ud800" <= char <= "\udfff" for char in floor)


@given(st.binary(max_size=80))
@BOUNDED
def test_an_arbitrary_query_gets_an_envelope(query: bytes) -> None:
    quoted = "".join(f"%{byte:02x}" for byte in query)
    _, app = served()
    answer = ask_app(app, "GET", f"{STATE}?lift_name={quoted}")
    assert answer.status_code == 200
    assert list(answer.json()) == ["data", "success", "msg"]
