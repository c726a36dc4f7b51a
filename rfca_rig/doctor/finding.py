"""Result of one check: a colour, the observation, and the fix."""

from dataclasses import dataclass
from enum import StrEnum


class Colour(StrEnum):
    """Green: in order. Yellow: works, but will cause trouble. Red: does not work."""

    GREEN = "green"
    YELLOW = "yellow"
    RED = "red"


@dataclass(frozen=True)
class Finding:
    """Result of one check: `subject` in a few words, `fix` is what to do, `commands` are lines to be typed unchanged."""

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


def join_ids(numbers: tuple[int, ...]) -> str:
    """Ids as a comma-separated text."""
    return ", ".join(map(str, numbers))
