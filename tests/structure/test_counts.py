"""The counts stay within limits a little looser than what the tree has now; a limit that is far off is drawn in."""

import pytest

from tests.structure.counts import count_all

# At most, and at least.
AT_MOST = {
    "modules": 462,
    "lines": 93_500,
    "lines of code": 59_400,
    "modules with one user, in their package": 29,
    "functions": 6_270,
    "private functions with one use": 760,
    "public class names defined more than once": 0,
    "functions named by a past participle": 25,
    "import circles": 0,
    "modules of the largest folder": 20,
    "words of our own dialect": 37,
}
AT_LEAST = {
    "full-line comments": 2_780,
    "array functions whose docstring states shapes, %": 99.0,
    "docstrings with structured sections": 210,
}


@pytest.fixture(scope="module")
def counts() -> dict[str, int | float]:
    return count_all()


@pytest.mark.parametrize(("row", "limit"), AT_MOST.items())
def test_the_tree_grows_no_further(counts, row, limit):
    assert counts[row] <= limit


@pytest.mark.parametrize(("row", "limit"), AT_LEAST.items())
def test_what_explains_the_tree_stays(counts, row, limit):
    assert counts[row] >= limit


def test_every_row_has_a_limit(counts):
    assert set(counts) == {*AT_MOST, *AT_LEAST}
