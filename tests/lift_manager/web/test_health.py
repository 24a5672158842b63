"""What tells whoever watches the process that it lives, and that it serves robots."""

from dataclasses import replace

import pytest

from lift_manager.api.roles import Role
from lift_manager.lift.state import Quality
from tests.lift_manager.web.fake import FakeSite, ask
from tests.lift_manager.web.fake_lifts import IDLE
from tests.lift_manager.web.keyed import ring

UNWRITTEN = frozenset({"journal", "state"})


def test_a_process_that_answers_is_alive_whatever_its_lifts_and_its_disk_do() -> None:
    site = FakeSite({"lift": replace(IDLE, quality=Quality.OFFLINE)}, unwritten=UNWRITTEN)
    answer = ask(site, "GET", "/healthz")
    assert (answer.status_code, answer.json()) == (200, {"status": "ok"})


def test_a_manager_that_can_write_down_what_it_does_is_ready_and_a_dead_lift_is_counted() -> None:
    site = FakeSite({"a": IDLE, "b": replace(IDLE, lift="b", quality=Quality.OFFLINE)})
    answer = ask(site, "GET", "/readyz")
    assert answer.status_code == 200
    assert answer.json() == {"ready": True, "journal": "written", "state": "written", "lifts": 2, "live": 1}


@pytest.mark.parametrize("file", sorted(UNWRITTEN))
def test_what_cannot_be_written_turns_the_health_red_and_is_named_without_its_path(file: str) -> None:
    answer = ask(FakeSite(unwritten=frozenset({file})), "GET", "/readyz")
    assert answer.status_code == 503
    said = answer.json()
    assert said["ready"] is False
    assert said.pop(file).startswith("not written: nothing is pressed")
    assert "written" in said.values()
    assert "/" not in answer.text


def test_no_key_is_needed_for_either() -> None:
    for url in ("/healthz", "/readyz"):
        assert ask(FakeSite(), "GET", url, keys=ring(Role.VIEWER)).status_code == 200
