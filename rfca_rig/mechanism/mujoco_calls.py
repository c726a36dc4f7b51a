"""Calls MuJoCo's C functions by their addresses from compiled code, with the interpreter lock released."""

import ctypes
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

NAMES = (
    "mj_step", "mj_step1", "mj_step2", "mj_fwdPosition", "mj_fwdVelocity", "mj_fwdActuation", "mj_fwdAcceleration", "mj_fwdConstraint",
    "mj_rnePostConstraint", "mj_sensorAcc",
)  # fmt: skip
STEP, STEP_1, STEP_2, POSITION, VELOCITY, ACTUATION, ACCELERATION, CONSTRAINT, INNER_FORCES, SENSORS = range(len(NAMES))


@cache
def list_addresses() -> NDArray[np.int64]:
    """Addresses (f,) of the functions of `NAMES`."""
    import mujoco  # noqa: PLC0415  (optional)

    folder = Path(mujoco.__file__).parent
    # The shared library is in the Python package, with another name on each platform.
    library = next(path for name in ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll") for path in folder.glob(name))
    functions = ctypes.CDLL(str(library))
    return np.array([ctypes.cast(getattr(functions, name), ctypes.c_void_p).value for name in NAMES])


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
