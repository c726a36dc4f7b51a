"""Broken environments: normal work or one clear line, no traceback, nothing half written.

Permissions are tested with /proc, which refuses an administrator too.
"""

import errno
import os
import re
import resource
import shutil
import socket
import subprocess
import sys
import tempfile
import tracemalloc
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from rfca_rig.devices.checks import probe_receive_buffer
from rfca_rig.executors.cores import ONE_THREAD, use_one_thread_if_processes_are_few
from rfca_rig.model.kernel import compiled
from tests.cli.malformed_inputs import CART, EXPERIMENT, MECHANISM
from tests.cli.typed import typed

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the shell and the limits of Unix")

TYPED = f'"{sys.executable}" -c "from rfca_rig.cli.main import run; run()"'
# Asks for no model; then one that plans, and one that moves the twin and records.
TRIP = "trip S-03"
WRONG = "trip X-99"
PLAN = "plan flapping"
RUN = "dynamic run --height 235 --speed 3.2 --repeats 1"


@dataclass(frozen=True)
class Surroundings:
    """How a command is called, and what it must end with: an exit code, and a text in its only
    line for codes other than 0.
    """

    words: str
    code: int = 0
    line: str = ""
    sets: Mapping[str, str] = field(default_factory=dict)
    unsets: tuple[str, ...] = ()
    script: str = "TYPED"
    limit: tuple[int, int] | None = None


def limit_of(kind: str, most: int) -> tuple[int, int]:
    return (getattr(resource, f"RLIMIT_{kind}"), most)


