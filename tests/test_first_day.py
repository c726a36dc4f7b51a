"""The pages of a new drive: their commands run as written on the twin, and print what is shown."""

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.cli.typed import typed
from tests.test_guide import plain

ROOT = Path(__file__).parents[1]
PAGES = {name: (ROOT / "docs" / f"{name}.md").read_text() for name in ("first-day", "drives")}
BLOCK = re.compile(
    r"(?:<!-- (?P<mark>[^>]*) -->\n)?```sh\n(?P<typed>.*?)```(?:\n\n```text\n(?P<shown>.*?)```)?",
    re.DOTALL,
)
# These need a server; `tests/twin_server/test_new_drive.py` has them.
SERVED = ("server", "served")


@dataclass(frozen=True)
class Block:
    """Commands, the exit codes that they may have, and what is shown of their output."""

    commands: list[str]
    exit_codes: set[int]
    shown: list[str]


def read_blocks(text: str) -> list[Block]:
    blocks = []
    for found in BLOCK.finditer(text):
        mark = found["mark"] or "exit 0"
        if mark not in SERVED:
            shown = [line for line in (found["shown"] or "").splitlines() if line != "..."]
            exit_codes = {int(code) for code in re.findall(r"\d+", mark)}
            blocks.append(Block(found["typed"].splitlines(), exit_codes, shown))
    return blocks


@pytest.mark.parametrize(("name", "count"), [("first-day", 8), ("drives", 2)])
def test_a_page_s_commands_run_as_written_and_print_what_is_shown(
    name, count, tmp_path, monkeypatch, capsys
):
    (tmp_path / "calibration").symlink_to(ROOT / "calibration")
    monkeypatch.chdir(tmp_path)
    blocks = read_blocks(PAGES[name])
    assert len(blocks) == count
    for block in blocks:
        said = ""
        for command in block.commands:
            program, *words = shlex.split(command)
            assert program == "rfca-rig"
            answer = typed(monkeypatch, capsys, *words)
            assert answer.exit_code in block.exit_codes, f"{command}\n{answer.err}"
            said += answer.out + answer.err
        for line in block.shown:
            assert plain(line) in plain(said), line


def test_every_message_that_is_shown_of_a_refusal_is_one_of_the_program_s():
    """But for their values; the messages themselves are in the tests of the drive's setup."""
    source = " ".join(
        path.read_text() for path in (ROOT / "rfca_rig" / "devices" / "odrive").glob("*.py")
    )
    for words in (
        "answer, and the rig file has",
        "no ODrive answers at",
        "answers, the rig file has",
        "s of silence; set",
        "under [motor]",
        "not idle: its settings are left",
    ):
        assert words in " ".join(source.split())


@pytest.mark.parametrize("name", PAGES)
def test_the_links_of_a_page_lead_somewhere(name):
    links = re.findall(r"\]\((?!http)([^)#]*)", PAGES[name])
    assert len(links) > 2
    for link in filter(None, links):
        assert (ROOT / "docs" / link).exists(), link
