"""No reader follows, believes or trips over what is in a hostile recording: every kind of the
catalogue, every command.
"""

import base64
import hashlib
import os
import shutil
import signal
import sys
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import h5py
import pytest

from rfca_rig.campaign.reading import read_campaign
from rfca_rig.recording import run_folder
from rfca_rig.recording.hdf5_file import seal_of
from rfca_rig.recording.run_text import Ending, write_ending
from rfca_rig.recording.store import write_recording
from tests.campaign.small import SMALL
from tests.cli.typed import typed
from tests.recording.growing import grown
from tests.recording.hostile import BYTES, CANARY, FILES, FOLDERS, HARMLESS, NO_DAMAGE, lay_canary

SEAL_BYTES = 41
# The interpreter with what it imports takes 300 MB; a reader may take this much more.
MOST_MEMORY_MB = 700
# Of processor time, against a reader that never ends: all take seconds. One that waits for a pipe
# meets the limit of every test.
MOST_WORK_S = 60


@pytest.fixture(scope="module")
def plain(tmp_path_factory) -> Path:
    """A recording in one file: a stroke and two static stages."""
    whole = read_campaign(SMALL)
    return write_recording(
        replace(whole, strokes=whole.strokes[:1], static=whole.static[:2]),
        tmp_path_factory.mktemp("plain") / "run.h5",
    )


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    """A finished run of two stages with a photo."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    grown(folder, 2).finish("done")
    write_ending(folder, Ending({"ended": "done"}, run_folder.read_stages(folder).static))
    run_folder.build_recording(folder)
    return folder


def each(kinds: Iterable[str]) -> list:
    """Every eighth kind at each change, all of them with the slow tests."""
    return [
        pytest.param(name, marks=() if number % 8 == 0 else pytest.mark.slow)
        for number, name in enumerate(kinds)
    ]


def seal_again(path: Path) -> None:
    """As somebody does who knows the format."""
    content = path.read_bytes()
    path.write_bytes(content + seal_of(hashlib.sha256(content).digest()))


@pytest.fixture
def peak_MB():
    """Resets the highest memory use of this process; the function returned reads it."""
    marks = Path("/proc/self/clear_refs")

    def read() -> float:
        (line,) = [
            line
            for line in Path("/proc/self/status").read_text().splitlines()
            if line.startswith("VmHWM")
        ]
        return int(line.split()[1]) / 1e3

    try:
        marks.write_text("5")
    except OSError:
        return lambda: 0.0
    before = read()
    return lambda: read() - before


def spellings(canary: bytes) -> Iterator[bytes]:
    """The canary as it is, and as base64 at each of three alignments."""
    yield canary
    for shift in range(3):
        yield base64.b64encode(bytes(shift) + canary)[4:-4]


def assert_no_canary(place: str, content: bytes) -> None:
    assert not any(spelling in content for spelling in spellings(CANARY)), (
        f"{place} shows another file"
    )


def times_of(folder: Path) -> dict[Path, tuple[int, int, int]]:
    """Size, place on the disk and time of the last change of everything in a folder; links are
    not followed.
    """
    found = {path: path.lstat() for path in (folder, *folder.rglob("*"))}
    return {path: (at.st_size, at.st_ino, at.st_mtime_ns) for path, at in found.items()}


def assert_taken_or_refused(monkeypatch, capsys, folder: Path, peak_MB) -> dict[str, int]:
    """Every reader, one after the other. Returns their exit codes."""
    out = folder.parent / "out"
    lines = {
        "check": ["check", folder],
        "runs": ["runs", "--runs", folder.parent],
        "report": ["report", folder, "--out", out / "report"],
        "diagnose": ["diagnose", folder, "--out", out / "diagnosis"],
        "csv": ["export", "csv", folder, "--out", out / "csv"],
        "mcap": ["export", "mcap", folder, "--out", out.parent / "out.mcap"],
        "static report": ["static", "report", folder, "--out", out / "static"],
        "recover": ["recover", folder],
        "check again": ["check", folder],
    }
    codes = {}
    before = {}
    signal.signal(signal.SIGPROF, lambda *_: pytest.fail("does not end"))
    signal.setitimer(signal.ITIMER_PROF, MOST_WORK_S)
    try:
        for name, line in lines.items():
            # A recording that can be read would be diagnosed for minutes; one that cannot is
            # refused at once.
            if name == "diagnose" and codes["report"] == 0:
                continue
            # What was refused and left as it was would be checked a second time with the same
            # result.
            if name == "check again" and codes["recover"] == 2:
                assert times_of(folder) == before
                continue
            if name == "recover":
                before = times_of(folder)
            said = typed(monkeypatch, capsys, *line)
            codes[name] = said.exit_code
            assert said.exit_code in (0, 2), f"{name}: {said.err}"
            assert "Traceback" not in said.err, name
            assert "mistake" not in said.err, f"{name}: {said.err}"
            assert said.exit_code == 0 or said.err.count("\n") == 1, f"{name}: {said.err}"
            assert len(said.err) < 2000, f"{name}: {said.err[:200]}"
            assert "\x1b" not in said.out + said.err, name
            assert_no_canary(name, (said.out + said.err).encode())
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    assert peak_MB() < MOST_MEMORY_MB
    for file in folder.parent.rglob("*"):
        if (
            file.is_file()
            and not file.is_symlink()
            and "secret" not in file.relative_to(folder.parent).parts
        ):
            assert_no_canary(
                str(file), file.read_bytes() if file.stat().st_size < 64 << 20 else b""
            )
    return codes


@pytest.fixture
def readers(tmp_path, monkeypatch, capsys, peak_MB):
    monkeypatch.chdir(tmp_path)
    return lambda folder: assert_taken_or_refused(monkeypatch, capsys, folder, peak_MB)


@pytest.mark.parametrize("name", each(FILES))
def test_a_hostile_file(plain, tmp_path, readers, name):
    secret = lay_canary(tmp_path / "secret")
    folder = tmp_path / "runs" / "run"
    folder.mkdir(parents=True)
    path = Path(shutil.copy(plain, folder))
    os.truncate(path, path.stat().st_size - SEAL_BYTES)
    with h5py.File(path, "r+") as file:
        FILES[name](file, secret)
    seal_again(path)
    codes = readers(folder)
    assert (2 in (codes["check"], codes["report"])) is (name not in HARMLESS), codes


@pytest.mark.parametrize("name", each(BYTES))
def test_hostile_bytes(plain, tmp_path, readers, name):
    lay_canary(tmp_path / "secret")
    folder = tmp_path / "runs" / "run"
    folder.mkdir(parents=True)
    BYTES[name](Path(shutil.copy(plain, folder)))
    codes = readers(folder)
    assert (codes["check"] == 2) is (name not in HARMLESS), codes


@pytest.mark.skipif(sys.platform == "win32", reason="links, pipes and devices of Unix")
@pytest.mark.parametrize("name", each(FOLDERS))
def test_a_hostile_folder(whole, tmp_path, readers, name):
    secret = lay_canary(tmp_path / "secret")
    folder = tmp_path / "runs" / "run"
    shutil.copytree(whole, folder)
    FOLDERS[name](folder, secret)
    assert readers(folder)["check"] == (0 if name in NO_DAMAGE else 2)
