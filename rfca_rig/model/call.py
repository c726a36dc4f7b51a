"""Calls a compiled law by its address, from inside compiled code."""

from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from rfca_rig.model.state import Floats


def _call_law(typing_context: Any, address: Any, x: Any, memory: Any, parameter: Any, out: Any) -> Any:
    """Hands the law the place of each array's first number; the arrays themselves are not touched, nor their owners counted."""
    del typing_context

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = ir.DoubleType().as_pointer()
        function = ir.FunctionType(ir.VoidType(), [pointer] * 4).as_pointer()
        places = [
            context.make_array(kind)(context, builder, argument).data
            for kind, argument in zip(signature.args[1:], arguments[1:], strict=True)
        ]
        builder.call(builder.inttoptr(arguments[0], function), places)
        return context.get_dummy_value()

    return types.void(address, x, memory, parameter, out), generate


call_law = cast(Callable[[int, Floats, Floats, Floats, Floats], None], intrinsic(_call_law))
