"""Counts what makes a tree hard to take over.

`python -m tests.structure.counts` prints the table. `--shapes`, `--single-users`,
`--past-participles` and `--comments` list what one row of it counts, with an optional prefix of
module names."""

import argparse
import ast
import gc
import io
import re
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
WORDS = ("believed", "foretold", "told", "said", "lets go", "held against", "anew", "mends")
SHAPE = re.compile(
    r"\(\s*(?:[A-Za-z_0-9+\-* ]+\s*,\s*)+(?:[A-Za-z_0-9+\-* .]+)?\)|\bshapes? |\(m\)|\bscalar\b"
)
SECTION = re.compile(
    r"^\s*(Parameters|Returns|Raises|References|Yields|Attributes|Notes)\n\s*-{3,}$", re.MULTILINE
)
ARRAY = re.compile(r"\b(NDArray|ndarray)\b")
IRREGULAR = frozenset(
    re.findall(
        r"\w+",
        """begun built chosen done drawn felt found foretold gone grown heard held kept known laid
        led left lit made meant met mixed paid placed said seen sent shown stood taken thought
        thrown told turned understood weighed won written""",
    )
)

Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Module:
    """A module of the package, by its dotted name."""

    name: str
    path: Path
    text: str

    @cached_property
    def tree(self) -> ast.Module:
        return ast.parse(self.text)

    @cached_property
    def nodes(self) -> list[ast.AST]:
        """All nodes of the tree; to walk it anew for every row would take most of the time."""
        return list(ast.walk(self.tree))

    def functions(self) -> Iterator[Function]:
        for node in self.nodes:
            if isinstance(node, Function):
                yield node

    @cached_property
    def array_names(self) -> set[str]:
        """Names of this module that stand for an array: `Floats = NDArray[np.float64]`."""
        return {
            target.id
            for node in self.tree.body
            if isinstance(node, ast.Assign)
            and ARRAY.search(ast.unparse(node.value))
            and "[" in ast.unparse(node.value)
            for target in node.targets
            if isinstance(target, ast.Name)
        } | {
            alias.asname or alias.name
            for node in self.nodes
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
            if alias.name in ("Floats", "Ints", "Bools")
        }


