"""One time step of a mechanism, with or without contacts that have a law of their own.

MuJoCo's integrators take external forces as constant over a step, which is of first order. Where it
would integrate explicitly, the classical Runge-Kutta scheme here replaces it, and evaluates the
contact law in each of the four stages. The error is of fourth order where no contact begins or ends
and no friction changes its sign, and of second order there.

Calls MuJoCo's C functions by their addresses from compiled code, with the interpreter lock
released.
"""

import ctypes
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from rfca_rig.mechanism.contact_law import ContactArrays, apply_contact_forces
from rfca_rig.model.kernel.compiled import jit_internal

NAMES = (
    "mj_step",
    "mj_step1",
    "mj_step2",
    "mj_fwdPosition",
    "mj_fwdVelocity",
    "mj_fwdActuation",
    "mj_fwdAcceleration",
    "mj_fwdConstraint",
    "mj_rnePostConstraint",
    "mj_sensorAcc",
)
(
    STEP,
    STEP_1,
    STEP_2,
    POSITION,
    VELOCITY,
    ACTUATION,
    ACCELERATION,
    CONSTRAINT,
    INNER_FORCES,
    SENSORS,
) = range(len(NAMES))

Floats = NDArray[np.float64]


@cache
def list_addresses() -> NDArray[np.int64]:
    """Addresses (f,) of the functions of `NAMES`."""
    import mujoco  # noqa: PLC0415  (optional)

    folder = Path(mujoco.__file__).parent
    # The shared library is in the Python package, with another name on each platform.
    library = next(
        path
        for name in ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll")
        for path in folder.glob(name)
    )
    functions = ctypes.CDLL(str(library))
    return np.array(
        [ctypes.cast(getattr(functions, name), ctypes.c_void_p).value for name in NAMES]
    )


def _call(typing_context: Any, address: Any, model: Any, data: Any) -> Any:
    del typing_context

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        del signature
        pointer = ir.IntType(8).as_pointer()
        function = ir.FunctionType(ir.VoidType(), [pointer, pointer]).as_pointer()
        places = [builder.inttoptr(argument, pointer) for argument in arguments[1:]]
        builder.call(builder.inttoptr(arguments[0], function), places)
        return context.get_dummy_value()

    return types.void(address, model, data), generate


call_mujoco = cast(Callable[[int, int, int], None], intrinsic(_call))


class StageArrays(NamedTuple):
    """State at a step's beginning, the weighted mean of the stages' rates, and MuJoCo's
    accelerations.

    `q`, `w` (n,), `stretch` (c, 3) and `normal` (c,) at the beginning, `total` (2, n) the mean
    rates, `qacc` and `qacc_warmstart` (n,). All but the last two are empty where MuJoCo integrates.
    """

    q: Floats
    w: Floats
    stretch: Floats
    normal: Floats
    total: Floats
    qacc: Floats
    qacc_warmstart: Floats


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
def _move_ahead(stages: StageArrays, ahead: float, q: Floats, w: Floats) -> None:
    """Sets positions and speeds (n,) to those `ahead` [s] after the step's beginning, by the rates
    of the stage before.
    """
    for i in range(q.size):
        speed = w[i]
        w[i] = stages.w[i] + ahead * stages.qacc[i]
        q[i] = stages.q[i] + ahead * speed


@jit_internal
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
        stages.q[i] = q[i]
        stages.w[i] = w[i]
        stages.total[0, i] = 0.0
        stages.total[1, i] = 0.0
    _copy_sticking(contacts.stretch, contacts.normal, stages.stretch, stages.normal)
    begin_s = contacts.clock[0]
    for stage in range(4):
        ahead = _choose_time_ahead(stage, h)
        if stage == 0:
            call_mujoco(addresses[STEP_1], model, data)
        else:
            _move_ahead(stages, ahead, q, w)
            _copy_sticking(stages.stretch, stages.normal, contacts.stretch, contacts.normal)
            call_mujoco(addresses[POSITION], model, data)
            call_mujoco(addresses[VELOCITY], model, data)
        # Each stage advances the sticking points from the step's beginning, so clock and stretch
        # are put back before it.
        contacts.clock[0] = begin_s
        apply_contact_forces(contacts, ahead)
        call_mujoco(addresses[ACTUATION], model, data)
        call_mujoco(addresses[ACCELERATION], model, data)
        call_mujoco(addresses[CONSTRAINT], model, data)
        if stage == 0:
            if noted.size > 0:
                # Force sensors read the joint reactions, which MuJoCo computes in a call of its
                # own.
                call_mujoco(addresses[INNER_FORCES], model, data)
                call_mujoco(addresses[SENSORS], model, data)
            for i in range(noted.size):
                noted[i] = sensordata[i]
            for i in range(q.size):
                # The constraint solver of the next stages begins from the accelerations of the
                # first one.
                stages.qacc_warmstart[i] = stages.qacc[i]
        # Weights 1, 2, 2, 1 over 6 of the classical scheme.
        share = (1.0 if stage in (0, 3) else 2.0) / 6.0
        for i in range(q.size):
            stages.total[0, i] += share * w[i]
            stages.total[1, i] += share * stages.qacc[i]
    for i in range(q.size):
        q[i] = stages.q[i] + h * stages.total[0, i]
        w[i] = stages.w[i] + h * stages.total[1, i]
    contacts.clock[0] = begin_s + h


@jit_internal
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
    """Advances positions and speeds (n,) by `h` [s], and stores the sensors (d,) or (0,) of the
    step's beginning in `noted`.
    """
    if stages.q.size > 0:
        _take_stages(addresses, model, data, q, w, h, stages, contacts, sensordata, noted)
        return
    if contacts.radius.size > 0:
        call_mujoco(addresses[STEP_1], model, data)
        apply_contact_forces(contacts, h)
        call_mujoco(addresses[STEP_2], model, data)
    else:
        call_mujoco(addresses[STEP], model, data)
    for i in range(noted.size):
        noted[i] = sensordata[i]
