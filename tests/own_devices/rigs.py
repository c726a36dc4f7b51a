"""Rig files with one device or both of a lab's own."""

import re
import shutil
from pathlib import Path

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "docs" / "examples"


def section(name: str) -> str:
    """As it stands in the worked example."""
    text = (EXAMPLES / "our-rig.toml").read_text()
    return re.search(rf"(?ms)^\[{name}\]\n.*?(?=^\[)", text)[0]


def rig_with(folder: Path, *names: str, change: tuple[str, str] | None = None) -> Path:
    """The shipped twin's file, with these sections and files of the worked example in place of
    its own, and one line changed.
    """
    text = (ROOT / "calibration" / "twin.toml").read_text().partition("[twin.camera]")[0]
    for name in names:
        text = re.sub(rf"(?ms)^\[{name}\]\n.*?(?=^\[)", lambda _, name=name: section(name), text)
    if change is not None:
        assert change[0] in text
        text = text.replace(*change)
    for file in EXAMPLES.glob("our_*.py"):
        shutil.copy(file, folder)
    rig = folder / "rig.toml"
    rig.write_text(text)
    return rig


def lines_of_code(file: Path) -> int:
    """What a person has to write: neither blank lines, nor comments, nor docstrings."""
    text = re.sub(r'(?s)"""(.*?)"""', "", file.read_text())
    return sum(
        bool(line.strip()) and not line.strip().startswith("#") for line in text.splitlines()
    )