CASES: dict[str, Surroundings] = {
    "stdin closed": Surroundings(TRIP, script="TYPED <&-"),
    "stdout closed": Surroundings(TRIP, script="TYPED >&-"),
    "stderr closed": Surroundings(WRONG, 2, script="TYPED 2>&-"),
    "all streams closed": Surroundings(WRONG, 2, script="TYPED <&- >&- 2>&-"),
    "stdout full": Surroundings(
        TRIP, 1, "the system refused: No space left on device", script="TYPED >/dev/full"
    ),
    "stderr full": Surroundings(WRONG, 2, script="TYPED 2>/dev/full"),
    "stdout a broken pipe": Surroundings("trip", 1, script="TYPED | true; exit ${PIPESTATUS[0]}"),
    "TERM unset": Surroundings("--help", unsets=("TERM",)),
    "TERM dumb": Surroundings("--help", sets={"TERM": "dumb"}),
    "COLUMNS 1": Surroundings(TRIP, sets={"COLUMNS": "1"}),
    "COLUMNS 0": Surroundings("--help", sets={"COLUMNS": "0"}),
    "COLUMNS text": Surroundings("--help", sets={"COLUMNS": "wide", "LINES": "-1"}),
    "COLUMNS negative": Surroundings(WRONG, 2, "no code of a trip", sets={"COLUMNS": "-5"}),
    "NO_COLOR and FORCE_COLOR": Surroundings("--help", sets={"NO_COLOR": "1", "FORCE_COLOR": "1"}),
    "LANG C": Surroundings(
        TRIP, sets={"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}
    ),
    "a locale that is not there": Surroundings(
        TRIP, sets={"LC_ALL": "xx_YY.ISO-8859-99"}, script="TYPED 2>/dev/null"
    ),
    "PYTHONIOENCODING ascii": Surroundings(TRIP, sets={"PYTHONIOENCODING": "ascii:strict"}),
    "PYTHONIOENCODING utf-16": Surroundings(TRIP, sets={"PYTHONIOENCODING": "utf-16"}),
    "HOME unset": Surroundings(
        "runs --runs .", unsets=("HOME", "XDG_CONFIG_HOME", "XDG_CACHE_HOME")
    ),
    "HOME missing": Surroundings(
        "runs --runs .", sets={"HOME": "/proc/nowhere"}, unsets=("XDG_CONFIG_HOME",)
    ),
    "HOME a file": Surroundings(
        "runs --runs .", sets={"HOME": "/etc/passwd"}, unsets=("XDG_CONFIG_HOME",)
    ),
    "XDG folders empty": Surroundings(
        "runs --runs .", sets={"XDG_CONFIG_HOME": "", "XDG_CACHE_HOME": "", "XDG_DATA_HOME": ""}
    ),
    "XDG folders no folders": Surroundings(
        "runs --runs .", sets={"XDG_CONFIG_HOME": "/dev/null", "XDG_RUNTIME_DIR": "/dev/null"}
    ),
    "TMPDIR missing": Surroundings("runs --runs .", sets={"TMPDIR": "/nowhere"}),
    "TMPDIR takes no file": Surroundings(TRIP, sets={"TMPDIR": "/proc"}),
    "folder deleted": Surroundings(
        "report x",
        2,
        "the folder that you are in has been deleted",
        script="mkdir a; cd a; rmdir ../a; TYPED",
    ),
    "folder takes no file": Surroundings(RUN, 2, "0 MB free", script="cd /proc; TYPED"),
    "runs in a folder that takes no file": Surroundings(
        "runs --runs irq", script="cd /proc; TYPED"
    ),
    "output folder a file": Surroundings(
        f"{RUN} --runs file", 2, "is a file, where a folder is needed", script="touch file; TYPED"
    ),
    "output folder takes no file": Surroundings(f"{RUN} --runs /proc/runs", 2, "/proc"),
    "output file a device": Surroundings(
        "predict --height 215 --speed 2 --csv pipe",
        2,
        "is a device or a pipe",
        script="mkfifo pipe; TYPED",
    ),
    "output file below a device": Surroundings(
        "predict --height 215 --speed 2 --csv /dev/null/x", 2, "Not a directory"
    ),
    "few open files": Surroundings(TRIP, limit=limit_of("NOFILE", 16)),
    "file size 0": Surroundings(TRIP, limit=limit_of("FSIZE", 0)),
    "little memory": Surroundings(TRIP, limit=limit_of("AS", 256 << 20)),
    "umask 777": Surroundings("runs --runs .", script="umask 777; TYPED"),
    "NUMBA_CACHE_DIR takes no file": Surroundings(
        "runs --runs .", sets={"NUMBA_CACHE_DIR": "/proc/x"}
    ),
    "OMP_NUM_THREADS text": Surroundings(
        TRIP, sets={"OMP_NUM_THREADS": "many", "OPENBLAS_NUM_THREADS": "-3"}
    ),
    "PYTHONHASHSEED": Surroundings(TRIP, sets={"PYTHONHASHSEED": "4294967295"}),
    "PYTHONOPTIMIZE": Surroundings(TRIP, sets={"PYTHONOPTIMIZE": "2"}),
    "PYTHONDONTWRITEBYTECODE": Surroundings(TRIP, sets={"PYTHONDONTWRITEBYTECODE": "1"}),
    "warnings are errors": Surroundings(TRIP, sets={"PYTHONWARNINGS": "error"}),
    "TZ nowhere": Surroundings("runs --runs . --since 2026-11-01", sets={"TZ": "Nowhere/Never"}),
    "TZ a device": Surroundings("runs --runs . --since 2026-11-01", sets={"TZ": ":/dev/zero"}),
    "PWD wrong": Surroundings("runs --runs .", sets={"PWD": "/nowhere"}),
    "proxies": Surroundings(
        "twin tell faults --control-port 1",
        1,
        "no answer on port 1",
        sets={"HTTP_PROXY": "http://x:1"},
    ),
    "a name with control characters": Surroundings(
        "runs --runs .", sets={"LOGNAME": "\x1b]0;x\x07", "USER": "a\nb"}
    ),
}


def called(surroundings: Surroundings, folder: Path) -> subprocess.CompletedProcess[bytes]:
    """The command in its surroundings, without those of the tests."""
    kept = (
        "PATH",
        "PYTHONPATH",
        "HOME",
        "XDG_CACHE_HOME",
        "XDG_CONFIG_HOME",
        "NUMBA_CACHE_DIR",
        "RFCA_RIG_THREADS",
        "OMP_NUM_THREADS",
    )
    environment = {name: os.environ[name] for name in kept if name in os.environ} | dict(
        surroundings.sets
    )
    for name in surroundings.unsets:
        environment.pop(name, None)
    script = surroundings.script.replace("TYPED", f"{TYPED} {surroundings.words}")
    return subprocess.run(
        ["bash", "-c", script],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        preexec_fn=limiting(surroundings.limit),
        timeout=500,
        check=False,
    )


def limiting(limit: tuple[int, int] | None) -> Callable[[], None]:
    def limit_self() -> None:
        if limit is not None:
            resource.setrlimit(limit[0], (limit[1], resource.getrlimit(limit[0])[1]))

    return limit_self


def check(surroundings: Surroundings, folder: Path) -> None:
    done = called(surroundings, folder)
    said = done.stderr.decode("utf-8", "replace")
    assert done.returncode == surroundings.code, said
    for word in ("Traceback", "mistake", "Exception ignored", "\x1b]"):
        assert word not in said
    assert surroundings.line in said
    own = [
        line
        for line in said.splitlines()
        if not line.startswith(("SIM ", "  ", "report/", "diagnosis/", "next: "))
    ]
    assert len(own) <= 1, own
    assert not [path for path in folder.rglob("*") if path.name.endswith(".writing")]


# Each starts an interpreter; these cover a stream, a setting, a folder and a limit each.
QUICK = (
    "stdout full",
    "stderr full",
    "stdout a broken pipe",
    "COLUMNS 0",
    "PYTHONIOENCODING ascii",
    "HOME missing",
    "folder deleted",
    "output folder takes no file",
    "few open files",
)


@pytest.mark.parametrize("name", QUICK)
def test_a_broken_environment_costs_one_line_at_most(tmp_path, name):
    check(CASES[name], tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in CASES if name not in QUICK])
