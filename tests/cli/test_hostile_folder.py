"""Python files in the current folder never run: neither in a command nor in the processes that it
starts.

The folder has a file for every module name that the program or a library of it could import. Each
writes a marker where it is imported.
"""

import ast
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
import typer

from rfca_rig.cli.main import app
from tests.cli.malformed_inputs import CART, EXPERIMENT, MECHANISM

ROOT = Path(__file__).parents[2]
MARKERS = "markers"
HOSTILE = """import os as _os
_folder = {folder!r}
_os.makedirs(_folder, exist_ok=True)
with open(_folder + "/" + {name!r}, "a") as _file:
    _file.write("imported by process %d\\n" % _os.getpid())
"""
PROGRAM = (sys.executable, "-P", "-m", "rfca_rig")
FREE_PORTS = tuple(f"--{name}-port=0" for name in ("rdt", "http", "command", "can", "control"))
RUN = ("dynamic", "run", "--height", "235", "--speed", "3.2", "--repeats", "1", "--runs", "runs")
# In an order in which each finds what an earlier one made. Those that end with 2 have nothing to
# work on here, after all imports.
COMMANDS: tuple[tuple[str, ...], ...] = (
    RUN,
    ("resume", "{run}"),
    ("recover", "{run}"),
    ("check", "{run}"),
    ("check", "cart"),
    ("check", "small-campaign"),
    ("runs", "--runs", "."),
    ("plan", "table2"),
    ("predict", "--height", "215", "--speed", "2.433"),
    ("report", "{run}", "--out", "report"),
    ("fit", "cart", "--out", "fitted"),
    ("diagnose", "cart", "--out", "diagnosis"),
    ("prove", "--out", "exam", "--cases", "1", "--workers", "1", "--kind", "nothing"),
    ("crosscheck",),
    ("strip", "--height", "235", "--speed", "3.276"),
    (
        "sweep",
        "--vary",
        "height_mm=215,235",
        "--outputs",
        "energy_J",
        "--out",
        "swept",
        "--workers",
        "2",
    ),
    ("doctor", "--rig", "calibration/twin.toml"),
    ("setup", "motor", "--rig", "calibration/twin.toml"),
    ("view", "nothing"),
    ("contract", "examples/our-rig.toml"),
    ("trip", "F-02"),
    ("schema", "rig"),
    ("static", "run", "--protocol", "protocols/static-angle.toml", "--runs", "static-runs"),
    ("static", "report", "{static}", "--out", "static-report"),
    ("static", "photos", "{static}", "calibration", "--camera", "calibration/twin-camera.toml"),
    ("paper", "small-campaign", "--out", "paper"),
    ("twin", "board", "board"),
    ("static", "load", "--shaft", "30", "--down", "-20"),
    ("static", "force", "--angles", "30,-4.1,-4.9,-5.1,-4.6,-3.4,-1.8"),
    ("fatigue", "run", "--cycles", "1", "--runs", "fatigue-runs"),
    ("twin", "serve", "--seconds", "0.1", *FREE_PORTS),
    ("twin", "tell", "on", "force-silent"),
    ("twin", "conceal", "riddle.toml"),
    ("calibrate", "camera", "calibration"),
    ("setup", "zero", "--rig", "calibration/twin.toml", "--yes"),
    ("export", "mcap", "{run}", "--out", "run.mcap"),
    ("export", "csv", "{run}", "--out", "run-csv"),
    ("record", "--seconds", "0.1", "--pace", "0", "--out", "listened"),
    ("export", "can", "listened", "--out", "bus.log"),
    ("export", "mjcf", "small-campaign", "--out", "mjcf"),
    ("export", "fmu", "--out", "leg.fmu"),
    ("import", "small-campaign", "--out", "imported"),
    ("reference", "set", "{run}"),
    ("reference", "show"),
    ("reference", "history", "--out", "history"),
    ("reference", "clear", "{run}"),
    ("setup", "sensor", "--rig", "calibration/twin.toml", "--yes"),
    ("datasets", "list"),
    ("datasets", "get", "golf"),
    ("init", "--mjcf", "cart/model.xml", "--data", "draft"),
)


def _module_names() -> set[str]:
    """Every module of the standard library and of all installed packages, but this program
    itself.
    """
    names = {*sys.stdlib_module_names, *packages_distributions()} - {"rfca_rig", "tests"}
    return {name for name in names if name.isidentifier()}


@pytest.fixture(scope="module")
def hostile_folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("hostile")
    for name in _module_names():
        (folder / f"{name}.py").write_text(
            HOSTILE.format(folder=str(folder / MARKERS), name=name), encoding="utf-8"
        )
    for source in ("calibration", "protocols", "docs/examples", "tests/data/small-campaign"):
        shutil.copytree(ROOT / source, folder / Path(source).name)
    for cart in ("cart", "draft"):
        (folder / cart).mkdir()
        (folder / cart / "a.csv").write_text(CART, encoding="utf-8")
    (folder / "cart" / "experiment.toml").write_text(EXPERIMENT, encoding="utf-8")
    (folder / "cart" / "model.xml").write_text(MECHANISM, encoding="utf-8")
    return folder


