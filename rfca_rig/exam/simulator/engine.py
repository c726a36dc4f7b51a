"""The exam's simulator: seven rods in relative angles, integrated by drift-kick-drift with a fixed step.

A step is half a drift, one solve for the change of all rates with hinge damping half implicit, and half a drift. It is second order.
The step is fixed, so halving it is the whole convergence test. The simulator shares no code, coordinates, integrator, friction law or
memory law with the model that the diagnosis uses.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import SimulationFailed
from rfca_rig.exam.simulator.step import FIRST_ANGLE, run
from rfca_rig.exam.simulator.world import GRAVITY_M_S2, World

Floats = NDArray[np.float64]

STEP_S = 5e-5
# The leg is released before the recording starts, so that it hangs still when the command begins at t = 0.
RELEASED_S = -0.6


@dataclass(frozen=True)
class Traces:
    """True signals of one simulation, before the sensor.

    All are (m,) at the times `t_s`, except `joint_angles_rad` (m, 7), the angles of the shaft and of the six hinges. `force_y_N` and
    `force_d_N` are the force of the mount on the leg, along y and d (downwards).
    """

    t_s: Floats
    force_y_N: Floats
    force_d_N: Floats
    leg_torque_Nm: Floats
    motor_torque_Nm: Floats
    motor_angle_rad: Floats
    motor_speed_rad_s: Floats
    joint_angles_rad: Floats


def simulate(world: World, knots: Floats, t_s: Floats, width_s: float = 1e-4, step_s: float = STEP_S) -> Traces:
    """Simulate a leg that is released straight at -0.6 s and then driven.

    Parameters
    ----------
    world : World
        The rig.
    knots : (2, k) array
        Times in s and commanded speeds in rad/s, linear in between.
    t_s : (m,) array
        Sample times, ascending.
    width_s : float
        Each sample is the mean over this time around it, at least one step on either side.
    step_s : float
        Step of the integrator; the method is of second order.

    Returns
    -------
    Traces
        The true signals at `t_s`.

    Raises
    ------
    SimulationFailed
        Where the state is no longer finite.
    """
    rod, mount = _rod(world), _mount(world)
    drive = np.array([getattr(world.drive, name) for name in _DRIVE])
    phi, motor = _at_release(world, rod)
    middle = (t_s - RELEASED_S) / step_s
    half = max(round(0.5 * width_s / step_s), 1)
    # Step k covers k to k + 1 steps after the release. These 2 * half steps are therefore symmetric about the sample.
    window = np.round(middle)[:, None] + np.array([-half, half - 1])
    out = np.zeros((len(t_s), FIRST_ANGLE + rod.shape[1]))
    steps = int(window[-1, 1]) + 1
    if not run(rod, _hinge(world), _floor(world), drive, mount, knots, phi, motor, RELEASED_S, step_s, steps, window, out):
        raise SimulationFailed(f"the exam's simulator left the finite numbers {1e3 * world.mount.height_m:.0f} mm above the ground")
    fy, fd, leg, torque, angle, speed = out[:, :FIRST_ANGLE].T
    return Traces(t_s, fy, fd, leg, torque, angle, speed, out[:, FIRST_ANGLE:])


# The order is that of the entries of `drive` in engine_drive.
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
    """Lengths, masses, centres of mass and moments of inertia about these, (4, 7); the tip mass is merged into the last rod."""
    length, mass = np.array(world.links.length_m), np.array(world.links.mass_kg)
    centre, inertia = length / 2.0, mass * length**2 / 12.0
    tip, whole = world.links.tip_mass_kg, mass[-1] + world.links.tip_mass_kg
    merged = (mass[-1] * centre[-1] + tip * length[-1]) / whole
    # Parallel axis theorem: rod and point mass about their common centre of mass.
    inertia[-1] += mass[-1] * (merged - centre[-1]) ** 2 + tip * (length[-1] - merged) ** 2
    centre[-1], mass[-1] = merged, whole
    return np.array([length, mass, centre, inertia])


def _hinge(world: World) -> Floats:
    # The fields of `Hinges` are in the order of the columns in engine_hinge. Row 0 is the shaft, which has no spring.
    columns = [getattr(world.hinges, field.name) for field in fields(world.hinges)]
    return np.vstack([np.zeros(len(columns)), np.array(columns).T])


def _floor(world: World) -> Floats:
    # The fields of `Floor` are in the order of the entries in engine_floor. The last two hold how far and how fast the floor shakes.
    return np.array([float(getattr(world.floor, field.name)) for field in fields(world.floor)] + [world.mount.height_m, 0.0, 0.0])


def _mount(world: World) -> Floats:
    mount, links = world.mount, world.links
    pull = GRAVITY_M_S2 * np.array([np.sin(mount.lean_rad), np.cos(mount.lean_rad)])
    drag = links.drag_N_s2_per_m3, links.drag_power
    frame = mount.frame_kg, mount.frame_N_per_m, mount.frame_N_s_per_m, mount.frame_lean_rad, mount.frame_felt_share
    return np.array([links.end_radius_m, *drag, *pull, *frame])


def _at_release(world: World, rod: Floats) -> tuple[Floats, Floats]:
    """Angles (n,) and motor state (4,) of the straight leg, with the drive's springs deflected so that they carry its weight."""
    drive, start = world.drive, world.drive.start_angle_rad
    angles = np.zeros(rod.shape[1] + (world.mount.frame_kg > 0.0))
    along = rod[1] @ (np.concatenate([[0.0], np.cumsum(rod[0])[:-1]]) + rod[2])
    weight = GRAVITY_M_S2 * along * np.cos(start + world.mount.lean_rad)
    # The PI loop gives torque only for an angle error, so the motor starts below its command by weight / ki.
    motor = start + (weight / drive.ki_Nm_per_rad if drive.ki_Nm_per_rad > 0.0 else 0.0)
    # The shaft spring acts only beyond its play.
    angles[0] = motor + (weight / drive.shaft_Nm_per_rad + drive.shaft_gap_rad if drive.shaft_Nm_per_rad > 0.0 else 0.0)
    return angles, np.array([start, 0.0, motor, 0.0])
