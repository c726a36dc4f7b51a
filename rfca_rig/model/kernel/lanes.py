"""Lanes: a number of the compiled chain that holds the values of eight legs, which are computed
side by side.

The equations are written once. Compiled for floats they compute one leg, compiled for lanes eight
of them with the same instructions. Three rules make a function fit for both:

- A choice by value is `select(condition, a, b)`, which computes both.
- `if` and `while` ask `in_any_lane` or `in_all_lanes`.
- What has no vector form, as the law of an effect or a search in a table, is done once per lane.

In memory, lanes are the last axis of an array of floats. Eight of them fill one register of 512
bits, two of 256 or four of 128; the compiler divides them as the processor needs. All functions
here are for compiled callers, and for floats in Python.
"""

import math
import operator
from collections.abc import Callable
from typing import Any, cast

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typeconv import Conversion  # type: ignore[attr-defined]
from numba.core.typing import signature  # type: ignore[attr-defined]
from numba.core.typing.templates import ConcreteTemplate, infer_global
from numba.extending import intrinsic, lower_builtin, lower_cast, models, overload, register_model
from numba.np.arrayobj import populate_array
from numpy.typing import NDArray

LANES = 8

_DOUBLE = ir.DoubleType()
_BIT = ir.IntType(1)
_INT32 = ir.IntType(32)
_VECTOR = ir.VectorType(_DOUBLE, LANES)
_BITS = ir.VectorType(_BIT, LANES)
_ALIGNMENT_BYTES = 8 * LANES
# A product and the sum it goes into may become one instruction, with one rounding; as for floats,
# see `compiled`.
_FUSED = ("contract",)


def select(condition: bool, a: float, b: float) -> float:
    """`a` where the condition holds, else `b`; both are computed."""
    if condition:
        return a
    return b


def in_any_lane(condition: bool) -> bool:
    """Whether the condition holds in any lane."""
    return condition


def in_all_lanes(condition: bool) -> bool:
    """Whether the condition holds in every lane."""
    return condition


def sign(x: float) -> float:
    """-1, 0 or 1."""
    return float(np.sign(x))


def highest(x: float) -> float:
    """The largest of all lanes."""
    return x


def lowest(x: float) -> float:
    """The smallest of all lanes."""
    return x


def count_lanes(x: float) -> int:  # noqa: ARG001  (its type says it)
    """Eight for lanes, one for a float."""
    return 1


def lane_of(x: float, lane: int) -> float:  # noqa: ARG001  (a float is its only lane)
    """The float in one lane."""
    return x


def with_lane(x: float, lane: int, new: float) -> float:  # noqa: ARG001
    """`x` with another float in one lane."""
    return new


def allocate_aligned(*shape: int) -> NDArray[np.float64]:
    """Zeros of a shape (..., 8), at an address that vector instructions need."""
    size = math.prod(shape)
    raw = np.zeros(size + LANES)
    skipped = (-raw.ctypes.data % _ALIGNMENT_BYTES) // 8
    return raw[skipped : skipped + size].reshape(shape)


class LanesType(types.Type):
    """Eight floats. A float becomes eight equal ones wherever lanes are expected."""

    def __init__(self) -> None:
        super().__init__(name=f"lanes{LANES}")

    def can_convert_from(self, typing_context: Any, other: Any) -> Any:  # noqa: ARG002
        """Called by the compiler: whether a value of another type becomes one of this."""
        if isinstance(other, (types.Float, types.Integer)):
            return Conversion.safe
        return None

    def unify(self, typing_context: Any, other: Any) -> Any:  # noqa: ARG002
        """Called by the compiler: the type of a variable that is assigned both."""
        if isinstance(other, (types.Float, types.Integer)):
            return self
        return None


class LaneBitsType(types.Type):
    """Eight truth values, as a comparison of lanes gives them."""

    def __init__(self) -> None:
        super().__init__(name=f"lane_bits{LANES}")

    def can_convert_from(self, typing_context: Any, other: Any) -> Any:  # noqa: ARG002
        """As for lanes."""
        if isinstance(other, types.Boolean):
            return Conversion.safe
        return None

    def unify(self, typing_context: Any, other: Any) -> Any:  # noqa: ARG002
        """As for lanes."""
        if isinstance(other, types.Boolean):
            return self
        return None


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, numba_type: Any) -> None:
        super().__init__(manager, numba_type, _VECTOR)


@register_model(LaneBitsType)
class _LaneBitsModel(models.PrimitiveModel):
    def __init__(self, manager: Any, numba_type: Any) -> None:
        super().__init__(manager, numba_type, _BITS)


def _repeat(builder: Any, value: Any, vector: Any) -> Any:
    undefined = ir.Constant(vector, ir.Undefined)
    first_everywhere = ir.Constant(ir.VectorType(_INT32, LANES), [0] * LANES)
    return builder.shuffle_vector(
        builder.insert_element(undefined, value, _INT32(0)), undefined, first_everywhere
    )


