"""Compiles the chain ahead of time to an object file that needs no Python.

The compiled functions of the simulation get one block of numbers and one of integers instead of
some sixty arrays. `MemoryLayout` says where in these blocks each array and number lies, for the
compiler here and as constants for the program in C. The object file has these functions, in which
`numbers` and `integers` are the two blocks:

    int64_t leg_settle(double *numbers, int64_t *integers)   1 where the rest pose was found
    int64_t leg_measure(double *numbers, int64_t *integers)  fills the samples from the state
    int64_t leg_move(double *numbers, int64_t *integers)     status of `integrator.take_steps`
    void leg_law_M(double *x, double *memory, double *parameter, double *out)
    void leg_advance_M(double *x, double *memory, double *parameter, double *out)
                                                             of law M, see `kernel.laws`
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array
from numpy.typing import NDArray

from rfca_rig.errors import RigError
from rfca_rig.model.chain import settle
from rfca_rig.model.kernel.compiled import compile_to_llvm, jit_internal
from rfca_rig.model.kernel.forces import measure
from rfca_rig.model.kernel.integrator import take_steps
from rfca_rig.model.kernel.laws import LawUse, make_advance_call, make_call
from rfca_rig.model.kernel.state import Chain, Laws, Samples, Shaft, State, Work

Floats = NDArray[np.float64]

# AVX2 and FMA: Intel since 2013, AMD since 2015. The chain runs with the same instructions in
# Python on such a processor, so that both round alike.
PROCESSOR = "x86-64-v3"

# Platforms of FMI, and what the compiler calls them.
TRIPLES = {
    "x86_64-linux": "x86_64-unknown-linux-gnu",
    "x86_64-windows": "x86_64-pc-windows-gnu",
}

# Functions of the C library that compiled code may call; every C library has them.
C_LIBRARY = """
acos asin atan atan2 cbrt ceil cos cosh exp exp2 expm1 fabs floor fmod frexp hypot ldexp log log10
log1p log2 memcpy memmove memset nearbyint pow rint sin sinh sqrt tan tanh trunc
"""

_NUMBERS = types.CPointer(types.float64)  # type: ignore[no-untyped-call]
_INTEGERS = types.CPointer(types.int64)  # type: ignore[no-untyped-call]

# What the names of the functions of laws begin with, before the law's number.
LAW = "leg_law_"
ADVANCE = "leg_advance_"

# The last change of Newton's iteration for the rest pose [rad], as in `chain.find_rest_state`.
SETTLED_RAD = 1e-12


class Stepping(NamedTuple):
    """What an integration takes and returns beside the chain: `span` (2,) is its begin and end [s],
    `next_step` (1,) the step to begin with, and afterwards to continue with [s].
    """

    span: Floats
    next_step: Floats
    longest_step: float
    most_steps: float
    tolerance: Floats


class LegMemory(NamedTuple):
    """Everything that the compiled functions work on, for one leg."""

    chain: Chain
    laws: Laws
    shaft: Shaft
    state: State
    work: Work
    samples: Samples
    stepping: Stepping


@dataclass(frozen=True)
class Slot:
    """Place of an array or a number in its block: index of its first element, and its shape, ()
    for a number.
    """

    offset: int
    shape: tuple[int, ...]
    is_integer: bool

    @property
    def size(self) -> int:
        """Number of elements."""
        return int(np.prod(self.shape, dtype=int))


@dataclass(frozen=True)
class MemoryLayout:
    """Where each field of a `LegMemory` lies.

    `slots` is by names of part and field, for example ("chain", "mu"). `numbers` and `integers` are
    the two blocks with the values of the leg.
    """

    memory: LegMemory
    slots: dict[tuple[str, str], Slot]
    numbers: Floats
    integers: NDArray[np.int64]

    def slot(self, part: str, field: str) -> Slot:
        return self.slots[part, field]


def lay_out(memory: LegMemory) -> MemoryLayout:
    """Places all fields one behind the other, in their order."""
    slots = {}
    numbers: list[Any] = []
    integers: list[Any] = []
    for part, fields in memory._asdict().items():
        for field, value in fields._asdict().items():
            array = np.asarray(value)
            is_integer = array.dtype == np.int64
            block = integers if is_integer else numbers
            slots[part, field] = Slot(len(block), array.shape, is_integer)
            block.extend(array.ravel().tolist())
    return MemoryLayout(
        memory, slots, np.array(numbers, dtype=np.float64), np.array(integers, dtype=np.int64)
    )


def compile_leg(
    layout: MemoryLayout, laws: Sequence[LawUse], platforms: Sequence[str]
) -> list[bytes]:
    """The object files for some of `TRIPLES`; `laws` are those of the layout, in their order.

    Raises RigError where the code needs more than the C library.
    """
    entries = {
        name: compile_to_llvm(function, (_NUMBERS, _INTEGERS))
        for name, function in _make_functions(layout).items()
    }
    module = _link(entries | _compile_laws(laws))
    _check_externals(module)
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    return [_emit_object(module.clone(), TRIPLES[platform]) for platform in platforms]


def _compile_laws(laws: Sequence[LawUse]) -> dict[str, tuple[str, bytes]]:
    """Name and LLVM bitcode of the functions of laws, by the names that C has for them."""
    pointers = (_NUMBERS,) * 4
    entries = {}
    for number, use in enumerate(laws):
        call = make_call(use.law, use.place)
        entries[f"{LAW}{number}"] = compile_to_llvm(call, pointers, is_law=True)
        if use.advance:
            call = make_advance_call(use.advance)
            entries[f"{ADVANCE}{number}"] = compile_to_llvm(call, pointers, is_law=True)
    return entries


def _make_functions(layout: MemoryLayout) -> dict[str, Callable[..., int]]:
    """The entry points of the simulation."""
    view = _make_view(layout)
    settle_inside = jit_internal(cast(Any, settle).py_func)

    def leg_settle(numbers: Any, integers: Any) -> int:
        chain, laws, shaft, state, work, _, _ = view(numbers, integers)
        return int(settle_inside(chain, laws, shaft, state, SETTLED_RAD, work))

    def leg_measure(numbers: Any, integers: Any) -> int:
        chain, laws, _, state, work, samples, _ = view(numbers, integers)
        measure(chain, laws, state, 0.0, state.q, state.w, state.a, work, work.force)
        for i in range(state.q.size):
            samples.q[0, i] = state.q[i]
            samples.w[0, i] = state.w[i]
        for i in range(state.anchor.size):
            samples.contact[0, 0, i] = work.contact[0, i]
            samples.contact[0, 1, i] = work.contact[1, i]
        for i in range(3):
            samples.force[0, i] = work.force[i]
        return 1

    def leg_move(numbers: Any, integers: Any) -> int:
        chain, laws, shaft, state, work, samples, stepping = view(numbers, integers)
        status, next_step, _, _ = take_steps(
            chain,
            laws,
            shaft,
            state,
            stepping.span[0],
            stepping.span[1],
            stepping.next_step[0],
            stepping.longest_step,
            int(stepping.most_steps),
            stepping.tolerance,
            work,
            samples,
        )
        stepping.next_step[0] = next_step
        return status

    return {"leg_settle": leg_settle, "leg_measure": leg_measure, "leg_move": leg_move}


def _make_view(layout: MemoryLayout) -> Any:
    """A function for compiled callers: from pointers to both blocks, a tuple of the parts whose
    arrays are views of them.
    """
    part_types = []
    for fields in layout.memory:
        field_types = [_type_of(value) for value in fields]
        part_types.append(cast(Any, types.NamedTuple)(field_types, type(fields)))
    result = types.Tuple(part_types)  # type: ignore[no-untyped-call]

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        del signature
        numbers, integers = arguments
        parts = []
        for part, part_type in zip(layout.memory._fields, part_types, strict=True):
            values = []
            for name, field_type in zip(part_type.fields, part_type.types, strict=True):
                slot = layout.slot(part, name)
                block = integers if slot.is_integer else numbers
                pointer = builder.gep(block, [_index(slot.offset)])
                if slot.shape:
                    value = _view_array(context, builder, field_type, pointer, slot.shape)
                else:
                    value = builder.load(pointer)
                # A truth value lies among the numbers, 0 for false.
                if field_type is types.boolean:
                    value = builder.fcmp_ordered("!=", value, ir.Constant(ir.DoubleType(), 0.0))
                values.append(value)
            parts.append(context.make_tuple(builder, part_type, values))
        return context.make_tuple(builder, result, parts)

    def view(typing_context: Any, numbers: Any, integers: Any) -> Any:
        del typing_context
        return result(numbers, integers), generate

    return cast(Any, intrinsic)(view)


def _type_of(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        element = types.int64 if value.dtype == np.int64 else types.float64
        return types.Array(element, value.ndim, "C")
    return types.boolean if isinstance(value, bool) else types.float64


def _index(value: int) -> Any:
    return ir.Constant(ir.IntType(64), value)


def _view_array(
    context: Any, builder: Any, array_type: Any, pointer: Any, shape: tuple[int, ...]
) -> Any:
    array = context.make_array(array_type)(context, builder)
    strides = [8 * int(np.prod(shape[axis + 1 :], dtype=int)) for axis in range(len(shape))]
    cast(Any, populate_array)(
        array,
        data=pointer,
        shape=[_index(length) for length in shape],
        strides=[_index(stride) for stride in strides],
        itemsize=_index(8),
        meminfo=None,
    )
    return array._getvalue()


def _link(entries: dict[str, tuple[str, bytes]]) -> Any:
    """One module with all functions, and under each name of `entries` a function that C calls.

    Everything else becomes internal, so that two models in one process cannot take each other's
    functions.
    """
    module = llvm.parse_assembly("")
    # The names of compiled functions contain a number of their compilation: nothing clashes.
    for name, (compiled, code) in entries.items():
        module.link_in(llvm.parse_bitcode(code))
        if name.startswith((LAW, ADVANCE)):
            entry = _write_law_entry(name, compiled)
        else:
            entry = _write_entry(name, compiled)
        module.link_in(llvm.parse_assembly(entry))
    for function in module.functions:
        if function.is_declaration:
            continue
        if function.name in entries:
            function.visibility = llvm.Visibility.hidden
        else:
            function.linkage = llvm.Linkage.internal
    for variable in module.global_variables:
        if not variable.is_declaration:
            variable.linkage = llvm.Linkage.internal
    module.verify()
    return module


def _write_entry(name: str, compiled: str) -> str:
    """LLVM code of a function for C that calls a compiled one with both blocks, and returns its
    result, or -1 for an exception.
    """
    word = ir.IntType(64)
    entry, builder, call = _begin_entry(name, compiled, word, 2)
    result = builder.alloca(word)
    builder.store(word(0), result)
    status = call(result)
    # What the compiler's functions return where they worked.
    worked = builder.icmp_signed("==", status, ir.IntType(32)(0))
    builder.ret(builder.select(worked, builder.load(result), word(-1)))
    return str(entry)


def _write_law_entry(name: str, compiled: str) -> str:
    """The same for a law, which the compiled chain calls; it returns nothing."""
    entry, builder, call = _begin_entry(name, compiled, ir.VoidType(), 4)
    call(builder.alloca(_POINTER))
    builder.ret_void()
    return str(entry)


_POINTER = ir.IntType(8).as_pointer()


def _begin_entry(
    name: str, compiled: str, result: Any, takes: int
) -> tuple[Any, Any, Callable[[Any], Any]]:
    """A module with the function `name` of so many pointers, the builder of its code, and what
    builds the call of `compiled`.

    A compiled function takes two more pointers: to its result, and to that of an exception.
    """
    entry = ir.Module()
    callee_type = ir.FunctionType(ir.IntType(32), [_POINTER] * (2 + takes))
    callee = ir.Function(entry, callee_type, compiled)
    function = ir.Function(entry, ir.FunctionType(result, [_POINTER] * takes), name)
    builder = ir.IRBuilder(function.append_basic_block())

    def call(output: Any) -> Any:
        error = builder.alloca(_POINTER)
        outputs = [builder.bitcast(pointer, _POINTER) for pointer in (output, error)]
        return builder.call(callee, [*outputs, *function.args])

    return entry, builder, call


def _check_externals(module: Any) -> None:
    externals = {
        function.name
        for function in module.functions
        if function.is_declaration and not function.name.startswith("llvm.")
    }
    if missing := externals - {*C_LIBRARY.split()}:
        raise RigError(
            f"the compiled leg needs {', '.join(sorted(missing))}, which only Python has; leave "
            "out the effect whose law calls it"
        )


def _emit_object(module: Any, triple: str) -> bytes:
    machine = llvm.Target.from_triple(triple).create_target_machine(
        cpu=PROCESSOR, opt=3, reloc="pic", codemodel="default"
    )
    module.triple = triple
    module.data_layout = str(machine.target_data)
    return cast(bytes, machine.emit_object(module))