def read_modules(package: str = "rfca_rig") -> dict[str, Module]:
    """Every module of `package`, by its dotted name."""
    found = {}
    for path in sorted((ROOT / package).rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        found[name] = Module(name, path, path.read_text())
    return found


def find_imports(modules: dict[str, Module]) -> dict[str, set[str]]:
    """Modules that each module imports, also those that only a function or a type checker
    imports.
    """
    found: dict[str, set[str]] = {name: set() for name in modules}
    for name, module in modules.items():
        for node in module.nodes:
            if isinstance(node, ast.ImportFrom) and node.module in modules:
                for alias in node.names:
                    full = f"{node.module}.{alias.name}"
                    found[name].add(full if full in modules else node.module)
            elif isinstance(node, ast.Import):
                found[name] |= {alias.name for alias in node.names if alias.name in modules}
        found[name].discard(name)
    # The package itself lists the names of the library, and imports each when it is first used.
    found["rfca_rig"] = set()
    return found


def find_parts(modules: dict[str, Module]) -> dict[str, set[str]]:
    """Modules that the make of a device names as text, `f"{__name__}.driver:make_driver"`: it
    imports them when they are first used.
    """
    return {
        name: {
            f"{name}{part}"
            for node in module.nodes
            if isinstance(node, ast.JoinedStr)
            and ast.unparse(node).startswith(('f"{__name__}.', "f'{__name__}."))
            for part in [str(getattr(node.values[1], "value", "")).partition(":")[0]]
        }
        for name, module in modules.items()
    }


def find_circles(modules: dict[str, Module]) -> list[list[str]]:
    """Groups of modules that import each other, Tarjan's strongly connected components of more
    than one.
    """
    imports = find_imports(modules)
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    circles: list[list[str]] = []

    def visit(name: str) -> None:
        index[name] = low[name] = len(index)
        stack.append(name)
        for other in sorted(imports[name]):
            if other not in index:
                visit(other)
                low[name] = min(low[name], low[other])
            elif other in stack:
                low[name] = min(low[name], index[other])
        if low[name] == index[name]:
            place = stack.index(name)
            if len(stack) - place > 1:
                circles.append(sorted(stack[place:]))
            del stack[place:]

    for name in modules:
        if name not in index:
            visit(name)
    return circles


def find_single_users(modules: dict[str, Module]) -> list[tuple[str, str]]:
    """Modules with exactly one user, which stands in the same package, with that user."""
    users: dict[str, set[str]] = defaultdict(set)
    for used in (find_imports(modules), find_parts(modules)):
        for name, others in used.items():
            for other in others:
                users[other].add(name)
    return [
        (name, user)
        for name in modules
        if modules[name].path.name != "__init__.py"
        for user in (users[name] if len(users[name]) == 1 else ())
        if user.rpartition(".")[0] == name.rpartition(".")[0]
    ]


def find_array_functions(modules: dict[str, Module]) -> Iterator[tuple[str, bool]]:
    """Public functions that take or return an array, and whether their docstring, or their
    class's, states a shape.
    """
    for module in modules.values():
        names = re.compile(
            rf"\b({'|'.join(['NDArray', 'ndarray', *sorted(module.array_names)])})\b"
        )
        for owner, function in _public_functions(module.tree):
            annotations = [
                one.annotation
                for one in (*function.args.args, *function.args.kwonlyargs)
                if one.annotation
            ]
            if function.returns is not None:
                annotations.append(function.returns)
            if any(names.search(ast.unparse(one)) for one in annotations):
                documents = [ast.get_docstring(function) or ""]
                if owner is not None:
                    documents.append(ast.get_docstring(owner) or "")
                yield (
                    f"{module.name}:{function.lineno} {function.name}",
                    any(SHAPE.search(one) for one in documents),
                )


def _public_functions(
    tree: ast.AST, owner: ast.ClassDef | None = None
) -> Iterator[tuple[ast.ClassDef | None, Function]]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, Function) and not node.name.startswith("_"):
            yield owner, node
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from _public_functions(node, node)


def find_past_participles(modules: dict[str, Module]) -> list[str]:
    """Functions and methods whose name begins with a past participle, without properties: those
    are nouns.
    """
    return [
        f"{module.name}:{function.lineno} {function.name}"
        for module in modules.values()
        for function in module.functions()
        if _is_participle(function.name.strip("_").partition("_")[0])
        and not any("property" in ast.unparse(one) for one in function.decorator_list)
    ]


def _is_participle(word: str) -> bool:
    return word in IRREGULAR or (
        len(word) > 4
        and word.endswith("ed")
        and word not in ("embed", "exceed", "feed", "need", "proceed", "seed", "speed", "succeed")
    )


def count_comments(module: Module) -> int:
    """Full-line comments."""
    beginning = [
        number
        for number, line in enumerate(module.text.splitlines(), 1)
        if line.lstrip().startswith("#")
    ]
    texts = [
        (node.lineno, node.end_lineno or 0)
        for node in module.nodes
        if isinstance(node, ast.Constant | ast.JoinedStr)
    ]
    if not any(
        first < number <= last for number in beginning for first, last in texts if first < last
    ):
        return len(beginning)
    # One of these lines may be a part of a text; the tokenizer tells, and takes a hundred times as
    # long.
    return sum(
        1
        for token in tokenize.generate_tokens(io.StringIO(module.text).readline)
        if token.type == tokenize.COMMENT and token.line.strip().startswith("#")
    )


