"""Writes a pendulum case as a campaign folder, and its truth."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.exam.pendulums.cases import (
    KNOWN_TO,
    PendulumCase,
    damping_std,
    offset_std,
    swing_rad_s,
    torque_scale_Nm,
)
from rfca_rig.exam.pendulums.world import PendulumTrace, PendulumWorld, Tones, swing
from rfca_rig.exam.truth import FORMAT

Floats = NDArray[np.float64]

RUN_S = 6.0
# Sines in a commanded torque, from half to twice the frequency of the small oscillation.
TONES = 4
# Largest amplitude of each sine of the first joint, as a share of the weight's largest torque.
DRIVE_SHARE = 0.2
# Length of the windows in which visibility is judged, and their number per run.
WINDOW_S = 0.5
WINDOWS = 3
# Usual model error, as a share of the weight's largest torque.
MODEL_ERROR = 0.01


def write_pendulum_campaign(case: PendulumCase, folder: Path) -> None:
    """Write the case's campaign into `folder`, which is created; nothing in it reveals the
    hidden effects.
    """
    (folder / "runs").mkdir(parents=True)
    joints = case.world.joints
    random = np.random.default_rng(case.seed)
    names = [
        f"{quantity}{joint}"
        for quantity in ("angle", "speed", "torque")
        for joint in range(1, joints + 1)
    ]
    entries = []
    for number, driven in enumerate(case.driven, start=1):
        trace = run(case, case.concealed, number)
        angle = trace.angle_rad + case.reading.angle_std_rad * random.standard_normal(
            trace.angle_rad.shape
        )
        speed = trace.speed_rad_s + case.reading.speed_std_rad_s * random.standard_normal(
            trace.speed_rad_s.shape
        )
        rows = np.column_stack([trace.t_s, angle, speed, trace.torque_Nm])
        file = f"runs/run-{number}.csv"
        lines = [",".join(["t", *names])]
        for row in rows.tolist():
            lines.append(",".join(f"{value:.6f}" for value in row))
        (folder / file).write_text("\n".join(lines) + "\n", encoding="utf-8")
        entries.append(
            f'[[runs]]\nfile = "{file}"\ncondition = "run {number}"\ndriven = '
            f"{str(driven).lower()}\n"
        )
    (folder / "pendulum.toml").write_text(
        "\n".join([_head(case.nominal), *entries]), encoding="utf-8"
    )


def _head(nominal: PendulumWorld) -> str:
    known_to = {
        **KNOWN_TO,
        "joint_damping_Nm_s_per_rad": damping_std(nominal),
        "torque_offset_Nm": offset_std(nominal),
    }
    lines = ['format = "rfca-pendulum/1"', 'title = "A pendulum"', ""]
    for joint in range(nominal.joints):
        lines += [
            f"[link{joint + 1}]",
            f"length_m = {nominal.length_m[joint]:.6f}",
            f"mass_kg = {nominal.mass_kg[joint]:.6f}",
            f"centre_of_mass_m = {nominal.centre_m[joint]:.6f}",
            f"inertia_kg_m2 = {nominal.inertia_kg_m2[joint]:.6e}",
            f"joint_damping_Nm_s_per_rad = {nominal.damping_Nm_s_per_rad[joint]:.6e}",
            "",
        ]
    lines += [
        "[known_to]",
        *(f"{key} = {value:.6g}" for key, value in known_to.items()),
        "",
        "[columns]",
        't_s = "t"',
    ]
    for joint in range(1, nominal.joints + 1):
        lines += [
            f'angle{joint}_rad = "angle{joint}"',
            f'speed{joint}_rad_s = "speed{joint}"',
            f'torque{joint}_Nm = "torque{joint}"',
        ]
    return "\n".join([*lines, ""])


def run(case: PendulumCase, world: PendulumWorld, number: int) -> PendulumTrace:
    """Simulate one run of a case in `world`, without reading noise. The same `number` gives the
    same command and start.
    """
    random = np.random.default_rng([case.seed, 1, number])
    start = np.zeros(2 * world.joints)
    largest_rad = 2.0
    # Released pendulums start from larger angles, since no torque moves them later.
    if case.driven[number - 1]:
        largest_rad = 0.5
    start[: world.joints] = random.uniform(-1.0, 1.0, world.joints) * largest_rad
    t_s = np.arange(0.0, RUN_S, case.reading.sample_s)
    return swing(world, start, _command(case, number), t_s, case.driven[number - 1])


def _command(case: PendulumCase, number: int) -> Tones:
    """Commanded torques, a sum of sines for each joint; those of the second joint are smaller
    because it carries less.
    """
    joints = case.world.joints
    random = np.random.default_rng([case.seed, 2, number])
    omega = swing_rad_s(case.world) * np.exp(
        random.uniform(np.log(0.5), np.log(2.0), (TONES, joints))
    )
    phase = random.uniform(0.0, 2.0 * np.pi, (TONES, joints))
    size = (
        DRIVE_SHARE
        * torque_scale_Nm(case.world)
        * random.uniform(0.5, 1.0, (TONES, joints))
        * np.array([1.0, 0.3])[:joints]
    )
    return Tones(size, omega, phase)


def truth_of_pendulum(case: PendulumCase) -> dict[str, Any]:
    """The truth of a case as plain data, with the same keys as that of a leg (`truth.truth_of`)."""
    hidden = {**case.effects, **case.strangers}
    sizes = {
        name: _size_of(replace(case, effects={name: values}, strangers={}))
        for name, values in case.effects.items()
    }
    if not hidden:
        shift = left = above = 0.0
    elif len(sizes) == len(hidden) == 1:
        shift, left, above = next(iter(sizes.values()))
    else:
        shift, left, above = _size_of(case)
    also_right = []
    # In a single joint, drag of the link and of the joint are one law.
    if "fluid_drag" in case.effects and case.world.joints == 1:
        also_right = ["joint_drag"]
    return {
        "format": FORMAT,
        "case": case.id,
        "kind": case.kind,
        "effects": {name: dict(values) for name, values in case.effects.items()},
        "strangers": {name: dict(values) for name, values in case.strangers.items()},
        "mislabelled": None,
        "also_right": also_right,
        "silence_is_right": False,
        "strength": case.strength,
        "size": {
            "shift_over_noise": shift,
            "left_over_noise": left,
            "left_over_model_error": above,
        },
        "left_of_each": {name: sizes[name][1] for name in case.effects},
        "above_of_each": {name: sizes[name][2] for name in case.effects},
        "structured": None,
        "uneven": None,
        "world": asdict(case.world),
        "friction": asdict(case.friction),
        "drag_power": case.drag_power,
        "design": {"conditions": [f"run {number}" for number in range(1, len(case.driven) + 1)]},
        "seed": case.seed,
    }


def _size_of(case: PendulumCase) -> tuple[float, float, float]:
    """Root mean square change by the hidden effects, in the channel that changes most, over short
    windows from the true state.

    Returns
    -------
    shift : float
        In units of a sample's noise.
    left : float
        The same after nominal values, each with its prior, and the window's start, which is free,
        have explained what they can (linearised).
    above : float
        As `left`, in units of noise and of the change by torques that are wrong by MODEL_ERROR.
    """
    plain = replace(case, effects={}, strangers={}).concealed
    traces = [run(case, case.concealed, number) for number in range(1, len(case.driven) + 1)]
    starts = [
        (number, float(t))
        for number in range(1, len(case.driven) + 1)
        for t in np.linspace(0.5, RUN_S - WINDOW_S, WINDOWS)
    ]
    noise = np.repeat([case.reading.angle_std_rad, case.reading.speed_std_rad_s], case.world.joints)

    def windows(world: PendulumWorld, start_off: Floats | None = None) -> Floats:
        """Simulated windows (windows, samples, channels) in units of noise, started at the true
        states plus `start_off` (2 n,).
        """
        simulated_windows = []
        for number, start_s in starts:
            trace = traces[number - 1]
            row = int(np.searchsorted(trace.t_s, start_s))
            state = trace.state[row] + (0.0 if start_off is None else start_off)
            t_s = trace.t_s[row] + np.linspace(0.0, WINDOW_S, 26)
            part = swing(world, state, _command(case, number), t_s, case.driven[number - 1])
            simulated_windows.append(np.column_stack([part.angle_rad, part.speed_rad_s]) / noise)
        return np.array(simulated_windows)

    base = windows(plain)
    shift = windows(case.concealed) - base
    moves = [windows(moved) - base for moved in _move_parameters(plain)]
    # A difference of 3 sigma is small for the motion and well above the integrator's tolerance.
    states = [windows(plain, off) - base for off in np.diag(3.0 * noise)]
    torque = replace(
        plain, torque_offset_Nm=tuple(MODEL_ERROR * torque_scale_Nm(case.world) for _ in noise)
    )
    error = np.abs(windows(torque) - base)
    left = _remainder(shift, moves, states, np.ones_like(base))
    return _largest_rms(shift), left, _remainder(shift, moves, states, np.hypot(1.0, error))


def _move_parameters(world: PendulumWorld) -> list[PendulumWorld]:
    """The rig with one nominal value after the other off by its standard deviation, in all links
    together.

    The inertia follows the mass, and the centre of mass by the parallel axis theorem.
    """
    mass = 1.0 + KNOWN_TO["mass_relative"]
    by = KNOWN_TO["centre_of_mass_m"]
    return [
        replace(
            world,
            mass_kg=tuple(mass * m for m in world.mass_kg),
            inertia_kg_m2=tuple(mass * m for m in world.inertia_kg_m2),
        ),
        replace(
            world,
            centre_m=tuple(c + by for c in world.centre_m),
            inertia_kg_m2=tuple(
                i + m * by * (2.0 * c + by)
                for i, m, c in zip(world.inertia_kg_m2, world.mass_kg, world.centre_m, strict=True)
            ),
        ),
        replace(
            world,
            damping_Nm_s_per_rad=tuple(c + damping_std(world) for c in world.damping_Nm_s_per_rad),
        ),
        replace(
            world, torque_offset_Nm=tuple(t + offset_std(world) for t in world.torque_offset_Nm)
        ),
        replace(world, torque_delay_s=world.torque_delay_s + KNOWN_TO["torque_delay_s"]),
    ]


def _remainder(shift: Floats, moves: list[Floats], states: list[Floats], units: Floats) -> float:
    """Remaining `shift` (windows, samples, channels), in these units, after a linear fit of nominal
    values and window starts.

    `moves` are the changes by one standard deviation of each nominal value, `states` those by each
    component of a window's start.
    """
    windows = len(shift)
    rest, *columns = ((change / units).reshape(windows, -1) for change in (shift, *moves))
    # The start of each window is free: its directions are projected out, window by window.
    starts = []
    for window in range(windows):
        directions = [(state[window] / units[window]).ravel() for state in states]
        starts.append(np.linalg.qr(np.stack(directions, axis=1))[0])

    def beyond_start(x: Floats) -> Floats:
        return np.stack(
            [row - basis @ (basis.T @ row) for row, basis in zip(x, starts, strict=True)]
        )

    rest = beyond_start(rest)
    J = np.stack([beyond_start(column).ravel() for column in columns], axis=1)
    # The identity is the prior of the nominal values: their columns are changes by one standard
    # deviation.
    z = np.linalg.solve(J.T @ J + np.eye(J.shape[1]), J.T @ rest.ravel())
    return _largest_rms((rest.ravel() - J @ z).reshape(shift.shape))


def _largest_rms(x: Floats) -> float:
    """Root mean square of each channel of x (windows, samples, channels), the largest of them."""
    return float(np.sqrt((x**2).mean(axis=(0, 1))).max())
