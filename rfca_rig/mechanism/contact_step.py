"""One step of a mechanism, with or without contacts that have a law of their own.

MuJoCo's integrators take outer forces as constant over a step, which is of first order. Where it integrates explicitly, the classical
Runge-Kutta scheme stands here in its place, and evaluates the contact law in each of the four stages. The error is of fourth order where
no contact begins or ends and no friction changes its sign, and of second order there.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rfca_rig.mechanism.contact_law import ContactArrays, push
from rfca_rig.mechanism.mujoco_calls import (
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
    call_mujoco,
)
from rfca_rig.model.compiled import internal

Floats = NDArray[np.float64]


class StageArrays(NamedTuple):
    """State at a step's beginning, (n,) and (c, ...), the mean of the stages' rates, (2, n), and MuJoCo's accelerations, (n,).

    The first ones are empty where MuJoCo integrates.
    """

    q: Floats
    w: Floats
    stretch: Floats
    normal: Floats
    total: Floats
    qacc: Floats
    qacc_warmstart: Floats


@internal
def _copy_sticking(stretch: Floats, normal: Floats, to_stretch: Floats, to_normal: Floats) -> None:
    for c in range(normal.size):
        to_normal[c] = normal[c]
        for i in range(3):
            to_stretch[c, i] = stretch[c, i]


@internal
def _take_stages(
    addresses: NDArray[np.int64],
    model: int,
    data: int,
    q: Floats,
    w: Floats,
    h: float,
    stages: StageArrays,
    contacts: ContactArrays,
    sensordata: Floats,
    noted: Floats,
) -> None:
    for i in range(q.size):
        stages.q[i], stages.w[i], stages.total[0, i], stages.total[1, i] = q[i], w[i], 0.0, 0.0
    _copy_sticking(contacts.stretch, contacts.normal, stages.stretch, stages.normal)
    begun_s = contacts.clock[0]
    for stage in range(4):
        ahead = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
        if stage == 0:
            call_mujoco(addresses[STEP_1], model, data)
        else:
            for i in range(q.size):
                speed = w[i]
                w[i] = stages.w[i] + ahead * stages.qacc[i]
                q[i] = stages.q[i] + ahead * speed
            _copy_sticking(stages.stretch, stages.normal, contacts.stretch, contacts.normal)
            call_mujoco(addresses[POSITION], model, data)
            call_mujoco(addresses[VELOCITY], model, data)
        contacts.clock[0] = begun_s
        push(contacts, ahead)
        call_mujoco(addresses[ACTUATION], model, data)
        call_mujoco(addresses[ACCELERATION], model, data)
        call_mujoco(addresses[CONSTRAINT], model, data)
        if stage == 0:
            if noted.size > 0:
                call_mujoco(addresses[INNER_FORCES], model, data)  # the sensors take them from the last call
                call_mujoco(addresses[SENSORS], model, data)
            for i in range(noted.size):
                noted[i] = sensordata[i]
            for i in range(q.size):
                stages.qacc_warmstart[i] = stages.qacc[i]
        share = (1.0 if stage in (0, 3) else 2.0) / 6.0
        for i in range(q.size):
            stages.total[0, i] += share * w[i]
            stages.total[1, i] += share * stages.qacc[i]
    for i in range(q.size):
        q[i] = stages.q[i] + h * stages.total[0, i]
        w[i] = stages.w[i] + h * stages.total[1, i]
    contacts.clock[0] = begun_s + h


@internal
def take_step(
    addresses: NDArray[np.int64],
    model: int,
    data: int,
    q: Floats,
    w: Floats,
    h: float,
    stages: StageArrays,
    contacts: ContactArrays,
    sensordata: Floats,
    noted: Floats,
) -> None:
    """Carries positions and speeds (n,) on by `h` [s], and notes the sensors (d,) or (0,) of the step's beginning."""
    if stages.q.size > 0:
        _take_stages(addresses, model, data, q, w, h, stages, contacts, sensordata, noted)
        return
    if contacts.radius.size > 0:
        call_mujoco(addresses[STEP_1], model, data)
        push(contacts, h)
        call_mujoco(addresses[STEP_2], model, data)
    else:
        call_mujoco(addresses[STEP], model, data)
    for i in range(noted.size):
        noted[i] = sensordata[i]
