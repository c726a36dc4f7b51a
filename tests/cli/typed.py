"""Types a command as a user would, in this process."""

import io
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import pytest

from rfca_rig.cli.main import run

# A busy machine must not change what a command says: its log has no line within a test.
PROGRESS_PERIOD = "rfca_rig.cli.progress.LOG_EVERY_S"
NEVER_S = 1e6


@dataclass(frozen=True)
class Said:
    """What a command left behind on the terminal."""

    exit_code: int
    out: str
    err: str


def typed(monkeypatch, capsys, *words) -> Said:
    monkeypatch.setattr(sys, "argv", ["rfca-rig", *map(str, words)])
    monkeypatch.setattr(PROGRESS_PERIOD, NEVER_S)
    with pytest.raises(SystemExit) as leaving:
        run()
    out, err = capsys.readouterr()
    return Said(leaving.value.code or 0, out, err)


def typed_in(folder: Path, *words) -> Said:
    """Types a command in that folder, for fixtures that several tests share. A process of its
    own would import all of it again.
    """
    out, err = (
        io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True) for _ in range(2)
    )
    with pytest.MonkeyPatch.context() as patched, redirect_stdout(out), redirect_stderr(err):
        patched.chdir(folder)
        patched.setattr(sys, "argv", ["rfca-rig", *map(str, words)])
        patched.setattr(PROGRESS_PERIOD, NEVER_S)
        with pytest.raises(SystemExit) as leaving:
            run()
    return Said(leaving.value.code or 0, *(one.buffer.getvalue().decode() for one in (out, err)))