def test_any_broken_environment_costs_one_line_at_most(tmp_path, name):
    check(CASES[name], tmp_path)


SLOW: dict[str, Surroundings] = {
    "all streams closed": Surroundings(RUN, script="TYPED <&- >&- 2>&-"),
    # The run is completed and recorded though nobody reads its lines; only its last line, where it
    # is recorded, costs the exit code.
    "stderr a broken pipe": Surroundings(
        RUN, 1, script="TYPED 2>&1 >/dev/null | true; exit ${PIPESTATUS[0]}"
    ),
    "stdout full": Surroundings(
        f"{RUN} --json", 1, "the system refused: No space left on device", script="TYPED >/dev/full"
    ),
    # Nothing of these depends on another, and each run takes two seconds to begin.
    "TMPDIR missing, LANG C, CAN_CONFIG no JSON, XDG_CONFIG_HOME takes no file": Surroundings(
        RUN,
        sets={
            "TMPDIR": "/nowhere",
            **{"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"},
            "CAN_CONFIG": "not json",
            "XDG_CONFIG_HOME": "/proc/x",
        },
    ),
    # With 2 the compiled model has another bytecode, and compiling it again takes a minute; the
    # quick test has 2.
    "PYTHONOPTIMIZE, COLUMNS 1": Surroundings(PLAN, sets={"PYTHONOPTIMIZE": "1", "COLUMNS": "1"}),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SLOW)
def test_a_run_in_a_broken_environment_costs_one_line_at_most(tmp_path, name):
    check(SLOW[name], tmp_path)
    if SLOW[name].words.startswith(RUN):
        assert len(list(tmp_path.glob("runs/SIM-*/run.h5"))) == 1


