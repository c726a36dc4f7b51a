"""README and documents are read in a second language, at a bench: no words of our own."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCUMENTS = sorted({*(ROOT / "docs").rglob("*.md"), *ROOT.glob("*.md")})
# What is no prose: front matter, code, comments, tables, quotes, addresses of links.
NO_PROSE = re.compile(
    r"\A---\n(?s:.*?)\n---\n|```(?s:.*?)```|<!--(?s:.*?)-->|^ *[|>].*$|\]\([^)]*\)", re.MULTILINE
)
TABLES = re.compile(r"^ *\|.*$", re.MULTILINE)
CODE = re.compile(r"`[^`]*`")
# Our own word: what the field says. A room may have a temperature.
OUR_OWN = {
    r"held against": "compared with",
    r"believed?": "nominal, prior",
    r"foretell\w*|foretold": "predict",
    r"told as": "reported as",
    r"mend(?:s|ed)?": "fix",
    r"lets? go": "disable, remove torque",
    r"by lot": "at random",
    r"decoys?": "negative control",
    r"sealed": "hidden",
    r"rooms?(?! temperature)": "package, space",
    r"crew": "executor",
    r"strangers": "third-party clients",
    r"how well known": "standard uncertainty",
    r"anew": "again",
    r"whoever": "who",
    r"as it stands": "unchanged",
    r"nobody": "no one, or say what is missing",
    r"(?:dis)?obey\w*|obedient": "follow commands",
}


def prose(text: str) -> str:
    """The text of sentences and lists; of a link its words, of code that it is there."""
    return NO_PROSE.sub("", text)


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_words_are_those_of_the_field(path):
    text = path.read_text(encoding="utf-8")
    text = CODE.sub("", "\n".join((prose(text), *TABLES.findall(text))))
    assert [
        (found[0], plain)
        for own, plain in OUR_OWN.items()
        for found in re.finditer(rf"\b(?:{own})\b", text, re.IGNORECASE)
    ] == []
