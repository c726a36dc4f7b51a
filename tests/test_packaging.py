"""Wheel and sdist: what is in them, and the wheel in an empty environment outside the repository.
Needs a package index.

The matrix of interpreters: RFCA_RIG_PYTHONS=python3.11:python3.12:python3.13 python -m pytest -m
long tests/test_packaging.py
"""

import json
import os
import subprocess
import sys
import tarfile
import zipfile
from dataclasses import dataclass
from email.parser import Parser
from pathlib import Path

import pytest

from rfca_rig import __version__
from rfca_rig.doctor.computer import PACKAGES_SUBJECT

pytestmark = [pytest.mark.long, pytest.mark.timeout(1800)]

ROOT = Path(__file__).parents[1]
PYTHONS = os.environ.get("RFCA_RIG_PYTHONS", sys.executable).split(os.pathsep)
# `lowest` takes the lowest version of each direct dependency that has a wheel for the interpreter.
VERSIONS = {
    "pinned": ("--constraint", str(ROOT / "constraints.txt")),
    "newest": ("--resolution", "highest"),
    "lowest": ("--resolution", "lowest-direct"),
}
STROKE = ("--height", "215", "--speed", "2.433")
COMMANDS = (
    ("--help",),
    ("plan", "table2"),
    ("trip", "F-02"),
    ("schema", "rig"),
    # A run and its pages need every dependency: the camera of the static stages takes OpenCV, the
    # report Matplotlib and Jinja2.
    ("dynamic", "run", *STROKE, "--repeats", "1", "--report", "report"),
    ("static", "run"),
)
CACHES = ("__pycache__", ".venv", "_cache", ".hypothesis", ".egg-info")


@dataclass(frozen=True)
class Built:
    """The two files that are published, and the tool that installs them."""

    wheel: Path
    sdist: Path
    uv: Path


def run(*words: str | Path, where: Path, codes: tuple[int, ...] = (0,)) -> str:
    """Output of a command that sees nothing of this checkout; its error stream is in the
    failure.
    """
    kept = {
        name: value
        for name, value in os.environ.items()
        if name not in ("PYTHONPATH", "VIRTUAL_ENV")
    }
    # Code is compiled afresh with the versions under test.
    clean = {
        **kept,
        "XDG_CACHE_HOME": str(where / "cache"),
        "XDG_CONFIG_HOME": str(where / "config"),
    }
    finished = subprocess.run(
        [*map(str, words)], cwd=where, env=clean, capture_output=True, text=True, check=False
    )
    assert finished.returncode in codes, (
        f"{' '.join(map(str, words))}\n{finished.stdout[-2000:]}\n{finished.stderr[-4000:]}"
    )
    return finished.stdout


def requirements(wheel: Path) -> list[str]:
    """The wheel's dependencies, without its extras: named beside the wheel they are direct ones,
    of which the lowest can be had.
    """
    with zipfile.ZipFile(wheel) as archive:
        (metadata,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        head = Parser().parsestr(archive.read(metadata).decode("utf-8"), headersonly=True)
    return [line for line in head.get_all("Requires-Dist", ()) if "extra ==" not in line]


@pytest.fixture(scope="session")
def built(tmp_path_factory) -> Built:
    where = tmp_path_factory.mktemp("built")
    run(sys.executable, "-m", "venv", "tools", where=where)
    tools = where / "tools" / ("Scripts" if os.name == "nt" else "bin")
    run(tools / "python", "-m", "pip", "install", "-q", "build", "uv", where=where)
    # The wheel is made from the sdist: so the sdist is complete.
    run(tools / "python", "-m", "build", "--outdir", where / "dist", ROOT, where=where)
    (wheel,), (sdist,) = (
        tuple((where / "dist").glob(f"*{ending}")) for ending in (".whl", ".tar.gz")
    )
    return Built(wheel, sdist, tools / "uv")


def test_the_sdist_holds_tests_and_documents_but_no_caches(built):
    with tarfile.open(built.sdist) as archive:
        names = [name.partition("/")[2] for name in archive.getnames()]
    for wanted in (
        "tests/test_packaging.py",
        "docs/architecture.md",
        "CHANGELOG.md",
        "constraints.txt",
        ".ci/run",
        "LICENSE",
        "rfca_rig/view/static/uPlot.LICENSE",
    ):
        assert wanted in names
    assert [
        name for name in names if is_in_cache(name) or name.startswith((".git/", "runs/"))
    ] == []


def test_the_wheel_is_typed_and_brings_protocols_rigs_sweeps_and_trip_pages(built):
    with zipfile.ZipFile(built.wheel) as archive:
        names = archive.namelist()
    shipped = (
        "protocols/table2.toml",
        "calibration/twin.toml",
        "sweeps/materials.toml",
        "docs/trips/F-02.md",
    )
    for wanted in ("rfca_rig/py.typed", *(f"rfca_rig/shipped/{name}" for name in shipped)):
        assert wanted in names
    assert [name for name in names if name.startswith("tests") or is_in_cache(name)] == []
    licences = f"rfca_rig-{__version__}.dist-info/licenses"
    for licence in ("LICENSE", "rfca_rig/view/static/uPlot.LICENSE"):
        assert f"{licences}/{licence}" in names


def is_in_cache(name):
    return any(cache in name for cache in CACHES)


@pytest.mark.parametrize("versions", VERSIONS)
@pytest.mark.parametrize("python", PYTHONS)
def test_the_wheel_works_in_an_empty_environment(built, tmp_path, python, versions):
    run(built.uv, "venv", "--python", python, "empty", where=tmp_path)
    bin_folder = tmp_path / "empty" / ("Scripts" if os.name == "nt" else "bin")
    install = (
        built.uv,
        "pip",
        "install",
        "--python",
        bin_folder / "python",
        "--only-binary",
        ":all:",
    )
    run(
        *install,
        "--cache-dir",
        built.uv.parent / "cache",
        *VERSIONS[versions],
        built.wheel,
        *requirements(built.wheel),
        where=tmp_path,
    )
    if versions == "lowest":
        # Without compiled parts, its lowest version exists for every interpreter.
        (packaging,) = (line for line in requirements(built.wheel) if line.startswith("packaging"))
        frozen = run(built.uv, "pip", "freeze", "--python", bin_folder / "python", where=tmp_path)
        assert packaging.replace(">=", "==") in frozen.splitlines()
    command = bin_folder / "rfca-rig"
    ask = "from importlib.metadata import version; print(version('rfca-rig'))"
    assert run(bin_folder / "python", "-c", ask, where=tmp_path).strip() == __version__
    assert run(command, "--version", where=tmp_path).split() == ["rfca-rig", __version__]
    assert run(bin_folder / "python", "-m", "rfca_rig", "--version", where=tmp_path).split() == [
        "rfca-rig",
        __version__,
    ]
    for words in COMMANDS:
        run(command, *words, where=tmp_path)
    # Of the findings only those on packages are the wheel's; others are of the machine and may be
    # red.
    findings = json.loads(run(command, "doctor", "--json", where=tmp_path, codes=(0, 1)))[
        "findings"
    ]
    assert [one["colour"] for one in findings if one["subject"] == PACKAGES_SUBJECT] == ["green"]