# The limit of processes does not hold for the administrator: another real user, and the rights
# without those to pass the limit.
ANOTHER_USER = (
    "setpriv --ruid 65533 --euid 0 --bounding-set -sys_resource,-sys_admin --inh-caps=-all "
)
NO_MORE = "the system allows no further process or thread"
# A recording for these that read one.
RECORDED = str(Path(__file__).parents[1] / "data" / "small-campaign")
FEW: dict[str, Surroundings] = {
    "one process": Surroundings(TRIP, script="exec PRLIMIT1 TYPED"),
    "one process for a plan": Surroundings(PLAN, script="exec PRLIMIT1 TYPED"),
    "one process for a run": Surroundings(RUN, 1, NO_MORE, script="exec PRLIMIT1 TYPED"),
    "two processes for a run": Surroundings(RUN, 1, NO_MORE, script="exec PRLIMIT2 TYPED"),
    "three processes for a run": Surroundings(RUN, 1, NO_MORE, script="exec PRLIMIT3 TYPED"),
    "one process for the doctor": Surroundings("doctor", 1, NO_MORE, script="exec PRLIMIT1 TYPED"),
    "one process for a report": Surroundings(
        f"report {RECORDED} --out report", script="exec PRLIMIT1 TYPED"
    ),
    "two processes for a report": Surroundings(
        f"report {RECORDED} --out report", script="exec PRLIMIT2 TYPED"
    ),
    "one process for a diagnosis": Surroundings(
        f"diagnose {RECORDED} --out diagnosis", script="exec PRLIMIT1 TYPED"
    ),
    "three processes for a diagnosis": Surroundings(
        f"diagnose {RECORDED} --out diagnosis", script="exec PRLIMIT3 TYPED"
    ),
}


@pytest.mark.skipif(
    shutil.which("prlimit") is None or shutil.which("setpriv") is None,
    reason="the tools of util-linux",
)
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=() if name == "one process" else pytest.mark.slow) for name in FEW],
)
def test_few_processes_cost_one_line_at_most(name):
    limited = rf"{ANOTHER_USER if os.getuid() == 0 else ''}prlimit --nproc=\1:\1"
    script = re.sub(r"PRLIMIT(\d)", limited, FEW[name].script)
    # The program asks with the rights of the real user whether it may write there; tmp_path is
    # closed to others.
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o777)
        check(replace(FEW[name], script=script), Path(folder))
        # What could not begin leaves no folder behind.
        assert FEW[name].code == 0 or not list(Path(folder).iterdir())


NO_LOOPBACK: dict[str, Surroundings] = {
    "twin server": Surroundings(
        "twin serve --seconds 0.1",
        2,
        "cannot listen on 127.0.0.1: this computer has no such address",
    ),
    "client of the twin server": Surroundings("twin tell status", 1, "no answer on port"),
    "run": Surroundings(RUN),
    "run with a view": Surroundings(
        f"{RUN} --view --pace 0", 2, "cannot listen on 127.0.0.1: this computer has no such address"
    ),
}


# Runs its arguments in a network of its own that has ::1 and no IPv4 address.
IPV6_ONLY = """
import fcntl, os, socket, struct, sys
control, no_address = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), struct.pack("16sH14x8x", b"lo", socket.AF_INET)
fcntl.ioctl(control, 0x8914, struct.pack("16sH14x8x", b"lo", 0x41))  # SIOCSIFFLAGS: up and running
fcntl.ioctl(control, 0x8916, no_address)  # SIOCSIFADDR
os.execvp(sys.argv[1], sys.argv[1:])
"""


def has_own_networks() -> bool:
    tool = shutil.which("unshare")
    return (
        tool is not None
        and subprocess.run([tool, "-rn", "true"], capture_output=True, check=False).returncode == 0
    )


@pytest.mark.slow
@pytest.mark.skipif(
    not has_own_networks(), reason="networks of its own, which the system may refuse to a user"
)
@pytest.mark.parametrize("name", NO_LOOPBACK)
def test_a_computer_without_ipv4_costs_one_line_at_most(tmp_path, name):
    tmp_path.joinpath("ipv6_only.py").write_text(IPV6_ONLY, encoding="utf-8")
    check(
        replace(
            NO_LOOPBACK[name], script=f'exec unshare -rn "{sys.executable}" ipv6_only.py TYPED'
        ),
        tmp_path,
    )


