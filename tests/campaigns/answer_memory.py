"""The fuzz over the wire Protocol: several links per loop on virtual time, where a time-out costs nothing."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from random import Random

from drivers.modbus.link import Link
from drivers.modbus.settings import LinkSettings
from drivers.modbus.wire import Wire
from tests.campaigns.answer_rig import Asker, Device, Finding, MakeClient, Report, together, unhandled_in_loop
from tests.support.virtual_time import VirtualTimeError, run_virtual

LINKS = 8
WITHOUT_ECHO = 4
"""One link in so many speaks to a device that is known not to return transaction ids."""
LIMIT_S = 1e7
"""Virtual time; a client that never ends waiting is found by that."""


def link(make_wire: Callable[[], Wire], settings: LinkSettings, name: str) -> Link:
    """The client that ships."""
    return Link(make_wire, settings, name=name)


def memory_batch(seed: int, batch: int, cases: int, make_client: MakeClient = link) -> Report:
    """Put so many mutated answers before clients in memory; the same seed and batch give the same bytes."""
    report = Report()
    where = f"memory:{seed}:{batch}:{cases}"
    try:
        run_virtual(lambda: _batch(seed, batch, cases, make_client, report, where), limit_s=LIMIT_S)
    except VirtualTimeError as error:
        report.find(Finding(where, f"{type(error).__name__}: {error}"))
    return report


async def _batch(seed: int, batch: int, cases: int, make_client: MakeClient, report: Report, where: str) -> None:
    unhandled_in_loop(report, where)
    devices, clients, asking, running = [], [], [], []
    for number in range(LINKS):
        rng = Random(f"{seed}/{batch}/{number}")
        settings = LinkSettings(tid_echo=number % WITHOUT_ECHO != 0, min_gap_s=rng.choice((0.0, 0.0, 0.005)))
        device = Device(rng, settings)
        client = make_client(device.wire, settings, f"link {number}")
        share = cases // LINKS + (number < cases % LINKS)
        devices.append(device)
        clients.append(client)
        asker = Asker(where, client, device, report, rng)
        asking.append(asyncio.ensure_future(asker.ask_until(share)))
        running.append(asyncio.ensure_future(client.run()))
    try:
        await together(asking, running, report, where)
    finally:
        for client in clients:
            await client.close()
        await asyncio.wait(running)
        report.cases = sum(device.asked for device in devices)
