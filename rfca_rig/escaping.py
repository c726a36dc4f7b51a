"""Names and other texts from files, written into another language so that they stay data: one
function for each language.

A name of a joint, a column or a run may come from a stranger's file. Wherever such a text becomes
part of a program, a file or a page, it goes through a function of this module, or through Python's
own writer of JSON.
"""

import csv
import io
import json
import re
from collections.abc import Iterable
from html import escape
from unicodedata import category

# Signs that turn the direction of the text after them: what is shown would differ from what is
# there.
TURNS_DIRECTION = frozenset(
    "\u061c\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
)
QUOTES = frozenset("\"'`")

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_TOML_ESCAPES = {'"': '\\"', "\\": "\\\\"}


def printable(text: str) -> str:
    """For a terminal or a page: no control characters, which could move the cursor, rename the
    window or write to the clipboard.

    Line feeds and tabs stay. Every other control character, every sign that turns the direction of
    the text, and half of a surrogate pair become a replacement character.
    """
    return "".join(
        "\N{REPLACEMENT CHARACTER}" if _is_control(sign) and sign not in "\n\t" else sign
        for sign in text
    )


def html_text(text: str) -> str:
    """The text as it stands in HTML or SVG, between tags or in an attribute with double quotes."""
    return escape(printable(text), quote=True)


def python_docstring(text: str) -> str:
    """One line of a docstring between triple quotes that is not raw; Python reads the same text
    from it.
    """
    # A quote ends the docstring only beside others, so that examples with quotes stay as they are.
    quoted = re.sub(r'"(?="|$)', r"\\" + '"', text.replace("\\", "\\\\"))
    return "".join(sign if sign.isprintable() else _python_escape(sign) for sign in quoted)


def toml_string(text: str) -> str:
    """A string of TOML, with its quotes. Half of a surrogate pair, which TOML cannot hold,
    becomes a replacement character.
    """
    return (
        '"'
        + "".join(
            _TOML_ESCAPES.get(sign, sign if sign.isprintable() else _toml_escape(sign))
            for sign in text
        )
        + '"'
    )


def toml_key(text: str) -> str:
    """A key of TOML, in quotes where it needs them."""
    if _BARE_KEY.fullmatch(text):
        return text
    return toml_string(text)


def toml_comment(text: str) -> str:
    """A comment of one line, with its line break. What cannot be printed becomes a blank: a line
    break would end the comment.
    """
    return f"# {''.join(sign if sign.isprintable() else ' ' for sign in text)}".rstrip() + "\n"


def csv_line(cells: Iterable[object]) -> str:
    """A line of CSV with its line feed; numbers as Python writes them."""
    out = io.StringIO(newline="")
    # Before Python 3.13 the writer quotes a carriage return only where it is part of the line end;
    # readers take one for the end of a row.
    csv.writer(out, lineterminator="\r\n").writerow(cells)
    return out.getvalue().removesuffix("\r\n") + "\n"


def json_text(text: str) -> str:
    """JSON for a terminal, of JSON: what cannot be printed is written as its escape, so that it
    reads back as the same.
    """
    return "".join(
        _json_escape(sign) if _is_control(sign) and sign not in "\n\t" else sign for sign in text
    )


def find_unusable_sign(name: str) -> str | None:
    """In words, the first sign that a model's name must not have: one that cannot be printed, or
    a quote. None where there is none.
    """
    for sign in name:
        if not sign.isprintable():
            return f"the character U+{ord(sign):04X}, which cannot be printed"
        if sign in QUOTES:
            return f"the quote {sign}"
    return None


def _is_control(sign: str) -> bool:
    return category(sign) in ("Cc", "Cs", "Zl", "Zp") or sign in TURNS_DIRECTION


def _python_escape(sign: str) -> str:
    if ord(sign) < 0x100:
        return f"\\x{ord(sign):02x}"
    return f"\\U{ord(sign):08x}"


def _json_escape(sign: str) -> str:
    if ord(sign) >= 0x80:
        return json.dumps(sign)[1:-1]
    return f"\\u{ord(sign):04x}"


def _toml_escape(sign: str) -> str:
    if category(sign) == "Cs":
        code = ord("\N{REPLACEMENT CHARACTER}")
    else:
        code = ord(sign)
    if code < 0x10000:
        return f"\\u{code:04x}"
    return f"\\U{code:08x}"