def test_threads_are_limited_only_where_processes_are_few(monkeypatch):
    for name in (*ONE_THREAD, "OPENCV_FOR_THREADS_NUM"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(resource, "getrlimit", lambda _: (4096, 4096))
    use_one_thread_if_processes_are_few()
    assert "OPENBLAS_NUM_THREADS" not in os.environ
    monkeypatch.setattr(resource, "getrlimit", lambda _: (100, 4096))
    # Deleted again after the test, as monkeypatch knows them.
    for name in (*ONE_THREAD, "OPENCV_FOR_THREADS_NUM"):
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    use_one_thread_if_processes_are_few()
    assert (
        os.environ["OPENBLAS_NUM_THREADS"],
        os.environ["OMP_NUM_THREADS"],
        os.environ["OPENCV_FOR_THREADS_NUM"],
    ) == ("1", "3", "1")


def test_the_doctor_needs_no_way_to_this_computer(monkeypatch):
    def refuse(*_: object) -> None:
        raise OSError(errno.ENETUNREACH, "Network is unreachable")

    class NoWay(socket.socket):
        connect = refuse

    monkeypatch.setattr(socket, "socket", NoWay)
    assert probe_receive_buffer() > 0


@pytest.mark.parametrize(
    ("package", "words", "extra"),
    [
        ("mujoco", ("check", "cart"), "mechanism"),
        ("mcap", ("export", "mcap", "run", "--out", "x.mcap"), "mcap"),
        ("uvicorn", ("view", "run"), "view"),
    ],
)
def test_an_extra_that_is_missing_is_named(monkeypatch, capsys, tmp_path, package, words, extra):
    monkeypatch.chdir(tmp_path)
    Path("cart").mkdir()
    for name, text in (("experiment.toml", EXPERIMENT), ("model.xml", MECHANISM), ("a.csv", CART)):
        Path("cart", name).write_text(text, encoding="utf-8")
    monkeypatch.setitem(sys.modules, package, None)
    said = typed(monkeypatch, capsys, *words)
    assert said.exit_code == 2
    assert f"rfca-rig[{extra}]" in said.err + said.out
    assert "Traceback" not in said.err


def test_a_library_that_cannot_be_loaded_is_no_mistake_of_the_program(
    monkeypatch, capsys, tmp_path
):
    monkeypatch.setitem(sys.modules, "cv2", None)
    monkeypatch.delitem(sys.modules, "rfca_rig.vision.board", raising=False)
    said = typed(monkeypatch, capsys, "calibrate", "camera", "--make-board", tmp_path / "board.pdf")
    assert said.exit_code == 1
    assert "a library cannot be loaded" in said.err
    assert "mistake" not in said.err
    assert not list(tmp_path.iterdir())


def test_a_user_without_a_home_has_a_cache_that_is_their_own(monkeypatch):
    def nowhere() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", nowhere)
    assert Path(compiled.cache_folder()).is_relative_to(Path(compiled.__file__).parent)


@pytest.mark.parametrize("name", ["experiment.toml", "a.csv", "campaign.toml"])
@pytest.mark.timeout(60)
def test_a_pipe_among_recordings_does_not_stop_the_list_of_runs(
    tmp_path, monkeypatch, capsys, name
):
    place = tmp_path / "cart"
    place.mkdir()
    for file, text in (("experiment.toml", EXPERIMENT), ("model.xml", MECHANISM), ("a.csv", CART)):
        place.joinpath(file).write_text(text, encoding="utf-8")
    place.joinpath(name).unlink(missing_ok=True)
    os.mkfifo(place / name)
    said = typed(monkeypatch, capsys, "runs", "--runs", tmp_path)
    assert said.exit_code == 0
    assert "Traceback" not in said.err


def test_a_table_of_a_campaign_that_does_not_fit_into_memory_is_refused(
    tmp_path, monkeypatch, capsys
):
    """Its hash is computed before it is refused, in pieces."""
    shutil.copytree("tests/data/small-campaign", tmp_path / "campaign")
    # A lower limit than the usual one has the same two steps.
    monkeypatch.setenv("RFCA_RIG_READ_GIB", "0.6")
    with (tmp_path / "campaign/runs/dynamic-03.csv").open("wb") as file:
        file.truncate(100_000_000)
    tracemalloc.start()
    try:
        said = typed(
            monkeypatch, capsys, "report", tmp_path / "campaign", "--out", tmp_path / "report"
        )
        _, most_bytes = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert said.exit_code == 2
    assert "has 100 MB, where 81 MB are the most; raise RFCA_RIG_READ_GIB, or split it" in said.err
    assert most_bytes < 50_000_000
