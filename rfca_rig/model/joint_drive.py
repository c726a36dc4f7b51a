"""A joint driven by a torque that is given over time, as a law of the compiled chain.

The law's row of parameters is longer than that of an effect: behind the eight numbers of its use stands the torque's trace, evenly
spaced and read by straight lines. The law keeps its own clock in the joint's memory.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.model.laws import HINGE, LawUse
from rfca_rig.model.setup import PARAMETERS_AT_MOST
from rfca_rig.model.state import Laws

Floats = NDArray[np.float64]

FACTOR, STEP, COUNT, TRACE = 0, 1, 2, PARAMETERS_AT_MOST


@dataclass(frozen=True)
class TorqueTrace:
    """Torques (m, n) of all joints, every `step_s` from t = 0 on; straight lines between, held beyond the last."""

    step_s: float
    torque_Nm: Floats


def torque_trace(t_s: Floats, torque_Nm: Floats) -> TorqueTrace:
    """The trace of torques (m, n) recorded at ascending times (m,), from t = 0 on, at the recording's own spacing.

    Raises BadInput where times and torques do not fit each other.
    """
    if t_s.shape != torque_Nm.shape[:1] or len(t_s) < 2 or (np.diff(t_s) <= 0.0).any():
        raise BadInput(f"torques of shape {torque_Nm.shape} at {len(t_s)} times: give one row per time, two or more, ascending")
    step_s = float(np.median(np.diff(t_s)))
    even = np.arange(int(np.ceil(max(t_s[-1], step_s) / step_s)) + 1) * step_s
    return TorqueTrace(step_s, np.column_stack([np.interp(even, t_s, torque) for torque in torque_Nm.T]))


def torque(  # a law takes what its place offers, needed or not
    phi: float,  # noqa: ARG001
    rate: float,  # noqa: ARG001
    elapsed: float,
    k0: float,  # noqa: ARG001
    k2: float,  # noqa: ARG001
    memory: Any,
    parameter: Any,
) -> tuple[float, float, float]:
    x = min((memory[0] + elapsed) / parameter[STEP], parameter[COUNT] - 1.0)
    i = min(int(x), int(parameter[COUNT]) - 2)
    before, after = parameter[TRACE + i], parameter[TRACE + i + 1]
    return -parameter[FACTOR] * (before + (x - i) * (after - before)), 0.0, 0.0


def advance(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> None:  # noqa: ARG001
    memory[0] += elapsed


def drive_of(joint: int) -> LawUse:
    """The drive of hinge `joint`, from 1."""
    return LawUse(HINGE, torque, (1.0,), advance, joint)


def is_drive(use: LawUse) -> bool:
    return use.law is torque


def with_traces(laws: Laws, uses: Sequence[LawUse], trace: TorqueTrace) -> Laws:
    """`laws`, which are those of `uses`, with the trace of its joint behind the parameters of each drive."""
    count, width = len(trace.torque_Nm), laws.parameter.shape[1]
    parameter = np.zeros((len(uses), max(TRACE + count, width)))
    parameter[:, :width] = laws.parameter
    for row, use in zip(parameter, uses, strict=True):
        if is_drive(use):
            row[STEP], row[COUNT] = trace.step_s, count
            row[TRACE : TRACE + count] = trace.torque_Nm[:, use.only - 1]
    return laws._replace(parameter=parameter)
