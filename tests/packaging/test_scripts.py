"""The two commands of the README on machines of every kind; Python and pip are played by shell scripts here."""

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.support.rows import each_row

ROOT = Path(__file__).resolve().parents[2]

# Writes down how it was called, and makes an environment in which nothing is real.
FAKE_PYTHON = """#!/bin/sh
echo "python $*" >>"$LOG"
case "$*" in
    *version_info*) echo "{version}" ;;
    *ensurepip*) exit {no_venv} ;;
    *sysconfig*) exit {no_headers} ;;
    *hashlib*) exec "{real}" "$@" ;;
    "-m venv --clear "*)
        rm -rf "$4" && mkdir -p "$4/bin" && echo "#!$4/bin/python" >"$4/bin/pip"
        cp "$FAKES/venv-python" "$4/bin/python"
        sed -i "s/VERSION/{version}/" "$4/bin/python"
        cp "$FAKES/tool" "$4/bin/ruff" && cp "$FAKES/tool" "$4/bin/mypy" && cp "$FAKES/tool" "$4/bin/lint-imports"
        ;;
esac
"""
FAKE_VENV_PYTHON = """#!/bin/sh
echo "venv $*" >>"$LOG"
case "$*" in
    *version_info*) echo VERSION ;;
    "-m pip install"*)
        cp "$FAKES/lift-manager" "${0%/python}/lift-manager"
        exit "${PIP_EXITS:-0}"
        ;;
    "-m pytest -n"*)
        [ -z "${PYTEST_ENDS_THE_RUN:-}" ] || { until grep -q mypy "$LOG"; do :; done; kill "$PPID"; }
        exit "${PYTEST_EXITS:-0}"
        ;;
esac
"""
FAKE_TOOL = """#!/bin/sh
echo "${0##*/} $*" >>"$LOG"
[ "${0##*/}" != "${FAILING_TOOL:-}" ] || { echo "${0##*/} complains"; exit 1; }
"""
FAKE_LIFT_MANAGER = """#!/bin/sh
for word in "$@"; do echo "[$word]"; done
"""


@dataclass(frozen=True)
class Machine:
    """A checkout in a folder with a space in its name, and a folder of fake programs in front of PATH."""

    repo: Path
    fakes: Path
    log: Path

    def add(self, name: str, script: str) -> Path:
        path = self.fakes / name
        path.write_text(script)
        path.chmod(0o755)
        return path

    def add_python(self, name: str, *, version: str = "3.11", has_venv: bool = True, has_headers: bool = True) -> Path:
        lacks = {"no_venv": int(not has_venv), "no_headers": int(not has_headers)}
        script = FAKE_PYTHON.format(version=version, real=sys.executable, **lacks)
        return self.add(name, script)

    def run(
        self, script: str, *args: str, more: dict[str, str] | None = None, cwd: Path | None = None
    ) -> subprocess.CompletedProcess[str]:
        """Start a script; `log` then holds what happened in this start only."""
        self.log.write_text("")
        environment = {name: value for name, value in os.environ.items() if name != "LIFT_MANAGER_PYTHON"}
        environment |= {"LOG": str(self.log), "FAKES": str(self.fakes), "PATH": f"{self.fakes}:/usr/bin:/bin"}
        return subprocess.run(
            [self.repo / "scripts" / script, *args],
            cwd=cwd or self.fakes,
            env=environment | (more or {}),
            capture_output=True,
            text=True,
            check=False,
        )

    @property
    def installs(self) -> list[str]:
        """The files of versions that were installed; after each of them the repository itself, and nothing that it needs."""
        lines = self.lines("venv -m pip install")
        needs, itself = lines[::2], lines[1::2]
        assert all("--require-hashes --requirement" in line for line in needs)
        assert all(line.endswith(f"--no-deps --no-build-isolation --editable {self.repo}") for line in itself)
        return [line.rpartition("/")[2] for line in needs]

    def lines(self, start: str) -> list[str]:
        return [line for line in self.log.read_text().splitlines() if line.startswith(start)]


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    repo = tmp_path / "a lift"
    fakes = tmp_path / "fakes"
    fakes.mkdir()
    shutil.copytree(ROOT / "scripts", repo / "scripts")
    shutil.copytree(ROOT / "constraints", repo / "constraints")
    shutil.copy(ROOT / "pyproject.toml", repo)
    machine = Machine(repo=repo, fakes=fakes, log=tmp_path / "log")
    machine.add_python("python3")
    machine.add("venv-python", FAKE_VENV_PYTHON)
    machine.add("tool", FAKE_TOOL)
    machine.add("lift-manager", FAKE_LIFT_MANAGER)
    return machine


