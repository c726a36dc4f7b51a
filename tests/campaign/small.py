"""A copy of the small campaign, to be broken in one place."""

import shutil
from collections.abc import Callable
from pathlib import Path

SMALL = Path(__file__).parents[1] / "data" / "small-campaign"


def copy_to(folder: Path) -> Path:
    return Path(shutil.copytree(SMALL, folder / "campaign"))


def edit(path: Path, change: Callable[[str], str]) -> None:
    before = path.read_text()
    after = change(before)
    assert after != before, "the edit changed nothing"
    path.write_text(after, newline="")


def swap(old: str, new: str) -> Callable[[str], str]:
    """Replaces the first `old`."""
    return lambda text: text.replace(old, new, 1)


def cell(line: int, column: int, new: str) -> Callable[[str], str]:
    """Puts `new` into a cell; lines and columns from 1."""

    def change(text: str) -> str:
        lines = text.split("\n")
        cells = lines[line - 1].split(",")
        cells[column - 1] = new
        lines[line - 1] = ",".join(cells)
        return "\n".join(lines)

    return change


def line(number: int, new: str | None) -> Callable[[str], str]:
    """Replaces a line, or takes it out."""

    def change(text: str) -> str:
        lines = text.split("\n")
        lines[number - 1 : number] = [] if new is None else [new]
        return "\n".join(lines)

    return change


def without_column(name: str) -> Callable[[str], str]:
    def change(text: str) -> str:
        rows = [row.split(",") for row in text.rstrip("\n").split("\n")]
        gone = rows[0].index(name)
        return "".join(",".join(row[:gone] + row[gone + 1 :]) + "\n" for row in rows)

    return change


def with_column(name: str, value: str) -> Callable[[str], str]:
    def change(text: str) -> str:
        header, *rows = text.rstrip("\n").split("\n")
        return "".join(
            row + "\n" for row in (f"{header},{name}", *(f"{row},{value}" for row in rows))
        )

    return change
