"""The log of a long-running command: lines for people, or a JSON object per line for programs."""

from __future__ import annotations

import json
import logging
import sys
from datetime import UTC, datetime
from enum import StrEnum, unique
from typing import Annotated, TextIO

import typer

from lift_manager.api.keys import redacted

VARIABLE = "LIFT_MANAGER_LOG_FORMAT"

_NOISE = "returning true from eof_received()"
"""What asyncio warns of whenever a server ends a TLS connection of nats-py (2.16), which has a line of its own and needs nothing more."""


@unique
class LogFormat(StrEnum):
    """The format of log lines."""

    HUMAN = "human"
    JSON = "json"


LogOption = Annotated[
    LogFormat,
    typer.Option("--log-format", envvar=VARIABLE, help="Lines for people, or an object of JSON per line for programs."),
]


def log_to(stream: TextIO, form: LogFormat) -> logging.Handler:
    """Log everything of this process, including its libraries, to a stream; return the handler."""
    handler = logging.StreamHandler(stream)
    handler.setFormatter(_FORMATTERS[form]())
    handler.addFilter(lambda record: record.name != "asyncio" or not record.getMessage().startswith(_NOISE))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
    logging.getLogger("pymodbus").setLevel(logging.ERROR)
    logging.getLogger("httpx").setLevel(logging.WARNING)  # it logs every request, several a second in a cluster
    return handler


def log_to_stderr(form: LogFormat = LogFormat.HUMAN) -> None:
    """Log to stderr, where systemd, a container or a person reads it."""
    log_to(sys.stderr, form)


class HumanFormatter(logging.Formatter):
    """Removes keys from whole entries, tracebacks included, as a last safeguard."""

    def __init__(self) -> None:
        super().__init__("%(asctime)s %(levelname)-7s %(message)s", datefmt="%H:%M:%S")

    def format(self, record: logging.LogRecord) -> str:
        """Return the line, or for an exception the lines."""
        return redacted(super().format(record))


class JsonFormatter(logging.Formatter):
    """One object per line: `time` (RFC 3339, UTC), `level`, `logger`, `message`; where known `event`, `lift` and `exception`.

    `event` is the id of the same event in the journal and in the event stream. Keys are removed as in lines for people.
    """

    def format(self, record: logging.LogRecord) -> str:
        """Return the line."""
        at = datetime.fromtimestamp(record.created, UTC).replace(tzinfo=None)
        fields = {
            "time": f"{at.isoformat(timespec='milliseconds')}Z",
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        for name in ("event", "lift"):
            value = getattr(record, name, None)
            if isinstance(value, str) and value:
                fields[name] = value
        if record.exc_info:
            fields["exception"] = self.formatException(record.exc_info)
        if record.stack_info:
            fields["stack"] = self.formatStack(record.stack_info)
        return redacted(json.dumps(fields, ensure_ascii=False))


_FORMATTERS: dict[LogFormat, type[logging.Formatter]] = {
    LogFormat.HUMAN: HumanFormatter,
    LogFormat.JSON: JsonFormatter,
}
