"""MuJoCo's C library: its functions for compiled code, and its timers.

Functions are called by their addresses, with the interpreter lock released.
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


class MujocoArrays(NamedTuple):
    """MuJoCo's functions by their addresses, model and data by theirs, and its own arrays, for the
    compiled loop.

    `functions` (f,) as `NAMES`. Of the n joints `q` and `w` are position and speed, `qacc` and
    `qacc_warmstart` the accelerations and those with which the constraint solver begins,
    `by_actuators` the torques of the actuators, `applied` those of the loop, and `frictionloss` the
    dry friction. `ctrl` (u,) are the commands, `sensordata` (d,) the sensors.
    """

    functions: NDArray[np.int64]
    model: int
    data: int
    q: Floats
    w: Floats
    qacc: Floats
    qacc_warmstart: Floats
    by_actuators: Floats
    applied: Floats
    frictionloss: Floats
    ctrl: Floats
    sensordata: Floats


@cache
def load_library() -> ctypes.CDLL:
    """The shared library that MuJoCo's Python package uses."""
    import mujoco  # noqa: PLC0415  (optional)

    folder = Path(mujoco.__file__).parent
    # The shared library is in the Python package, with another name on each platform.
    path = next(
        path
        for name in ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll")
        for path in folder.glob(name)
    )
    return ctypes.CDLL(str(path))


@cache
def list_addresses() -> NDArray[np.int64]:
    """Addresses (f,) of the functions of `NAMES`."""
    library = load_library()
    return np.array([ctypes.cast(getattr(library, name), ctypes.c_void_p).value for name in NAMES])


def list_arrays(model: Any, data: Any) -> MujocoArrays:
    """The arrays of MuJoCo's model and data."""
    return MujocoArrays(
        functions=list_addresses(),
        model=model._address,
        data=data._address,
        q=data.qpos,
        w=data.qvel,
        qacc=data.qacc,
        qacc_warmstart=data.qacc_warmstart,
        by_actuators=data.qfrc_actuator,
        applied=data.qfrc_applied,
        frictionloss=model.dof_frictionloss,
        ctrl=data.ctrl,
        sensordata=data.sensordata,
    )


def switch_off_timers() -> None:
    """Switch off MuJoCo's timers, in the whole process.

    MuJoCo's Python package sets a clock, which MuJoCo reads up to 30 times in an evaluation: half
    the time of a step of a pendulum. The package cannot unset it: `set_mjcb_time(None)` sets it
    again. A simulation does not depend on it.
    """
    ctypes.c_void_p.in_dll(load_library(), "mjcb_time").value = None


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


_call_address = cast(Callable[[int, int, int], None], intrinsic(_call))


@jit_internal
def call_mujoco(mujoco: MujocoArrays, function: int) -> None:
    """Calls the function of this number in `NAMES`."""
    _call_address(mujoco.functions[function], mujoco.model, mujoco.data)
