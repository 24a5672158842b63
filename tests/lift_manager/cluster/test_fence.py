"""The command of a site that closes the way of the other machine to a controller: it succeeds once, or nothing is sent."""

import asyncio
import json
import os
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import pytest

from drivers.errors import ConnectFailed
from lift_manager.cluster.fence import SiteFence, fences_of
from lift_manager.config.load import load_site
from lift_manager.config.site import Fence
from tests.support.programs import HANGS_S

CLUSTER = {
    "machines": {"north": {"address": "http://192.0.2.11:5003"}, "south": {"address": "http://192.0.2.12:5003"}},
    "etcd": ["http://127.0.0.1:2379"],
}


def fence(folder: Path, script: str, within_s: float = 60.0) -> SiteFence:
    return SiteFence("plc", Fence(command=("sh", "-c", script), within_s=within_s), folder, {"WHO": "south"})


def play(check: Callable[[], Awaitable[None]]) -> None:
    async def run() -> None:
        async with asyncio.timeout(HANGS_S):
            await check()

    asyncio.run(run())


async def refusal(closing: SiteFence) -> str:
    with pytest.raises(ConnectFailed) as caught:
        await closing.close()
    return str(caught.value)


def test_it_succeeds_once_and_is_not_run_again(tmp_path: Path) -> None:
    closing = fence(tmp_path, 'echo "$WHO" >> closed')

    async def check() -> None:
        await closing.close()
        await closing.close()

    play(check)
    assert (tmp_path / "closed").read_text() == "south\n"


def test_one_that_fails_says_how_and_is_tried_again(tmp_path: Path) -> None:
    closing = fence(tmp_path, "test -e ready || { printf 'port 3:\\033 no answer\\n' >&2; exit 7; }")

    async def check() -> None:
        said = await refusal(closing)
        assert said == "plc: its fence is not closed, so nothing is sent to it: sh has ended with 7: port 3: no answer"
        (tmp_path / "ready").touch()
        await closing.close()

    play(check)


def test_one_that_does_not_end_is_killed_with_all_that_it_has_started(tmp_path: Path) -> None:
    closing = fence(tmp_path, "sleep 100 > held & wait", within_s=0.5)

    async def check() -> None:
        with pipe(tmp_path / "held") as held:
            assert "sh has not ended within 0.5 s" in await refusal(closing)
            assert await asyncio.to_thread(held.read) == b""

    play(check)


def test_one_whose_run_is_cancelled_is_killed_too(tmp_path: Path) -> None:
    closing, begun = fence(tmp_path, "echo > begun; exec sleep 100 > held"), tmp_path / "begun"
    os.mkfifo(begun)

    async def check() -> None:
        with pipe(tmp_path / "held") as held:
            running = asyncio.create_task(closing.close())
            await asyncio.to_thread(begun.read_bytes)
            running.cancel()
            await asyncio.wait([running])
            assert await asyncio.to_thread(held.read) == b""

    play(check)


@contextmanager
def pipe(path: Path) -> Iterator[BinaryIO]:
    """A pipe that is read to its end only once no program has it open for writing."""
    os.mkfifo(path)
    number = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    os.set_blocking(number, True)
    with os.fdopen(number, "rb") as held:
        yield held


def test_a_program_that_is_not_there_is_named(tmp_path: Path) -> None:
    closing = SiteFence("plc", Fence(command=("./close-port",)), tmp_path, {})

    async def check() -> None:
        assert "./close-port cannot be run: No such file or directory" in await refusal(closing)

    play(check)


def test_it_is_told_which_machine_takes_over_which_controller_and_in_which_epoch(tmp_path: Path) -> None:
    site = {
        "schema": 1,
        "name": "A building",
        "controllers": {"plc": {"host": "192.0.2.5", "map": "generic-registers"}},
        "lifts": {"main": {"controller": "plc", "access": "control", "floors": {"L1": 1, "L2": 2}}},
        "cluster": {**CLUSTER, "fence": {"plc": {"command": ["sh", "-c", "env > told"]}}},
    }
    (tmp_path / "site.yaml").write_text(json.dumps(site))
    closing = fences_of(load_site(tmp_path / "site.yaml"), "south", 7)["plc"]
    play(closing.close)
    told = {line for line in (tmp_path / "told").read_text().splitlines() if line.startswith("LIFT_MANAGER_")}
    assert told >= {
        "LIFT_MANAGER_CONTROLLER=plc",
        "LIFT_MANAGER_MACHINE=south",
        "LIFT_MANAGER_OTHER_MACHINE=north",
        "LIFT_MANAGER_EPOCH=7",
    }
