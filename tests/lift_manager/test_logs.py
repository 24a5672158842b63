"""The log of a running manager, for people and for programs."""

import io
import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import Any

import pytest
from typer.testing import CliRunner

from lift_manager.cli.logs import HumanFormatter, JsonFormatter, LogFormat, log_to
from lift_manager.cli.main import app
from tests.support.programs import running

KEY = "lm_0123abcd_" + "0123456789abcdef" * 4


@contextmanager
def logging_to(formatter: logging.Formatter) -> Iterator[tuple[logging.Logger, io.StringIO]]:
    stream = io.StringIO()
    handler = logging.StreamHandler(stream)
    handler.setFormatter(formatter)
    logger = logging.getLogger("tests.of.logs")
    logger.setLevel(logging.INFO)
    logger.addHandler(handler)
    try:
        yield logger, stream
    finally:
        logger.removeHandler(handler)


def lines(stream: io.StringIO) -> list[dict[str, Any]]:
    return [json.loads(line) for line in stream.getvalue().splitlines()]


def test_a_line_is_one_object_with_the_time_in_utc_and_the_event_where_there_is_one() -> None:
    with logging_to(JsonFormatter()) as (log, stream):
        log.warning("%s: fire", "goods", extra={"event": "b0-7", "lift": "goods"})
        log.info("no event\nbut two lines, ü")
    first, second = lines(stream)
    at = datetime.fromisoformat(first.pop("time"))
    assert at.tzinfo == UTC
    assert abs((datetime.now(UTC) - at).total_seconds()) < 60
    assert first == {
        "level": "warning",
        "logger": "tests.of.logs",
        "message": "goods: fire",
        "event": "b0-7",
        "lift": "goods",
    }
    assert second["message"] == "no event\nbut two lines, ü"
    assert set(second) == {"time", "level", "logger", "message"}


@pytest.mark.parametrize("formatter", [JsonFormatter(), HumanFormatter()], ids=["json", "human"])
def test_no_key_is_written_wherever_it_comes_from(formatter: logging.Formatter) -> None:
    with logging_to(formatter) as (log, stream):
        log.info("asked with %s", KEY, extra={"lift": KEY})
        try:
            int(f"no such key: {KEY}")
        except ValueError:
            log.exception("failed")
    assert KEY not in stream.getvalue()
    assert "no such key: lm_..." in stream.getvalue()


def test_an_exception_is_in_the_object_with_its_traceback() -> None:
    with logging_to(JsonFormatter()) as (log, stream):
        try:
            int("of all things")
        except ValueError:
            log.exception("failed")
    (line,) = lines(stream)
    assert line["level"] == "error"
    assert line["exception"].startswith("Traceback")
    assert line["exception"].endswith("'of all things'")


def test_a_manager_logs_objects_alone_where_it_is_told_to() -> None:
    with running("demo", "--port", "0", "--log-format", "json") as program:
        program.says("/docs")
        assert program.stop()[0] == 0
        found = [json.loads(line) for line in program.err.splitlines()]
    assert {"time", "level", "logger", "message"} <= set(found[0])
    assert {line["lift"] for line in found if "lift" in line} != set()


def test_the_form_of_the_log_may_be_said_by_the_environment_and_a_word_that_is_none_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("LIFT_MANAGER_LOG_FORMAT", "xml")
    done = CliRunner().invoke(app, ["serve", "site.yaml"])
    assert done.exit_code == 2
    assert "'human'" in done.stderr
    assert "'json'" in done.stderr


def test_what_asyncio_says_of_the_end_of_a_tls_connection_is_left_out() -> None:
    shown = io.StringIO()
    handler = log_to(shown, LogFormat.JSON)
    for text in ("returning true from eof_received() has no effect when using ssl", "Task was destroyed"):
        handler.handle(logging.LogRecord("asyncio", logging.WARNING, "", 0, text, None, None))
    assert [json.loads(line)["message"] for line in shown.getvalue().splitlines()] == ["Task was destroyed"]