@lower_cast(types.Float, LanesType)
@lower_cast(types.Integer, LanesType)
def _cast_to_lanes(context: Any, builder: Any, from_type: Any, to_type: Any, value: Any) -> Any:  # noqa: ARG001
    return _repeat(builder, context.cast(builder, value, from_type, types.float64), _VECTOR)


@lower_cast(types.Boolean, LaneBitsType)
def _cast_to_bits(context: Any, builder: Any, from_type: Any, to_type: Any, value: Any) -> Any:  # noqa: ARG001
    return _repeat(builder, value, _BITS)


_LANES = LanesType()
_LANE_BITS = LaneBitsType()
_FLOAT = types.float64
_BOOLEAN = types.boolean
_INTEGER = types.intp


def _define(function: Any, *forms: tuple[Any, tuple[Any, ...], Callable[..., Any]]) -> None:
    """Gives `function` forms for the compiler: type of the result, types of the arguments,
    instructions from a builder and their values.
    """

    class _Template(ConcreteTemplate):
        # Together, so that the compiler chooses the form that converts least.
        cases = [signature(result, *arguments) for result, arguments, _ in forms]  # noqa: RUF012
        key = function

    infer_global(function, types.Function(_Template))
    for _, arguments, build in forms:
        lower_builtin(function, *arguments)(
            lambda context, builder, sig, values, build=build: build(builder, *values)  # noqa: ARG005
        )


def _call_vector(name: str) -> Callable[..., Any]:
    def build(builder: Any, x: Any) -> Any:
        kind = ir.FunctionType(_VECTOR, [_VECTOR])
        return builder.call(
            cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{LANES}f64"), [x]
        )

    return build


def _test_bits(symbol: str, value: int) -> Callable[..., Any]:
    def build(builder: Any, condition: Any) -> Any:
        packed = builder.bitcast(condition, ir.IntType(LANES))
        return builder.icmp_signed(symbol, packed, ir.Constant(packed.type, value))

    return build


def _extreme(symbol: str) -> Callable[..., Any]:
    def build(builder: Any, x: Any) -> Any:
        extreme = builder.extract_element(x, _INT32(0))
        for lane in range(1, LANES):
            other = builder.extract_element(x, _INT32(lane))
            extreme = builder.select(builder.fcmp_ordered(symbol, other, extreme), other, extreme)
        return extreme

    return build


def _build_sign(builder: Any, x: Any) -> Any:
    zero, one, minus = (
        _DOUBLE(value) if x.type == _DOUBLE else _repeat(builder, _DOUBLE(value), _VECTOR)
        for value in (0.0, 1.0, -1.0)
    )
    below = builder.select(builder.fcmp_ordered("<", x, zero), minus, zero)
    return builder.select(builder.fcmp_ordered(">", x, zero), one, below)


def _build_same(builder: Any, x: Any, *others: Any) -> Any:  # noqa: ARG001
    return x


for _functions, _build in (
    ((operator.add, operator.iadd), lambda builder, a, b: builder.fadd(a, b, flags=_FUSED)),
    ((operator.sub, operator.isub), lambda builder, a, b: builder.fsub(a, b, flags=_FUSED)),
    ((operator.mul, operator.imul), lambda builder, a, b: builder.fmul(a, b, flags=_FUSED)),
    ((operator.truediv, operator.itruediv), lambda builder, a, b: builder.fdiv(a, b)),
    # As Python's: the first argument where the comparison fails, so where one is NaN.
    ((max,), lambda builder, a, b: builder.select(builder.fcmp_ordered(">", b, a), b, a)),
    ((min,), lambda builder, a, b: builder.select(builder.fcmp_ordered("<", b, a), b, a)),
):
    for _function in _functions:
        _define(_function, (_LANES, (_LANES, _LANES), _build))
for _function, _symbol in (
    (operator.lt, "<"),
    (operator.le, "<="),
    (operator.gt, ">"),
    (operator.ge, ">="),
    (operator.eq, "=="),
):
    _define(
        _function,
        (
            _LANE_BITS,
            (_LANES, _LANES),
            lambda builder, a, b, symbol=_symbol: builder.fcmp_ordered(symbol, a, b),
        ),
    )
