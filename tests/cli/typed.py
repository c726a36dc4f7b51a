"""Types a command as a user would, in this process."""

import sys
from dataclasses import dataclass

import pytest

from rfca_rig.cli.main import run


@dataclass(frozen=True)
class Said:
    """What a command left behind on the terminal."""

    exit_code: int
    out: str
    err: str


def typed(monkeypatch, capsys, *words) -> Said:
    monkeypatch.setattr(sys, "argv", ["rfca-rig", *map(str, words)])
    with pytest.raises(SystemExit) as leaving:
        run()
    out, err = capsys.readouterr()
    return Said(leaving.value.code or 0, out, err)
