"""Writes a case as a campaign folder, as a lab would provide it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.exam.cases import Case, ExamDesign
from rfca_rig.exam.hidden_laws import columns_as_written, speed_as_written
from rfca_rig.exam.sampled_rig import build_world, draw_scatter
from rfca_rig.exam.simulator.experiment import (
    HOLD_S,
    READ_S,
    STAGES,
    ExamStage,
    Noise,
    record_stroke,
    static_table,
)

Floats = NDArray[np.float64]

DIGITS = {
    "t_s": 4,
    "shaft_angle_rad": 5,
    "shaft_speed_rad_s": 4,
    "motor_torque_Nm": 3,
    "fx_N": 3,
    "fy_N": 3,
    "fz_N": 3,
}
TORQUE_DIGITS = 4
DYNAMIC = 'experiment = "dynamic"'
# From the end of the move to the middle of the reading.
HELD_S = HOLD_S - 0.5 * READ_S
# Range of the shaft's stopping time at a static stage. The campaign file does not state it, so it
# is drawn.
STATIC_RAMPS_S = (0.005, 0.012)

# The values are those of `nominal_world`; `[known_to]` are its prior standard deviations.
HEAD = """format = "rfca-campaign/1"
title = "A campaign"

[leg]
link_lengths_mm = [54.000, 39.333, 39.333, 39.333, 39.333, 39.333, 39.333]
link_masses_g = [59.586, 43.402, 43.402, 43.402, 43.402, 43.402, 43.402]
link_radius_mm = 3.0
hinge_torque_Nm = "k0*phi + k0*k2*phi**3"
k0_Nm_per_rad = 11.0
k2_per_rad2 = 4.2
hinge_damping_Nm_s_per_rad = 0.05
start_angle_rad = 0.226893

[ground]
contact_stiffness_N_per_m1p5 = 1.0e5
contact_damping_s_per_m = 1.0
friction_coefficient = 0.45
presliding_mm = 0.1
tangential_damping_N_s_per_m = 2.0

[sensor]
below_shaft_mm = 45.0
noise_std = { fy_N = 0.10, fz_N = 0.15, tx_Nm = 0.006 }
tared = "without the leg"

[drive]
ramp_s = 0.05
mode = "speed"

