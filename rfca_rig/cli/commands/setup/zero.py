"""rfca-rig setup zero: the zero of the drive's encoder, after a power-up and on the first day."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.cli.options import Fault
from rfca_rig.cli.terminal import echo, has_terminal

if TYPE_CHECKING:
    from rfca_rig.bench.zero_check import EncoderReading
    from rfca_rig.bench.zero_setup import HeldMotor, NewZero
    from rfca_rig.description.rig_file import RigFile
    from rfca_rig.drivers.encoder_zero import EncoderZero

# The error in degrees from which a zero that is to be written is called another one.
SAME_ZERO_DEG = 0.05


def zero(
    rig: Annotated[
        str,
        typer.Option("--rig", metavar="NAME|FILE", help="The rig file that gets the zero."),
    ],
    at_deg: Annotated[
        float | None,
        typer.Option(
            "--at-deg",
            metavar="DEG",
            help="Angle at which the leg is held or stands against a stop; horizontal, 0, if not "
            "given.",
        ),
    ] = None,
    check_direction: Annotated[
        bool,
        typer.Option(
            "--check-direction",
            help="Check zero, direction and gear by turning the leg by hand; nothing is written.",
        ),
    ] = False,
    remeasure: Annotated[
        bool,
        typer.Option(
            "--remeasure",
            help="Behind a gear: take the reading itself, as after leg or encoder were mounted "
            "again.",
        ),
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Write without asking.")] = False,
    fault: Fault = None,
) -> None:
    """Find the zero of the drive's encoder, with the motor off and the leg held at a known angle.

    Writes it into the rig file, whose comments stay, and stores the check beside it: a run after a
    power-up of the drive is refused until then, where zero_policy says so.

    Example: rfca-rig setup zero --rig my-rig.toml
    """
    from rfca_rig.bench.zero_check import zero_of
    from rfca_rig.bench.zero_setup import held_angle_rad, open_held_motor
    from rfca_rig.cli.paths import find_rig, refuse_shipped
    from rfca_rig.cli.run_config import parse_faults
    from rfca_rig.description.rig_file import read_rig
    from rfca_rig.errors import BadInput

    path = find_rig(rig)
    refuse_shipped(path)
    described = read_rig(path)
    encoder_zero = zero_of(described)
    if check_direction and not has_terminal():
        raise BadInput("--check-direction needs a terminal: a person turns the leg in between")
    if not (yes or has_terminal()):
        raise BadInput("there is no terminal to ask before the zero is written; say --yes")
    angle_rad = held_angle_rad(described, at_deg)
    with open_held_motor(described, encoder_zero, parse_faults(described, fault or ())) as held:
        if check_direction:
            is_right = _check_by_hand(described, held, angle_rad)
        else:
            is_right = True
            _find_zero(path, described, held, angle_rad, remeasure, ask=not yes)
    if not is_right:
        raise typer.Exit(1)


def _find_zero(
    path: Path,
    rig: "RigFile",
    held: "HeldMotor",
    angle_rad: float,
    remeasure: bool,
    ask: bool,
) -> None:
    from math import degrees

    from rfca_rig.bench.zero_check import new_check, state_file, write_check
    from rfca_rig.bench.zero_setup import choose_zero, write_zero
    from rfca_rig.description.rig_file import read_rig
    from rfca_rig.errors import BadInput
    from rfca_rig.recording.atomic import write_atomically
    from rfca_rig.toml import read_text

    if ask and rig.is_real:
        _prompt(f"motor off; hold the leg at {degrees(angle_rad):g} deg, then press Enter")
    reading = held.read()
    policy = rig.motor.zero_policy
    chosen = choose_zero(held.zero, policy, reading.value, angle_rad, remeasure)
    for line in _describe(rig, held.zero, reading, angle_rad, chosen):
        echo(line)
    if ask and not typer.confirm(f"write {held.zero.key} into {path}?", err=True):
        raise BadInput(f"{path}: left as it is; the zero is not checked")
    left = reading
    if ask and rig.is_real and reading.uptime_s is None:
        # Its power-ups show only by where the encoder stands, so it must be known where it is left.
        _prompt("let the leg down to where it stays until the run, then press Enter")
        left = held.read_left()
    write_atomically(path, write_zero(read_text(path), path, held.zero, chosen.value).encode())
    write_check(path, new_check(read_rig(path), reading, left))
    echo(f"{path}: {held.zero.key} written; the check is in {state_file(path)}")
    if policy is None and rig.is_real:
        echo(
            "next: state zero_policy under [motor], absolute, behind-gear or incremental, "
            "so that a power-up is noticed; docs/safety.md says which",
            err=True,
        )


def _describe(
    rig: "RigFile",
    zero: "EncoderZero",
    reading: "EncoderReading",
    angle_rad: float,
    chosen: "NewZero",
) -> list[str]:
    from math import degrees

    present_deg = degrees(zero.angle_rad(reading.value))
    if chosen.motor_turns is None:
        change = f"{chosen.off_deg:.2f} deg of the shaft from the present one"
    else:
        change = (
            f"{chosen.motor_turns:+d} motor turns, {chosen.off_deg:.1f} deg of the shaft; the "
            f"held leg differs by {chosen.rest_deg:.1f} deg"
        )
    if chosen.off_deg < SAME_ZERO_DEG:
        change = "as it was"
        if chosen.value != zero.value:
            change = "as it was, but for whole turns of the shaft"
    return [
        f"policy        {rig.motor.zero_policy or 'not stated'}",
        f"encoder       {reading.value:.4f} {zero.unit}, {reading.count} readings within "
        f"{zero.shaft_deg(reading.spread):.2f} deg of the shaft",
        f"held at       {degrees(angle_rad):.1f} deg",
        f"present zero  {zero.key} = {zero.value:.6g}, by which the leg is at "
        f"{present_deg:.1f} deg",
        f"new zero      {zero.key} = {chosen.value:.6g}: {change}",
    ]


def _check_by_hand(rig: "RigFile", held: "HeldMotor", angle_rad: float) -> bool:
    """The three checks of zero, direction and gear, each with its verdict on a line."""
    from math import degrees

    from rfca_rig.bench.zero_setup import (
        gear_ratio_of,
        judge_direction,
        judge_quarter_turn,
        judge_stated_angle,
    )

    def ask_angle(pose: str) -> float:
        _prompt(f"motor off; {pose}, then press Enter")
        return degrees(held.zero.angle_rad(held.read().value))

    stated_deg = degrees(angle_rad)
    held_deg = ask_angle(f"hold the leg at {stated_deg:g} deg")
    checks = [judge_stated_angle(held_deg, stated_deg, held.zero.key)]
    echo(checks[-1].line())
    turned_deg = ask_angle("turn the leg down by some 30 deg and hold it")
    checks.append(judge_direction(held_deg, turned_deg, rig.motor.direction))
    echo(checks[-1].line())
    quarter_deg = ask_angle(f"hold it a quarter turn down from {stated_deg:g} deg")
    checks.append(judge_quarter_turn(quarter_deg - held_deg, gear_ratio_of(rig)))
    echo(checks[-1].line())
    return all(verdict.is_right for verdict in checks)


def _prompt(text: str) -> None:
    typer.prompt(text, default="", show_default=False, prompt_suffix=" ", err=True)
