"""Every name of the vocabulary has its meaning in plain words."""

from register_maps.meanings import COMMAND_MEANINGS, SIGNAL_MEANINGS
from register_maps.vocabulary import COMMANDS, SIGNALS
from tests.support.rows import each_row

ALL = [*SIGNAL_MEANINGS.items(), *COMMAND_MEANINGS.items()]


def test_every_signal_has_a_meaning_and_nothing_else_has() -> None:
    assert set(SIGNAL_MEANINGS) == set(SIGNALS)


def test_every_command_has_a_meaning_and_nothing_else_has() -> None:
    assert set(COMMAND_MEANINGS) == set(COMMANDS)


def test_no_two_names_mean_the_same() -> None:
    meanings = [meaning for _, meaning in ALL]
    assert len(set(meanings)) == len(meanings)


@each_row(("name", "meaning"), ALL)
def test_a_meaning_is_a_phrase_that_fits_into_a_cell_and_does_not_repeat_the_name(name: str, meaning: str) -> None:
    assert 8 <= len(meaning) <= 110
    assert meaning == meaning.strip()
    assert not meaning.endswith(".")
    assert "_" not in meaning
    assert meaning != name.replace("_", " ")
