"""A table in one test: every row is tried, and those that fail are named."""

import pytest

from tests.support.rows import each_row


def test_every_row_that_fails_is_named_and_the_others_are_tried_all_the_same() -> None:
    tried = []

    @each_row("left, right", [(1, 1), (1, 2), (3, 3), (3, 4)])
    def alike(left: int, right: int) -> None:
        tried.append((left, right))
        assert left == right

    with pytest.raises(ExceptionGroup, match="2 of 4 rows") as caught:
        alike()
    assert [error.__notes__ for error in caught.value.exceptions] == [["in the row (1, 2)"], ["in the row (3, 4)"]]
    assert len(tried) == 4


def test_an_error_that_does_not_come_is_a_failure_of_its_row() -> None:
    @each_row("number", [0, 1])
    def divides(number: int) -> None:
        with pytest.raises(ZeroDivisionError):
            assert 1 / number == 1

    with pytest.raises(ExceptionGroup, match="1 of 2 rows") as caught:
        divides()
    assert caught.value.exceptions[0].__notes__ == ["in the row (1,)"]


def test_a_row_may_have_a_name() -> None:
    @each_row("number", [pytest.param(1, id="the first one"), pytest.param(2)])
    def equals_zero(number: int) -> None:
        assert number == 0

    with pytest.raises(ExceptionGroup) as caught:
        equals_zero()
    assert [error.__notes__ for error in caught.value.exceptions] == [["in the row the first one"], ["in the row (2,)"]]


def test_a_table_without_rows_shows_nothing_and_fails() -> None:
    @each_row("number", [])
    def anything(number: int) -> None:
        raise AssertionError(number)

    with pytest.raises(AssertionError, match="without rows"):
        anything()


def test_a_row_that_does_not_fit_its_names_fails() -> None:
    @each_row("left, right", [(1, 2, 3)])
    def anything(left: int, right: int) -> None:
        """Nothing is wrong with it."""

    with pytest.raises(ExceptionGroup, match="1 of 1 rows"):
        anything()


@each_row("number", [1, 2, 3])
@pytest.mark.parametrize("name", ["one", "two"])
def test_what_is_not_in_the_table_is_given_by_pytest(number: int, name: str, request: pytest.FixtureRequest) -> None:
    assert number in {1, 2, 3}
    assert request.node.callspec.params == {"name": name}


def test_rows_that_are_given_as_a_function_are_made_when_the_test_runs() -> None:
    made = []

    def rows() -> list[int]:
        made.append("rows")
        return [1, 2]

    @each_row("number", rows)
    def tries(number: int) -> None:
        made.append(str(number))

    assert made == []
    tries()
    assert made == ["rows", "1", "2"]
