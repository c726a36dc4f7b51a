"""Laws of effects inside the compiled chain: plain functions, compiled on their own and called by address.

So the chain is compiled once, whatever effects are switched on, and a lab's own law needs no change in it. A law is a plain
Python function that numba can compile, with one of these signatures; `memory` (4) and `parameter` (8) are indexed, nothing more:

    HINGE   torque(phi, rate, elapsed, k0, k2, memory, parameter) -> (T, dT/dphi, dT/drate)
            T [N m] resists phi beside the believed spring k0 phi (1 + k2 phi^2); `elapsed` [s] since the step began
    ROTOR   torque(phi, rate, acceleration, elapsed, k0, k2, memory, parameter) -> (T, dT/dphi, dT/drate, dT/dacceleration)
            the same, for a law that is told the acceleration d2phi/dt2 [rad/s2] too
    LINK    force(v, length, memory, parameter) -> (F, dF/dv)
            F [N] at the middle of a link, across it, in the direction of growing angle, for the speed v [m/s] there
    SLIP    factor(v, memory, parameter) -> (f, df/dv)
            f multiplies the friction coefficient at the sliding speed v [m/s]
    LOAD    factor(N, memory, parameter) -> (f, df/dN)
            f multiplies the friction coefficient at the normal force N [N]
    NORMAL  force(depth, rate, memory, parameter) -> (N, dN/d depth, dN/d rate)
            N [N] is added to the normal force of an end that is `depth` [m] in the ground and sinks at `rate` [m/s]

A law that needs more than 8 numbers takes them from its `table`, which stands from parameter[8] on.

A HINGE or ROTOR law with memory brings a second function, called once after each accepted step, which may change `memory`:

    advance(phi, rate, elapsed, k0, k2, memory, parameter)

A HINGE law on one joint of a pendulum may read the torque that was recorded there: with `reads_torque`, `joint_drive.torque_at` gives
it. Such a law has five parameters of its own at most and counts its time in memory[3]; see `effects.joint_load_friction`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, cast

import numba
from numba import types

HINGE, LINK, SLIP, NORMAL, ROTOR, LOAD = range(6)
TABLE = 8  # where the table of a law begins in its row of parameters

Law = Callable[..., Any]

_NUMBERS = types.CPointer(types.float64)  # type: ignore[no-untyped-call]
_SIGNATURE = types.void(_NUMBERS, _NUMBERS, _NUMBERS, _NUMBERS)
_KEPT: list[Any] = []  # compiled code must live as long as anybody may call its address


@cache
def address_of(law: Law, place: int) -> int:
    """The address of the compiled law, to be called with pointers to inputs, memory, parameters and outputs."""
    return _kept(_WRAPPERS[place](numba.njit(law, error_model="numpy")))


@cache
def address_of_advance(law: Law) -> int:
    """The same for the second function of a hinge law."""
    return _kept(_advance(numba.njit(law, error_model="numpy")))


def _kept(wrapper: Law) -> int:
    compiled = numba.cfunc(_SIGNATURE)(wrapper)
    _KEPT.append(compiled)
    return int(cast(int, compiled.address))


def _hinge(law: Law) -> Law:
    def call(x, memory, parameter, out):  # type: ignore[no-untyped-def]
        out[0], out[1], out[2] = law(x[0], x[1], x[2], x[3], x[4], memory, parameter)
        out[3] = 0.0

    return call


def _rotor(law: Law) -> Law:
    def call(x, memory, parameter, out):  # type: ignore[no-untyped-def]
        out[0], out[1], out[2], out[3] = law(x[0], x[1], x[5], x[2], x[3], x[4], memory, parameter)

    return call


def _advance(law: Law) -> Law:
    def call(x, memory, parameter, out):  # type: ignore[no-untyped-def]  # noqa: ARG001
        law(x[0], x[1], x[2], x[3], x[4], memory, parameter)

    return call


def _link(law: Law) -> Law:
    def call(x, memory, parameter, out):  # type: ignore[no-untyped-def]
        out[0], out[1] = law(x[0], x[1], memory, parameter)

    return call


def _slip(law: Law) -> Law:
    def call(x, memory, parameter, out):  # type: ignore[no-untyped-def]
        out[0], out[1] = law(x[0], memory, parameter)

    return call


def _normal(law: Law) -> Law:
    def call(x, memory, parameter, out):  # type: ignore[no-untyped-def]
        out[0], out[1], out[2] = law(x[0], x[1], memory, parameter)

    return call


_WRAPPERS = {HINGE: _hinge, LINK: _link, SLIP: _slip, NORMAL: _normal, ROTOR: _rotor, LOAD: _slip}


@dataclass(frozen=True)
class LawUse:
    """One law as an effect uses it: where, with which parameters (at most 8) and `table`, on which one hinge or link (-1 for all).

    `reads_torque`: whether it reads the torque that drives its joint.
    """

    place: int
    law: Law
    parameters: tuple[float, ...]
    advance: Law | None = None
    only: int = -1
    table: tuple[float, ...] = ()
    reads_torque: bool = False


def compile_law(use: LawUse) -> None:
    """Compiles what has not been compiled yet. Raises NumbaError where that cannot be done."""
    address_of(use.law, use.place)
    if use.advance:
        address_of_advance(use.advance)
