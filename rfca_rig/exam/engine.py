"""The exam's simulator: seven rods in relative angles, drift-kick-drift with a fixed step.

Half a drift, one solve for the change of all rates with hinge damping taken half implicitly, half a drift: second order, and with
no error control to argue about, so that halving the step is the whole proof of convergence. It shares no code, coordinates, integrator,
friction or memory law with the model that the diagnosis uses.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import SimulationFailed
from rfca_rig.exam.engine_step import BENT, run
from rfca_rig.exam.world import GRAVITY_M_S2, World

Floats = NDArray[np.float64]

STEP_S = 5e-5
RELEASED_S = -0.6  # when the straight leg is let go


@dataclass(frozen=True)
class Traces:
    """What happened at the times `t_s` (m,): force of the mount on the leg along y and d, torques, the motor's angle and speed,
    and the angles (m, 7) of the shaft and of the hinges.
    """

    t_s: Floats
    force_y_N: Floats
    force_d_N: Floats
    leg_torque_Nm: Floats
    motor_torque_Nm: Floats
    motor_angle_rad: Floats
    motor_speed_rad_s: Floats
    bent_rad: Floats


def simulate(world: World, knots: Floats, t_s: Floats, width_s: float = 1e-4, step_s: float = STEP_S) -> Traces:
    """The leg let go straight at -0.6 s and then driven with the speeds of `knots` (2, m): times and speeds, straight in between.

    `t_s` (m,) ascending; each sample is the mean over `width_s` around it, at least one step on either side. Raises SimulationFailed.
    """
    rod, mount = _rod(world), _mount(world)
    drive = np.array([getattr(world.drive, name) for name in _DRIVE])
    phi, motor = _at_release(world, rod)
    middle = (t_s - RELEASED_S) / step_s
    half = max(round(0.5 * width_s / step_s), 1)
    window = np.round(middle)[:, None] + np.array([-half, half - 1])
    out = np.zeros((len(t_s), BENT + rod.shape[1]))
    steps = int(window[-1, 1]) + 1
    if not run(rod, _hinge(world), _floor(world), drive, mount, knots, phi, motor, RELEASED_S, step_s, steps, window, out):
        raise SimulationFailed(f"the exam's simulator left the finite numbers {1e3 * world.mount.height_m:.0f} mm above the ground")
    fy, fd, leg, torque, angle, speed = out[:, :BENT].T
    return Traces(t_s, fy, fd, leg, torque, angle, speed, out[:, BENT:])


_DRIVE = (
    "start_angle_rad",
    "kp_Nm_s_per_rad",
    "ki_Nm_per_rad",
    "rotor_kg_m2",
    "shaft_Nm_per_rad",
    "shaft_Nm_s_per_rad",
    "shaft_gap_rad",
    "shaft_loss_s_per_rad",
    "ripple_share",
    "ripple_cycles",
    "ripple_phase_rad",
    "cable_Nm",
    "limit_Nm",
    "cogging_Nm",
    "cogging_cycles",
    "hose_Nm_per_rad",
)


def _rod(world: World) -> Floats:
    """Lengths, masses, centres and moments of inertia about them; the tip's mass merged into the last rod."""
    length, mass = np.array(world.links.length_m), np.array(world.links.mass_kg)
    centre, inertia = length / 2.0, mass * length**2 / 12.0
    tip, whole = world.links.tip_mass_kg, mass[-1] + world.links.tip_mass_kg
    merged = (mass[-1] * centre[-1] + tip * length[-1]) / whole
    inertia[-1] += mass[-1] * (merged - centre[-1]) ** 2 + tip * (length[-1] - merged) ** 2
    centre[-1], mass[-1] = merged, whole
    return np.array([length, mass, centre, inertia])


def _hinge(world: World) -> Floats:
    columns = [getattr(world.hinges, field.name) for field in fields(world.hinges)]
    return np.vstack([np.zeros(len(columns)), np.array(columns).T])


def _floor(world: World) -> Floats:
    return np.array([float(getattr(world.floor, field.name)) for field in fields(world.floor)] + [world.mount.height_m, 0.0, 0.0])


def _mount(world: World) -> Floats:
    mount, links = world.mount, world.links
    pull = GRAVITY_M_S2 * np.array([np.sin(mount.lean_rad), np.cos(mount.lean_rad)])
    drag = links.drag_N_s2_per_m3, links.drag_power
    frame = mount.frame_kg, mount.frame_N_per_m, mount.frame_N_s_per_m, mount.frame_lean_rad, mount.frame_felt_share
    return np.array([links.end_radius_m, *drag, *pull, *frame])


def _at_release(world: World, rod: Floats) -> tuple[Floats, Floats]:
    """Straight, with the springs of the drive bent as far as they carry the straight leg."""
    drive, start = world.drive, world.drive.start_angle_rad
    phi = np.zeros(rod.shape[1] + (world.mount.frame_kg > 0.0))
    along = rod[1] @ (np.concatenate([[0.0], np.cumsum(rod[0])[:-1]]) + rod[2])
    weight = GRAVITY_M_S2 * along * np.cos(start + world.mount.lean_rad)
    motor = start + (weight / drive.ki_Nm_per_rad if drive.ki_Nm_per_rad > 0.0 else 0.0)
    phi[0] = motor + (weight / drive.shaft_Nm_per_rad + drive.shaft_gap_rad if drive.shaft_Nm_per_rad > 0.0 else 0.0)
    return phi, np.array([start, 0.0, motor, 0.0])
