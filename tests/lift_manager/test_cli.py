"""The command line as real processes: exit codes, what is printed where, and no traceback whatever it is given."""

import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import chdir, closing
from importlib.metadata import version
from pathlib import Path

import httpx
import pytest

from drivers.errors import ControllerTaken
from lift_manager.cli.main import COMMANDS, SUMMARIES, load_command
from lift_manager.cli.serve import first_error
from lift_manager.store.place import store_path
from register_maps.load import MAPS
from tests.support.programs import HANGS_S, ROOT, call, run, run_each, running
from tests.support.rows import each_row


def plain(text: str) -> str:
    """Without the frames of rich and its line ends, as one line."""
    return re.sub(r"[\s│╭╮╰╯─]+", " ", text).strip()


SITE = """\
schema: 1
name: A building
controllers:
  plc: {{host: 127.0.0.1, port: {port}, map: generic-registers}}
lifts:
  main:
    controller: plc
    access: control
    floors: {{G: 1, First: 2, Second: 3}}
"""


GOOD = SITE.format(port=5020)

FILES: dict[str, bytes] = {
    "good.yaml": GOOD.encode(),
    "three.yaml": GOOD.replace("Second: 3", "Second: 2, 3: 3").replace("access: control", "poll_s: 5").encode(),
    "one.yaml": GOOD.replace("Second: 3", "Second: 2").encode(),
    "required.yaml": f"{GOOD}state: kept\nrequire_checkout: true\n".encode(),
    "program.yaml": b"\x7fELF\x02\x01\x01\x00\xff\xfe\xd0",
    "empty.yaml": b"",
    "tabs.yaml": b"schema: 1\nname: x\nlifts:\n\tmain: 1\n",
    "prose.yaml": b"# A building\n\nSome *words*: and: more\n",
    "unknown-map.yaml": GOOD.replace("generic-registers", "generic").encode(),
    "long.yaml": b"#" * 1_000_001,
}

BAD_FILES = {
    "none.yaml": "none.yaml: there is no such file",
    "program.yaml": "program.yaml:1: byte 0xFF is not UTF-8",
    "empty.yaml": "empty.yaml: the file is empty",
    "tabs.yaml": "tabs.yaml:4: tab; use spaces",
    "prose.yaml": "prose.yaml:3: ",
    "unknown-map.yaml": "unknown-map.yaml:4: controllers.plc.map: generic: no map has this name",
    "long.yaml": "long.yaml: has 1000001 bytes and was not read",
    "one.yaml": "one.yaml:9: lifts.main.floors.Second: code 2 is floor First already",
    ".": ".: is a directory, not a file",
}
BAD_CALLS = [("check", file) for file in BAD_FILES] + [("serve", file) for file in ("none.yaml", "one.yaml")]

BAD_SIMULATIONS: list[tuple[str, list[str]]] = [
    ("generic-register", ["no map has this name", "did you mean `generic-registers`?", "two-stop-agv"]),
    ("./nowhere.yaml", ["nowhere.yaml: there is no such file"]),
    ("generic-registers --floors L1=one,L2=2", ["--floors", "'L1=one'", "NAME=CODE"]),
    ("generic-registers --floors =1,L2=2", ["--floors", "'=1'", "NAME=CODE"]),
    ("generic-registers --floors L1=1", ["--floors", "two floors or more"]),
    ("generic-registers --floors L1=1,L2=2,L1=3", ["--floors", "L1", "twice"]),
    ("generic-registers --floors L1=1,L2=1", ["--floors", "code 1", "L1"]),
    ("generic-registers --floors L1=1,L2=99999", ["99999 does not fit"]),
    ("generic-registers --floors L0=0,L1=1", ["rests at 0"]),
    ("two-stop-agv --floors L1=0,L2=1,L3=2", ["2 floors, with codes 0 to 1"]),
    ("generic-registers --speed 0", ["--speed", "0.1"]),
    ("generic-registers --host no.such.host.invalid", ["no.such.host.invalid", "--host"]),
]

