"""Shell completion: names and folders for every command, by the names of its options and arguments."""

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from rfca_rig.cli import names

# Set by the shell's completion script.
VARIABLE = "_RFCA_RIG_COMPLETE"

Offer = Callable[[str], Iterable[str]]


@dataclass(frozen=True)
class Offered:
    """One of the words that the shell shows."""

    value: str
    type: str = "plain"
    help: str | None = None


def add_completions(command: Any) -> None:
    """Adds completions to a command and its subcommands, only where the shell asks for them."""
    # Ordinary commands start without the cost of walking through all parameters.
    if VARIABLE in os.environ:
        _add(command, command.name)


def _add(command: Any, path: str) -> None:
    for name, below in getattr(command, "commands", {}).items():
        _add(below, f"{path} {name}")
    for parameter in command.params:
        offer = _offer(path.partition(" ")[2], parameter)
        if offer is not None:
            parameter.shell_complete = _answer(offer)


def _answer(offer: Offer) -> Callable[[object, str], list[Offered]]:
    """Where nothing matches, the shell offers files."""
    return lambda _context, begun: [Offered(word) for word in offer(begun) if word.startswith(begun)]


def _offer(command: str, parameter: Any) -> Offer | None:
    """Completions of an option or argument; None where there are none."""
    option = next((one for one in parameter.opts if one.startswith("--")), "")
    # The more specific wins: by command, then by option, then by metavar.
    offers = {**_BY_METAVAR, **_BY_OPTION, **{key: offer for (where, key), offer in _BY_COMMAND.items() if where == command}}
    return offers.get(option) or offers.get(parameter.metavar or "")


def _each_of(words: Iterable[str]) -> Offer:
    return lambda _begun: words


def _behind_commas(words: Iterable[str]) -> Offer:
    """For lists, as k0,k2: the words already typed stay."""

    def offer(begun: str) -> Iterable[str]:
        before, comma, _ = begun.rpartition(",")
        return (f"{before}{comma}{word}" for word in words if word not in before.split(","))

    return offer


def _verdicts(_begun: str) -> Iterable[str]:
    return (*names.VERDICTS, *names.effect_names())


_BY_METAVAR: dict[str, Offer] = {
    "RUN": names.list_recorded_folders,
    "PATH": names.list_recorded_folders,
    "FOLDER": names.list_recorded_folders,
    "RIG": lambda _begun: names.rig_names(),
    "PROTOCOL": lambda _begun: names.file_names("protocols"),
    "CODE": _each_of(names.TRIP_CODES),
}
_BY_OPTION: dict[str, Offer] = {
    "--rig": lambda _begun: names.rig_names(),
    "--protocol": lambda _begun: names.file_names("protocols"),
    "--parameters": _behind_commas(names.FIT_PARAMETERS),
    "--effects": _behind_commas(names.MECHANISM_EFFECTS),
    "--phases": _behind_commas(names.PHASES),
}
_BY_COMMAND: dict[tuple[str, str], Offer] = {
    ("runs", "--kind"): _each_of(names.RUN_KINDS),
    ("runs", "--source"): _each_of(names.SOURCES),
    ("runs", "--ended"): _each_of((*names.RUN_ENDINGS, *names.TRIP_CODES)),
    ("runs", "--verdict"): _verdicts,
    ("prove", "--kind"): _each_of(names.CASE_KINDS),
    ("schema", "KIND"): _each_of(names.FILE_KINDS),
    ("sweep", "SWEEP"): lambda _begun: names.file_names("sweeps"),
}
