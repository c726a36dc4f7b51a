"""Names that can be typed on the command line, found without loading anything heavy: for completion
and suggestions.

Shell completion offers names and folders for every command, by the names of its options and
arguments.
"""

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rfca_rig.cli.paths import folders_of
from rfca_rig.errors import Trip
from rfca_rig.logbook import entry
from rfca_rig.logbook.entry import VERDICTS as ANY_VERDICT

# Copies of names that other packages define: importing those would take too long for a completion.
FIT_PARAMETERS = (
    "k0",
    "k2",
    "hinge_damping",
    "mass",
    "link_radius",
    "friction",
    "contact_stiffness",
    "contact_damping",
    "presliding",
    "friction_lever",
    "friction_rise",
    "leaving_damping",
    "tangential_damping",
    "below_shaft",
    "ramp",
    "start_angle",
    "height",
)
CASE_KINDS = (
    "nothing missing",
    "nothing missing, model error",
    "one effect",
    "two effects",
    "stranger",
    "right family, wrong law",
    "poor data",
    "wrong metadata",
    "approximate law",
    "three effects",
    "pendulum, nothing missing",
    "pendulum, one effect",
    "pendulum, two effects",
    "pendulum, stranger",
)
PHASES = ("rest", "free", "touchdown", "loading", "release", "rebound")
FILE_KINDS = ("rig", "protocol", "experiment", "campaign", "sweep", "tolerances")
RUN_KINDS = entry.KINDS
SOURCES = entry.SOURCES
RUN_ENDINGS = tuple(word.replace(" ", "-") for word in entry.ENDINGS)
VERDICTS = tuple(word.replace(" ", "-") for word in ANY_VERDICT)
TRIP_CODES = tuple(code.value for code in Trip)
RECORDED = ("run.json", "run.h5", "campaign.toml", "pendulum.toml", "experiment.toml")
MAX_FOLDERS = 50

# Set by the shell's completion script.
VARIABLE = "_RFCA_RIG_COMPLETE"

Offer = Callable[[str], Iterable[str]]


def effect_names() -> list[str]:
    """Effects of legs and mechanisms, changes of values, and effects of the lab's own folder, where
    an effect's file has its name.
    """
    from rfca_rig.model.declarations import LEG, MECHANISM
    from rfca_rig.model.declarations.changes import CHANGES

    declared = (*LEG, *MECHANISM, *CHANGES.values())
    of_package = (declaration.id for declaration in declared)
    of_lab = _stems(filter(None, (os.environ.get("RFCA_RIG_EFFECTS"),)), "*.py")
    return sorted({*of_package, *of_lab})


def mechanism_effect_names() -> tuple[str, ...]:
    """Effects of mechanisms."""
    from rfca_rig.model.declarations import MECHANISM

    return tuple(declaration.id for declaration in MECHANISM)


def file_names(kind: str) -> list[str]:
    """Protocols, sweeps or rigs ("calibration") that can be named without a path."""
    return _stems(folders_of(kind), "*.toml")


def rig_names() -> list[str]:
    """Rig files; camera files lie in the same folder and are left out."""
    files = {
        file.stem: file
        for folder in folders_of("calibration")
        for file in Path(folder).glob("*.toml")
    }
    return sorted(
        name
        for name, file in files.items()
        if "\n[rig]" in file.read_text(encoding="utf-8", errors="replace")
    )


def list_recorded_folders(begun: str) -> list[str]:
    """Folders of runs and campaigns whose path begins with `begun`, newest first; those in runs/
    where nothing is typed yet.
    """
    parent, slash, _ = begun.rpartition("/")
    parents = [".", "runs"]
    if slash:
        parents = [parent or "/"]
    newest = sorted(
        (candidate for folder in parents for candidate in _folders_in(folder, begun)), reverse=True
    )
    recorded: list[str] = []
    for _, path in newest:
        if len(recorded) == MAX_FOLDERS:
            break
        if any(Path(path, name).exists() for name in RECORDED):
            recorded.append(path)
    return recorded


def _folders_in(folder: str, begun: str) -> Iterator[tuple[float, str]]:
    """(time of last change, path) of each."""
    try:
        with os.scandir(folder) as listing:
            inside = [child for child in listing if child.path.removeprefix("./").startswith(begun)]
    # The folder does not exist, or may not be read: there is nothing to offer.
    except OSError:
        return
    for child in inside:
        # A loop of links, and a folder that is removed meanwhile, are passed over.
        with suppress(OSError):
            if child.is_dir():
                yield child.stat().st_mtime, child.path.removeprefix("./")


def _stems(folders: Iterable[str | Path], pattern: str) -> list[str]:
    return sorted(
        {
            file.stem
            for folder in folders
            for file in Path(folder).glob(pattern)
            if not file.stem.startswith("_")
        }
    )


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
        typed = path.partition(" ")[2]
        option = next((spelling for spelling in parameter.opts if spelling.startswith("--")), "")
        # The more specific wins: by command, then by option, then by metavar.
        offers = {
            **_BY_METAVAR,
            **_BY_OPTION,
            **{key: offer for (where, key), offer in _BY_COMMAND.items() if where == typed},
        }
        offer = offers.get(option) or offers.get(parameter.metavar or "")
        if offer is not None:
            parameter.shell_complete = _answer(offer)


def _answer(offer: Offer) -> Callable[[object, str], list[Offered]]:
    """Where nothing matches, the shell offers files."""
    return lambda _context, begun: [
        Offered(word) for word in offer(begun) if word.startswith(begun)
    ]


def _offer_words(words: Iterable[str]) -> Offer:
    return lambda _begun: words


def _behind_commas(words: Iterable[str]) -> Offer:
    """For lists, as k0,k2: the words already typed stay."""

    def offer(begun: str) -> Iterable[str]:
        before, comma, _ = begun.rpartition(",")
        return (f"{before}{comma}{word}" for word in words if word not in before.split(","))

    return offer


def _dataset_names(_begun: str) -> Iterable[str]:
    from rfca_rig.public_data.registry import read_registry

    return read_registry().sets


def _verdicts(_begun: str) -> Iterable[str]:
    return (*VERDICTS, *effect_names())


def _mechanism_effects(begun: str) -> Iterable[str]:
    return _behind_commas(mechanism_effect_names())(begun)


_BY_METAVAR: dict[str, Offer] = {
    "RUN": list_recorded_folders,
    "PATH": list_recorded_folders,
    "FOLDER": list_recorded_folders,
    "RIG": lambda _begun: rig_names(),
    "PROTOCOL": lambda _begun: file_names("protocols"),
    "CODE": _offer_words(TRIP_CODES),
}
_BY_OPTION: dict[str, Offer] = {
    "--rig": lambda _begun: rig_names(),
    "--protocol": lambda _begun: file_names("protocols"),
    "--parameters": _behind_commas(FIT_PARAMETERS),
    "--effects": _mechanism_effects,
    "--phases": _behind_commas(PHASES),
}
_BY_COMMAND: dict[tuple[str, str], Offer] = {
    ("datasets get", "NAME"): _dataset_names,
    ("runs", "--kind"): _offer_words(RUN_KINDS),
    ("runs", "--source"): _offer_words(SOURCES),
    ("runs", "--ended"): _offer_words((*RUN_ENDINGS, *TRIP_CODES)),
    ("runs", "--verdict"): _verdicts,
    ("prove", "--kind"): _offer_words(CASE_KINDS),
    ("schema", "KIND"): _offer_words(FILE_KINDS),
    ("sweep", "SWEEP"): lambda _begun: file_names("sweeps"),
}
