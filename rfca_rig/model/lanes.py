"""Lanes: a number of the compiled chain that holds the values of eight strokes, which are computed side by side.

The equations are written once. Compiled for floats they compute one stroke, compiled for lanes they compute eight, because the arithmetic
of a lane is that of a float. Three rules make a function fit for both:

- A choice by value is `select(condition, a, b)`, which computes both branches.
- `if` and `while` ask `in_any_lane` or `in_all_lanes`.
- A function without a vector form, as a law of an effect, is called once per lane.

In memory, lanes are the last axis of an array of floats. The number eight fills one register of 512 bits, two of 256 or four of 128; the
compiler divides it as the processor needs.
"""

import math
import operator
from collections.abc import Callable
from typing import Any, cast

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typeconv import Conversion
from numba.core.typing import signature
from numba.core.typing.templates import ConcreteTemplate, infer_global
from numba.np.arrayobj import populate_array
from numba.extending import intrinsic, lower_builtin, lower_cast, models, overload, register_model
from numpy.typing import NDArray

LANES = 8

_DOUBLE, _BIT, _INT32 = ir.DoubleType(), ir.IntType(1), ir.IntType(32)
_VECTOR, _BITS = ir.VectorType(_DOUBLE, LANES), ir.VectorType(_BIT, LANES)
_ALIGNMENT_BYTES = 8 * LANES


class LanesType(types.Type):
    """Eight floats. A float becomes one wherever lanes are expected."""

    def __init__(self) -> None:
        super().__init__(name=f"lanes{LANES}")

    def can_convert_from(self, typing_context: Any, other: Any) -> Any:
        del typing_context
        return Conversion.safe if isinstance(other, (types.Float, types.Integer)) else None

    def unify(self, typing_context: Any, other: Any) -> Any:
        del typing_context
        return self if isinstance(other, (types.Float, types.Integer)) else None


class LaneBitsType(types.Type):
    """Eight truth values: a comparison of lanes."""

    def __init__(self) -> None:
        super().__init__(name=f"lane_bits{LANES}")

    def can_convert_from(self, typing_context: Any, other: Any) -> Any:
        del typing_context
        return Conversion.safe if isinstance(other, types.Boolean) else None

    def unify(self, typing_context: Any, other: Any) -> Any:
        del typing_context
        return self if isinstance(other, types.Boolean) else None


lanes, bits = LanesType(), LaneBitsType()


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, numba_type: Any) -> None:
        super().__init__(manager, numba_type, _VECTOR)


@register_model(LaneBitsType)
class _BitsModel(models.PrimitiveModel):
    def __init__(self, manager: Any, numba_type: Any) -> None:
        super().__init__(manager, numba_type, _BITS)


def _splat(builder: Any, value: Any, vector: Any) -> Any:
    one = builder.insert_element(ir.Constant(vector, ir.Undefined), value, _INT32(0))
    return builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), ir.Constant(ir.VectorType(_INT32, LANES), [0] * LANES))


@lower_cast(types.Float, LanesType)
@lower_cast(types.Integer, LanesType)
def _cast_to_lanes(context: Any, builder: Any, from_type: Any, to_type: Any, value: Any) -> Any:
    del to_type
    return _splat(builder, context.cast(builder, value, from_type, types.float64), _VECTOR)


@lower_cast(types.Boolean, LaneBitsType)
def _cast_to_bits(context: Any, builder: Any, from_type: Any, to_type: Any, value: Any) -> Any:
    del to_type
    return _splat(builder, builder.icmp_signed("!=", value, context.get_constant(from_type, False)), _BITS)


def _define(function: Any, result: Any, arguments: tuple[Any, ...], build: Callable[..., Any]) -> None:
    """Types `function` for lanes and lets `build` generate its instruction."""

    class _Template(ConcreteTemplate):
        cases = [signature(result, *arguments)]  # noqa: RUF012  (numba reads it from the class)

    infer_global(function)(_Template)

    @lower_builtin(function, *arguments)
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        del context, sig
        return build(builder, *args)


# A product and the sum it goes into may become one instruction, with one rounding.
_FUSED = ("contract",)
for _functions, _build in (
    ((operator.add, operator.iadd), lambda builder, a, b: builder.fadd(a, b, flags=_FUSED)),
    ((operator.sub, operator.isub), lambda builder, a, b: builder.fsub(a, b, flags=_FUSED)),
    ((operator.mul, operator.imul), lambda builder, a, b: builder.fmul(a, b, flags=_FUSED)),
    ((operator.truediv, operator.itruediv), lambda builder, a, b: builder.fdiv(a, b)),
):
    for _function in _functions:
        _define(_function, lanes, (lanes, lanes), _build)