@each_row("path", ["scripts/demo", "scripts/test", "scripts/docs", "scripts/pin", ".ci/run"])
def test_the_commands_are_executable_and_free_of_syntax_errors(path: str) -> None:
    assert os.access(ROOT / path, os.X_OK)
    for script in (ROOT / path, ROOT / "scripts" / "lib.sh"):
        done = subprocess.run(["bash", "-n", script], capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")


def test_a_first_demo_says_one_line_installs_what_the_program_needs_and_starts_it(machine: Machine) -> None:
    done = machine.run("demo", "--port", "5010", "two words")
    assert (done.returncode, done.stdout) == (0, "[demo]\n[--port]\n[5010]\n[two words]\n")
    assert done.stderr == "Installing into .venv (first start, about a minute) ...\n"
    assert machine.installs == ["run.txt"]


def test_a_second_demo_installs_nothing_and_says_nothing(machine: Machine) -> None:
    machine.run("demo")
    done = machine.run("demo")
    assert (done.returncode, done.stdout, done.stderr) == (0, "[demo]\n", "")
    assert machine.lines("venv") == []
    assert machine.lines("python -m") == []


def test_a_demo_environment_is_completed_by_test_and_then_serves_both(machine: Machine) -> None:
    machine.run("demo")
    machine.run("test", "tests")
    assert machine.installs == ["dev.txt"]
    assert machine.lines("python -m venv") == []
    machine.run("demo")
    assert machine.installs == []
    machine.run("test", "tests")
    assert machine.installs == []


def test_what_changed_is_installed_into_the_same_environment(machine: Machine) -> None:
    machine.run("test", "tests")
    for changed in ("pyproject.toml", "constraints/run.txt", "constraints/dev.txt"):
        with (machine.repo / changed).open("a") as file:
            file.write("# changed\n")
        machine.run("demo")
        assert machine.installs == ["dev.txt"], f"{changed}: a test environment stays one"
        assert machine.lines("python -m venv") == []


def test_another_python_version_gets_a_new_environment(machine: Machine) -> None:
    machine.run("demo")
    machine.add_python("python3", version="3.13")
    machine.run("demo")
    assert len(machine.lines("python -m venv")) == 1
    assert len(machine.installs) == 1


def test_an_environment_made_by_hand_is_completed_and_not_thrown_away(machine: Machine) -> None:
    machine.run("demo")
    (machine.repo / ".venv" / "stamp").unlink()
    machine.run("demo")
    assert machine.lines("python -m venv") == []
    assert len(machine.installs) == 1


def test_an_interrupted_install_is_not_taken_for_a_ready_one(machine: Machine) -> None:
    done = machine.run("demo", more={"PIP_EXITS": "1"})
    assert done.returncode == 1
    assert "the next start tries again" in done.stderr
    done = machine.run("demo")
    assert (done.returncode, done.stdout) == (0, "[demo]\n")
    assert len(machine.lines("python -m venv")) == 1
    assert len(machine.installs) == 1


def test_an_interrupted_upgrade_is_not_taken_for_a_ready_one(machine: Machine) -> None:
    machine.run("demo")
    machine.run("test", "tests", more={"PIP_EXITS": "1"})
    machine.run("demo")
    assert len(machine.installs) == 1


def test_a_copied_folder_gets_an_environment_of_its_own(machine: Machine, tmp_path: Path) -> None:
    machine.run("demo")
    copy = Machine(repo=tmp_path / "a copy", fakes=machine.fakes, log=machine.log)
    shutil.copytree(machine.repo, copy.repo)
    assert copy.run("demo").returncode == 0
    assert len(copy.lines("python -m venv")) == 1


def test_the_commands_work_from_any_folder(machine: Machine, tmp_path: Path) -> None:
    for cwd in (tmp_path, machine.repo, machine.repo / "scripts", Path("/")):
        assert machine.run("demo", cwd=cwd).stdout == "[demo]\n"


@pytest.mark.parametrize("script", ["demo", "test"])
def test_an_old_python_is_answered_with_one_sentence_that_says_what_to_install(machine: Machine, script: str) -> None:
    machine.add_python("python3", version="3.9")
    done = machine.run(script, more={"LIFT_MANAGER_PYTHON": "python3"})
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "needs Python 3.11 or newer, but python3 is 3.9" in done.stderr
    assert "apt-get install python3 python3-venv" in done.stderr
    assert not (machine.repo / ".venv").exists()


@pytest.mark.parametrize("version", ["2.7", "3.10"])
def test_where_python3_is_too_old_a_newer_one_beside_it_is_used(machine: Machine, version: str) -> None:
    machine.add_python("python3", version=version)
    machine.add_python("python3.14", version="3.14")
    assert machine.run("demo").returncode == 0
    assert (machine.repo / ".venv" / "stamp").read_text().startswith("demo 3.14 ")


def test_no_python_at_all_is_answered_with_one_sentence_that_says_what_to_install(machine: Machine) -> None:
    done = machine.run("demo", more={"LIFT_MANAGER_PYTHON": "no-such-python"})
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "found no no-such-python" in done.stderr
    assert "apt-get install python3 python3-venv" in done.stderr


def test_a_missing_venv_module_is_answered_with_one_sentence_that_says_what_to_install(machine: Machine) -> None:
    machine.add_python("python3", has_venv=False)
    done = machine.run("demo")
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].endswith("its venv module is not installed: apt-get install python3-venv")
    assert not (machine.repo / ".venv").exists()


