"""A joint driven by a recorded torque, as a law of the compiled chain.

The torque stands behind the eight parameters of a law: the trace is evenly spaced and interpolated linearly. Of the
eight, the last three belong to the trace; the law keeps the time in the last place of the joint's memory.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numba
import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.model.effects.sensor_lag import filter_first_order
from rfca_rig.model.laws import HINGE, LawUse
from rfca_rig.model.setup import MAX_PARAMETERS, Setup
from rfca_rig.model.state import Laws

Floats = NDArray[np.float64]

# Indices in the parameters of a drive, of every law that reads the torque, and in the memory.
STEP, COUNT, BEGIN, TRACE = 5, 6, 7, MAX_PARAMETERS
CLOCK = 3


@dataclass(frozen=True)
class TorqueTrace:
    """Torques (m, n) of all joints, every `step_s` from `begin_s` on, interpolated linearly, constant before the first and after the last.

    With `powered` False the motors were off: the torque's sensor then reads no offset either.
    """

    step_s: float
    torque_Nm: Floats
    begin_s: float = 0.0
    powered: bool = True


def torque_trace(t_s: Floats, torque_Nm: Floats) -> TorqueTrace:
    """Resamples torques (m, n), recorded at ascending times (m,), evenly at the median spacing of the recording.

    Raises BadInput where times and torques do not fit each other.
    """
    if t_s.shape != torque_Nm.shape[:1] or len(t_s) < 2 or (np.diff(t_s) <= 0.0).any():
        raise BadInput(f"torques of shape {torque_Nm.shape} at {len(t_s)} times: give one row per time, two or more, ascending")
    step_s, span_s = float(np.median(np.diff(t_s))), float(t_s[-1] - t_s[0])
    # The last point is at or behind the last time; the small number keeps rounding from adding another one.
    even = t_s[0] + np.arange(int(np.ceil(max(span_s, step_s) / step_s - 1e-9)) + 1) * step_s
    return TorqueTrace(step_s, np.column_stack([np.interp(even, t_s, torque) for torque in torque_Nm.T]), float(t_s[0]))


@cast(Callable[[Callable[..., float]], Callable[..., float]], numba.njit(error_model="numpy"))
def torque_at(t_s: float, parameter: Any) -> float:
    """Recorded torque [N m] of the law's joint at a time [s], for laws that read it."""
    x = min(max((t_s - parameter[BEGIN]) / parameter[STEP], 0.0), parameter[COUNT] - 1.0)
    i = min(int(x), int(parameter[COUNT]) - 2)
    before, after = parameter[TRACE + i], parameter[TRACE + i + 1]
    return float(before + (x - i) * (after - before))


def torque(  # a law takes what its place offers, needed or not
    phi: float,  # noqa: ARG001
    rate: float,  # noqa: ARG001
    elapsed: float,
    k0: float,  # noqa: ARG001
    k2: float,  # noqa: ARG001
    memory: Any,
    parameter: Any,
) -> tuple[float, float, float]:
    # A law's torque resists the joint, so the drive's has the other sign.
    return -torque_at(memory[CLOCK] + elapsed, parameter), 0.0, 0.0


def advance(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> None:  # noqa: ARG001
    memory[CLOCK] += elapsed


def drive_of(joint: int, delay_s: float = 0.0) -> LawUse:
    """The drive of hinge `joint`, from 1; the recorded torque acts `delay_s` later than recorded."""
    return LawUse(HINGE, torque, (1.0, delay_s, 0.0), advance, joint, reads_torque=True)


def is_drive(use: LawUse) -> bool:
    return use.law is torque


def with_drives(setup: Setup, effect_id: str, change: Callable[[tuple[float, ...]], tuple[float, ...]]) -> Setup:
    """The setup with changed parameters (factor, delay_s, lag_s) of its drives.

    Raises BadInput for a rig without torque-driven joints, on which the effect would do nothing.
    """
    if not any(is_drive(use) for use in setup.laws):
        raise BadInput(f"effect {effect_id}: no joint of this rig is driven by a recorded torque; leave it out")
    return replace(setup, laws=tuple(replace(use, parameters=change(use.parameters)) if is_drive(use) else use for use in setup.laws))


def with_traces(laws: Laws, uses: Sequence[LawUse], trace: TorqueTrace) -> Laws:
    """`laws`, made from `uses`, with the torque trace behind the parameters of each law that reads it.

    Factor, delay and lag of the joint's drive are applied to the trace.
    """
    count, width = len(trace.torque_Nm), laws.parameter.shape[1]
    parameter = np.zeros((len(uses), max(TRACE + count, width)))
    parameter[:, :width] = laws.parameter
    drives = {use.only: use.parameters for use in uses if is_drive(use)}
    t_s = trace.step_s * np.arange(count, dtype=np.float64)
    for row, use in zip(parameter, uses, strict=True):
        if use.reads_torque:
            factor, delay_s, lag_s = drives.get(use.only, (0.0, 0.0, 0.0))
            recorded = trace.torque_Nm[:, use.only - 1]
            row[STEP], row[COUNT], row[BEGIN] = trace.step_s, count, trace.begin_s + delay_s
            row[TRACE : TRACE + count] = factor * (filter_first_order(t_s, recorded, lag_s) if lag_s > 0.0 else recorded)
    return laws._replace(parameter=parameter)
