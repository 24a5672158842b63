"""What is installed: every transition, and every point at which the computer may lose its power."""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import pytest

from lift_manager.config.load import load_site
from lift_manager.hub.errors import UpdateRefused
from lift_manager.hub.update.installation import Installation
from lift_manager.hub.update.installed import (
    MOST_STARTS,
    Hold,
    Installed,
    Version,
    apply,
    prove,
    roll_back,
    start,
    without_notes,
)
from lift_manager.hub.update.stage import stage
from tests.lift_manager.hub.update.office import Office, served

HOLD = Hold(why="update 7 changes its map", number=7, tested="")
SEVEN = Installed(
    current=Version(number=7, made_by="M. Weber", signed_by="office.pub", held={"goods": HOLD}), highest=7
)
EIGHT = Version(number=8, made_by="M. Weber", signed_by="office.pub")


def test_an_update_is_on_trial_until_it_is_proven() -> None:
    trial = apply(SEVEN, EIGHT, ("goods",), "r1")
    assert (trial.current.number, trial.on_trial, trial.live, trial.highest) == (8, True, ("goods",), 8)
    proven = prove(start(trial))
    assert (proven.current.number, proven.on_trial, proven.starts) == (8, False, 0)
    assert proven.before == SEVEN.current


def test_going_back_brings_back_which_lifts_were_only_watched_and_forgets_no_number() -> None:
    back = roll_back(apply(SEVEN, EIGHT, (), "r1"), "goods cannot be read")
    assert back.current == SEVEN.current
    assert (back.on_trial, back.before, back.highest) == (False, None, 8)
    assert back.failed is not None
    assert (back.failed.number, back.failed.rollout, back.failed.what) == (8, "r1", "rolled back")
    with pytest.raises(ValueError, match="no version to go back to"):
        roll_back(back, "again")


def test_a_version_that_does_not_stay_up_is_rolled_back_without_the_hub() -> None:
    installed = apply(SEVEN, EIGHT, (), "r1")
    for _ in range(MOST_STARTS):
        installed = start(installed)
        assert installed.on_trial
    assert start(installed).current == SEVEN.current


def test_starts_count_only_during_a_trial() -> None:
    assert start(SEVEN) == SEVEN
    proven = prove(apply(SEVEN, EIGHT, (), "r1"))
    assert start(proven) == proven


def test_what_happened_is_noted_for_the_journal_with_who_signed_it() -> None:
    held = EIGHT.model_copy(update={"held": {"goods": HOLD}})
    applied = apply(SEVEN, held, (), "r1")
    assert "update 8, made by M. Weber and signed with office.pub, is applied in place of update 7" in applied.notes[0]
    assert "goods is only watched until it is tested: update 7 changes its map" in applied.notes[0]
    assert "update 8 is rolled back, and update 7 is in its place: it hangs" in roll_back(applied, "it hangs").notes[1]
    assert without_notes(applied).notes == ()


def run(steps: Iterator[None], most: int) -> bool:
    """Take this many steps, and lose the power; returns whether there were more."""
    return len(list(islice(steps, most))) == most


def test_a_loss_of_power_at_any_step_leaves_one_whole_configuration(office: Office) -> None:
    installation = office.installation()
    staged = stage(office.package(8, office.site(timezone="Europe/Berlin")), installation, served)
    before = installation.read()
    steps, seen = 0, []
    while True:
        installation.write(before)
        if not (installation.folder / "8").exists():
            staged = stage(office.package(8, office.site(timezone="Europe/Berlin")), installation, served)
        goes_on = run(installation.writing(apply(before, staged, (), "r1")), steps)
        restarted = Installation(installation.folder)
        restarted.settle()
        number = restarted.read().current.number
        zone = load_site(restarted.site_file).site.timezone
        assert (number, zone) in {(0, None), (8, "Europe/Berlin")}
        seen.append(number)
        if not goes_on:
            break
        steps += 1
    # the first step decides, because what is installed is one file
    assert seen == [0, *[8] * steps]
    assert steps >= 3


def test_a_loss_of_power_while_going_back_leaves_one_whole_configuration(office: Office) -> None:
    installation = office.installation()
    site = office.site(timezone="Europe/Berlin")
    for steps in range(5):
        number = 8 + steps
        installation.write(
            apply(installation.read(), stage(office.package(number, site), installation, served), (), "r1")
        )
        assert load_site(installation.site_file).site.timezone == "Europe/Berlin"
        run(installation.writing(roll_back(installation.read(), "a test")), steps)
        restarted = Installation(installation.folder)
        restarted.settle()
        if steps == 0:
            assert restarted.read().on_trial
            restarted.write(roll_back(restarted.read(), "a test"))
        assert load_site(restarted.site_file).site.timezone is None
        assert not (installation.folder / str(number)).exists()


def test_what_was_being_checked_is_removed_at_the_next_start(office: Office) -> None:
    installation = office.installation()
    installation.unpack({"site.yaml": b"half"})
    installation.incoming.write_bytes(b"half")
    installation.settle()
    assert {path.name for path in installation.folder.iterdir()} == {"0", "current", "installed.json"}


def test_one_manager_at_a_time_runs_with_a_folder(office: Office) -> None:
    installation = office.installation()
    with (
        installation.claimed(),
        pytest.raises(UpdateRefused, match="a manager runs with"),
        Installation(installation.folder).claimed(),
    ):
        pass
    with Installation(installation.folder).claimed():
        pass


def test_a_folder_that_others_can_write_to_is_refused(office: Office) -> None:
    installation = office.installation()
    installation.folder.chmod(0o777)
    with pytest.raises(UpdateRefused, match="can be written by others"):
        installation.read()


def test_a_damaged_record_is_named_with_what_to_do(office: Office) -> None:
    installation = office.installation()
    (installation.folder / "installed.json").write_text("{")
    with pytest.raises(UpdateRefused, match="restore a copy of it"):
        installation.read()


def test_a_site_file_belongs_to_the_installation_in_whose_current_folder_it_is(office: Office, tmp_path: Path) -> None:
    installation = office.installation()
    found = Installation.of(installation.site_file)
    assert found is not None
    assert found.folder == installation.folder
    assert Installation.of(tmp_path / "site.yaml") is None
    (tmp_path / "current").mkdir()
    assert Installation.of(tmp_path / "current" / "site.yaml") is None