def test_the_interpreter_can_be_chosen_even_in_a_folder_with_a_space(machine: Machine) -> None:
    chosen = machine.repo / "my python"
    machine.add_python("python3", version="3.9").rename(machine.fakes / "old")
    machine.add_python("python3", version="3.12").rename(chosen)
    assert machine.run("demo", more={"LIFT_MANAGER_PYTHON": str(chosen)}).returncode == 0
    assert (machine.repo / ".venv" / "stamp").read_text().startswith("demo 3.12 ")


PYTEST = "venv -m pytest -n 6 --dist loadfile --no-loadscope-reorder"


def test_test_runs_the_linters_and_then_the_tests(machine: Machine) -> None:
    assert machine.run("test").returncode == 0
    ran = machine.log.read_text().splitlines()[-6:]
    assert ran[:3] == ["ruff check --quiet", "ruff format --check --quiet", "lint-imports "]
    assert [line for line in ran[3:] if line != "mypy "] == ["venv -m tests.support.compiled", PYTEST]
    assert ran.count("mypy ") == 1, "beside them"


def test_test_with_arguments_hands_them_to_the_tests_alone(machine: Machine) -> None:
    assert machine.run("test", "tests/drivers", "-k", "late").returncode == 0
    assert machine.log.read_text().splitlines()[-1] == "venv -m pytest tests/drivers -k late"
    assert machine.lines("ruff") == []


@pytest.mark.parametrize("tool", ["ruff", "mypy", "lint-imports"])
def test_a_linter_that_complains_does_not_hide_the_tests_but_fails_the_run(machine: Machine, tool: str) -> None:
    done = machine.run("test", more={"FAILING_TOOL": tool})
    assert done.returncode == 1
    assert f"{tool} complains\n" in done.stdout
    assert done.stderr.splitlines()[-1].startswith(f"Failed: {tool}")
    assert machine.lines("venv -m pytest") == [PYTEST]


