"""The tutorials: their commands run as written, and print what is shown."""

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
RIG = "from-your-rig-to-a-diagnosis"
MECHANISM = "from-a-model-file-to-a-diagnosis"
GUIDES = {
    name: (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8") for name in (RIG, MECHANISM)
}
GUIDE = GUIDES[RIG]
BLOCK = re.compile(
    r"(?:<!-- file: (?P<file>\S+) -->\n```toml\n(?P<content>.*?)```)"
    r"|(?P<long><!-- long -->\n)?```sh\n(?P<typed>.*?)```(?:\n\n```text\n(?P<shown>.*?)```)?",
    re.DOTALL,
)


@dataclass(frozen=True)
class Block:
    """Commands that stand together, and what is shown of what they print; or a file with its
    content.
    """

    commands: Sequence[str]
    shown: Sequence[str]
    is_long: bool
    file: tuple[str, str] | None = None


def read_blocks(text: str) -> list[Block]:
    """The blocks of a tutorial, in their order."""
    blocks = []
    for found in BLOCK.finditer(text):
        if found["file"]:
            blocks.append(Block((), (), False, (found["file"], found["content"])))
        else:
            shown = [line for line in (found["shown"] or "").splitlines() if line != "..."]
            blocks.append(Block(found["typed"].splitlines(), shown, bool(found["long"])))
    return blocks


@pytest.fixture
def clone(tmp_path, monkeypatch):
    """A folder that looks like a fresh clone to the commands."""
    for name in ("calibration", "tests"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)


def follow(blocks, monkeypatch, capsys):
    """Types every command; each line that is shown must have been said, whatever its numbers."""
    for block in blocks:
        if block.file is not None:
            path, content = block.file
            Path(path).write_text(content, encoding="utf-8")
        said = ""
        for command in block.commands:
            program, *words = shlex.split(command)
            if program in ("cp", "mkdir"):
                shutil.copy(*words) if program == "cp" else Path(*words).mkdir()
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


@pytest.mark.parametrize(("name", "short", "long"), [(RIG, 7, 5), (MECHANISM, 4, 2)])
def test_a_tutorial_has_blocks_of_both_kinds(name, short, long):
    assert [
        sum(block.is_long is kind for block in read_blocks(GUIDES[name])) for kind in (False, True)
    ] == [short, long]


@pytest.mark.parametrize("name", [RIG, pytest.param(MECHANISM, marks=pytest.mark.slow)])
def test_its_short_commands_run_as_written(name, clone, monkeypatch, capsys):
    follow([block for block in read_blocks(GUIDES[name]) if not block.is_long], monkeypatch, capsys)


@pytest.mark.long
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("name", GUIDES)
def test_all_of_it_runs_as_written(name, clone, monkeypatch, capsys):
    follow(read_blocks(GUIDES[name]), monkeypatch, capsys)


def test_the_pages_that_it_leads_to_are_there():
    for page in re.findall(r"`((?:docs|calibration|tests)/[\w./-]+)`", "".join(GUIDES.values())):
        assert (ROOT / page).exists(), page


def test_every_verdict_has_its_line():
    for verdict in (
        "IDENTIFIED",
        "MOSTLY",
        "FAMILY",
        "NOTHING MISSING",
        "UNEXPLAINED",
        "NOT ENOUGH DATA",
    ):
        assert f"| `{verdict}` |" in GUIDE
