"""The guide from one's own rig to a diagnosis: its commands run as written, and print what it shows."""

import re
import shlex
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.cli.typed import typed
from tests.trip_pages import form

ROOT = Path(__file__).parents[1]
GUIDE = (ROOT / "docs" / "from-your-rig-to-a-diagnosis.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"(?P<long><!-- long -->\n)?```sh\n(?P<typed>.*?)```(?:\n\n```text\n(?P<shown>.*?)```)?", re.DOTALL)


@dataclass(frozen=True)
class Block:
    """Commands that stand together, and what is shown of what they print."""

    commands: Sequence[str]
    shown: Sequence[str]
    is_long: bool


BLOCKS = [
    Block(found["typed"].splitlines(), [line for line in (found["shown"] or "").splitlines() if line != "..."], bool(found["long"]))
    for found in BLOCK.finditer(GUIDE)
]


@pytest.fixture
def clone(tmp_path, monkeypatch):
    """A folder that looks like a fresh clone to the commands."""
    for name in ("calibration", "tests"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)


def follow(blocks, monkeypatch, capsys):
    """Types every command; each line that is shown must have been said, whatever its numbers."""
    for block in blocks:
        said = ""
        for command in block.commands:
            program, *words = shlex.split(command)
            if program == "cp":
                shutil.copy(*words)
                continue
            assert program == "rfca-rig"
            answer = typed(monkeypatch, capsys, *words)
            assert answer.exit_code == 0, f"{command}\n{answer.err}"
            said += answer.out + answer.err
        for line in block.shown:
            assert plain(line) in plain(said), line


def plain(text: str) -> str:
    """Numbers are those of the machine that the guide was written on."""
    return form(" ".join(text.split()))


def test_the_guide_has_blocks_of_both_kinds():
    assert [sum(block.is_long is kind for block in BLOCKS) for kind in (False, True)] == [6, 5]


def test_its_short_commands_run_as_written(clone, monkeypatch, capsys):
    follow([block for block in BLOCKS if not block.is_long], monkeypatch, capsys)


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_all_of_it_runs_as_written(clone, monkeypatch, capsys):
    follow(BLOCKS, monkeypatch, capsys)


def test_the_pages_that_it_leads_to_are_there():
    for page in re.findall(r"`((?:docs|calibration|tests)/[\w./-]+)`", GUIDE):
        assert (ROOT / page).exists(), page


def test_every_verdict_has_its_line():
    for verdict in ("IDENTIFIED", "MOSTLY", "FAMILY", "NOTHING MISSING", "UNEXPLAINED", "NOT ENOUGH DATA"):
        assert f"| `{verdict}` |" in GUIDE