HELP = {
    "": ["Connect robots to real lifts", "demo", "serve", "check", "simulate", "maps"],
    "demo": ["three simulated lifts", "--port", "5003", "--speed", "--panel", "--no-panel"],
    "serve": ["Run the lift manager", "SITE", "--port"],
    "check": ["Find every", "FILE", "Exits 2"],
    "lifts": ["running manager", "--json", "--follow", "--manager", "--key-file"],
    "ride": [
        "LIFT",
        "FROM",
        "TO",
        "Ctrl-C cancels",
        "--robot",
        "--yes",
        "--manager",
        "--key-file",
        "5 the ride goes on",
    ],
    "ack": ["checked after a fire", "LIFT", "--by", "--manager"],
    "lockout": ["Keep robots off", "LIFT", "--by", "--reason", "--end", "--now", "--manager"],
    "drain": ["Let present sessions end", "LIFT", "--all", "--by", "--reason", "--end", "--manager"],
    "simulate": [
        "one simulated lift",
        "MAP",
        "--port",
        "5020",
        "--host",
        "--floors",
        "L1=1,L2=2",
        "--speed",
        "--panel",
    ],
}

CALLS: list[tuple[str, ...]] = [
    ("check", "good.yaml"),
    ("check", "three.yaml"),
    ("check", "required.yaml"),
    ("serve", "required.yaml", "--port", "0"),
    ("check", str(MAPS / "two-stop-agv.yaml")),
    *BAD_CALLS,
    *(("simulate", "--port", "0", *given.split()) for given, _ in BAD_SIMULATIONS),
    *((*filter(None, [command]), "--help") for command in HELP),
    (),
    ("simulat",),
]

OF_THEIR_OWN = [*CALLS[:3], ("check", "one.yaml")]
"""In a process each: whole findings, in the narrowest terminal, whose width is read once. The others only differ in their words."""

Answers = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> Answers:
    """What each of CALLS came to."""
    folder = tmp_path_factory.mktemp("files")
    for name, content in FILES.items():
        (folder / name).write_bytes(content)
    runs = dict(zip(OF_THEIR_OWN, run_each(OF_THEIR_OWN, folder), strict=True))
    with chdir(folder):
        runs |= {words: call(*words) for words in CALLS if words not in runs}

    def answer(*call: str) -> subprocess.CompletedProcess[str]:
        done = runs[call]
        assert "Traceback" not in done.stdout + done.stderr, done.stderr
        return done

    return answer


@pytest.fixture
def taken() -> Iterator[int]:
    """A port that somebody else listens on."""
    with socket.create_server(("127.0.0.1", 0)) as other:
        yield other.getsockname()[1]


def state_folder() -> Path:
    """Where the site of `good.yaml` has its files, on the computer of this test run."""
    return store_path("A building", None, Path("good.yaml"), os.environ).parent


def test_check_says_of_a_good_site_file_what_is_in_it_and_exits_with_0(answers: Answers) -> None:
    done = answers("check", "good.yaml")
    assert (done.returncode, done.stderr) == (0, "")
    missing = f"there is no checkout record of it in {state_folder()}"
    assert done.stdout.splitlines() == [
        "caution: main: map generic-registers is a template and was not taken from a real lift; compare every signal with the real lift",
        f"caution: main: robots may use it, and {missing}; test and sign it with `lift-manager checkout good.yaml main`",
        "main: control, floors G, First, Second, map generic-registers (template)",
        "good.yaml: no mistakes",
    ]


def test_check_also_takes_a_register_map(answers: Answers) -> None:
    path = str(MAPS / "two-stop-agv.yaml")
    done = answers("check", path)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[-1] == f"{path}: map two-stop-agv (integration-code): no mistakes"


def test_check_prints_every_mistake_with_file_line_and_key_counts_them_and_exits_with_2(answers: Answers) -> None:
    done = answers("check", "three.yaml")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.splitlines() == [
        "three.yaml:8: lifts.main.poll_s: a poll every 5 s is too slow for max_age_s 1: one lost poll would take the lift offline",
        'three.yaml:9: lifts.main.floors.3: YAML reads 3 as a number; quote it: "3"',
        "three.yaml:9: lifts.main.floors.Second: code 2 is floor First already",
        "3 mistakes",
    ]


@each_row(("call", "code"), [(("check", "required.yaml"), 2), (("serve", "required.yaml", "--port", "0"), 1)])
def test_a_site_that_requires_a_checkout_record_is_refused_without_one(
    answers: Answers, call: tuple[str, ...], code: int
) -> None:
    done = answers(*call)
    assert (done.returncode, done.stdout) == (code, "")
    assert "there is no checkout record of it in " in done.stderr
    assert "test and sign it with `lift-manager checkout required.yaml main`, or use `access: monitor`" in done.stderr


