"""Recordings of pendulums for tests and documents: python -m tests.make_pendulums FOLDER

They come from the benchmark's simulator, which shares no code with the model. The description of
each pendulum omits its friction, and that of the double pendulum its rotors, too. Columns have the
names and digits that the software of such rigs writes.
"""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rfca_rig.exam.pendulums.world import Friction, PendulumWorld, Tones, swing

SPEED_STD_RAD_S = 0.05
TORQUE_STD_Nm = 0.02
STEP_S = 0.004
RELEASE_STEP_S = 0.005
NO_COMMAND = Tones(np.zeros((1, 1)), np.ones((1, 1)), np.zeros((1, 1)))


def tones(*rows: tuple[Sequence[float], Sequence[float]]) -> Tones:
    """Sums of sines with (sizes in N m, frequencies in rad/s), a value for each joint."""
    sizes = np.array([size for size, _ in rows])
    omegas = np.array([omega for _, omega in rows])
    return Tones(sizes, omegas, 0.3 * omegas)


@dataclass(frozen=True)
class MadeRun:
    """A recording: its start (2 n,), the command, None where nothing drives, and its times."""

    start: tuple[float, ...]
    command: Tones | None
    from_s: float
    to_s: float


@dataclass(frozen=True)
class MadePendulum:
    """A pendulum, its encoder, and its recordings by the name of their file.

    `columns` names time, angles, speeds and torques; without speeds and torques there are none.
    """

    world: PendulumWorld
    encoder_step_rad: float
    step_s: float
    columns: tuple[str, ...]
    runs: Mapping[str, MadeRun] = field(default_factory=dict)


ROD = PendulumWorld(
    length_m=(0.124,),
    mass_kg=(0.01225,),
    centre_m=(0.062,),
    inertia_kg_m2=(7.0e-5,),
    damping_Nm_s_per_rad=(1.6e-5,),
    friction=Friction((1.2e-4,)),
    angle_zero_rad=(0.01,),
)
GEARED = PendulumWorld(
    length_m=(0.5,),
    mass_kg=(0.69,),
    centre_m=(0.452,),
    inertia_kg_m2=(0.1503,),
    damping_Nm_s_per_rad=(0.01,),
    friction=Friction((0.18,)),
    torque_offset_Nm=(0.02,),
    torque_delay_s=0.002,
)
DOUBLE = PendulumWorld(
    length_m=(0.2, 0.3),
    mass_kg=(0.53, 0.62),
    centre_m=(0.2, 0.2557),
    inertia_kg_m2=(0.0323, 0.0504),
    damping_Nm_s_per_rad=(0.001, 0.001),
    friction=Friction((0.16, 0.12)),
    rotor_kg_m2=0.0023,
)
SLOW = tones(((1.6,), (3.1,)), ((1.0,), (4.7,)))
FAST = tones(((2.2,), (5.2,)), ((0.9,), (8.3,)))
BOTH = tones(((0.8, 0.7), (4.0, 6.1)), ((0.5, 0.5), (7.3, 9.7)))
PENDULUMS = {
    "free-swing": MadePendulum(
        world=ROD,
        encoder_step_rad=2.0 * np.pi / 4000,
        step_s=RELEASE_STEP_S,
        columns=("time_s", "angle_rad"),
        runs={
            f"release-{degrees}": MadeRun((np.deg2rad(degrees), 0.0), None, 0.4, 4.6)
            for degrees in (45, 90, 135)
        },
    ),
    "geared": MadePendulum(
        world=GEARED,
        encoder_step_rad=2.0 * np.pi / 16384,
        step_s=STEP_S,
        columns=("time", "position", "velocity", "torque"),
        runs={
            "slow": MadeRun((0.0, 0.0), SLOW, 0.0, 6.0),
            "fast": MadeRun((0.0, 0.0), FAST, 0.0, 6.0),
        },
    ),
    "double": MadePendulum(
        world=DOUBLE,
        encoder_step_rad=2.0 * np.pi / 16384,
        step_s=STEP_S,
        columns=(
            "time",
            "pos_meas1",
            "pos_meas2",
            "vel_meas1",
            "vel_meas2",
            "tau_meas1",
            "tau_meas2",
        ),
        runs={
            f"sines-{repeat}": MadeRun((0.0, 0.0, 0.0, 0.0), BOTH, 0.0, 6.0) for repeat in (1, 2)
        },
    ),
}


def simulate_run(pendulum: MadePendulum, run: MadeRun, seed: int) -> str:
    """A recording as the text of its CSV file."""
    random = np.random.default_rng(seed)
    time_s = np.arange(0.0, run.to_s - run.from_s, pendulum.step_s)
    command = NO_COMMAND if run.command is None else run.command
    trace = swing(pendulum.world, np.array(run.start), command, time_s, run.command is not None)
    step_rad = pendulum.encoder_step_rad
    angle_rad = step_rad * np.round(trace.angle_rad / step_rad)
    parts = [np.round(run.from_s + time_s, 5)[:, np.newaxis], np.round(angle_rad, 6)]
    if run.command is not None:
        noise = random.normal(0.0, SPEED_STD_RAD_S, trace.speed_rad_s.shape)
        parts.append(np.round(trace.speed_rad_s + noise, 3))
        noise = random.normal(0.0, TORQUE_STD_Nm, trace.torque_Nm.shape)
        parts.append(np.round(trace.torque_Nm + noise, 3))
    rows = np.column_stack(parts)
    lines = [",".join(pendulum.columns)]
    lines += [",".join(f"{value:.7g}" for value in row) for row in rows]
    return "\n".join(lines) + "\n"


def make_pendulum(name: str, folder: Path) -> None:
    """Write the recordings of a pendulum into folder/runs."""
    pendulum = PENDULUMS[name]
    (folder / "runs").mkdir(parents=True, exist_ok=True)
    for seed, (run_name, run) in enumerate(pendulum.runs.items(), start=1):
        text = simulate_run(pendulum, run, seed)
        (folder / "runs" / f"{run_name}.csv").write_text(text, encoding="utf-8", newline="\n")


def main(out: Path) -> None:
    """Write the recordings of every pendulum."""
    for name in PENDULUMS:
        make_pendulum(name, out / name)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
