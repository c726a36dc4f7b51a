"""What one check found: a colour, what was seen, and the remedy."""

from dataclasses import dataclass
from enum import StrEnum


class Colour(StrEnum):
    """Green is as it should be, yellow works but will bite, red does not work."""

    GREEN = "green"
    YELLOW = "yellow"
    RED = "red"


@dataclass(frozen=True)
class Finding:
    """`subject` in a few words; `fix` says what to do, `commands` are lines to be typed as they stand."""

    subject: str
    colour: Colour
    seen: str
    fix: str = ""
    commands: tuple[str, ...] = ()


def green(subject: str, seen: str) -> Finding:
    return Finding(subject, Colour.GREEN, seen)


def yellow(subject: str, seen: str, fix: str, *commands: str) -> Finding:
    return Finding(subject, Colour.YELLOW, seen, fix, commands)


def red(subject: str, seen: str, fix: str, *commands: str) -> Finding:
    return Finding(subject, Colour.RED, seen, fix, commands)


def listed(numbers: tuple[int, ...]) -> str:
    """Ids as people write them."""
    return ", ".join(map(str, numbers))
