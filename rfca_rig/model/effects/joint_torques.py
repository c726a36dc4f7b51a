"""A joint driven by a recorded torque, as a law of the compiled chain.

The torque stands behind the eight parameters of a law: the trace is evenly spaced and interpolated
linearly. Of the eight, the last three belong to the trace; the law keeps the time in the last place
of the joint's memory.

Effects act on these torques: a wrong scale, a delay, a lag, and friction that grows with the load.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numba
import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.effects.joints import DAMPING_S, PRESLIDING_RAD
from rfca_rig.model.effects.sensor_timing import filter_first_order
from rfca_rig.model.kernel.laws import HINGE, LawUse
from rfca_rig.model.kernel.state import Laws
from rfca_rig.model.setup import MAX_PARAMETERS, Setup

Floats = NDArray[np.float64]


# Indices in the parameters of a drive, of every law that reads the torque, and in the memory.
STEP = 5
COUNT = 6
BEGIN = 7
TRACE = MAX_PARAMETERS
CLOCK = 3


@dataclass(frozen=True)
class TorqueTrace:
    """Torques (m, n) of all joints, every `step_s` from `begin_s` on, interpolated linearly,
    constant before the first and after the last.

    With `powered` False the motors were off: the torque's sensor then reads no offset either.
    """

    step_s: float
    torque_Nm: Floats
    begin_s: float = 0.0
    powered: bool = True


def torque_trace(t_s: Floats, torque_Nm: Floats) -> TorqueTrace:
    """Resamples torques (m, n), recorded at ascending times (m,), evenly at the median spacing of
    the recording.

    Raises BadInput where times and torques do not fit each other.
    """
    if t_s.shape != torque_Nm.shape[:1] or len(t_s) < 2 or (np.diff(t_s) <= 0.0).any():
        raise BadInput(
            f"torques of shape {torque_Nm.shape} at {len(t_s)} times: give one row per "
            "time, two or more, ascending"
        )
    step_s = float(np.median(np.diff(t_s)))
    span_s = float(t_s[-1] - t_s[0])
    # The last point is at or behind the last time; the small number keeps rounding from adding
    # another one.
    even = t_s[0] + np.arange(int(np.ceil(max(span_s, step_s) / step_s - 1e-9)) + 1) * step_s
    return TorqueTrace(
        step_s,
        np.column_stack([np.interp(even, t_s, torque) for torque in torque_Nm.T]),
        float(t_s[0]),
    )


@cast(Callable[[Callable[..., float]], Callable[..., float]], numba.njit(error_model="numpy"))
def torque_at(t_s: float, parameter: Any) -> float:
    """Recorded torque [N m] of the law's joint at a time [s], for laws that read it."""
    x = min(max((t_s - parameter[BEGIN]) / parameter[STEP], 0.0), parameter[COUNT] - 1.0)
    i = min(int(x), int(parameter[COUNT]) - 2)
    before = parameter[TRACE + i]
    after = parameter[TRACE + i + 1]
    return float(before + (x - i) * (after - before))


def joint_drive_torque(  # a law takes what its place offers, needed or not
    phi: float,
    rate: float,
    elapsed: float,
    k0: float,
    k2: float,
    memory: Any,
    parameter: Any,
) -> tuple[float, float, float]:
    # A law's torque resists the joint, so the drive's has the other sign.
    return -torque_at(memory[CLOCK] + elapsed, parameter), 0.0, 0.0


def joint_drive_advance(
    phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any
) -> None:
    memory[CLOCK] += elapsed


def drive_of(joint: int, delay_s: float = 0.0) -> LawUse:
    """The drive of hinge `joint`, from 1; the recorded torque acts `delay_s` later than
    recorded.
    """
    return LawUse(
        HINGE,
        joint_drive_torque,
        (1.0, delay_s, 0.0),
        joint_drive_advance,
        joint,
        reads_torque=True,
    )


def is_drive(use: LawUse) -> bool:
    return use.law is joint_drive_torque


