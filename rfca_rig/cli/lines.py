"""Results on standard output, in lines that fit a terminal."""

import shutil
import textwrap
from collections.abc import Iterable

import typer

WIDTH, WIDEST = 80, 120


def print_lines(lines: Iterable[str], indent: str = "  ") -> None:
    """Prints lines wrapped between words to the width of the terminal; 80 columns where there is none.

    Tables are made to fit 80 columns, so that only prose is ever wrapped.
    """
    width = min(shutil.get_terminal_size((WIDTH, 24)).columns, WIDEST)
    for line in lines:
        for piece in wrap_line(line, width, indent):
            typer.echo(piece)


def wrap_line(line: str, width: int = WIDTH, indent: str = "  ") -> list[str]:
    """The line in pieces of at most that many columns; a path or a command too long for one stays whole."""
    if len(line) <= width:
        return [line]
    return textwrap.wrap(line, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