@each_row("call", BAD_CALLS)
def test_a_bad_file_gets_one_sentence_and_exit_code_2(answers: Answers, call: tuple[str, str]) -> None:
    done = answers(*call)
    assert (done.returncode, done.stdout) == (2, "")
    first, last = done.stderr.splitlines()
    assert first.startswith(BAD_FILES[call[1]])
    assert last == "1 mistake"


@each_row(("given", "words"), BAD_SIMULATIONS)
def test_simulate_says_what_is_wrong_with_what_it_is_given(answers: Answers, given: str, words: list[str]) -> None:
    done = answers("simulate", "--port", "0", *given.split())
    assert done.returncode in (1, 2)
    assert done.stdout == ""
    for word in words:
        assert word in plain(done.stderr)


@each_row("command", HELP)
def test_help_names_every_option_and_says_what_the_command_is_for(answers: Answers, command: str) -> None:
    done = answers(*filter(None, [command]), "--help")
    assert (done.returncode, done.stderr) == (0, "")
    for word in HELP[command]:
        assert word in plain(done.stdout)


def test_without_a_command_the_help_is_shown(answers: Answers) -> None:
    assert "simulate" in plain(answers().stdout)


def test_an_unknown_command_is_named_with_the_nearest_one(answers: Answers) -> None:
    done = answers("simulat")
    assert done.returncode == 2
    assert "simulate" in plain(done.stderr)


def test_demo_says_in_one_sentence_that_its_port_is_taken(taken: int) -> None:
    done = run("demo", "--port", str(taken))
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    assert f"port {taken} on 127.0.0.1 is in use" in line
    assert "--port" in line