def _environment() -> dict[str, str]:
    settings = {
        # The workers of a sweep and the photo reader need a second core.
        "RFCA_RIG_THREADS": "2",
        "PYTHONDONTWRITEBYTECODE": "1",
        # Nothing is fetched: no proxy listens here.
        "HTTPS_PROXY": "http://127.0.0.1:9",
        "RFCA_RIG_DATASETS": "public-recordings",
        "RFCA_RIG_DATASETS_SOURCES": "public-sources",
    }
    return {**os.environ, **settings}


def _imported(folder: Path) -> list[str]:
    """Names of the hostile modules that were imported, whose markers are removed."""
    markers = folder / MARKERS
    if markers.is_dir():
        names = sorted(marker.name for marker in markers.iterdir())
    else:
        names = []
    shutil.rmtree(markers, ignore_errors=True)
    return names


def _first(runs: Path) -> str:
    """The first run in this folder."""
    if runs.is_dir():
        return str(min(runs.iterdir(), default="none"))
    return "none"


# No twin serves here, and a new drive has wrong settings.
FAILING = {("twin", "tell"): (1,), ("setup", "motor"): (1,)}


def test_the_folder_is_hostile(hostile_folder: Path):
    subprocess.run(
        [sys.executable, "-c", "import json"],
        cwd=hostile_folder,
        env=_environment(),
        check=False,
        capture_output=True,
    )
    assert "json" in _imported(hostile_folder)


@pytest.mark.slow
@pytest.mark.parametrize("words", COMMANDS, ids=lambda words: "-".join(words[:2]))
def test_no_command_runs_files_of_the_current_folder(hostile_folder: Path, words: tuple[str, ...]):
    runs = {
        "run": _first(hostile_folder / "runs"),
        "static": _first(hostile_folder / "static-runs"),
    }
    command = [*PROGRAM, *(word.format_map(runs) for word in words)]
    closed = subprocess.DEVNULL
    done = subprocess.run(
        command,
        cwd=hostile_folder,
        env=_environment(),
        capture_output=True,
        text=True,
        stdin=closed,
        check=False,
    )
    assert _imported(hostile_folder) == []
    exit_codes = FAILING.get(words[:2], (0, 2, 3))
    assert done.returncode in exit_codes, done.stderr[-2000:]
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_nor_do_they_after_python_m(tmp_path: Path):
    """The interpreter looks there before the first line of the program, for importlib and
    typing; the rest and its processes do not.
    """
    for name in (
        "numpy",
        "json",
        "socket",
        "ctypes",
        "subprocess",
        "multiprocessing",
        "typer",
        "h5py",
        "mujoco",
    ):
        (tmp_path / f"{name}.py").write_text(
            HOSTILE.format(folder=str(tmp_path / MARKERS), name=name), encoding="utf-8"
        )
    words = (
        "sweep",
        "--vary",
        "height_mm=215,235",
        "--outputs",
        "energy_J",
        "--out",
        "swept",
        "--workers",
        "2",
    )
    command = [sys.executable, "-m", "rfca_rig", *words]
    done = subprocess.run(
        command, cwd=tmp_path, env=_environment(), capture_output=True, text=True, check=False
    )
    assert _imported(tmp_path) == []
    assert done.returncode == 0, done.stderr


def test_every_command_is_tried():
    def walk(
        command: typer.main.TyperGroup, before: tuple[str, ...] = ()
    ) -> Iterator[tuple[str, ...]]:
        for name, inner in getattr(command, "commands", {}).items():
            yield from (
                walk(inner, (*before, name)) if hasattr(inner, "commands") else [(*before, name)]
            )

    commands = set(walk(typer.main.get_command(app)))
    tried = {
        words[: len(command)]
        for words in COMMANDS
        for command in commands
        if words[: len(command)] == command
    }
    assert tried == commands


def test_python_is_started_in_one_way():
    """What starts an interpreter does so by `python_command`, or within `safe_path`."""
    allowed = {"subprocesses.py", "executors/slurm.py"}
    for path in sorted((ROOT / "rfca_rig").rglob("*.py")):
        name = path.relative_to(ROOT / "rfca_rig").as_posix()
        tree = ast.parse(path.read_text(encoding="utf-8"))
        mentions = {ast.unparse(node) for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
        assert "sys.executable" not in mentions or name in allowed, (
            f"{name}: take subprocesses.python_command"
        )
        text = path.read_text(encoding="utf-8")
        starts = (
            'get_context("spawn")' in text
            or "ensure_running()" in text
            or "SharedMemory(name)" in text
        )
        assert not starts or "safe_path()" in text, (
            f"{name}: start it within subprocesses.safe_path"
        )
