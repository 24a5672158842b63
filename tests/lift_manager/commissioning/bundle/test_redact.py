"""The redactor of support bundles: secrets go whatever their form, names become numbers, everything else stays."""

import json

import pytest

from lift_manager.commissioning.bundle.redact import LEFT_OUT, Redactor
from tests.support.rows import each_row

DIGEST = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"
TOKEN = f"lm_0a1b2c3d_{DIGEST}"
PEM = "-----BEGIN PRIVATE KEY-----\nMIGHAgEAMBMGByqGSM49AgEGCCqGSM49\nAwEHBG0wawIBAQQg\n-----END PRIVATE KEY-----"


@each_row(
    ("text", "secret"),
    [
        (f"Authorization: Bearer {TOKEN}", TOKEN),
        (f"key={TOKEN}, next", TOKEN[12:]),
        (f"the digest {DIGEST.upper()} of it", DIGEST.upper()),
        (f"before\n{PEM}\nafter", "MIGHAgEAMBMGByqGSM49AgEGCCqGSM49"),
        (json.dumps({"file": PEM}), "AwEHBG0wawIBAQQg"),
        ("-----BEGIN RSA PRIVATE KEY-----\nMIGHAgEAMBMGByqG cut here", "MIGHAgEAMBMGByqG"),
        ("https://anna:hunter2@proxy.example/x", "hunter2"),
        ("https://hunter2@proxy.example/x", "hunter2"),
        ("password: hunter2", "hunter2"),
        ('"mqtt_password": "hunter 2 and more"', "hunter 2"),
        ("LIFT_MANAGER_KEY=hunter2", "hunter2"),
        ("Authorization: Basic aHVudGVyMg==", "aHVudGVyMg"),
    ],
)
def test_a_secret_goes_in_any_form_and_the_rest_stays(text: str, secret: str) -> None:
    redactor = Redactor(with_names=True)
    done = redactor.text(text)
    assert secret not in done
    assert LEFT_OUT in done or "lm_..." in done
    assert sum(redactor.counts.values()) >= 1


@each_row("text", ["door open at L2", "sha 9f86d081", "192.0.2.10:502", "tokens are fine", "no secret here"])
def test_what_is_no_secret_stays_as_it_is(text: str) -> None:
    assert Redactor().text(text) == text


def test_the_hash_of_a_map_stays() -> None:
    assert Redactor(hashes=[DIGEST]).text(f"sha256 {DIGEST}") == f"sha256 {DIGEST}"


def test_a_name_is_the_same_number_everywhere() -> None:
    redactor = Redactor()
    redactor.learn_names(["api:Anna Berg", "rmf:tug 1"])
    assert redactor.name("api:Anna Berg") == "api:name-1"
    assert redactor.text("Anna Berg took the lift from tug 1") == "name-1 took the lift from name-2"
    assert redactor.data({"by": "Anna Berg", "n": [1, {"holder": "rmf:tug 1"}]}) == {
        "by": "name-1", "n": [1, {"holder": "rmf:name-2"}],
    }  # fmt: skip


def test_the_name_of_a_lift_stays_although_a_robot_has_it_too() -> None:
    redactor = Redactor(keep=["east"])
    redactor.learn_names(["api:east"])
    assert redactor.text("east is offline") == "east is offline"
    assert redactor.name("api:east") == "api:name-1"


@each_row(
    ("text", "redacted"),
    [
        ("locked out by Anna Berg since noon: her phone is 555", f"locked out by {LEFT_OUT}"),
        ("fire acknowledged by Anna", f"fire acknowledged by {LEFT_OUT}"),
    ],
)
def test_what_a_person_decided_stays_without_the_person_and_the_reason(text: str, redacted: str) -> None:
    assert Redactor().text(text) == redacted


def test_names_and_reasons_stay_where_they_are_wanted_but_never_secrets() -> None:
    redactor = Redactor(with_names=True)
    redactor.learn_names(["api:Anna"])
    assert redactor.text("locked out by Anna: cleaning") == "locked out by Anna: cleaning"
    assert redactor.data({"by": "Anna", "reason": "password: x1"}) == {"by": "Anna", "reason": f"password: {LEFT_OUT}"}


@pytest.mark.parametrize("known", [DIGEST, "a passphrase of this computer"])
def test_a_known_secret_goes_wherever_it_stands(known: str) -> None:
    redactor = Redactor(hashes=[DIGEST], with_names=True)
    redactor.learn_secrets([known, ""])
    assert known not in redactor.text(f"x{known}y")
