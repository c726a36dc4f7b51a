"""rfca-rig setup motor: compares the settings of a drive with the rig file, and writes them."""

from collections import Counter
from collections.abc import Sequence
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.cli.options import Rig
from rfca_rig.cli.terminal import echo, has_terminal, print_lines, takes_colours
from rfca_rig.errors import BadInput

if TYPE_CHECKING:
    import can

    from rfca_rig.clock import Clock
    from rfca_rig.description.rig_file import RigFile
    from rfca_rig.devices.drive_setup import DriveSetup, Setting

STATE_WIDTH = 10
NAME_WIDTH = 42
VALUE_WIDTH = 15
RIGHT = "right"
WRONG = "wrong"
ANY = "any"
NOT_TOLD = "not told"
COLOURS = {RIGHT: "green", WRONG: "red", NOT_TOLD: "yellow"}

Write = Annotated[
    bool, typer.Option("--write", help="Write what is wrong, save it, and read it back.")
]
Yes = Annotated[bool, typer.Option("--yes", help="With --write: do not ask first.")]
Print = Annotated[
    bool,
    typer.Option(
        "--print", help="Print lines for the maker's own tool; nothing on the bus is touched."
    ),
]
Endpoints = Annotated[
    Path | None,
    typer.Option(
        "--endpoints",
        metavar="FILE",
        help="The maker's file of this firmware (flat_endpoints.json), where it has one.",
    ),
]


def motor(
    rig: Rig,
    write: Write = False,
    yes: Yes = False,
    prints_lines: Print = False,
    endpoints: Endpoints = None,
) -> None:
    """Compare the settings of the drive with what the rig file needs, and write those that are
    wrong.

    The motor stays off, and a drive that runs is left alone. Exit code 1 where a setting is wrong,
    with --write where one still is. The drive of a twin rig is a new one each time, whose settings
    last as long as the command.

    Example: rfca-rig setup motor --rig my-rig.toml --write
    """
    from rfca_rig.bench.factory import open_setup_bus
    from rfca_rig.cli.paths import find_rig
    from rfca_rig.clock import TwinClock
    from rfca_rig.description.rig_file import read_rig
    from rfca_rig.twins.wires import can_wire

    described = read_rig(find_rig(rig))
    if prints_lines:
        with can_wire() as (unconnected, _):
            setup = _make_setup(described, unconnected, TwinClock(), endpoints)
            for line in setup.list_lines(setup.list_wanted()):
                echo(line)
        return
    if write and not yes and not has_terminal():
        raise BadInput("--write asks before it writes, and there is no terminal; add --yes")
    with open_setup_bus(described) as (bus, clock):
        setup = _make_setup(described, bus, clock, endpoints)
        before = setup.read()
        _print_head(described, setup)
        _print_table(before)
        settings = before
        to_write = [setting for setting in before if setting.is_wrong and setting.can_write]
        if write and to_write:
            if not yes:
                typer.confirm(f"write and save {len(to_write)} settings?", abort=True)
            setup.write(to_write)
            setup.save()
            settings = setup.read()
            _print_changes(before, settings)
    command = f"rfca-rig setup motor --rig {rig}"
    if endpoints is not None:
        command += f" --endpoints {endpoints}"
    _conclude(command, rig, settings, write)


def _make_setup(
    described: "RigFile", bus: "can.BusABC", clock: "Clock", endpoints: Path | None
) -> "DriveSetup":
    from rfca_rig.bench.factory import list_drive_needs
    from rfca_rig.devices import find_motor

    keys = described.motor
    setup = find_motor(keys.device).make_setup(
        keys, bus, clock, list_drive_needs(described, endpoints)
    )
    if setup is None:
        raise BadInput(
            f"{described.rig.title}: the settings of a {keys.title} are not known here; set it up "
            "with the tool of its maker, then rfca-rig doctor checks it"
        )
    return setup


def _print_head(described: "RigFile", setup: "DriveSetup") -> None:
    echo(f"{described.source} {described.rig.title}")
    print_lines(setup.describe())
    columns = f"{'setting':<{NAME_WIDTH}}{'drive has':<{VALUE_WIDTH}}rig needs"
    echo(" " * STATE_WIDTH + columns)


def _print_table(settings: "Sequence[Setting]") -> None:
    for setting in settings:
        state = _state(setting)
        word = state
        if takes_colours() and state in COLOURS:
            word = typer.style(state, fg=COLOURS[state])
        name = f"{setting.name:<{NAME_WIDTH}}"
        values = f"{_actual(setting):<{VALUE_WIDTH}}{_wanted(setting)}".rstrip()
        echo(name + values, coloured=word + " " * (STATE_WIDTH - len(state)))
        echo(f"{'':<{STATE_WIDTH + 2}}{setting.purpose}")


def _state(setting: "Setting") -> str:
    if setting.wanted is None:
        return ANY
    if setting.actual is None:
        return NOT_TOLD
    if setting.is_wrong:
        return WRONG
    return RIGHT


def _actual(setting: "Setting") -> str:
    if setting.actual is None:
        return "-"
    return _with_unit(setting.actual, setting.unit)


def _wanted(setting: "Setting") -> str:
    if setting.wanted is None:
        return ""
    return _with_unit(setting.wanted, setting.unit)


def _with_unit(value: float, unit: str) -> str:
    from rfca_rig.devices.drive_setup import ON_OFF

    if unit == ON_OFF:
        return "on" if value else "off"
    if isnan(value):
        return "none"
    # Seven digits: a bit rate is whole.
    return f"{value:.7g} {unit}".rstrip()


def _print_changes(before: "Sequence[Setting]", after: "Sequence[Setting]") -> None:
    echo("written, saved and read back:")
    for old, new in zip(before, after, strict=True):
        if _actual(new) != _actual(old):
            echo(f"  {new.name}: {_actual(old)} -> {_actual(new)}")


def _conclude(command: str, rig: str, settings: "Sequence[Setting]", write: bool) -> None:
    """Prints the counts and what to do next. Exit code 1 where a setting is wrong."""
    states = Counter(_state(setting) for setting in settings)
    echo(", ".join(f"{states[state]} {state}" for state in (RIGHT, WRONG, NOT_TOLD)))
    wrong = [setting for setting in settings if setting.is_wrong]
    writable = [setting for setting in wrong if setting.can_write]
    if states[NOT_TOLD] or len(writable) < len(wrong):
        echo(f"lines for the maker's own tool: {command} --print", err=True)
    if writable and not write:
        echo(f"next: {command} --write", err=True)
    elif not wrong:
        echo(f"next: rfca-rig doctor --rig {rig}", err=True)
    if wrong:
        raise typer.Exit(1)
