"""One time step of a mechanism, with or without contacts that have a law of their own.

MuJoCo's integrators take external forces as constant over a step, which is of first order. Where it
would integrate explicitly, the classical Runge-Kutta scheme here replaces it, and evaluates the
contact law in each of the four stages. The error is of fourth order where no contact begins or ends
and no friction changes its sign, and of second order there.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rfca_rig.mechanism.contact_law import ContactArrays, apply_contact_forces
from rfca_rig.mechanism.library import (
    ACCELERATION,
    ACTUATION,
    CONSTRAINT,
    INNER_FORCES,
    POSITION,
    SENSORS,
    STEP,
    STEP_1,
    STEP_2,
    VELOCITY,
    MujocoArrays,
    call_mujoco,
)
from rfca_rig.model.kernel.compiled import jit_internal

Floats = NDArray[np.float64]


class StageArrays(NamedTuple):
    """State at a step's beginning, and the weighted mean of the stages' rates.

    `q`, `w` (n,), `stretch` (c, 3) and `normal` (c,) at the beginning, and `total` (2, n) the mean
    rates. All are empty where MuJoCo integrates.
    """

    q: Floats
    w: Floats
    stretch: Floats
    normal: Floats
    total: Floats


@jit_internal
def _copy_sticking(stretch: Floats, normal: Floats, to_stretch: Floats, to_normal: Floats) -> None:
    for c in range(normal.size):
        to_normal[c] = normal[c]
        for i in range(3):
            to_stretch[c, i] = stretch[c, i]


@jit_internal
def _choose_time_ahead(stage: int, h: float) -> float:
    """Time of a stage after the beginning of a step of `h` [s]."""
    if stage == 0:
        return 0.0
    if stage == 3:
        return h
    return 0.5 * h


@jit_internal
def _move_ahead(mujoco: MujocoArrays, stages: StageArrays, ahead: float) -> None:
    """Sets positions and speeds to those `ahead` [s] after the step's beginning, by the rates of
    the stage before.
    """
    for i in range(mujoco.q.size):
        speed = mujoco.w[i]
        mujoco.w[i] = stages.w[i] + ahead * mujoco.qacc[i]
        mujoco.q[i] = stages.q[i] + ahead * speed


@jit_internal
def _take_stages(
    mujoco: MujocoArrays, h: float, stages: StageArrays, contacts: ContactArrays, noted: Floats
) -> None:
    for i in range(mujoco.q.size):
        stages.q[i] = mujoco.q[i]
        stages.w[i] = mujoco.w[i]
        stages.total[0, i] = 0.0
        stages.total[1, i] = 0.0
    _copy_sticking(contacts.stretch, contacts.normal, stages.stretch, stages.normal)
    begin_s = contacts.clock[0]
    for stage in range(4):
        ahead = _choose_time_ahead(stage, h)
        if stage == 0:
            call_mujoco(mujoco, STEP_1)
        else:
            _move_ahead(mujoco, stages, ahead)
            _copy_sticking(stages.stretch, stages.normal, contacts.stretch, contacts.normal)
            call_mujoco(mujoco, POSITION)
            call_mujoco(mujoco, VELOCITY)
        # Each stage advances the sticking points from the step's beginning, so clock and stretch
        # are put back before it.
        contacts.clock[0] = begin_s
        apply_contact_forces(contacts, ahead)
        call_mujoco(mujoco, ACTUATION)
        call_mujoco(mujoco, ACCELERATION)
        call_mujoco(mujoco, CONSTRAINT)
        if stage == 0:
            if noted.size > 0:
                # Force sensors read the joint reactions, which MuJoCo computes in a call of its
                # own.
                call_mujoco(mujoco, INNER_FORCES)
                call_mujoco(mujoco, SENSORS)
            for i in range(noted.size):
                noted[i] = mujoco.sensordata[i]
            for i in range(mujoco.q.size):
                # The constraint solver of the next stages begins from the accelerations of the
                # first one.
                mujoco.qacc_warmstart[i] = mujoco.qacc[i]
        # Weights 1, 2, 2, 1 over 6 of the classical scheme.
        share = (1.0 if stage in (0, 3) else 2.0) / 6.0
        for i in range(mujoco.q.size):
            stages.total[0, i] += share * mujoco.w[i]
            stages.total[1, i] += share * mujoco.qacc[i]
    for i in range(mujoco.q.size):
        mujoco.q[i] = stages.q[i] + h * stages.total[0, i]
        mujoco.w[i] = stages.w[i] + h * stages.total[1, i]
    contacts.clock[0] = begin_s + h


@jit_internal
def take_step(
    mujoco: MujocoArrays, h: float, stages: StageArrays, contacts: ContactArrays, noted: Floats
) -> None:
    """Advances positions and speeds by `h` [s], and stores the sensors (d,) or (0,) of the step's
    beginning in `noted`.
    """
    if stages.q.size > 0:
        _take_stages(mujoco, h, stages, contacts, noted)
        return
    if contacts.radius.size > 0:
        call_mujoco(mujoco, STEP_1)
        apply_contact_forces(contacts, h)
        call_mujoco(mujoco, STEP_2)
    else:
        call_mujoco(mujoco, STEP)
    for i in range(noted.size):
        noted[i] = mujoco.sensordata[i]