_define(
    operator.ne,
    (_LANE_BITS, (_LANES, _LANES), lambda builder, a, b: builder.fcmp_unordered("!=", a, b)),
)
_define(
    operator.and_, (_LANE_BITS, (_LANE_BITS, _LANE_BITS), lambda builder, a, b: builder.and_(a, b))
)
_define(
    operator.or_, (_LANE_BITS, (_LANE_BITS, _LANE_BITS), lambda builder, a, b: builder.or_(a, b))
)
_define(operator.neg, (_LANES, (_LANES,), lambda builder, x: builder.fneg(x)))
_define(abs, (_LANES, (_LANES,), _call_vector("fabs")))
_define(np.sqrt, (_LANES, (_LANES,), _call_vector("sqrt")))
_define(np.floor, (_LANES, (_LANES,), _call_vector("floor")))
_define(sign, (_FLOAT, (_FLOAT,), _build_sign), (_LANES, (_LANES,), _build_sign))
_define(
    select,
    (
        _FLOAT,
        (_BOOLEAN, _FLOAT, _FLOAT),
        lambda builder, condition, a, b: builder.select(condition, a, b),
    ),
    (
        _LANES,
        (_LANE_BITS, _LANES, _LANES),
        lambda builder, condition, a, b: builder.select(condition, a, b),
    ),
)
_define(
    in_any_lane,
    (_BOOLEAN, (_BOOLEAN,), _build_same),
    (_BOOLEAN, (_LANE_BITS,), _test_bits("!=", 0)),
)
_define(
    in_all_lanes,
    (_BOOLEAN, (_BOOLEAN,), _build_same),
    (_BOOLEAN, (_LANE_BITS,), _test_bits("==", -1)),
)
_define(highest, (_FLOAT, (_FLOAT,), _build_same), (_FLOAT, (_LANES,), _extreme(">")))
_define(lowest, (_FLOAT, (_FLOAT,), _build_same), (_FLOAT, (_LANES,), _extreme("<")))
_define(
    count_lanes,
    (_INTEGER, (_FLOAT,), lambda builder, x: ir.Constant(ir.IntType(64), 1)),  # noqa: ARG005
    (_INTEGER, (_LANES,), lambda builder, x: ir.Constant(ir.IntType(64), LANES)),  # noqa: ARG005
)
_define(
    lane_of,
    (_FLOAT, (_FLOAT, _INTEGER), _build_same),
    (
        _FLOAT,
        (_LANES, _INTEGER),
        lambda builder, x, lane: builder.extract_element(x, builder.trunc(lane, _INT32)),
    ),
)
_define(
    with_lane,
    (_FLOAT, (_FLOAT, _INTEGER, _FLOAT), lambda builder, x, lane, new: new),  # noqa: ARG005
    (
        _LANES,
        (_LANES, _INTEGER, _FLOAT),
        lambda builder, x, lane, new: builder.insert_element(x, new, builder.trunc(lane, _INT32)),
    ),
)


def _call_each_lane(function: Any, of_float: Any) -> None:
    """Lets `function` take lanes, by a call of `of_float` for each."""

    @overload(function)
    def _overload(x):  # type: ignore[no-untyped-def]
        if not isinstance(x, LanesType):
            return None

        def each(x):  # type: ignore[no-untyped-def]
            out = x
            for lane in range(LANES):
                out = with_lane(out, lane, of_float(lane_of(x, lane)))
            return out

        return each


for _function, _of_float in (
    (np.exp, math.exp),
    (np.tanh, math.tanh),
    (np.sin, math.sin),
    (np.cos, math.cos),
):
    _call_each_lane(_function, _of_float)


def _view(typing_context: Any, array: Any) -> Any:  # noqa: ARG001
    """Type and instructions of `view_lanes`; no reference to the array is counted."""
    if array.ndim == 1:

        def load(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            data = context.make_array(sig.args[0])(context, builder, args[0]).data
            return builder.load(builder.bitcast(data, _VECTOR.as_pointer()))

        return _LANES(array), load
    viewed = types.Array(_LANES, array.ndim - 1, "C")

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        old = context.make_array(sig.args[0])(context, builder, args[0])
        new = context.make_array(viewed)(context, builder)
        populate_array(
            new,
            data=builder.bitcast(old.data, _VECTOR.as_pointer()),
            shape=[builder.extract_value(old.shape, axis) for axis in range(viewed.ndim)],
            strides=[builder.extract_value(old.strides, axis) for axis in range(viewed.ndim)],
            itemsize=context.get_constant(types.intp, _ALIGNMENT_BYTES),
            meminfo=None,
            parent=None,
        )
        return new._getvalue()

    return viewed(array), generate


def _view_fields(typing_context: Any, fields: Any) -> Any:
    """Type and instructions of `view_fields`."""
    views = [
        _view(typing_context, kind) if _is_array_of_floats(kind) else None for kind in fields.types
    ]
    kinds = [
        kind if view is None else view[0].return_type
        for kind, view in zip(fields.types, views, strict=True)
    ]
    viewed = types.NamedTuple(kinds, fields.instance_class)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:  # noqa: ARG001
        members = [builder.extract_value(args[0], index) for index in range(len(kinds))]
        members = [
            member if view is None else view[1](context, builder, view[0], (member,))
            for member, view in zip(members, views, strict=True)
        ]
        return context.make_tuple(builder, viewed, members)

    return viewed(fields), generate


def _is_array_of_floats(kind: Any) -> bool:
    return isinstance(kind, types.Array) and kind.dtype == types.float64


# An array (..., 8) of floats as an array (...) of lanes, or one number where it is (8,).
view_lanes = cast(Callable[[Any], Any], intrinsic(_view))
# A named tuple whose arrays of floats have become lanes in this way; everything else stays.
view_fields = cast(Callable[[Any], Any], intrinsic(_view_fields))
