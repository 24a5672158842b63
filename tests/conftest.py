"""What every test runs under: repeatable examples, an order, and programs from outside that may be absent."""

import gc
import os
import shutil
import signal
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# A test passes or fails for everybody; finding new examples is a job for a run of its own.
settings.register_profile("repeatable", derandomize=True, deadline=None, database=None)
settings.load_profile("repeatable")

TESTS = Path(__file__).parent
LONGEST = (
    "test_benchmarks.py",
    "campaigns/test_takeover.py",
    "campaigns/test_crash.py",
    "lift_manager/commissioning/checkout/test_steps.py",
    "lift_manager/test_checkout_command.py",
    "lift_manager/rmf/test_rides.py",
    "lift_manager/commissioning/checkout/test_planted_mistakes.py",
    "campaigns/test_wiring.py",
    "lift_manager/lab/scenario/test_play.py",
    "lift_manager/test_end_to_end.py",
    "test_readme.py",
    "lift_manager/lab/test_pytest_plugin.py",
    "lift_manager/lab/scenario/test_examples.py",
    "lift_manager/rmf/test_interleavings.py",
    "lift_manager/lab/test_door_released_after_open.py",
    "campaigns/test_truth.py",
    "campaigns/test_truth_too.py",
    "lift_manager/commissioning/learn/test_shipped_maps.py",
    "lift_manager/commissioning/learn/test_codings.py",
    "trips/test_trips.py",
    "lift_manager/web/test_page_with_axe.py",
    "packaging/test_packages.py",
    "packaging/test_wheel.py",
    "lift_manager/hub/test_hub.py",
    "lift_manager/hub/test_three_servers.py",
    "lift_manager/hub/test_missing.py",
    "campaigns/test_other_campaigns.py",
    "campaigns/test_rest.py",
    "campaigns/test_record.py",
    "lift_manager/test_cli.py",
    "lift_manager/test_watch_and_trace.py",
    "lift_manager/hub/test_processes.py",
    "lift_manager/hub/update/test_processes.py",
    "lift_manager/rmf/test_sessions.py",
    "test_how_to.py",
    "lift_manager/commissioning/plc/test_program_text.py",
    "lift_manager/commissioning/test_poke.py",
    "lift_manager/test_poke.py",
    "lift_manager/rmf/test_commands.py",
    "lift_manager/hub/test_page.py",
    "lift_manager/test_own_manager.py",
    "lift_manager/test_learn.py",
    "lift_manager/store/test_committer.py",
    "lift_manager/client/test_contract.py",
    "lift_manager/web/test_docs.py",
    "lift_manager/web/test_page_of_the_demo.py",
    "lift_manager/hub/test_hostile.py",
    "external/test_stunnel.py",
)
"""Files with three seconds of processor time and more, and those that wait for as long. They begin first, so that at the end of a run no worker
has one left while others wait."""
MEMORY, ENOUGH_BYTES = Path("/dev/shm"), 1 << 30
"""Where the files of tests are, if there is room: a disk that others write to holds up a flush for seconds, and a run needs 100 MB."""
DESELECTED = pytest.StashKey[dict[str, int]]()
UNDER_CI = os.environ.get("CI", "").lower() not in ("", "0", "false")


def pytest_configure(config: pytest.Config) -> None:
    # a shell has what it starts in the background ignore Ctrl-C, and nohup the end of the terminal; so would every program that
    # a test starts
    for number, default in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, default)
    config.stash[DESELECTED] = {}
    if os.access(MEMORY, os.W_OK) and shutil.disk_usage(MEMORY).free > ENOUGH_BYTES:
        os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(MEMORY))
    gc.disable()  # a third of the time of collecting is spent on looking for garbage among modules and tests, which stay


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    place = {TESTS / name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path, len(place)))
    if UNDER_CI:
        return  # they fail instead, see pytest_runtest_setup
    kept: list[pytest.Item] = []
    dropped: list[pytest.Item] = []
    for item in items:
        missing = missing_programs(item)
        for program in missing:
            config.stash[DESELECTED][program] = config.stash[DESELECTED].get(program, 0) + 1
        (dropped if missing else kept).append(item)
    if dropped:
        config.hook.pytest_deselected(items=dropped)
        items[:] = kept


def pytest_collection_finish() -> None:
    # modules and tests stay to the end, and so does the little garbage among them: to look through them again and again is a
    # tenth of all time
    gc.freeze()
    gc.set_threshold(50_000, 20, 50)
    gc.enable()


def pytest_runtest_setup(item: pytest.Item) -> None:
    if missing := missing_programs(item):
        pytest.fail(f"{' and '.join(missing)} not found, and under CI every external test must run", pytrace=False)


def missing_programs(item: pytest.Item) -> list[str]:
    wanted: Iterable[str] = dict.fromkeys(name for mark in item.iter_markers("external") for name in mark.args)
    return [program for program in wanted if shutil.which(program) is None]


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    for program, count in sorted(config.stash[DESELECTED].items()):
        terminalreporter.write_line(f"{program} not found: {count} external test(s) deselected")


# Under xdist the workers collect and the main process prints.


def pytest_sessionfinish(session: pytest.Session) -> None:
    output: dict[str, Any] | None = getattr(session.config, "workeroutput", None)
    if output is not None:
        output["deselected"] = session.config.stash[DESELECTED]


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    node.config.stash[DESELECTED].update(getattr(node, "workeroutput", {}).get("deselected", {}))
