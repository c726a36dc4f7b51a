"""Places where a line does more than a reader takes in at once.

Each rule finds the lines of a syntax tree that break it.
"""

import ast
from collections.abc import Callable, Iterator

COMPREHENSIONS = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)
Comprehension = ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp


def find_packed_assignments(tree: ast.AST) -> list[int]:
    """`a, b = x, y` of values that do not depend on each other's targets.

    Swaps, and updates that need the values of before, are what tuples are for.
    """
    lines = []
    for node in ast.walk(tree):
        if not isinstance(node, ast.Assign) or len(node.targets) != 1:
            continue
        target = node.targets[0]
        if not isinstance(target, ast.Tuple) or not isinstance(node.value, ast.Tuple):
            continue
        if any(isinstance(value, ast.Starred) for value in (*target.elts, *node.value.elts)):
            continue
        if not _depends_on_earlier_target(target.elts, node.value.elts):
            lines.append(node.lineno)
    return lines


def _depends_on_earlier_target(targets: list[ast.expr], values: list[ast.expr]) -> bool:
    """Whether the assignments, one after the other, could give other values."""
    for number, target in enumerate(targets):
        text = ast.unparse(target)
        for later in (*targets[number + 1 :], *values[number + 1 :]):
            if text in _list_parts(later):
                return True
    return False


def _list_parts(expression: ast.expr) -> set[str]:
    """The source of every expression within an expression."""
    parts = set()
    for node in ast.walk(expression):
        if isinstance(node, ast.expr):
            parts.add(ast.unparse(node))
    return parts


def find_nested_comprehensions(tree: ast.AST) -> list[int]:
    """A comprehension that holds another."""
    return [outer.lineno for outer, _ in _list_nested_comprehensions(tree)]


def find_nested_comprehensions_with_condition(tree: ast.AST) -> list[int]:
    """A comprehension within another where either has a condition."""
    lines = []
    for outer, inner in _list_nested_comprehensions(tree):
        conditions = []
        for comprehension in (outer, *inner):
            for generator in comprehension.generators:
                conditions += generator.ifs
        if conditions:
            lines.append(outer.lineno)
    return lines


def _list_nested_comprehensions(tree: ast.AST) -> Iterator[tuple[Comprehension, list]]:
    """Every comprehension that holds others, with those."""
    for outer in _walk(tree, COMPREHENSIONS):
        inner = [node for node in _walk(outer, COMPREHENSIONS) if node is not outer]
        if inner:
            yield outer, inner


def find_nested_conditionals(tree: ast.AST) -> list[int]:
    """A conditional expression within another."""
    lines = []
    for outer in _walk(tree, (ast.IfExp,)):
        if sum(1 for _ in _walk(outer, (ast.IfExp,))) > 1:
            lines.append(outer.lineno)
    return lines


def find_conditionals(tree: ast.AST) -> list[int]:
    """Every conditional expression."""
    return [node.lineno for node in _walk(tree, (ast.IfExp,))]


def find_shared_iterators(tree: ast.AST) -> list[int]:
    """`next()` within a comprehension, on an iterator that is made outside of it."""
    lines = []
    for comprehension in _walk(tree, COMPREHENSIONS):
        for call in _walk(comprehension, (ast.Call,)):
            is_next = isinstance(call.func, ast.Name) and call.func.id == "next"
            if is_next and isinstance(call.args[0], ast.Name):
                lines.append(comprehension.lineno)
    return lines


def _walk(tree: ast.AST, kinds: tuple[type[ast.AST], ...]) -> Iterator:
    """The tree's nodes of these kinds, itself included."""
    return (node for node in ast.walk(tree) if isinstance(node, kinds))


Rule = Callable[[ast.AST], list[int]]

RULES: dict[str, Rule] = {
    "packed assignments": find_packed_assignments,
    "nested comprehensions with a condition": find_nested_comprehensions_with_condition,
    "nested conditional expressions": find_nested_conditionals,
    "next() of a shared iterator in a comprehension": find_shared_iterators,
}
