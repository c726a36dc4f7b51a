"""Folders of recordings of pendulums that an independent integrator made, in both formats."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rfca_rig.campaign.pendulum import LinkSection, write_pendulum_mjcf
from rfca_rig.exam.pendulums.world import PendulumWorld, Tones, swing
from rfca_rig.toml import format_value, table

SAMPLE_S = 0.004
SPEED_STD_RAD_S = 0.02


@dataclass(frozen=True)
class Run:
    """One recording: the start (2 n,), the command, None where the motors are off, and the rows."""

    start: tuple[float, ...]
    command: Tones | None = None
    seconds: float = 5.0


NO_COMMAND = Tones(np.zeros((1, 1)), np.ones((1, 1)), np.zeros((1, 1)))


def release(*angles_rad: float, seconds: float = 5.0) -> Run:
    return Run((*angles_rad, *(0.0 for _ in angles_rad)), seconds=seconds)


def sine(torque_Nm: float, rad_s: float, start_rad: float = 0.8, seconds: float = 5.0) -> Run:
    tones = Tones(np.array([[torque_Nm]]), np.array([[rad_s]]), np.array([[rad_s]]))
    return Run((start_rad, 0.0), tones, seconds)


def link_of(world: PendulumWorld, joint: int = 0) -> LinkSection:
    """The nominal link of a true one."""
    return LinkSection(
        length_m=world.length_m[joint],
        mass_kg=world.mass_kg[joint],
        centre_of_mass_m=world.centre_m[joint],
        inertia_kg_m2=world.inertia_kg_m2[joint],
        joint_damping_Nm_s_per_rad=world.damping_Nm_s_per_rad[joint],
    )


def write_runs(
    folder: Path, world: PendulumWorld, runs: Sequence[Run], angle_std_rad: float, step_rad: float
) -> None:
    """The recordings as runs/N.csv: angles with noise, and in steps of an encoder if not 0."""
    (folder / "runs").mkdir(parents=True, exist_ok=True)
    for number, run in enumerate(runs, start=1):
        random = np.random.default_rng(number)
        t_s = np.arange(0.0, run.seconds, SAMPLE_S)
        command = NO_COMMAND if run.command is None else run.command
        trace = swing(world, np.array(run.start), command, t_s, run.command is not None)
        angle = trace.angle_rad + random.normal(0.0, angle_std_rad, trace.angle_rad.shape)
        if step_rad:
            angle = step_rad * np.round(angle / step_rad)
        speed = trace.speed_rad_s + random.normal(0.0, SPEED_STD_RAD_S, trace.speed_rad_s.shape)
        rows = np.column_stack([t_s, angle, speed, trace.torque_Nm])
        columns = [
            f"{name}{joint + 1}"
            for name in ("angle", "speed", "torque")
            for joint in range(world.joints)
        ]
        np.savetxt(
            folder / "runs" / f"{number}.csv",
            rows,
            fmt="%.7g",
            delimiter=",",
            header=",".join(["t", *columns]),
            comments="",
        )


def write_pendulum(
    folder: Path,
    nominal: Sequence[LinkSection],
    world: PendulumWorld,
    runs: Sequence[Run],
    known_to: Mapping[str, float],
    has_speeds: bool = True,
    angle_std_rad: float = 5e-4,
    step_rad: float = 0.0,
) -> Path:
    """The recordings with pendulum.toml."""
    write_runs(folder, world, runs, angle_std_rad, step_rad)
    columns = {"t_s": "t"}
    for joint in range(1, world.joints + 1):
        columns |= {f"angle{joint}_rad": f"angle{joint}", f"torque{joint}_Nm": f"torque{joint}"}
        if has_speeds:
            columns[f"speed{joint}_rad_s"] = f"speed{joint}"
    parts = ['format = "rfca-pendulum/1"\ntitle = "A pendulum"\n']
    parts += [
        table(f"link{number}", link.model_dump()) for number, link in enumerate(nominal, start=1)
    ]
    parts += [table("known_to", dict(known_to)), table("columns", columns)]
    for number, run in enumerate(runs, start=1):
        driven = format_value(run.command is not None)
        parts.append(
            f'[[runs]]\nfile = "runs/{number}.csv"\ncondition = "run {number}"\ndriven = {driven}\n'
        )
    (folder / "pendulum.toml").write_text("\n".join(parts), encoding="utf-8")
    return folder


def write_experiment(
    folder: Path,
    nominal: Sequence[LinkSection],
    world: PendulumWorld,
    runs: Sequence[Run],
    known_to: Mapping[str, float],
    has_speeds: bool = True,
    angle_std_rad: float = 5e-4,
    step_rad: float = 0.0,
) -> Path:
    """The same recordings with experiment.toml and a model file."""
    write_runs(folder, world, runs, angle_std_rad, step_rad)
    (folder / "model.xml").write_text(write_pendulum_mjcf(nominal), encoding="utf-8")
    text = 'format = "rfca-experiment/1"\ntitle = "A pendulum"\nmodel = "model.xml"\n'
    text += '[time]\ncolumn = "t"\nunit = "s"\n'
    quantities = {"position": ("angle", "rad"), "speed": ("speed", "rad/s")}
    for quantity in ("position", "speed") if has_speeds else ("position",):
        column, unit = quantities[quantity]
        for joint in range(1, world.joints + 1):
            text += f'[[signals]]\njoint = "joint{joint}"\nquantity = "{quantity}"\n'
            text += f'column = "{column}{joint}"\nunit = "{unit}"\n'
    for joint in range(1, world.joints + 1):
        text += f'[[commands]]\nactuator = "motor{joint}"\ncolumn = "torque{joint}"\n'
        text += 'unit = "N m"\n'
    text += table("known_to", dict(known_to))
    for number, run in enumerate(runs, start=1):
        text += f'[[recordings]]\nfile = "runs/{number}.csv"\ncondition = "run {number}"\n'
        text += f"driven = {format_value(run.command is not None)}\n"
    (folder / "experiment.toml").write_text(text, encoding="utf-8")
    return folder
