"""What a worker elsewhere must have in common with the process that hands it work, or its results would be others."""

import hashlib
import os
import platform
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import rfca_rig
from rfca_rig.errors import BadInput
from rfca_rig.executors.cores import ONE_THREAD

PACKAGES = ("numpy", "scipy", "numba", "llvmlite", "distributed", "cloudpickle")
LINEAR_ALGEBRA = "OPENBLAS_NUM_THREADS"

Facts = Mapping[str, str]


@dataclass(frozen=True)
class EnvironmentCheck:
    """`facts` as they are here; `token` is the name of a file in the folder, which workers must see, where one is named."""

    facts: Facts
    folder: str | None = None
    token: str = ""

    def unmet(self, facts: Facts) -> str | None:
        """What is otherwise in a process with these facts, in words for a line."""
        there = {name: facts.get(name, "missing") for name in self.facts}
        differing = [f"{name} is {there[name]} there, {here} here" for name, here in self.facts.items() if there[name] != here]
        if differing:
            return "; ".join(differing)
        if self.folder is not None and not Path(self.folder, self.token).exists():
            return f"{self.folder} is not the same folder there; results must go where all computers see them"
        return None


def facts_here() -> Facts:
    """Versions, and the very source of this package."""
    return {
        "Python": platform.python_version(),
        "rfca_rig": rfca_rig.__version__,
        "source": source_hash(Path(rfca_rig.__file__).parent),
        **{name: _version(name) for name in PACKAGES},
    }


def source_hash(folder: Path) -> str:
    """Of all Python files below: two checkouts of one git revision may differ, and an installed package has no revision."""
    found = hashlib.sha256()
    for file in sorted(folder.rglob("*.py")):
        found.update(f"{file.relative_to(folder)}\0".encode())
        found.update(file.read_bytes())
    return found.hexdigest()[:12]


def processor() -> str:
    """The kind of processor, for which compiled code and linear algebra are chosen."""
    from llvmlite.binding import get_host_cpu_name  # noqa: PLC0415 - of no use to processes that hand nothing out

    return str(get_host_cpu_name())


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "missing"


def ready(terms: EnvironmentCheck, facts: Callable[[], Facts]) -> None:
    """In a worker, before its first work. Raises BadInput, which names the worker's computer."""
    unmet = _unmet(terms.folder, terms.token, tuple(terms.facts.items()), facts)
    if unmet is not None:
        raise BadInput(f"the worker on {platform.node()} is not as this process: {unmet}")
    os.environ.update(ONE_THREAD)


@cache
def _unmet(folder: str | None, token: str, facts: tuple[tuple[str, str], ...], facts_there: Callable[[], Facts]) -> str | None:
    """Looked at once in a process."""
    if os.environ.get(LINEAR_ALGEBRA) != "1":
        return f"linear algebra may use many threads there; start it with {LINEAR_ALGEBRA}=1"
    return EnvironmentCheck(dict(facts), folder, token).unmet(facts_there())
