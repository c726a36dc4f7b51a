"""Environment check of workers: what they must have in common with this process to compute the
same results.
"""

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
    """Expected `facts` of a worker. If `folder` is given, the worker must see the file `token`
    in it.
    """

    facts: Facts
    folder: str | None = None
    token: str = ""

    def find_differences(self, facts: Facts) -> str | None:
        """Differences of a process with these facts, as one line; None if there are none."""
        actual = {name: facts.get(name, "missing") for name in self.facts}
        differing = [
            f"{name} is {actual[name]} there, {expected} here"
            for name, expected in self.facts.items()
            if actual[name] != expected
        ]
        if differing:
            return "; ".join(differing)
        # A folder may have the same path on two computers and still be two folders.
        if self.folder is not None and not Path(self.folder, self.token).exists():
            return (
                f"{self.folder} is not the same folder there; results must go where all "
                "computers see them"
            )
        return None


def collect_facts() -> Facts:
    """Versions of Python and packages, and a hash of this package's source."""
    return {
        "Python": platform.python_version(),
        "rfca_rig": rfca_rig.__version__,
        "source": hash_source(Path(rfca_rig.__file__).parent),
        **{name: _version(name) for name in PACKAGES},
    }


def hash_source(folder: Path) -> str:
    """Hash of all Python files below `folder`.

    A git revision is not enough: two checkouts of it may differ, and an installed package has none.
    """
    digest = hashlib.sha256()
    for file in sorted(folder.rglob("*.py")):
        # The name is part of the hash, so that a renamed file counts as a change.
        digest.update(f"{file.relative_to(folder)}\0".encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def detect_processor() -> str:
    """Processor type, for which compiled code and linear algebra kernels are chosen."""
    from llvmlite.binding import get_host_cpu_name  # noqa: PLC0415 - of no use to processes that hand nothing out

    return str(get_host_cpu_name())


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "missing"


def check_worker(terms: EnvironmentCheck, facts: Callable[[], Facts]) -> None:
    """Checks a worker before its first task. Raises BadInput, which names the worker's computer."""
    unmet = _unmet(terms.folder, terms.token, tuple(terms.facts.items()), facts)
    if unmet is not None:
        raise BadInput(f"the worker on {platform.node()} is not as this process: {unmet}")
    # For child processes and for libraries that are loaded later.
    os.environ.update(ONE_THREAD)


@cache
def _unmet(
    folder: str | None,
    token: str,
    facts: tuple[tuple[str, str], ...],
    facts_there: Callable[[], Facts],
) -> str | None:
    """Result of the check, computed once per process."""
    # OpenBLAS reads its thread count when it is loaded, so it cannot be set here any more.
    if os.environ.get(LINEAR_ALGEBRA) != "1":
        return f"linear algebra may use many threads there; start it with {LINEAR_ALGEBRA}=1"
    return EnvironmentCheck(dict(facts), folder, token).find_differences(facts_there())