def test_tests_that_fail_fail_the_run_and_what_mypy_says_stands_after_what_they_say(machine: Machine) -> None:
    done = machine.run("test", more={"PYTEST_EXITS": "1", "FAILING_TOOL": "mypy"})
    assert done.returncode == 1
    assert done.stderr.endswith("Failed: python -m, mypy\n")
    assert done.stdout.splitlines()[-1] == "mypy complains"


def test_a_run_that_is_ended_leaves_no_mypy_behind(machine: Machine) -> None:
    machine.run("test", "tests")  # makes the environment
    slow = machine.repo / ".venv" / "bin" / "mypy"
    slow.write_text('#!/bin/sh\necho "mypy $$" >>"$LOG"\nexec tail -f /dev/null\n')
    done = machine.run("test", more={"PYTEST_ENDS_THE_RUN": "yes"})
    assert done.returncode == 143
    (running,) = machine.lines("mypy")
    with pytest.raises(ProcessLookupError):
        os.kill(int(running.split()[1]), 0)


def test_what_ros_puts_into_the_environment_does_not_reach_the_program(machine: Machine) -> None:
    machine.add("lift-manager", '#!/bin/sh\necho "${PYTHONPATH-none}"\n')
    assert machine.run("demo", more={"PYTHONPATH": "/opt/ros"}).stdout == "none\n"


FAKE_APT = """#!/bin/sh
echo "apt-get $*" >>"$LOG"
case "$*" in
    update*) [ "${APT_FAILS:-no}" = no ] || [ "$(grep -c update "$LOG")" -gt 1 ] ;;
esac
"""


@pytest.fixture
def ci_machine(machine: Machine) -> Machine:
    """Where nothing is installed but a shell, apt and what the test adds."""
    shutil.copytree(ROOT / ".ci", machine.repo / ".ci")
    tests = machine.repo / "scripts" / "test"
    tests.write_text('#!/bin/sh\necho "tests $#" >>"$LOG"\nexit "${TESTS_EXIT:-0}"\n')
    for name in ("bash", "sh", "env", "dirname", "grep"):
        (machine.fakes / name).symlink_to(shutil.which(name) or name)
    machine.add("apt-get", FAKE_APT)
    machine.add("sleep", "#!/bin/sh\n")
    return machine


def run_ci(machine: Machine, **more: str) -> subprocess.CompletedProcess[str]:
    return machine.run("../.ci/run", more={"PATH": str(machine.fakes), **more})


def test_ci_installs_what_is_missing_and_runs_the_command_of_the_readme(ci_machine: Machine) -> None:
    ci_machine.add_python("python3", has_venv=False, has_headers=False)
    ci_machine.add("tshark", FAKE_TOOL)
    done = run_ci(ci_machine)
    assert done.returncode == 0, done.stderr
    assert ci_machine.lines("apt-get")[-1].endswith(
        " python3 python3-venv curl mbpoll openssl stunnel4 strace chromium iproute2 nftables etcd-server etcd-client gcc libc6-dev python3-dev"
    )
    assert ci_machine.lines("tests") == ["tests 0"]


def test_ci_asks_nothing_of_apt_when_everything_is_there(ci_machine: Machine) -> None:
    for name in (
        "curl",
        "mbpoll",
        "openssl",
        "stunnel4",
        "strace",
        "tshark",
        "chromium",
        "ip",
        "nft",
        "etcd",
        "etcdctl",
        "cc",
    ):
        ci_machine.add(name, FAKE_TOOL)
    assert run_ci(ci_machine).returncode == 0
    assert ci_machine.lines("apt-get") == []


def test_ci_asks_apt_a_second_time_when_it_fails(ci_machine: Machine) -> None:
    assert run_ci(ci_machine, APT_FAILS="once").returncode == 0
    assert len(ci_machine.lines("apt-get update")) == 2
    assert ci_machine.lines("tests") == ["tests 0"]


def test_ci_fails_when_the_tests_fail(ci_machine: Machine) -> None:
    assert run_ci(ci_machine, TESTS_EXIT="3").returncode == 3
