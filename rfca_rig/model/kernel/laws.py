"""Laws of effects inside the compiled chain: plain functions, compiled on their own and called by
address.

The chain is compiled once, for any set of effects, and a lab's own law needs no change in it. A law
is a plain Python function that numba can compile, with one of these signatures; `memory` (4,) and
`parameter` (8,) may only be indexed:

    HINGE   torque(phi, rate, elapsed, k0, k2, memory, parameter) -> (T, dT/dphi, dT/drate)
            T [N m] resists phi beside the nominal spring k0 phi (1 + k2 phi^2); `elapsed` [s] since
            the step began
    ROTOR   torque(phi, rate, acceleration, elapsed, k0, k2, memory, parameter)
            -> (T, dT/dphi, dT/drate, dT/dacceleration)
            the same, for a law that also needs the acceleration d2phi/dt2 [rad/s2]
    LINK    force(v, length, memory, parameter) -> (F, dF/dv)
            F [N] at the middle of a link, across it, in the direction of growing angle, for the
            speed v [m/s] there
    SLIP    factor(v, memory, parameter) -> (f, df/dv)
            f multiplies the friction coefficient at the sliding speed v [m/s]
    LOAD    factor(N, memory, parameter) -> (f, df/dN)
            f multiplies the friction coefficient at the normal force N [N]
    NORMAL  force(depth, rate, memory, parameter) -> (N, dN/d depth, dN/d rate)
            N [N] is added to the normal force of an end that is `depth` [m] in the ground and sinks
            at `rate` [m/s]

A law that needs more than 8 numbers takes them from its `table`, which begins at parameter[8].

A HINGE or ROTOR law with memory has a second function, called once after each accepted step, which
may change `memory`:

    advance(phi, rate, elapsed, k0, k2, memory, parameter)
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any, cast

import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.ccallback import CFunc
from numba.extending import intrinsic

from rfca_rig.compile_cache import CodeCache
from rfca_rig.model.kernel.compiled import CACHE_FOLDER
from rfca_rig.model.kernel.lanes import LANES, LanesType
from rfca_rig.model.kernel.state import Floats

HINGE, LINK, SLIP, NORMAL, ROTOR, LOAD = range(6)
# of a law at most, and numbers of its memory
ARGUMENTS = 6
RESULTS = 4
MEMORY = 4
TABLE = 8  # index at which the table of a law begins in its row of parameters

Law = Callable[..., Any]

_NUMBERS = types.CPointer(types.float64)  # type: ignore[no-untyped-call]
_SIGNATURE = types.void(_NUMBERS, _NUMBERS, _NUMBERS, _NUMBERS)
# Compiled code must outlive every call of its address, and nothing else refers to it.
_COMPILED_CODE: list[Any] = []


@cache
def address_of(law: Law, place: int) -> int:
    """The address of the compiled law, to be called with pointers to inputs, memory, parameters
    and outputs.
    """
    return _compile_call(_CALLS[place], law)


@cache
def address_of_advance(law: Law) -> int:
    """The same for the second function of a hinge law."""
    return _compile_call(_call_advance, law)


def _compile_call(call: Law, law: Law) -> int:
    """Compiles `call` with `law` in the place of its global name `law`.

    The cache distinguishes functions by name and code of `call`, which all laws share. So each law
    has its own folder.
    """
    function = _insert_law(call, law)
    if law.__module__.startswith("rfca_rig.model.") and law.__closure__ is None:
        # As `numba.cfunc` does with its own cache, which loads the compiler's functions first.
        compiled: Any = cast(Any, CFunc)(
            function, (_SIGNATURE.args, _SIGNATURE.return_type), locals={}, options={}
        )
        compiled._cache = CodeCache(function, Path(CACHE_FOLDER) / "laws" / _key_of(law))
        compiled.compile()
    else:
        # A closure, or a lab's own law, may depend on any file or value. Without a cache, no
        # outdated code can run.
        compiled = numba.cfunc(_SIGNATURE)(function)
    _COMPILED_CODE.append(compiled)
    return int(cast(int, compiled.address))


def make_call(law: Law, place: int) -> Law:
    """The function that `address_of` compiles, of pointers to inputs, memory, parameters and
    outputs, for another compiler.
    """
    return _insert_law(_CALLS[place], law)


def make_advance_call(law: Law) -> Law:
    """The same for `address_of_advance`."""
    return _insert_law(_call_advance, law)


def _insert_law(call: Law, law: Law) -> Law:
    # A new function with globals of its own: the module has no name `law`, and each law needs
    # another value for it.
    return FunctionType(
        call.__code__,
        {"__name__": __name__, "law": numba.njit(law, error_model="numpy")},
        call.__name__,
    )


def _key_of(law: Law) -> str:
    return hashlib.sha256(
        f"{_source_of_laws()} {law.__module__} {law.__qualname__}".encode()
    ).hexdigest()[:16]


@cache
def _source_of_laws() -> str:
    """A hash of all files from which the laws of the package are compiled."""
    # A law may call any module of the package, and the compiler notices an edit in the law's own
    # file only.
    content = hashlib.sha256()
    for source in sorted(Path(__file__).parents[1].rglob("*.py")):
        content.update(source.read_bytes())
    return content.hexdigest()


# The functions that the chain calls, one for each signature. `law` is no name of this module:
# `_compile_call` supplies it.
def _call_hinge(x, memory, parameter, out):  # type: ignore[no-untyped-def]
    out[0], out[1], out[2] = law(x[0], x[1], x[2], x[3], x[4], memory, parameter)  # type: ignore[name-defined]  # noqa: F821
    out[3] = 0.0


def _call_rotor(x, memory, parameter, out):  # type: ignore[no-untyped-def]
    out[0], out[1], out[2], out[3] = law(x[0], x[1], x[5], x[2], x[3], x[4], memory, parameter)  # type: ignore[name-defined]  # noqa: F821


def _call_advance(x, memory, parameter, out):  # type: ignore[no-untyped-def]  # noqa: ARG001
    law(x[0], x[1], x[2], x[3], x[4], memory, parameter)  # type: ignore[name-defined]  # noqa: F821


def _call_link(x, memory, parameter, out):  # type: ignore[no-untyped-def]
    out[0], out[1] = law(x[0], x[1], memory, parameter)  # type: ignore[name-defined]  # noqa: F821


def _call_factor(x, memory, parameter, out):  # type: ignore[no-untyped-def]
    out[0], out[1] = law(x[0], memory, parameter)  # type: ignore[name-defined]  # noqa: F821


def _call_normal(x, memory, parameter, out):  # type: ignore[no-untyped-def]
    out[0], out[1], out[2] = law(x[0], x[1], memory, parameter)  # type: ignore[name-defined]  # noqa: F821


_CALLS = {
    HINGE: _call_hinge,
    LINK: _call_link,
    SLIP: _call_factor,
    NORMAL: _call_normal,
    ROTOR: _call_rotor,
    LOAD: _call_factor,
}


@dataclass(frozen=True)
class LawUse:
    """One law as an effect uses it: its place, its parameters (at most 8) and `table`, and the one
    hinge or link it acts on (-1 for all).
    """

    place: int
    law: Law
    parameters: tuple[float, ...]
    advance: Law | None = None
    only: int = -1
    table: tuple[float, ...] = ()


def compile_law(use: LawUse) -> None:
    """Compiles the functions of a law, unless this process has done so before. Raises NumbaError
    where that is impossible.
    """
    address_of(use.law, use.place)
    if use.advance:
        address_of_advance(use.advance)


def _call_law(
    typing_context: Any, address: Any, x: Any, memory: Any, parameter: Any, out: Any
) -> Any:
    """Calls the law with pointers to the data of the arrays; reference counts of the arrays are not
    touched, as that would take time.

    Where `x` (8,) and `out` (8,) are lanes, it calls the law once for each, with `memory` (8, 4)
    and `parameter` (8, p) of that lane.
    """
    del typing_context
    in_lanes = isinstance(x.dtype, LanesType)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = ir.DoubleType().as_pointer()
        # All laws have the C signature void(double*, double*, double*, double*), see
        # `laws._SIGNATURE`.
        function = builder.inttoptr(
            arguments[0], ir.FunctionType(ir.VoidType(), [pointer] * 4).as_pointer()
        )
        arrays = [
            context.make_array(kind)(context, builder, argument)
            for kind, argument in zip(signature.args[1:], arguments[1:], strict=True)
        ]
        x_data, memory_data, parameter_data, out_data = (
            builder.bitcast(array.data, pointer) for array in arrays
        )
        if not in_lanes:
            builder.call(function, [x_data, memory_data, parameter_data, out_data])
            return context.get_dummy_value()
        index = ir.IntType(64)
        one_x, one_out = (
            builder.alloca(ir.DoubleType(), ir.Constant(index, ARGUMENTS)) for _ in range(2)
        )
        with cgutils.for_range(builder, ir.Constant(index, LANES)) as loop:
            for argument in range(ARGUMENTS):
                at = builder.add(ir.Constant(index, LANES * argument), loop.index)
                builder.store(
                    builder.load(builder.gep(x_data, [at])),
                    builder.gep(one_x, [ir.Constant(index, argument)]),
                )
            # Laws without memory get `x` in its place, which has no axis of lanes.
            own_memory = one_x
            if memory.ndim == 2:
                own_memory = builder.gep(
                    memory_data, [builder.mul(loop.index, ir.Constant(index, MEMORY))]
                )
            width = builder.extract_value(arrays[2].shape, 1)
            own_parameter = builder.gep(parameter_data, [builder.mul(loop.index, width)])
            builder.call(function, [one_x, own_memory, own_parameter, one_out])
            for result in range(RESULTS):
                at = builder.add(ir.Constant(index, LANES * result), loop.index)
                builder.store(
                    builder.load(builder.gep(one_out, [ir.Constant(index, result)])),
                    builder.gep(out_data, [at]),
                )
        return context.get_dummy_value()

    return types.void(address, x, memory, parameter, out), generate


call_law = cast(Callable[[int, Floats, Floats, Floats, Floats], None], intrinsic(_call_law))