def test_serve_says_in_one_sentence_that_the_port_of_its_site_file_is_taken(tmp_path: Path, taken: int) -> None:
    (tmp_path / "site.yaml").write_text(f"{GOOD}api: {{port: {taken}}}\n", "utf-8")
    done = run("serve", "site.yaml", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = [line for line in done.stderr.splitlines() if "WARNING" not in line]
    assert f"port {taken} on 127.0.0.1 is in use" in line
    assert "--port" in line


def test_simulate_says_in_one_sentence_that_its_port_is_taken(taken: int) -> None:
    done = run("simulate", "generic-registers", "--port", str(taken))
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    assert line == (
        f"port {taken} on 127.0.0.1 is in use by another program; stop that one, or choose another with --port"
    )


def test_a_simulated_controller_prints_its_registers_and_ends_quietly() -> None:
    with running("simulate", "generic-registers", "--port", "0", "--floors", "B1=-1, L1=1, L2=2") as program:
        port = int(program.says(r"127\.0\.0\.1:(\d+), unit 1")[1])
        program.says("Ctrl-C ends it")
        for name in ["car_floor", "door.front", "go_to", "hold_door.front", "holding:16", "Floors: B1 = -1, L1 = 1"]:
            assert name in program.out
        with socket.create_connection(("127.0.0.1", port), timeout=HANGS_S):
            code, _ = program.stop()
        assert (code, program.err) == (0, "")


def test_the_panel_of_a_simulated_lift_is_where_it_is_announced() -> None:
    with running("simulate", "generic-registers", "--port", "0", "--panel", "0") as program:
        panel = program.says(r"make faults: (http://127\.0\.0\.1:\d+/)")[1]
        controller = program.says(r"(127\.0\.0\.1:\d+), unit 1")[1]
        (lift,) = httpx.get(f"{panel}lifts", trust_env=False, timeout=HANGS_S).json()["lifts"]
        address = httpx.get(f"{panel}lifts/{lift}", trust_env=False, timeout=HANGS_S).json()["controllers"][""]
        assert f"{address['host']}:{address['port']}" == controller
        assert (program.stop()[0], program.err) == (0, "")


def test_a_panel_whose_port_is_taken_is_elsewhere_unless_the_port_was_given(taken: int) -> None:
    done = run("simulate", "generic-registers", "--port", "0", "--panel", str(taken))
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    assert f"port {taken} on 127.0.0.1 is in use" in line
    assert "--no-panel" in line
    with (
        running("simulate", "generic-registers", "--port", "0") as first,
        running("simulate", "generic-registers", "--port", "0") as second,
    ):
        panels = {program.says(r"make faults: (\S+)")[1] for program in (first, second)}
        assert len(panels) == 2


def test_there_is_no_panel_where_none_is_requested() -> None:
    with running("simulate", "generic-registers", "--port", "0", "--no-panel") as program:
        program.says("Ctrl-C ends it")
        assert "make faults" not in program.out
    for words in (["generic-registers", "--no-panel"], ["--replay", "recording.jsonl"]):
        done = call("simulate", *words, "--panel", "0")
        assert done.returncode == 2
        assert "--panel" in plain(done.stderr)


def test_a_simulated_controller_does_not_mind_a_client_that_talks_nonsense_or_leaves_in_the_middle() -> None:
    with running("simulate", "generic-registers", "--port", "0") as program:
        address = ("127.0.0.1", int(program.says(r"127\.0\.0\.1:(\d+), unit 1")[1]))
        for nonsense in [b"GET / HTTP/1.1\r\n\r\n", b"\x00\x01\x00\x00\x00\x06\x01\x03\x00"]:
            with socket.create_connection(address, timeout=HANGS_S) as client:
                client.sendall(nonsense)
        with socket.create_connection(address, timeout=HANGS_S) as client:
            client.sendall(bytes.fromhex("0007 0000 0006 01 03 0001 0001"))
            assert client.recv(64) == bytes.fromhex("0007 0000 0005 01 03 02 0001")
        code, _ = program.stop(signal.SIGINT)
        assert (code, program.err) == (0, "")


def test_every_word_of_the_help_leads_to_a_command_of_that_name() -> None:
    for word in COMMANDS:
        done = call(word, "--help")
        assert done.returncode == 0
        assert f" {word} " in done.stdout


def test_the_list_of_commands_shows_how_the_help_of_each_begins() -> None:
    listed = {word: line for summaries in SUMMARIES.values() for word, line in summaries.items()}
    assert {word: load_command(word).help.split("\n\n")[0] for word in COMMANDS} == listed


def test_the_list_of_commands_has_one_line_for_each_on_a_terminal_of_80_columns() -> None:
    lines = [line.strip("│ ") for line in call("--help").stdout.splitlines()]
    for summaries in SUMMARIES.values():
        for word, summary in summaries.items():
            assert f"{word:{max(map(len, COMMANDS))}}  {summary}" in lines


def test_the_list_of_commands_imports_none_of_them() -> None:
    program = (
        "import sys; from lift_manager.cli.main import app; from typer.testing import CliRunner;"
        "done = CliRunner().invoke(app, ['--help']); print(done.exit_code, 'pydantic' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "0 False"


def test_serve_refuses_workers_and_says_how_to_serve_more_lifts(tmp_path: Path) -> None:
    done = call("serve", tmp_path / "site.yaml", "--workers", "4")
    said = " ".join(done.stderr.replace("│", " ").split())
    assert done.returncode == 2
    assert "a site is served by one process" in said
    assert "divide the controllers between two site files, and run a manager for each of them" in said
    assert "--workers" not in call("serve", "--help").stdout


def test_a_word_to_a_running_manager_imports_neither_a_web_server_nor_a_driver() -> None:
    program = (
        "import sys; from lift_manager.cli.main import app; from typer.testing import CliRunner;"
        "CliRunner().invoke(app, ['ack', '--help']); print([name for name in ('fastapi', 'pymodbus') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "[]"


def test_the_version_is_that_of_the_package() -> None:
    done = call("--version")
    assert (done.returncode, done.stdout) == (0, f"lift-manager {version('lift-manager')}\n")


@each_row("written", ["127.0.0.1:{port}", "http://127.0.0.1:{port}", " localhost:{port}", "http://127.0.0.1:{port}/"])
def test_a_manager_is_found_by_host_and_port_or_by_a_url(written: str) -> None:
    with closing(socket.socket()) as nobody:
        nobody.bind(("127.0.0.1", 0))
        port = nobody.getsockname()[1]
        done = call("lifts", "--manager", written.format(port=port))
    assert done.returncode == 1
    assert (
        f"no manager answers at http://{'localhost' if 'localhost' in written else '127.0.0.1'}:{port} (" in done.stderr
    )


@each_row("written", ["ftp://lifts.example", "host:port", "http://user@host:1", "lifts.example:99999"])
def test_what_is_no_address_of_a_manager_is_refused_in_words(written: str) -> None:
    done = call("lifts", "--manager", written)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert "--manager" in done.stderr


def test_what_stops_a_manager_is_found_in_the_task_groups_around_it() -> None:
    taken = ControllerTaken("127.0.0.1:502", "7")
    assert first_error(ExceptionGroup("outer", [ExceptionGroup("inner", [taken])])) is taken
