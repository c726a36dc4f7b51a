"""Calls a compiled law by its address, from inside compiled code."""

from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from rfca_rig.model.state import Floats


def _call_law(typing_context: Any, address: Any, x: Any, memory: Any, parameter: Any, out: Any) -> Any:
    """Passes the law a pointer to the data of each array; reference counts of the arrays are not touched, as that would take time."""
    del typing_context

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = ir.DoubleType().as_pointer()
        function = ir.FunctionType(ir.VoidType(), [pointer] * 4).as_pointer()
        # All laws have the C signature void(double*, double*, double*, double*), see `laws._SIGNATURE`.
        pointers = [
            context.make_array(kind)(context, builder, argument).data
            for kind, argument in zip(signature.args[1:], arguments[1:], strict=True)
        ]
        builder.call(builder.inttoptr(arguments[0], function), pointers)
        return context.get_dummy_value()

    return types.void(address, x, memory, parameter, out), generate


call_law = cast(Callable[[int, Floats, Floats, Floats, Floats], None], intrinsic(_call_law))
