"""Text for people: what a mistyped name may have meant, and messages of one line."""

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path

from rfca_rig.escaping import printable

# Characters of a message, ten rows of a terminal, and of a word in it: a path in a deep folder is
# whole, a cell of 100 kB is not.
LONGEST_LINE = 800
LONGEST_WORD = 200


def in_one_line(text: str) -> str:
    """The text as one printable line: what a file or an option holds, however long, does not
    hide the message about it.
    """
    words = (
        word if len(word) <= LONGEST_WORD else f"{word[:80]}...{word[-40:]}"
        for word in printable(text).split()
    )
    line = " ".join(words)
    if len(line) <= LONGEST_LINE:
        return line
    return f"{line[: LONGEST_LINE - 3]}..."


def suggestion(name: str, known: Iterable[str]) -> str:
    """`did you mean x?` where something known is near, else all there is: `there are x, y, z`."""
    listed = list(known)
    near = _near(name, listed)
    if near:
        return f"did you mean {near}?"
    return f"there are {', '.join(listed)}"


def not_there(path: Path) -> str:
    """That there is no such file or folder, and what is called nearly so; else the command that
    lists runs.
    """
    if path.absolute().parent.is_dir():
        siblings = [sibling.name for sibling in path.absolute().parent.iterdir()]
    else:
        siblings = []
    near = _near(path.name, siblings)
    if near:
        return f"{path}: is not there; did you mean {path.parent / near}?"
    return f"{path}: is not there; rfca-rig runs lists what was recorded"


def _near(name: str, known: Iterable[str]) -> str:
    """The nearest, "" where none is near."""
    by_lower = {candidate.casefold(): candidate for candidate in known}
    matches = get_close_matches(name.casefold(), by_lower, n=1, cutoff=0.6)
    if matches:
        return by_lower[matches[0]]
    return ""
