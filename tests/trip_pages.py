"""The pages of docs/trips, for the tests of what they show."""

import re
from dataclasses import dataclass
from pathlib import Path

DOCS = Path(__file__).parents[1] / "docs"
NUMBER = r"-?\d+(\.\d+)?"


@dataclass(frozen=True)
class Page:
    """`line` is its example of what the program says, `fault` that of the fault table by which
    it was made; "" for none.
    """

    text: str
    line: str
    fault: str


def page_of(code: str) -> Page:
    text = (DOCS / "trips" / f"{code}.md").read_text(encoding="utf-8")
    line = re.search(rf"```text\nrfca-rig: (.*); more: rfca-rig trip {code}\n```", text)[1]
    fault = re.search(r"Made by the fault `(.*)` of", text)
    return Page(text, line, fault[1] if fault else "")


def form(line: str) -> str:
    """The line without its numbers; hexadecimal ones stay."""
    return re.sub(rf"(?<![\w.])(?!0x){NUMBER}", "#", line)