def with_drives(
    setup: Setup, effect_id: str, change: Callable[[tuple[float, ...]], tuple[float, ...]]
) -> Setup:
    """The setup with changed parameters (factor, delay_s, lag_s) of its drives.

    Raises BadInput for a rig without torque-driven joints, on which the effect would do nothing.
    """
    if not any(is_drive(use) for use in setup.laws):
        raise BadInput(
            f"effect {effect_id}: no joint of this rig is driven by a recorded torque; leave it out"
        )
    return replace(
        setup,
        laws=tuple(
            replace(use, parameters=change(use.parameters)) if is_drive(use) else use
            for use in setup.laws
        ),
    )


def with_traces(laws: Laws, uses: Sequence[LawUse], trace: TorqueTrace) -> Laws:
    """`laws`, made from `uses`, with the torque trace behind the parameters of each law that reads
    it.

    Factor, delay and lag of the joint's drive are applied to the trace.
    """
    count = len(trace.torque_Nm)
    width = laws.parameter.shape[1]
    parameter = np.zeros((len(uses), max(TRACE + count, width)))
    parameter[:, :width] = laws.parameter
    drives = {use.only: use.parameters for use in uses if is_drive(use)}
    t_s = trace.step_s * np.arange(count, dtype=np.float64)
    for row, use in zip(parameter, uses, strict=True):
        if use.reads_torque:
            factor, delay_s, lag_s = drives.get(use.only, (0.0, 0.0, 0.0))
            recorded = trace.torque_Nm[:, use.only - 1]
            row[STEP] = trace.step_s
            row[COUNT] = count
            row[BEGIN] = trace.begin_s + delay_s
            row[TRACE : TRACE + count] = factor * (
                filter_first_order(t_s, recorded, lag_s) if lag_s > 0.0 else recorded
            )
    return laws._replace(parameter=parameter)


# Joint torques in proportion to the recorded ones: a wrong torque constant of the motors, or losses
# in proportion to the torque.


def apply_torque_scale(setup: Setup, values: Values) -> Setup:
    """Raises BadInput for a rig without torque-driven joints, on which it would do nothing."""
    return with_drives(
        setup, "torque_scale", lambda drive: (drive[0] * values["factor"], *drive[1:])
    )


TORQUE_SCALE = Effect(
    id="torque_scale",
    where="pendulum-like rigs",
    left_out="scale of the recorded joint torques wrong",
    law="tau = factor tau_recorded",
    source="torque constant of the motors",
    parameters=(Parameter("factor", 0.3, 3.0),),
    apply=apply_torque_scale,
)


# Recorded joint torques whose time stamps are off against those of the angles.


def apply_torque_delay(setup: Setup, values: Values) -> Setup:
    """Raises BadInput for a rig without torque-driven joints, on which it would do nothing."""
    return with_drives(
        setup, "torque_delay", lambda drive: (drive[0], drive[1] + values["delay_s"], *drive[2:])
    )


TORQUE_DELAY = Effect(
    id="torque_delay",
    where="pendulum-like rigs",
    left_out="joint torques act later than recorded (a negative delay: they were recorded late)",
    law="tau(t) = tau_recorded(t - delay)",
    source=(
        "dead time of a drive that is commanded by torque; the other way round, of the "
        "current sensor and its bus"
    ),
    parameters=(Parameter("delay_s", -0.04, 0.04, below=0.1),),
    apply=apply_torque_delay,
)


# Joint torques that follow the recorded ones with a first-order lag, as those of a
# torque-controlled drive.


def apply_torque_lag(setup: Setup, values: Values) -> Setup:
    """Two lags in series count as one with the sum of their time constants. Raises BadInput for
    a rig without torque-driven joints.
    """
    return with_drives(
        setup, "torque_lag", lambda drive: (*drive[:2], drive[2] + values["time_constant_s"])
    )


