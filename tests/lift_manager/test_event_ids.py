"""One id for one event: in the log, in the journal on the disk, and in the event stream."""

import asyncio
import json
import logging
from contextlib import closing
from pathlib import Path

import pytest

from lift_manager.app import ManagerParts, build
from lift_manager.cli.logs import JsonFormatter
from lift_manager.config.load import load_site
from lift_manager.runtime.recorder import Recorder
from lift_manager.store.read import RowFilter, event_of, open_journal
from lift_manager.store.retention import Limits
from lift_manager.store.site import open_store
from lift_manager.web.app import make_app
from tests.lift_manager.web.fake import serving
from tests.lift_manager.web.listening import Message, listening

SITE = {
    "schema": 1,
    "name": "one id",
    # nobody answers there: what people say needs no controller
    "controllers": {"plc": {"host": "127.0.0.1", "port": 1, "map": "generic-registers"}},
    "lifts": {"goods": {"controller": "plc", "floors": {"L1": 1, "L2": 2}}},
}


def of_site(folder: Path, recorder: Recorder) -> ManagerParts:
    file = folder / "site.yaml"
    file.write_text(json.dumps(SITE), "utf-8")  # JSON is YAML
    return build(load_site(file), recorder=recorder)


def test_log_journal_and_stream_name_an_event_alike(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "one.db"

    async def main() -> list[Message]:
        journal = open_store(path, "one id", ["goods"], Limits(10, 10))
        site = of_site(tmp_path, journal).site
        recording = asyncio.ensure_future(journal.run(site.report_disk))
        async with serving(make_app(site)) as port, listening(port) as stream:
            await stream.begin()
            await stream.take(1)
            site.lock_out("goods", "A. Beck", "new ropes")
            site.end_lockout("goods", "A. Beck")
            found = await stream.take(4)
        await journal.settled()
        recording.cancel()
        await asyncio.gather(recording, return_exceptions=True)
        return found

    with caplog.at_level(logging.INFO):
        heard = asyncio.run(main())
    told = {message.data["what"]: message.id for message in heard if message.event == "person"}
    assert set(told) == {"locked_out", "lockout_over"}
    logged = [json.loads(JsonFormatter().format(record)) for record in caplog.records]
    assert [line["event"] for line in logged if "event" in line] == list(told.values())
    assert {line["lift"] for line in logged if "event" in line} == {"goods"}
    with closing(open_journal(path)) as reader:
        rows = [row for row in reader.rows() if event_of(row)]
        assert [event_of(row) for row in rows] == list(told.values())
        for what, event in told.items():
            (row,) = reader.rows(RowFilter(event=event))
            assert json.loads(row.data)["said"] == {"locked_out": "lockout", "lockout_over": "lockout_end"}[what]