_define(operator.neg, lanes, (lanes,), lambda builder, a: builder.fneg(a))
_define(operator.and_, bits, (bits, bits), lambda builder, a, b: builder.and_(a, b))
_define(operator.or_, bits, (bits, bits), lambda builder, a, b: builder.or_(a, b))
_define(operator.invert, bits, (bits,), lambda builder, a: builder.not_(a))
for _function, _symbol in (
    (operator.lt, "<"),
    (operator.le, "<="),
    (operator.gt, ">"),
    (operator.ge, ">="),
    (operator.eq, "=="),
):
    _define(_function, bits, (lanes, lanes), lambda builder, a, b, symbol=_symbol: builder.fcmp_ordered(symbol, a, b))
_define(operator.ne, bits, (lanes, lanes), lambda builder, a, b: builder.fcmp_unordered("!=", a, b))


def _intrinsic_of(name: str) -> Callable[..., Any]:
    def build(builder: Any, *args: Any) -> Any:
        kind = ir.FunctionType(_VECTOR, [_VECTOR] * len(args))
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{LANES}f64"), args)

    return build


def _choose(symbol: str) -> Callable[..., Any]:
    # As Python's: the first argument where the comparison fails, so where one is NaN.
    return lambda builder, a, b: builder.select(builder.fcmp_ordered(symbol, b, a), b, a)


_define(abs, lanes, (lanes,), _intrinsic_of("fabs"))
_define(np.sqrt, lanes, (lanes,), _intrinsic_of("sqrt"))
_define(np.floor, lanes, (lanes,), _intrinsic_of("floor"))
_define(max, lanes, (lanes, lanes), _choose(">"))
_define(min, lanes, (lanes, lanes), _choose("<"))


def select(condition: Any, a: Any, b: Any) -> Any:
    """`a` where the condition holds, else `b`; both are computed."""
    return a if condition else b


@intrinsic
def _select_lanes(typing_context: Any, condition: Any, a: Any, b: Any) -> Any:
    del typing_context, condition, a, b
    return lanes(bits, lanes, lanes), lambda context, builder, sig, args: builder.select(*args)  # noqa: ARG005


@overload(select)
def _overload_select(condition, a, b):  # type: ignore[no-untyped-def]
    if isinstance(condition, LaneBitsType):
        return lambda condition, a, b: _select_lanes(condition, a, b)
    return lambda condition, a, b: a if condition else b


def in_any_lane(condition: Any) -> bool:
    """Whether the condition holds in any lane."""
    return cast(bool, condition)


def in_all_lanes(condition: Any) -> bool:
    """Whether the condition holds in every lane."""
    return cast(bool, condition)


def _reduce_bits(all_of_them: bool) -> Any:
    def reduce(typing_context: Any, condition: Any) -> Any:
        del typing_context, condition

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            del sig
            packed = builder.bitcast(args[0], ir.IntType(LANES))
            symbol, value = ("==", -1) if all_of_them else ("!=", 0)
            return context.cast(builder, builder.icmp_unsigned(symbol, packed, ir.Constant(packed.type, value)), types.boolean, types.boolean)

        return types.boolean(bits), generate

    return intrinsic(reduce)


_any_bit, _every_bit = _reduce_bits(False), _reduce_bits(True)


@overload(in_any_lane)
def _overload_any(condition):  # type: ignore[no-untyped-def]
    if isinstance(condition, LaneBitsType):
        return lambda condition: _any_bit(condition)
    return lambda condition: condition


@overload(in_all_lanes)
def _overload_all(condition):  # type: ignore[no-untyped-def]
    if isinstance(condition, LaneBitsType):
        return lambda condition: _every_bit(condition)
    return lambda condition: condition


def lane_of(value: Any, lane: int) -> float:
    """The float in one lane."""
    del lane
    return cast(float, value)


def with_lane(value: Any, lane: int, new: float) -> Any:
    """`value` with another float in one lane."""
    del value, lane
    return new


@intrinsic
def _extract(typing_context: Any, value: Any, lane: Any) -> Any:
    del typing_context

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        del context, sig
        return builder.extract_element(args[0], builder.trunc(args[1], _INT32))

    return types.float64(value, types.int64), generate


@intrinsic
def _insert(typing_context: Any, value: Any, lane: Any, new: Any) -> Any:
    del typing_context, value, lane, new

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        del context, sig
        return builder.insert_element(args[0], args[2], builder.trunc(args[1], _INT32))

    return lanes(lanes, types.int64, types.float64), generate


