"""Terminal output: lines that fit it, in its encoding."""

import codecs
import io
import os
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TextIO

import typer

from rfca_rig.escaping import printable

Say = Callable[[str], None]

WIDTH = 80
WIDEST = 120

NAME = "rfca-ascii"
ASCII = {
    "\u00a0": " ",
    "\u00b0": " deg",
    "\u00b1": "+-",
    "\u00b2": "2",
    "\u00b3": "3",
    "\u00b5": "u",
    "\u00b7": ".",
    "\u00d7": "x",
    "\u2013": "-",
    "\u2026": "...",
    "\u2192": "->",
    "\u2212": "-",
}


def echo(text: str, nl: bool = True, err: bool = False, coloured: str = "") -> None:
    """Prints the text on standard output or the error stream: the one way in which a command
    prints.

    Texts of files and names of folders are in it, so it is printed without control characters.
    `coloured` is printed before it as it is: a word of this program, with the codes of its colour.
    """
    typer.echo(coloured + printable(text), nl=nl, err=err)


def print_lines(lines: Iterable[str], indent: str = "  ") -> None:
    """Prints lines wrapped between words to the width of the terminal; 80 columns where there is
    none.

    Tables are made to fit 80 columns, so that only prose is ever wrapped.
    """
    width = min(shutil.get_terminal_size((WIDTH, 24)).columns, WIDEST)
    for line in lines:
        for piece in wrap_line(line, width, indent):
            echo(piece)


def wrap_line(line: str, width: int = WIDTH, indent: str = "  ") -> list[str]:
    """The line in pieces of at most that many columns; a path or a command too long for one
    stays whole.
    """
    if len(line) <= width:
        return [line]
    return textwrap.wrap(
        line, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )


def open_null() -> TextIO:
    """A stream that takes everything, for the rest of the process."""
    return Path(os.devnull).open("w", encoding="utf-8")


def use_ascii_fallback() -> None:
    """For standard output and the error stream of this process; streams of another kind, as in
    tests, stay unchanged.
    """
    codecs.register_error(NAME, _in_ascii)
    # Python has no streams where the shell closed them (>&-): what is printed goes nowhere then.
    sys.stdout = sys.stdout or open_null()
    sys.stderr = sys.stderr or open_null()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=NAME)


def _in_ascii(error: UnicodeError) -> tuple[str, int]:
    """ASCII text for characters that cannot be encoded. Where no sign is similar, JSON's escape,
    so that JSON stays JSON.
    """
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(_sign, error.object[error.start : error.end])), error.end


def _sign(character: str) -> str:
    if character in ASCII:
        return ASCII[character]
    # JSON escapes characters beyond the basic plane as two UTF-16 surrogates.
    words = character.encode("utf-16-be", "surrogatepass")
    return "".join(f"\\u{words[i]:02x}{words[i + 1]:02x}" for i in range(0, len(words), 2))


def has_terminal() -> bool:
    """Whether a person can answer a question."""
    # Python has no standard input where the shell closed it (<&-).
    return sys.stdin is not None and sys.stdin.isatty()


def takes_colours() -> bool:
    """Whether the user allows colours; whether there is a terminal is another question."""
    return not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
