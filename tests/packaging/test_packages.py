"""What is in deploy/: the commands that build packages, and what these do on a machine that has a manager running."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml

from lift_manager.hub.folder import HubFolder
from tests.support.programs import HANGS_S, ROOT, eventually, free_port, running
from tests.support.rows import each_row

DEPLOY = ROOT / "deploy"
DEBIAN = DEPLOY / "deb" / "debian"
COMMANDS = [
    "deb/build",
    "deb/test",
    "wheelhouse/build",
    "wheelhouse/install",
    "wheelhouse/test",
    "release/check",
    "container/test",
]
SCRIPTS = [*COMMANDS, "lib.sh", *(f"deb/debian/{name}" for name in ("lift-manager.postinst", "lift-manager.postrm", "runtime.prerm"))]  # fmt: skip


@each_row("name", SCRIPTS)
def test_the_scripts_are_free_of_syntax_errors_and_the_commands_executable(name: str) -> None:
    done = subprocess.run(["sh", "-n", DEPLOY / name], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert os.access(DEPLOY / name, os.X_OK) is (name in COMMANDS)


# -- the Debian packages


def test_the_debian_unit_runs_the_files_of_its_version_and_waits_for_a_site_file(tmp_path: Path) -> None:
    (edits,) = re.findall(
        r"\tsed (-e '1d'.*?) \\\n\t    lift-manager\.service", (DEBIAN / "rules").read_text(), re.DOTALL
    )
    command = f"sed {edits} lift-manager.service".replace("\\\n", " ").replace("$$", "$")
    command = command.replace("$(place)", "/usr/lib/lift-manager/1.2-1")
    shutil.copy(DEPLOY / "systemd" / "lift-manager.service", tmp_path)
    made = subprocess.run(["sh", "-c", command], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    program = "/usr/lib/lift-manager/1.2-1/bin/python -I -m lift_manager"
    assert f"\nExecStart={program} serve /etc/lift-manager/site.yaml $LIFT_MANAGER_OPTIONS\n" in made
    assert "\nConditionPathExists=/etc/lift-manager/site.yaml\n" in made
    assert "\nEnvironmentFile=-/etc/default/lift-manager\n" in made
    assert "/opt/" not in made
    assert made.startswith("[Unit]\n")


def maintainer_script(name: str, tmp_path: Path, *words: str, active: bool = True) -> subprocess.CompletedProcess[str]:
    """Run a maintainer script for version 1.2-1 with programs that write down how they are called."""
    script = tmp_path / name
    text = (DEBIAN / name).read_text().replace("@PACKAGE@", "1.2-1")
    # a computer with systemd and the folders of the state
    text = text.replace("/run/systemd/system", str(tmp_path)).replace("/var/lib/", f"{tmp_path}/lib/")
    script.write_text(text)
    for program in ("systemctl", "adduser", "install", "getent", "chmod"):
        fake = tmp_path / program
        fake.write_text(
            f'#!/bin/sh\necho "{program} $*" >>{tmp_path}/called\nexit {1 if not active and program in ("systemctl", "getent") else 0}\n'
        )
        fake.chmod(0o755)
    environment = {"PATH": f"{tmp_path}:/usr/bin:/bin"}
    return subprocess.run(["sh", script, *words], env=environment, capture_output=True, text=True, check=False)


def called(tmp_path: Path, program: str) -> list[str]:
    return [line for line in (tmp_path / "called").read_text().splitlines() if line.startswith(program)]


def test_an_upgrade_leaves_a_manager_that_runs_alone_and_says_how_to_change_over(tmp_path: Path) -> None:
    done = maintainer_script("lift-manager.postinst", tmp_path, "configure", "1.1-1")
    assert done.returncode == 0, done.stderr
    assert called(tmp_path, "systemctl") == [
        f"systemctl --quiet is-active {name}.service" for name in ("lift-manager", "lift-manager-hub")
    ]
    assert "the hub that runs is still the one before" in done.stdout
    assert "1.2-1 is installed. The manager that runs is still the one before, and goes on" in done.stdout
    assert "lift-manager drain --all --by NAME --reason upgrade" in done.stdout
    # what debhelper adds neither stops nor starts anything
    rules = (DEBIAN / "rules").read_text()
    assert "dh_installsystemd --package=lift-manager --no-start --no-stop-on-upgrade lift-manager.service" in rules


def test_a_first_installation_makes_the_users_and_starts_nothing(tmp_path: Path) -> None:
    done = maintainer_script("lift-manager.postinst", tmp_path, "configure", "", active=False)
    assert "write /etc/lift-manager/site.yaml" in done.stdout
    assert {line.split(" ", 1)[1] for line in called(tmp_path, "systemctl")} == {
        f"--quiet is-active {name}.service" for name in ("lift-manager", "lift-manager-hub")
    }
    users = ["lift-manager", "lift-manager-hub", "lift-manager-leaf"]
    assert [line.split()[-1] for line in called(tmp_path, "adduser")] == [*users, "lift-manager-filter"]
    folders = [f"install -d -m 700 -o {user} -g {user} {tmp_path}/lib/{user}" for user in users]
    assert called(tmp_path, "install") == folders


def test_the_units_of_a_hub_and_a_cluster_are_in_the_package_and_a_person_enables_them(tmp_path: Path) -> None:
    rules = (DEBIAN / "rules").read_text()
    (listed,) = re.findall(r"^units := (.*)$", rules, re.MULTILINE)
    assert {f"{name}.service" for name in (*listed.split(), "lift-manager")} == {
        path.name for path in (DEPLOY / "systemd").iterdir()
    }
    assert "dh_installsystemd --package=lift-manager --name=$$unit --no-enable --no-start --no-stop-on-upgrade" in rules
    (loop,) = re.findall(r"^\t(for unit in \$\(units\); do \\\n\t    sed .*?done)$", rules, re.DOTALL | re.MULTILINE)
    command = loop.replace("\\\n", " ").replace("$$", "$").replace("$(units)", listed)
    command = command.replace("$(place)", "/usr/lib/lift-manager/1.2-1")
    shutil.copytree(DEPLOY / "systemd", tmp_path, dirs_exist_ok=True)
    (tmp_path / "debian").mkdir()
    subprocess.run(["sh", "-c", command], cwd=tmp_path, check=True)
    made = {name: (tmp_path / "debian" / f"lift-manager.{name}.service").read_text() for name in listed.split()}
    assert all(text.startswith("[Unit]\n") for text in made.values())
    program = "/usr/lib/lift-manager/1.2-1/bin/python -I -m lift_manager"
    assert f"\nExecStart={program} hub --folder /var/lib/lift-manager-hub\n" in made["lift-manager-hub"]
    filtering = f"\nExecStart={program} cluster packet-filter /etc/lift-manager/site.yaml --user lift-manager\n"
    assert filtering in made["lift-manager-packet-filter"]


@contextmanager
def process_named(name: str) -> Iterator[None]:
    """Run a process with this as its first word."""
    script = f'exec -a "{name}" {sys.executable} -c "import sys; print(1, flush=True); sys.stdin.read()"'
    with subprocess.Popen(["bash", "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        yield
        process.communicate()


def test_the_files_of_a_manager_that_runs_are_not_removed(tmp_path: Path) -> None:
    version = f"/usr/lib/lift-manager/1.2-1-{os.getpid()}/bin/python"
    script = tmp_path / "prerm"
    script.write_text((DEBIAN / "runtime.prerm").read_text().replace("@PACKAGE@", version.split("/")[4]))
    with process_named(version):
        done = subprocess.run(["sh", script, "remove"], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "a lift manager runs from" in done.stderr
    for word in ("remove", "upgrade"):
        assert subprocess.run(["sh", script, word], check=False).returncode == 0


def test_needrestart_is_kept_from_restarting_a_manager() -> None:
    settings = (DEBIAN / "needrestart" / "lift-manager.conf").read_text()
    assert "$nrconf{override_rc}{qr(^lift-manager)} = 0;" in settings
    assert "needrestart/lift-manager.conf etc/needrestart/conf.d" in (DEBIAN / "lift-manager.install").read_text()


# -- the archive that installs without a network


@pytest.fixture
def house(tmp_path: Path) -> Path:
    """An unpacked archive for this computer, with nothing to install."""
    house = tmp_path / "house"
    (house / "wheels").mkdir(parents=True)
    shutil.copy(DEPLOY / "wheelhouse" / "install", house)
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    (house / "about").write_text(f"number=1.2\nmachine={os.uname().machine}\npython={python}\n")
    (house / "requirements.txt").write_text("nothing==1 --hash=sha256:00\n")
    subprocess.run(
        "find . -type f | xargs sha256sum >../sums && mv ../sums SHA256SUMS", shell=True, cwd=house, check=True
    )
    return house


def install_refused(house: Path, target: Path, first: Path = Path(sys.executable).parent) -> str:
    environment = {"PATH": f"{first}:/usr/bin:/bin"}
    done = subprocess.run([house / "install", target], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    return done.stderr


def test_an_archive_for_another_computer_or_another_python_is_refused_in_a_sentence(
    house: Path, tmp_path: Path
) -> None:
    about = (house / "about").read_text()
    (house / "about").write_text(about.replace(os.uname().machine, "sparc"))
    assert f"This archive is for sparc, and this computer is {os.uname().machine}" in install_refused(
        house, tmp_path / "x"
    )
    (house / "about").write_text(re.sub(r"python=.*", "python=3.99", about))
    assert "This archive is for Python 3.99, which is not here: apt-get install" in install_refused(
        house, tmp_path / "x"
    )


def test_an_archive_that_was_damaged_on_the_way_installs_nothing(house: Path, tmp_path: Path) -> None:
    (house / "requirements.txt").write_text("another\n")
    assert "This archive is not as it was made" in install_refused(house, tmp_path / "x")
    assert not (tmp_path / "x").exists()


def test_a_folder_from_which_a_manager_may_run_is_not_touched(house: Path, tmp_path: Path) -> None:
    (tmp_path / "x").mkdir()
    said = install_refused(house, tmp_path / "x")
    assert (
        f"{tmp_path / 'x'} is there already, and a manager may run from it. Install beside it, such as in {tmp_path / 'x'}-1.2"
        in said
    )
    assert list((tmp_path / "x").iterdir()) == []


def test_a_failed_installation_leaves_nothing_behind(house: Path, tmp_path: Path) -> None:
    # what installs nothing here need not take four seconds to install pip
    python = f"python{sys.version_info.major}.{sys.version_info.minor}"
    (tmp_path / python).write_text(
        f'#!/bin/sh\n[ "$1" = -c ] || set -- "$@" --without-pip\nexec "{sys.executable}" "$@"\n'
    )
    (tmp_path / python).chmod(0o755)
    assert f"{tmp_path / 'x'} was removed again" in install_refused(house, tmp_path / "x", first=tmp_path)
    assert not (tmp_path / "x").exists()


# -- the container


def healthy(url: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-I", str(DEPLOY / "container" / "healthy.py")]
    environment = {"LIFT_MANAGER_HEALTH_URL": url}
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=HANGS_S, check=False)


def test_the_health_check_is_about_the_manager_and_not_about_its_controllers(tmp_path: Path) -> None:
    port = free_port()
    silent = healthy(f"http://127.0.0.1:{port}/healthz")
    assert silent.returncode == 1
    assert silent.stderr.startswith("the manager does not answer: ")
    lift = {"controller": "plc", "floors": {"L1": 1, "L2": 2}}
    site = {
        "schema": 1,
        "name": "container",
        "state": "kept",
        "controllers": {"plc": {"host": "127.0.0.1", "port": free_port(), "map": "generic-registers"}},
        "lifts": {"main": lift},
    }
    (tmp_path / "site.yaml").write_text(json.dumps(site))
    with running("serve", tmp_path / "site.yaml", "--port", str(port)):
        eventually(lambda: healthy(f"http://127.0.0.1:{port}/healthz").returncode == 0)


def services(folder: str = "container") -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load((DEPLOY / folder / "compose.yaml").read_text())["services"]
    return found


def test_the_containers_can_write_and_do_no_more_than_they_need() -> None:
    for name, service in services().items():
        assert service["cap_drop"] == ["ALL"], name
        assert service["security_opt"] == ["no-new-privileges:true"], name
        assert all(port.startswith("127.0.0.1:") for port in service["ports"]), name
    assert services()["lift-manager"]["read_only"]
    lines = (DEPLOY / "container" / "Containerfile").read_text().splitlines()
    assert "USER 10001:10001" in lines
    assert any(line.startswith("HEALTHCHECK ") for line in lines)


def test_every_file_that_compose_mounts_from_the_repository_is_there() -> None:
    made_by_people = {"./site", "./secrets/prometheus.key"}
    volumes = [volume.split(":")[0] for service in services().values() for volume in service.get("volumes", ())]
    mounted = [source for source in volumes if source.startswith(".") and source not in made_by_people]
    assert mounted
    assert [source for source in mounted if not (DEPLOY / "container" / source).is_file()] == []


def test_the_dashboard_of_compose_reads_from_its_prometheus() -> None:
    (_, _, command) = services()["grafana"]["entrypoint"]
    edit = re.search(r"sed '(.*?)'", command.replace("$$", "$"))
    assert edit is not None
    dashboard = DEPLOY / "grafana" / "lift-manager.json"
    made = subprocess.run(["sed", edit[1], dashboard], capture_output=True, text=True, check=True).stdout
    assert "${DS_" not in made
    (source,) = yaml.safe_load((DEPLOY / "container" / "grafana" / "datasource.yaml").read_text())["datasources"]
    assert f'"value": "{source["uid"]}"' in made
    assert json.loads(made)["uid"] == "lift-manager"


def test_prometheus_of_compose_scrapes_what_the_manager_listens_on() -> None:
    (job,) = yaml.safe_load((DEPLOY / "container" / "prometheus.yml").read_text())["scrape_configs"]
    assert job["static_configs"] == [{"targets": ["lift-manager:5003"]}]
    mounted = services()["prometheus"]["volumes"]
    assert any(volume.endswith(f":{job['authorization']['credentials_file']}:ro") for volume in mounted)


HUB_FOLDER = DEPLOY / "container" / "hub"


def test_the_containers_of_a_hub_can_write_its_folder_and_nothing_else() -> None:
    for name, service in services("container/hub").items():
        assert service["read_only"], name
        assert service["cap_drop"] == ["ALL"], name
        assert service["security_opt"] == ["no-new-privileges:true"], name
        assert service["volumes"] == (["./hub:/hub"] if name == "hub" else ["./hub:/hub:ro"])
        # on this computer alone, unless somebody says another address
        assert all(re.match(r"127\.0\.0\.1:|\$\{LEAF_HOST:-127\.0\.0\.1\}:", port) for port in service["ports"]), name


def test_the_hub_and_the_servers_of_compose_find_each_other(tmp_path: Path) -> None:
    shutil.copy(HUB_FOLDER / "hub.yaml", tmp_path)
    settings = HubFolder(tmp_path).settings().nats
    servers = {name: service for name, service in services("container/hub").items() if name != "hub"}
    assert [url.partition("://")[2] for url in settings.servers] == [f"{name}:4222" for name in servers]
    routes = re.findall(r"tls://(\w+):6222", (DEPLOY / "nats" / "server.conf").read_text())
    assert routes == list(servers)
    assert {service["environment"]["NATS_NAME"] for service in servers.values()} == set(servers)
    published = [port.rpartition("}:")[2] for service in servers.values() for port in service["ports"]]
    assert published == [f"{address.rpartition(':')[2]}:7422" for address in settings.address]
