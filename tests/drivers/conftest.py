"""What the tests of TLS have in common: an authority, our side of a link, and both event loops."""

import asyncio
from pathlib import Path

import pytest
import uvloop

from drivers.modbus.tls import LinkTls
from tests.drivers.secured import Run, run_quietly
from tests.support.certificates import Authority
from tests.support.programs import HANGS_S


@pytest.fixture(params=[asyncio.new_event_loop, uvloop.new_event_loop], ids=["asyncio", "uvloop"])
def run(request: pytest.FixtureRequest, caplog: pytest.LogCaptureFixture) -> Run:
    return lambda test: run_quietly(test, request.param, caplog)


@pytest.fixture
def authority(tmp_path: Path) -> Authority:
    return Authority(tmp_path)


@pytest.fixture
def tls(authority: Authority) -> LinkTls:
    ours = authority.issue("manager", "lift-manager")
    return LinkTls(ca=authority.file, certificate=ours.certificate, key=ours.key, handshake_s=HANGS_S, files_s=HANGS_S)