@overload(lane_of)
def _overload_lane_of(value, lane):  # type: ignore[no-untyped-def]
    if isinstance(value, LanesType):
        return lambda value, lane: _extract(value, lane)
    return lambda value, lane: value


@overload(with_lane)
def _overload_with_lane(value, lane, new):  # type: ignore[no-untyped-def]
    if isinstance(value, LanesType):
        return lambda value, lane, new: _insert(value, lane, new)
    return lambda value, lane, new: new


def _overload_each_lane(function: Any, of_float: Any) -> None:
    """Lets `function` take lanes by a call for each of them."""

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


for _function, _of_float in ((np.exp, math.exp), (np.tanh, math.tanh), (np.sin, math.sin), (np.cos, math.cos)):
    _overload_each_lane(_function, _of_float)


def sign(x: Any) -> Any:
    """-1, 0 or 1."""
    return np.sign(x)


@overload(sign)
def _overload_sign(x):  # type: ignore[no-untyped-def]
    if isinstance(x, LanesType):
        return lambda x: select(x > 0.0, 1.0, select(x < 0.0, -1.0, 0.0))
    return lambda x: np.sign(x)


def highest(x: Any) -> float:
    """The largest of all lanes."""
    return cast(float, x)


def lowest(x: Any) -> float:
    """The smallest of all lanes."""
    return cast(float, x)


@overload(highest)
def _overload_highest(x):  # type: ignore[no-untyped-def]
    if not isinstance(x, LanesType):
        return lambda x: x

    def reduce(x):  # type: ignore[no-untyped-def]
        found = lane_of(x, 0)
        for lane in range(1, LANES):
            found = max(found, lane_of(x, lane))
        return found

    return reduce


@overload(lowest)
def _overload_lowest(x):  # type: ignore[no-untyped-def]
    if not isinstance(x, LanesType):
        return lambda x: x

    def reduce(x):  # type: ignore[no-untyped-def]
        found = lane_of(x, 0)
        for lane in range(1, LANES):
            found = min(found, lane_of(x, lane))
        return found

    return reduce


def count_lanes(x: Any) -> int:
    """1 for a float."""
    del x
    return 1


@overload(count_lanes)
def _overload_count(x):  # type: ignore[no-untyped-def]
    if isinstance(x, LanesType):
        return lambda x: LANES
    return lambda x: 1


def _view(typing_context: Any, array: Any) -> Any:
    """The array (..., 8) of floats as an array (...) of lanes, or as one number where it is (8,). No reference is counted."""
    del typing_context
    if array.ndim == 1:

        def load(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            data = context.make_array(sig.args[0])(context, builder, args[0]).data
            return builder.load(builder.bitcast(data, _VECTOR.as_pointer()))

        return lanes(array), load
    viewed = types.Array(lanes, array.ndim - 1, "C")

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        old = context.make_array(sig.args[0])(context, builder, args[0])
        new = context.make_array(viewed)(context, builder)
        axes = range(array.ndim - 1)
        populate_array(
            new,
            data=builder.bitcast(old.data, _VECTOR.as_pointer()),
            shape=[builder.extract_value(old.shape, axis) for axis in axes],
            strides=[builder.extract_value(old.strides, axis) for axis in axes],
            itemsize=context.get_constant(types.intp, _ALIGNMENT_BYTES),
            meminfo=None,
            parent=None,
        )
        return new._getvalue()

    return viewed(array), generate


view_lanes = intrinsic(_view)


@intrinsic
def view_fields(typing_context: Any, fields: Any) -> Any:
    """A named tuple whose arrays of floats (..., 8) have become arrays of lanes, or lanes where they are (8,); the rest stays."""
    kinds = [_view(typing_context, kind)[0].return_type if _is_array_of_floats(kind) else kind for kind in fields.types]
    viewed = types.NamedTuple(kinds, fields.instance_class)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        del sig
        members = []
        for index, kind in enumerate(fields.types):
            member = builder.extract_value(args[0], index)
            if _is_array_of_floats(kind):
                sig_of_view, build = _view(typing_context, kind)
                member = build(context, builder, sig_of_view, (member,))
            members.append(member)
        return context.make_tuple(builder, viewed, members)

    return viewed(fields), generate


def _is_array_of_floats(kind: Any) -> bool:
    return isinstance(kind, types.Array) and kind.dtype == types.float64


def aligned_zeros(*shape: int) -> NDArray[np.float64]:
    """Zeros of a shape (..., 8), at an address that vector instructions need."""
    size = math.prod(shape)
    raw = np.zeros(size + LANES)
    skipped = (-raw.ctypes.data % _ALIGNMENT_BYTES) // 8
    return raw[skipped : skipped + size].reshape(shape)
