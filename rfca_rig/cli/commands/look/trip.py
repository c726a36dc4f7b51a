"""rfca-rig trip"""

import re
from pathlib import Path
from typing import Annotated

import typer

WIDTH = 80


def trip(code: Annotated[str, typer.Argument(metavar="CODE", help="Such as F-02; without it, all codes are listed.")] = "") -> None:
    """Say what a code that stopped a run means: likely causes, how to tell them apart, what to change and what not, how to go on.

    Example: rfca-rig trip F-02
    """
    from rfca_rig.errors import BadInput, Trip

    known = [str(one) for one in Trip]
    if not code:
        typer.echo("\n".join(f"{one}  {_title(one)}" for one in known))
        return
    if code.upper() not in known:
        raise BadInput(f"{code}: no code of a trip; known are {', '.join(known)}")
    typer.echo("\n".join(_lines(_page(code.upper()))))


def _lines(page: str) -> list[str]:
    """The page as a terminal shows it: paragraphs and items within 80 columns, without marks and links."""
    from textwrap import wrap

    # Blocks begin at an empty line, a numbered item or a heading; each is wrapped on its own.
    blocks = re.split(r"\n(?=\n|\d\. |# )", re.sub(r" \[All trips\]\(.*?\)|```(text)?\n|\*\*", "", page))
    plain = (re.sub(r"\[(.*?)\]\(.*?\)", r"\1", block).replace("`", "") for block in blocks)
    return [
        line
        for block in plain
        for line in ([] if block.strip() and not block.startswith("\n") else [""])
        + wrap(" ".join(block.split()), WIDTH, subsequent_indent="   " if block[:1].isdigit() else "", break_on_hyphens=False)
    ]


def _title(code: str) -> str:
    """The text behind the code in the page's heading."""
    return _page(code).partition("\n")[0].partition(": ")[2]


def _page(code: str) -> str:
    from rfca_rig.cli.paths import folders_of
    from rfca_rig.errors import BadInput

    for folder in folders_of("docs"):
        page: Path = folder / "trips" / f"{code}.md"
        if page.is_file():
            return page.read_text(encoding="utf-8")
    raise BadInput(f"docs/trips/{code}.md did not come with this installation; it is in the package's repository")