def count_code_lines(module: Module) -> int:
    """Lines that are neither empty, nor a comment, nor a docstring."""
    documents: set[int] = set()
    for node in module.nodes:
        if (
            isinstance(node, ast.Module | ast.ClassDef | Function)
            and ast.get_docstring(node) is not None
        ):
            first = node.body[0]
            documents.update(range(first.lineno, (first.end_lineno or first.lineno) + 1))
    return sum(
        1
        for number, line in enumerate(module.text.splitlines(), 1)
        if line.strip() and not line.strip().startswith("#") and number not in documents
    )


def count_words() -> dict[str, int]:
    """Uses of our own dialect in the package and the documents."""
    files = [*(ROOT / "rfca_rig").rglob("*.py"), *(ROOT / "docs").rglob("*.md"), ROOT / "README.md"]
    text = "\n".join(path.read_text() for path in files)
    return {word: len(re.findall(rf"(?<![a-z]){word}(?![a-z])", text)) for word in WORDS}


def count_all() -> dict[str, int | float]:
    """The whole table, by its rows."""
    # All trees are kept until the end. Python would look for garbage among them again and again,
    # half of the time.
    gc.disable()
    try:
        return _count_all()
    finally:
        gc.enable()


def _count_all() -> dict[str, int | float]:
    modules = read_modules()
    functions = [function for module in modules.values() for function in module.functions()]
    uses = Counter(
        node.id if isinstance(node, ast.Name) else node.attr
        for module in modules.values()
        for node in module.nodes
        if isinstance(node, ast.Name | ast.Attribute)
    )
    private = [
        one.name for one in functions if one.name.startswith("_") and not one.name.startswith("__")
    ]
    classes = Counter(
        node.name
        for module in modules.values()
        for node in module.nodes
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    stated = [states for _, states in find_array_functions(modules)]
    documents = [text for function in functions if (text := ast.get_docstring(function))]
    folders = Counter(
        str(module.path.parent) for module in modules.values() if module.path.name != "__init__.py"
    )
    return {
        "modules": len(modules),
        "lines": sum(module.text.count("\n") for module in modules.values()),
        "lines of code": sum(map(count_code_lines, modules.values())),
        "modules with one user, in their package": len(find_single_users(modules)),
        "functions": len(functions),
        "private functions with one use": sum(uses[name] == 1 for name in private),
        "public class names defined more than once": sum(count > 1 for count in classes.values()),
        "functions named by a past participle": len(find_past_participles(modules)),
        "full-line comments": sum(map(count_comments, modules.values())),
        "array functions whose docstring states shapes, %": round(
            100.0 * sum(stated) / len(stated), 1
        ),
        "docstrings with structured sections": sum(
            bool(SECTION.search(text)) for text in documents
        ),
        "import circles": len(find_circles(modules)),
        "modules of the largest folder": max(folders.values()),
        "words of our own dialect": sum(count_words().values()),
    }


def main() -> None:
    """Print the table, or what one of its rows counts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    for name in ("shapes", "single-users", "past-participles", "comments"):
        parser.add_argument(f"--{name}", metavar="PREFIX", nargs="?", const="rfca_rig")
    asked = parser.parse_args()
    modules = read_modules()
    for prefix in (asked.shapes, asked.past_participles, asked.comments):
        if prefix:
            modules = {name: module for name, module in modules.items() if name.startswith(prefix)}
    if asked.shapes:
        lines = [where for where, states in find_array_functions(modules) if not states]
    elif asked.single_users:
        lines = [
            f"{name} is used by {user} alone"
            for name, user in find_single_users(modules)
            if name.startswith(asked.single_users)
        ]
    elif asked.past_participles:
        lines = find_past_participles(modules)
    elif asked.comments:
        lines = [f"{count_comments(one):3d} {name}" for name, one in modules.items()]
    else:
        lines = [f"{value:>8g}  {row}" for row, value in count_all().items()]
        lines += [f"{count:>8d}    {word}" for word, count in count_words().items()]
    print("\n".join(lines))


if __name__ == "__main__":
    main()
