"""rfca-rig setup sensor: three pushes and a known mass show how the force sensor is mounted."""

import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rfca_rig.cli.commands.doctor import print_finding
from rfca_rig.cli.options import Fault, Json, Seed
from rfca_rig.cli.terminal import echo, has_terminal

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from rfca_rig.bench.sensor_bench import SensorBench
    from rfca_rig.cli.terminal import Say
    from rfca_rig.description.rig_file import RigFile
    from rfca_rig.devices.checks import Finding
    from rfca_rig.doctor.sensor_setup import Hand, LoadStep, MountingCheck

RigToSetUp = Annotated[
    str, typer.Option("--rig", metavar="NAME|FILE", help="The rig file, which is changed on a yes.")
]
MassKg = Annotated[
    float,
    typer.Option("--mass-kg", metavar="KG", min=0.1, max=100.0, help="The mass that is hung."),
]
LeverMm = Annotated[
    float,
    typer.Option(
        "--lever-mm",
        metavar="MM",
        min=-1000.0,
        max=1000.0,
        help="Where: along y from the shaft's axis; 0 is straight below it.",
    ),
]
Yes = Annotated[
    bool, typer.Option("--yes", help="Write what was found into the rig file without asking.")
]


def sensor(
    rig: RigToSetUp,
    mass_kg: MassKg = 1.0,
    lever_mm: LeverMm = 0.0,
    yes: Yes = False,
    fault: Fault = None,
    seed: Seed = None,
    as_json: Json = False,
) -> None:
    """Find the axes of the force sensor with three pushes of a hand, and check counts, lever and
    below_shaft with a known mass.

    The motor stays off. Nothing is written where something is red, nor before you say yes. On a
    twin the pushes are simulated. Exit code 1 where something is red.

    Example: rfca-rig setup sensor --rig our-rig.toml --mass-kg 2
    """
    from rfca_rig.bench.sensor_bench import open_sensor
    from rfca_rig.cli.paths import find_rig, is_shipped
    from rfca_rig.cli.progress import make_marked_say
    from rfca_rig.cli.run_config import parse_faults
    from rfca_rig.description.rig_file import read_rig
    from rfca_rig.doctor.sensor_setup import hang_mass

    path = find_rig(rig)
    described = read_rig(path)
    faults = parse_faults(described, fault or [])
    # A rig that came with the package is only rehearsed with.
    can_write = not is_shipped(path)
    if can_write and not yes:
        _check_terminal()
    say = make_marked_say(described.source, as_json)
    if seed is None:
        seed = 0
        if described.twin is not None:
            seed = described.twin.seed
    mass = hang_mass(mass_kg, lever_mm)
    check = None
    with open_sensor(described, seed, faults) as bench:
        findings = list(bench.settings)
        _show(findings, as_json)
        # What the sensor itself is set to wrongly would make every later finding wrong.
        if not _has_red(findings):
            check = _check_mounting(described, bench, mass, seed, say)
            findings += check.findings
            _show(check.findings, as_json)
        date = bench.clock.wall_time().date().isoformat()
    written = False
    if check is not None and not _has_red(findings) and can_write:
        written = _write(path, _values_to_write(described, check, mass, date), yes, say)
    axes = None
    if check is not None and check.axes is not None:
        axes = check.axes.names
    if as_json:
        document = {
            "title": described.rig.title,
            "findings": [asdict(finding) for finding in findings],
            "axes": axes,
            "written": written,
        }
        echo(json.dumps(document, indent=2))
    if _has_red(findings):
        raise typer.Exit(1)


def _check_terminal() -> None:
    from rfca_rig.errors import BadInput

    if not has_terminal():
        raise BadInput(
            "setup sensor asks before it writes into the rig file; answer on a terminal, or let it "
            "write by --yes"
        )


class _Person:
    """Implements `Hand`: tells a person what to do."""

    def __init__(self, say: "Say") -> None:
        self._say = say

    def apply(self, step: "LoadStep") -> None:
        self._say(f"{step.instruction} ...")

    def release(self) -> None:
        self._say("measured: take the load off, hands away")


class _RehearsedHand:
    """Implements `Hand` on a twin: says what a person would be told, and does it."""

    def __init__(self, person: _Person, hand: "Hand") -> None:
        self._person = person
        self._hand = hand

    def apply(self, step: "LoadStep") -> None:
        self._person.apply(step)
        self._hand.apply(step)

    def release(self) -> None:
        self._person.release()
        self._hand.release()


def _check_mounting(
    rig: "RigFile", bench: "SensorBench", mass: "LoadStep", seed: int, say: "Say"
) -> "MountingCheck":
    import numpy as np

    from rfca_rig.doctor.sensor_setup import (
        PUSHES,
        SimulatedHand,
        judge_mounting,
        measure_loads,
    )

    hand: Hand = _Person(say)
    if bench.load is None:
        say("the motor stays off; hands off the leg and the plate between the steps")
    else:
        below_m = rig.sensor.below_shaft_mm / 1e3
        simulated = SimulatedHand(bench.load, below_m, np.random.default_rng([seed, 3]))
        hand = _RehearsedHand(_Person(say), simulated)
    loads = measure_loads(bench.sensor, bench.clock, hand, (*PUSHES, mass))
    return judge_mounting(loads, mass, rig.sensor.mounting, rig.sensor.below_shaft_mm)


def _has_red(findings: "Iterable[Finding]") -> bool:
    from rfca_rig.devices.checks import Colour

    return any(finding.colour is Colour.RED for finding in findings)


def _show(findings: "Iterable[Finding]", as_json: bool) -> None:
    if not as_json:
        for finding in findings:
            print_finding(finding)


def _values_to_write(
    rig: "RigFile", check: "MountingCheck", mass: "LoadStep", date: str
) -> dict[str, Any]:
    """The keys of [sensor] that the check gives."""
    from rfca_rig.model.parameters import GRAVITY_M_S2

    assert check.axes is not None and check.mass_N is not None and check.below_shaft_mm is not None
    assert mass.mass_kg is not None
    values: dict[str, Any] = {}
    if check.axes != rig.sensor.mounting:
        values["axes"] = list(check.axes.names)
    weight_N = mass.mass_kg * GRAVITY_M_S2
    values["checked"] = {
        "date": date,
        "source": rig.source,
        "axes": list(check.axes.names),
        "mass_kg": mass.mass_kg,
        "lever_mm": 1e3 * mass.lever_m,
        "force_N": round(check.mass_N, 3),
        "deviation_percent": round(100.0 * (check.mass_N / weight_N - 1.0), 2),
        "below_shaft_mm": round(check.below_shaft_mm, 1),
    }
    return values


def _write(path: "Path", values: dict[str, Any], yes: bool, say: "Say") -> bool:
    """Writes the keys into [sensor] of the rig file, after a yes."""
    from rfca_rig.recording.atomic import write_atomically
    from rfca_rig.toml import format_value, read_text
    from rfca_rig.toml_edit import set_keys

    edited = set_keys(read_text(path), "sensor", values, path)
    for key, value in values.items():
        say(f"[sensor] {key} = {format_value(value)}")
    if not yes and not typer.confirm(f"write this into {path}?", err=True):
        say(f"{path}: not changed")
        return False
    write_atomically(path, edited.encode("utf-8"))
    say(f"{path}: written; every later run is recorded with it")
    return True