[known_to]
height_mm = 0.2
start_angle_deg = 0.3
friction_coefficient = 0.05
k0_relative = 0.03
mass_relative = 0.01
hinge_damping_relative = 0.5
contact_stiffness_relative = 0.5
"""


def write_campaign(case: Case, folder: Path) -> None:
    """Write the case's campaign into `folder`, which is created; nothing in it reveals the
    hidden effects.
    """
    random = np.random.default_rng(case.seed)
    (folder / "runs").mkdir(parents=True)
    strokes = _strokes(case, folder, random)
    entries = [*strokes, *_static(case, folder, random, before=len(strokes))]
    (folder / "campaign.toml").write_text("\n".join([HEAD, *entries]), encoding="utf-8")


def add_experiment(case: Case, folder: Path, proposal: Mapping[str, Any], number: int) -> None:
    """Add one more experiment on the case's rig to its campaign folder, as a diagnosis proposes it.

    `proposal` is a height with a speed and repeats, or with stages. `number`, from 1, distinguishes
    the experiments on one rig: it is part of their names and seeds their scatter.
    """
    random = np.random.default_rng([case.seed, number])
    path = folder / "campaign.toml"
    written = path.read_text(encoding="utf-8")
    # Effects that grow with the number of strokes continue where the campaign ended.
    before = written.count(DYNAMIC)
    height_mm = float(proposal["height_mm"])
    name = f"next-{number:02d}"
    if "speed_rad_s" in proposal:
        design = ExamDesign(
            ((height_mm, float(proposal["speed_rad_s"])),), int(proposal["repeats"]), ()
        )
        entries = _strokes(replace(case, design=design), folder, random, f"{name}-dynamic", before)
    else:
        wanted = [
            (float(np.radians(stage["angle_deg"])), str(stage["direction"]))
            for stage in proposal["stages"]
        ]
        design = ExamDesign((), 1, (height_mm,))
        entries = _static(
            replace(case, design=design), folder, random, f"{name}-static", wanted, before
        )
    path.write_text("\n".join([written, *entries]), encoding="utf-8")


def _strokes(
    case: Case, folder: Path, random: np.random.Generator, name: str = "dynamic", before: int = 0
) -> list[str]:
    """Write the recordings of all strokes and return their entries in the campaign file.

    `before` is the number of earlier strokes. The effect's size varies between conditions where the
    case says so.
    """
    entries: list[str] = []
    speeds = tuple(speed for _, speed in case.design.conditions)
    for height_mm, speed in case.design.conditions:
        stronger = _stronger(case, random)
        for repeat in range(1, case.design.repeats + 1):
            made = before + len(entries)
            world = build_world(
                case, 1e-3 * height_mm, draw_scatter(random), repeat, stronger, made
            )
            columns = columns_as_written(
                record_stroke(world, speed, Noise(), random), case.mislabelled
            )
            file = f"runs/{name}-{len(entries) + 1:02d}.csv"
            (folder / file).write_text(_csv(columns), encoding="utf-8")
            entries.append(
                _entry(
                    file, height_mm, speed_as_written(speed, speeds, case.mislabelled), repeat, made
                )
            )
    return entries


def _stronger(case: Case, random: np.random.Generator) -> float:
    # Drawn also where the spread is zero: the random stream is then the same for all cases.
    # Bounded, so that no effect changes its sign.
    spread = 0.0
    if case.uneven is not None:
        spread = case.uneven.per_condition
    return float(max(1.0 + spread * random.normal(), 0.2))


def _static(
    case: Case,
    folder: Path,
    random: np.random.Generator,
    name: str = "static",
    wanted: Sequence[tuple[float, str]] = STAGES,
    before: int = 0,
) -> list[str]:
    """Write the static table, if the design has one, measured after the strokes `before`;
    returns its entry.
    """
    stages: list[ExamStage] = []
    ramp_s = float(random.uniform(*STATIC_RAMPS_S))
    for height_mm in case.design.static_heights_mm:
        world = build_world(
            case, 1e-3 * height_mm, draw_scatter(random), 1, _stronger(case, random), before
        )
        stages += static_table(world, height_mm, ramp_s, random, wanted)
    if not stages:
        return []
    forces = {}
    for signal in ("fy_N", "fz_N", "tx_Nm"):
        forces[signal] = np.array([getattr(stage, signal) for stage in stages])
    written = columns_as_written(forces, case.mislabelled)
    header = (
        "height_mm,stage,direction,shaft_angle_rad,"
        "hinge2_deg,hinge3_deg,hinge4_deg,hinge5_deg,hinge6_deg,hinge7_deg,"
        "fy_N,fz_N,tx_Nm"
    )
    lines = [header]
    for i, stage in enumerate(stages):
        hinges = ",".join(f"{angle:.4f}" for angle in stage.hinge_deg)
        columns = ",".join(f"{written[name][i]:.4f}" for name in ("fy_N", "fz_N", "tx_Nm"))
        lines.append(
            f"{stage.height_mm:g},{stage.stage},{stage.direction},{stage.shaft_angle_rad:.4f},{hinges},{columns}"
        )
    (folder / "runs" / f"{name}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return [
        (
            f'[[runs]]\nexperiment = "static"\nfile = "runs/{name}.csv"\nstrokes_before = '
            f"{before}\nheld_s = {HELD_S:g}\n"
        )
    ]


def _entry(file: str, height_mm: float, speed: float, repeat: int, before: int) -> str:
    condition = (
        f"height_mm = {height_mm:.1f}\nspeed_rad_s = {float(speed)!r}\nrepeat = "
        f"{repeat}\nstrokes_before = {before}\n"
    )
    return f'[[runs]]\n{DYNAMIC}\nfile = "{file}"\n{condition}'


def _csv(columns: dict[str, Floats]) -> str:
    form = ",".join(f"%.{DIGITS.get(name, TORQUE_DIGITS)}f" for name in columns)
    rows = np.column_stack(list(columns.values()))
    return "\n".join([",".join(columns), *(form % tuple(row) for row in rows.tolist())]) + "\n"
