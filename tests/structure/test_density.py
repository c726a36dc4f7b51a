"""No line does more than a reader takes in at once, in the package, its tests and its examples."""

import ast
import textwrap

import pytest

from tests.structure.density import RULES, find_conditionals, find_nested_comprehensions
from tests.structure.tree import ROOT, density_of, read_modules

FOLDERS = ("rfca_rig", "tests", "docs")

# Per 1,000 lines of code of the package. A conditional expression is fine for a default or a choice
# of two words; at 12 every page had several within calls, where a reader must hold the rest of the
# line in mind. The package has 4.8.
MAX_CONDITIONALS_PER_1000_LINES = 5.0

# Per 1,000 lines of code of the package. Two levels of a small table can be plain; at 1.0 a reader
# had to read many of them inside out. The package has 0.04.
MAX_NESTED_COMPREHENSIONS_PER_1000_LINES = 0.1


@pytest.fixture(scope="module")
def trees() -> dict[str, ast.AST]:
    """The syntax tree of every file, by its path."""
    trees = {}
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            trees[str(path.relative_to(ROOT))] = ast.parse(path.read_text(encoding="utf-8"))
    return trees


@pytest.mark.parametrize("rule", RULES)
def test_no_line_is_dense(trees, rule):
    find = RULES[rule]
    sites = []
    for path, tree in trees.items():
        sites += [f"{path}:{line}" for line in find(tree)]
    assert sites == []


@pytest.mark.parametrize(
    ("find", "most"),
    [
        (find_conditionals, MAX_CONDITIONALS_PER_1000_LINES),
        (find_nested_comprehensions, MAX_NESTED_COMPREHENSIONS_PER_1000_LINES),
    ],
)
def test_dense_expressions_are_rare(find, most):
    assert density_of(find, read_modules()) <= most


def test_comprehension_that_holds_another_is_found():
    tree = ast.parse("[[x for x in row] for row in rows]\n[sum(row) for row in rows if row]")
    assert find_nested_comprehensions(tree) == [1]


@pytest.mark.parametrize(
    ("rule", "dense", "plain"),
    [
        ("packed assignments", "a, b = 1, c", "a, b = f()"),
        ("packed assignments", "self.a, self.b = a, self.c", "a, b = b, a"),
        ("packed assignments", "x[i], y = i, x", "x[i], x[j] = x[j], x[i]"),
        ("packed assignments", "i, v = 0, x", "i, x[i] = 0, v"),
        (
            "nested comprehensions with a condition",
            "[[x for x in row if x] for row in rows]",
            "[[x for x in row] for row in rows]",
        ),
        (
            "nested comprehensions with a condition",
            "[sum(x for x in row) for row in rows if row]",
            "[sum(row) for row in rows if row]",
        ),
        ("nested conditional expressions", "a if b else c if d else e", "f(a if b else c)"),
        (
            "next() of a shared iterator in a comprehension",
            "[next(values) for name in names]",
            "[next(x for x in row) for row in rows]",
        ),
    ],
)
def test_what_counts_as_dense(rule, dense, plain):
    find = RULES[rule]
    assert find(ast.parse(textwrap.dedent(dense))) == [1]
    assert find(ast.parse(textwrap.dedent(plain))) == []