TORQUE_LAG = Effect(
    id="torque_lag",
    where="pendulum-like rigs",
    left_out="joint torques follow the recorded ones with a lag",
    law="tau_lag tau' = tau_recorded - tau",
    source="first-order current loop of a motor",
    parameters=(Parameter("time_constant_s", 0.002, 0.05, below=0.1),),
    apply=apply_torque_lag,
)


# Dry friction in proportion to the torque that a joint's gear transmits: an efficiency below one,
# with stick.


@cast(
    Callable[
        [Callable[..., tuple[float, float, float]]], Callable[..., tuple[float, float, float]]
    ],
    numba.njit(error_model="numpy"),
)
def carry_load(
    phi: float, elapsed: float, memory: Any, parameter: Any
) -> tuple[float, float, float]:
    """Friction limit [N m], torque of the stuck joint without its damping, and the slope of that
    torque by phi.

    The stiffness of a stuck joint is its limit over the presliding. Where the limit falls, the
    torque falls with it. Where it grows, the present torque stays and only further yielding is
    stiffer, as in `contact.carry_stretch`: a torque that grew with the limit would give back more
    energy than it took. memory = (anchor, limit and angle at the beginning of the step).
    """
    limit = parameter[0] * abs(torque_at(memory[CLOCK] + elapsed, parameter))
    yielded = phi - memory[0]
    begun = memory[2] - memory[0]
    if limit < memory[1]:
        return limit, limit * yielded / parameter[1], limit / parameter[1]
    mean = 0.5 * (limit + memory[1])
    return limit, (memory[1] * begun + mean * (yielded - begun)) / parameter[1], mean / parameter[1]


def joint_load_friction_torque(
    phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any
) -> tuple[float, float, float]:
    # parameter = (loss, presliding, damping time, and the recorded torque); dry friction whose
    # limit follows the torque.
    most, carried, slope = carry_load(phi, elapsed, memory, parameter)
    damping = most / parameter[1] * parameter[2]
    stuck = carried + damping * rate
    if stuck > most:
        return most, 0.0, 0.0
    if stuck < -most:
        return -most, 0.0, 0.0
    return stuck, slope, damping


def joint_load_friction_advance(
    phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any
) -> None:
    most, carried, _ = carry_load(phi, elapsed, memory, parameter)
    # The anchor is put where the spring of the present limit gives the torque that is carried.
    if most > 0.0:
        share = min(max(carried / most, -1.0), 1.0)
    else:
        share = 0.0
    memory[0] = phi - share * parameter[1]
    memory[1] = most
    memory[2] = phi
    memory[CLOCK] += elapsed


def apply_joint_load_friction(setup: Setup, values: Values) -> Setup:
    """Raises BadInput for a rig without torque-driven joints, on which it would do nothing."""
    joints = [use.only for use in setup.laws if is_drive(use)]
    if not joints:
        raise BadInput(
            "effect joint_load_friction: no joint of this rig is driven by a recorded "
            "torque; leave it out"
        )
    parameters = (values["loss_relative"], PRESLIDING_RAD, DAMPING_S)
    laws = tuple(
        LawUse(
            HINGE,
            joint_load_friction_torque,
            parameters,
            joint_load_friction_advance,
            joint,
            reads_torque=True,
        )
        for joint in joints
    )
    return replace(setup, laws=(*setup.laws, *laws))


JOINT_LOAD_FRICTION = Effect(
    id="joint_load_friction",
    where="pendulum-like rigs",
    left_out="friction of the gears that grows with the torque they transmit",
    law=(
        "T = loss |tau| sgn(phi'), stuck below it; the efficiency is 1 - loss where the "
        "motor drives the joint"
    ),
    source=(
        "Hamon, Gautier and Garrec, IROS 2010, dry friction that depends on load; tau is the "
        "torque of the drive"
    ),
    parameters=(Parameter("loss_relative", 0.01, 0.6, below=1.0),),
    apply=apply_joint_load_friction,
)


EFFECTS = (
    TORQUE_SCALE,
    TORQUE_DELAY,
    TORQUE_LAG,
    JOINT_LOAD_FRICTION,
)
