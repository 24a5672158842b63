"""What tells whoever watches the process that it lives, and that it serves robots."""

from dataclasses import replace

from lift_manager.domain.access import Role
from lift_manager.domain.state import Quality
from tests.lift_manager.web.fake import IDLE, FakeManager, ask
from tests.lift_manager.web.keyed import ring

FULL = "the journal /var/lib/lift-manager/east.journal.db has no room: the disk is full"


def test_a_process_that_answers_is_alive_whatever_its_lifts_and_its_disk_do() -> None:
    facade = FakeManager({"lift": replace(IDLE, quality=Quality.OFFLINE)}, trouble=FULL)
    answer = ask(facade, "GET", "/healthz")
    assert (answer.status_code, answer.json()) == (200, {"status": "ok"})


def test_a_manager_that_can_write_down_what_it_does_is_ready_and_a_dead_lift_is_counted() -> None:
    facade = FakeManager({"a": IDLE, "b": replace(IDLE, lift="b", quality=Quality.OFFLINE)})
    answer = ask(facade, "GET", "/readyz")
    assert answer.status_code == 200
    assert answer.json() == {"ready": True, "journal": "written", "lifts": 2, "live": 1}


def test_a_full_disk_turns_the_health_red_and_tells_nobody_where_it_is() -> None:
    answer = ask(FakeManager(trouble=FULL), "GET", "/readyz")
    assert answer.status_code == 503
    assert answer.json()["ready"] is False
    assert "/var" not in answer.text


def test_no_key_is_needed_for_either() -> None:
    for url in ("/healthz", "/readyz"):
        assert ask(FakeManager(), "GET", url, keys=ring(Role.VIEWER)).status_code == 200
