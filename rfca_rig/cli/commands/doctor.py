"""rfca-rig doctor and contract: checks of the computer and the devices, and conformance tests of
own drivers.
"""

import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.cli.options import Json, out_folder
from rfca_rig.cli.terminal import echo, takes_colours

if TYPE_CHECKING:
    from rfca_rig.description.rig_file import RigFile
    from rfca_rig.devices.checks import Finding


WIDTH = 80
COLOUR_WIDTH = 8
SUBJECT_WIDTH = 18
INDENT = " " * (COLOUR_WIDTH + SUBJECT_WIDTH)
COMMAND_INDENT = " " * 4

HELP_RIG = "The rig to check: a name in calibration/ (plan --list), or a .toml file; else a scan."
HELP_RUNS = "Folder of the runs, whose disk is measured: space and speed."
RigToCheck = Annotated[str | None, typer.Option("--rig", metavar="NAME|FILE", help=HELP_RIG)]
RunsToCheck = Annotated[
    Path, typer.Option("--runs", metavar="DIR", callback=out_folder, help=HELP_RUNS)
]


def doctor(rig: RigToCheck = None, runs: RunsToCheck = Path("runs"), as_json: Json = False) -> None:
    """Check what a rig file names, or without one find what there is: buses, drives, sensors, this
    computer.

    Nothing is sent that could turn the shaft; not to be used while a run is going on, for it takes
    over the sensor's stream. Exit code 1 where something is red.

    Example: rfca-rig doctor --rig my-rig.toml
    """
    from rfca_rig.cli.paths import find_rig
    from rfca_rig.clock import WallClock
    from rfca_rig.description.rig_file import read_rig
    from rfca_rig.devices.checks import Colour
    from rfca_rig.doctor.rig_checks import check_rig, scan

    clock = WallClock()
    described = None
    if rig is None:
        checks = scan(runs, clock)
    else:
        path = find_rig(rig)
        described = read_rig(path)
        checks = check_rig(described, runs, clock, path)
    # JSON is printed as one document, after all checks; text line by line, as each is done.
    if as_json:
        findings = list(checks)
    else:
        findings = list(_print_findings(_title(described), checks))
    colours = Counter(finding.colour for finding in findings)
    counts = {colour.value: colours[colour] for colour in Colour}
    if as_json:
        echo(
            json.dumps(
                {
                    "title": _title(described),
                    "findings": [asdict(finding) for finding in findings],
                    **counts,
                },
                indent=2,
            )
        )
    else:
        echo(", ".join(f"{count} {colour}" for colour, count in counts.items()))
    if counts[Colour.RED]:
        raise typer.Exit(1)


def _title(rig: "RigFile | None") -> str:
    if rig is None:
        return "scan: no rig file, so nothing is known of what should be there"
    return f"{rig.source} {rig.rig.title}"


def _print_findings(title: str, checks: "Iterator[Finding]") -> "Iterator[Finding]":
    """Prints each finding before the next check begins."""
    echo(title)
    for finding in checks:
        print_finding(finding)
        yield finding


def print_finding(finding: "Finding") -> None:
    """Prints a finding with its colour, its fix and its commands."""
    first, *rest = _lines(finding)
    echo(first, coloured=_colour_word(finding))
    for line in rest:
        echo(line)


def _colour_word(finding: "Finding") -> str:
    """The word of its colour, padded; in that colour only on a terminal, which typer detects."""
    word = finding.colour.value
    padding = " " * (COLOUR_WIDTH - len(word))
    if takes_colours():
        word = typer.style(word, fg=word)
    return word + padding


def _lines(finding: "Finding") -> Iterator[str]:
    """Lines of at most 80 columns, together with the word of the colour before the first one."""
    first, *rest = wrap(finding.seen, WIDTH - len(INDENT), break_on_hyphens=False)
    yield f"{finding.subject:<{SUBJECT_WIDTH}}{first}"
    yield from (INDENT + line for line in rest)
    if finding.fix:
        yield from (
            INDENT + line
            for line in wrap(f"fix: {finding.fix}", WIDTH - len(INDENT), break_on_hyphens=False)
        )
    for command in finding.commands:
        # For copying: a long command continues on the next line with the shell's backslash.
        pieces = wrap(
            command, WIDTH - len(COMMAND_INDENT) - 2, break_long_words=False, break_on_hyphens=False
        )
        yield from [COMMAND_INDENT + line for line in " \\\n".join(pieces).splitlines()]


def contract(
    rig: Annotated[
        str,
        typer.Argument(
            metavar="RIG", help="A rig file with a motor or a force sensor of your own."
        ),
    ],
) -> None:
    """Try your own driver on its twin with everything that every driver must do: energise without a
    jerk, obey, report, name each fault.

    Nothing real is touched. Exit code 1 where something is not as it must be; the names of the
    tests say what.

    Example: rfca-rig contract our-rig.toml
    """
    from rfca_rig.cli.paths import find_rig
    from rfca_rig.description.rig_file import read_rig
    from rfca_rig.errors import BadInput

    path = find_rig(rig)
    described = read_rig(path)
    try:
        from rfca_rig.contracts.own_devices import run_conformance_tests
    # pytest is not installed with the package; only this command needs it.
    except ModuleNotFoundError as missing:
        raise BadInput(f"the contract needs {missing.name}; type pip install pytest") from None
    if not run_conformance_tests(described, path.resolve()):
        raise typer.Exit(1)
    echo(f"{described.rig.title}: the contract is kept; next: rfca-rig doctor --rig {rig}")
