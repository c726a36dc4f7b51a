"""What the source of the package tells of itself: modules, imports, circles, shapes in docstrings.

`python -m tests.structure.tree` prints how large and how dense the tree is.
"""

import ast
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from tests.structure import density

ROOT = Path(__file__).resolve().parents[2]
SHAPE = re.compile(
    r"\(\s*(?:[A-Za-z_0-9+\-* ]+\s*,\s*)+(?:[A-Za-z_0-9+\-* .]+)?\)|\bshapes? |\(m\)|\bscalar\b"
)
ARRAY = re.compile(r"\b(NDArray|ndarray)\b")

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


def density_of(find: density.Rule, modules: dict[str, Module]) -> float:
    """How often `find` finds something per 1,000 lines of code."""
    count = sum(len(find(module.tree)) for module in modules.values())
    return 1e3 * count / sum(count_code_lines(module) for module in modules.values())


def find_public_classes(modules: dict[str, Module]) -> Counter[str]:
    """How often each public class name is defined."""
    names: Counter[str] = Counter()
    for module in modules.values():
        for node in module.nodes:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                names[node.name] += 1
    return names


def main() -> None:
    """Print the size of the package, and its density per 1,000 lines of code."""
    modules = read_modules()
    lines = sum(count_code_lines(module) for module in modules.values())
    functions = sum(len(list(module.functions())) for module in modules.values())
    print(f"modules {len(modules)}, functions {functions}, lines of code {lines}")
    for rule, find in density.RULES.items():
        sites = sum(len(find(module.tree)) for module in modules.values())
        print(f"{1e3 * sites / lines:8.2f}  {rule}")
    print(f"{density_of(density.find_conditionals, modules):8.2f}  conditional expressions")
    nested = density_of(density.find_nested_comprehensions, modules)
    print(f"{nested:8.2f}  nested comprehensions")


if __name__ == "__main__":
    main()
