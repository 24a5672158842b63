"""Roles, keys and secrets, without a file or a socket."""

import re
import traceback
from itertools import product

import pytest
from starlette.routing import compile_path

from lift_manager.api.keys import Key, KeyRing, Secret, digest_of, holds_key, is_token, redacted, token
from lift_manager.api.roles import ROLES, ROUTES, AccessLevel, LiftIn, Role, Route, refusal
from tests.support.rows import each_row

SECRET = "5ec2e7" * 10 + "beef"
TOKEN = f"lm_0123abcd_{SECRET}"
KEY = Key("0123abcd", "amr-1", Role.ROBOT, ("east",))
RING = KeyRing([(KEY, digest_of(SECRET))])


def test_viewer_operator_and_commissioner_each_may_all_that_the_one_before_may() -> None:
    allowed = [
        {need for need, roles in ROLES.items() if role in roles}
        for role in (Role.VIEWER, Role.OPERATOR, Role.COMMISSIONER)
    ]
    assert allowed == [
        {AccessLevel.READ},
        {AccessLevel.READ, AccessLevel.COMMAND, AccessLevel.OPERATE},
        set(AccessLevel) - {AccessLevel.NOTHING, AccessLevel.RMF},
    ]


@each_row(
    ("asked", "may"),
    [(["east"], True), (["west"], False), (["east", "west"], False), ([], False), (["east", "east"], True)],
)
def test_a_robot_commands_its_own_lifts_and_nothing_that_names_none(asked: list[str], may: bool) -> None:
    assert (not refusal(Role.ROBOT, ["east"], AccessLevel.COMMAND, asked)) is may
    assert refusal(Role.ROBOT, ["east"], AccessLevel.READ, asked) == ""


@each_row(("asked", "may"), [(["east"], True), (["west"], False), ([], False)])
def test_only_a_key_of_rmf_speaks_for_rmf_of_its_own_lifts_and_it_may_read_and_nothing_else(
    asked: list[str], may: bool
) -> None:
    assert (not refusal(Role.RMF, ["east"], AccessLevel.RMF, asked)) is may
    assert [need for need, roles in ROLES.items() if Role.RMF in roles] == [AccessLevel.READ, AccessLevel.RMF]
    assert refusal(Role.RMF, ["east"], AccessLevel.READ, asked) == ""
    for role in set(Role) - {Role.RMF}:
        assert "needs a key with the role rmf; this key's is" in refusal(role, ["east"], AccessLevel.RMF, ["east"])


def test_a_refusal_names_the_roles_that_may_or_the_lifts_of_the_key() -> None:
    assert refusal(Role.VIEWER, (), AccessLevel.OPERATE, ["east"]) == (
        "this needs a key with the role operator or commissioner; this key's is viewer"
    )
    assert refusal(Role.ROBOT, ["east", "west"], AccessLevel.COMMAND, ["north"]) == (
        "this key commands east and west and no other; another lift needs a key that names it"
    )


def test_every_route_that_a_robot_may_command_says_where_its_lift_is() -> None:
    assert all(route.lift_in is not None for route in ROUTES if route.need in (AccessLevel.COMMAND, AccessLevel.RMF))
    assert all(("{lift}" in route.path) is (route.lift_in is LiftIn.PATH) for route in ROUTES)


FILLED = {"{path:path}": "x.js", "{session}": "s1", "{command}": "7", "{ride}": "r1"}


def filled(route: Route, lift: str) -> str:
    """A path of this route."""
    path = route.path.replace("{lift}", lift)
    for name, value in FILLED.items():
        path = path.replace(name, value)
    return re.sub(r"\{\w+(:path)?\}", "x", path)


def first_match(method: str, path: str) -> tuple[Route, str]:
    """The route that the gate takes, and the lift that it looks at."""
    for route in ROUTES:
        match = compile_path(route.path)[0].match(path)
        if match is not None and method in route.methods:
            return route, match.groupdict().get("lift", "")
    raise AssertionError(path)


LIKE_A_WORD_OF_A_PATH = ("east", "B-2_goods.1", "sessions", "rides", "lockout", "capabilities", "session", "s1")


@each_row("route", ROUTES)
def test_a_request_reaches_its_route_and_names_its_lift_whatever_the_lift_is_called(route: Route) -> None:
    for method, lift in product(route.methods, LIKE_A_WORD_OF_A_PATH):
        found, named = first_match(method, filled(route, lift))
        assert found == route, lift
        assert named == (lift if route.lift_in is LiftIn.PATH else "")


@each_row("route", ROUTES)
def test_no_two_routes_take_the_same_request(route: Route) -> None:
    path = filled(route, "east")
    for method in route.methods:
        taking = [one for one in ROUTES if method in one.methods and compile_path(one.path)[0].match(path)]
        assert taking == [route]


def test_a_key_is_found_by_its_secret_alone() -> None:
    assert RING.find(Secret(TOKEN)) is KEY
    assert str(RING.find(token(KEY.id, SECRET))) == str(KEY)


@each_row(
    "wrong",
    [
        "",
        "lm",
        SECRET,
        TOKEN[:-1],
        TOKEN + "0",
        TOKEN.upper(),
        f" {TOKEN}",
        f"{TOKEN}\n",
        TOKEN.replace("0123abcd", "0123abce"),
        f"lm_0123abcd_{'0' * 64}",
        f"lm_0123abce_{'0' * 64}",
        f"lm_0123abcd_{digest_of(SECRET)}",
        f"lm_0123abcd_{SECRET[:-1]}e",
        TOKEN.replace("5", "\u0665"),
    ],
)
def test_a_mistyped_key_is_none(wrong: str) -> None:
    assert RING.find(Secret(wrong)) is None


def test_a_ring_without_keys_needs_none_unless_it_is_told_to() -> None:
    assert RING.are_required
    assert not KeyRing().are_required
    assert KeyRing(open_without_keys=False).are_required


def test_a_secret_shows_itself_in_no_text() -> None:
    secret = Secret(TOKEN)
    shown = [repr(secret), str(secret), f"{secret}", f"{secret!r:>20}", repr([secret]), repr({"key": secret})]
    with pytest.raises(TypeError) as caught:
        secret + secret  # type: ignore[operator]
    shown.append("".join(traceback.TracebackException.from_exception(caught.value, capture_locals=True).format()))
    assert [text for text in shown if SECRET in text] == []
    assert secret.reveal() == TOKEN
    assert not hasattr(secret, "__dict__")


@each_row("text", [TOKEN, TOKEN.upper(), TOKEN[:30], f"/lifts/{TOKEN}/lockout", SECRET, SECRET[2:]])
def test_what_holds_a_key_or_the_better_part_of_one_is_recognised(text: str) -> None:
    assert holds_key(text)


@each_row("text", ["", "lm_", "east wing", "lm_east_wing", "2" * 500, "a" * 59, "lm_0123abcd_..."])
def test_the_names_of_lifts_and_people_are_no_keys(text: str) -> None:
    assert not holds_key(text)


def test_what_is_written_down_loses_its_keys() -> None:
    assert redacted(f"GET /{TOKEN}x failed: {TOKEN[:40]}") == "GET /lm_... failed: lm_..."
    assert redacted(f"map sha256 {SECRET}") == f"map sha256 {SECRET}"


def test_only_the_exact_form_is_a_key() -> None:
    assert is_token(TOKEN)
    assert not is_token(f"{TOKEN} ")
