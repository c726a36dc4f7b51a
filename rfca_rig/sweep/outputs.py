"""Outputs of a sweep: each with its unit, its definition and its source.

Over a stroke, t runs from the commanded start, 0, to the end of the shaft's turn. N_k and F_k are
the ground's forces on the end of link k, up and along +y. fy, fz, tx are the sensor's values; tau
is the torque of the shaft, w its speed; phi_i are hinge angles. The leg presses where sum N_k > 0
and more than 30 ms have passed since touchdown. t* is the moment of the greatest load, -fz, while
it presses.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.phases import TOUCHDOWN_LASTS_S, Undetermined, Valley, find_valley
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.catalogue import set_up
from rfca_rig.model.hinge_springs import bending_stiffness_Nm_per_rad, bending_torque_Nm
from rfca_rig.model.kernel.forces import mechanical_energy_J
from rfca_rig.model.kernel.state import Chain
from rfca_rig.model.motion import ShaftMotion, ramp_to_speed
from rfca_rig.model.parameters import GRAVITY_M_S2, RigModel
from rfca_rig.model.static_stages import StaticState
from rfca_rig.model.statics_contact import follow_static_path
from rfca_rig.model.stroke import SimulatedStroke, simulate_stroke
from rfca_rig.sweep.quantities import SweepCase, suggest_name

Floats = NDArray[np.float64]

BEFORE_S = 0.1
# Power and impulse are sums over these; ten times as many change them by less than 1 in 10 000.
SAMPLES_PER_S = 4000
# The valley is evaluated at 1 kHz, as in `rfca-rig predict`.
VALLEY_EVERY = 4


class OutputMissing(Exception):
    """An output that this case does not have, with the reason."""


class CaseResults:
    """One design and its stroke; arrays over the stroke are (m,)."""

    def __init__(self, design: SweepCase) -> None:
        self.design = design

    @cached_property
    def rig(self) -> RigModel:
        """The rig model with the design's strip and links."""
        return self.design.model()

    @cached_property
    def motion(self) -> ShaftMotion:
        """Rest, the drive's ramp, constant speed."""
        return ramp_to_speed(
            self.rig.leg.start_angle_rad,
            self.design.speed_rad_s,
            self.rig.drive.ramp_s,
            self._end_s,
        )

    @cached_property
    def chain(self) -> Chain:
        """The chain as it is simulated, effects included."""
        return set_up(self.rig, self.design.height_m, self.motion).chain()

    @property
    def stroke(self) -> SimulatedStroke:
        """From 0.1 s before the start to the end of the turn. Raises SimulationFailed, on every
        access.
        """
        if isinstance(self._stroke, SimulationFailed):
            raise self._stroke
        return self._stroke

    @cached_property
    def _stroke(self) -> SimulatedStroke | SimulationFailed:
        t_s = (
            np.arange(
                -round(BEFORE_S * SAMPLES_PER_S),
                int(self._end_s * SAMPLES_PER_S) + 1,
                dtype=np.float64,
            )
            / SAMPLES_PER_S
        )
        # The failure is cached too: otherwise every output of the case would simulate again.
        try:
            return simulate_stroke(self.rig, self.design.height_m, self.motion, t_s)
        except SimulationFailed as failed:
            return failed

    @property
    def _end_s(self) -> float:
        # The ramp covers half the angle of a turn at full speed, so the turn takes half a ramp
        # longer.
        return self.design.turn_rad / self.design.speed_rad_s + 0.5 * self.rig.drive.ramp_s

    @cached_property
    def moving(self) -> slice:
        """The samples from the start on."""
        return slice(int(np.searchsorted(self.stroke.t_s, 0.0)), None)

    @cached_property
    def normal_N(self) -> Floats:
        """Normal force of the ground, (m,) in N, summed over the link ends."""
        return np.asarray(self.stroke.normal_N.sum(axis=1))

    @property
    def valley(self) -> Valley:
        """The valley of fz. Raises OutputMissing where there is none."""
        if isinstance(self._valley, Undetermined):
            raise OutputMissing(self._valley.reason)
        return self._valley

    @cached_property
    def _valley(self) -> Valley | Undetermined:
        if self.normal_N[0] > 0.0:
            return Undetermined("the leg lies on the ground before it starts")
        valley = find_valley(self.stroke.t_s[::VALLEY_EVERY], self.stroke.fz_N[::VALLEY_EVERY])
        if isinstance(valley, Valley):
            return valley
        return Undetermined(f"no valley: {valley.reason}")

    @cached_property
    def touchdown(self) -> int:
        """The first sample in contact. Raises OutputMissing where the leg never touches."""
        if not self.normal_N.any():
            raise OutputMissing("the leg does not touch the ground")
        return int((self.normal_N > 0.0).argmax())

    @cached_property
    def pressing(self) -> int:
        """The sample of the greatest load while the leg presses: in contact, more than 30 ms
        after touchdown.
        """
        stroke = self.stroke
        pressed = (stroke.t_s >= stroke.t_s[self.touchdown] + TOUCHDOWN_LASTS_S) & (
            self.normal_N > 0.0
        )
        if not pressed.any():
            raise OutputMissing(
                f"the leg does not press for longer than {1e3 * TOUCHDOWN_LASTS_S:.0f} ms"
            )
        return int(np.where(pressed, -stroke.fz_N, -np.inf).argmax())

    def integrate(self, values: Floats) -> float:
        """Integral of values (m,) over the stroke from the start on, by the trapezoidal rule (order
        2).

        It is a plain sum, because the rounding of a dot product may depend on the number of
        threads.
        """
        moving = values[self.moving]
        t_s = self.stroke.t_s[self.moving]
        return float(np.sum(0.5 * (moving[1:] + moving[:-1]) * np.diff(t_s)))


ANGLE_SEPARATOR = "@"


def _power_W(case: CaseResults) -> Floats:
    return np.asarray(case.stroke.shaft_torque_Nm * case.stroke.w_rad_s[:, 0])


def energy_J(case: CaseResults) -> float:
    return case.integrate(_power_W(case))


def energy_put_in_J(case: CaseResults) -> float:
    return case.integrate(np.maximum(_power_W(case), 0.0))


def dissipated_J(case: CaseResults) -> float:
    ends = [case.moving.start, -1]
    # The work that is neither stored in links, springs, height nor floor was dissipated.
    before, after = mechanical_energy_J(
        case.chain, case.stroke.q_rad[ends], case.stroke.w_rad_s[ends]
    )
    return energy_J(case) - float(after - before)


def hinge_loss_J(case: CaseResults) -> float:
    rates = np.diff(case.stroke.w_rad_s, axis=1)
    return case.integrate(np.asarray((case.chain.hinge_damping[1:] * rates**2).sum(axis=1)))


def peak_power_W(case: CaseResults) -> float:
    return float(_power_W(case)[case.moving].max())


def valley_time_s(case: CaseResults) -> float:
    return case.valley.time_s


def valley_fz_N(case: CaseResults) -> float:
    return case.valley.fz_N


def peak_force_N(case: CaseResults) -> float:
    return float(np.hypot(case.stroke.fy_N, case.stroke.fz_N)[case.moving].max())


def peak_moment_Nm(case: CaseResults) -> float:
    return float(np.abs(case.stroke.tx_Nm[case.moving]).max())


def peak_shaft_torque_Nm(case: CaseResults) -> float:
    return float(np.abs(case.stroke.shaft_torque_Nm[case.moving]).max())


def load_capacity_N(case: CaseResults) -> float:
    # fz is negative where the ground pushes the leg up; a load is positive.
    return -float(case.stroke.fz_N[case.pressing])


def load_capacity_kg(case: CaseResults) -> float:
    return load_capacity_N(case) / GRAVITY_M_S2


def driving_force_N(case: CaseResults) -> float:
    return -float(case.stroke.fy_N[case.pressing])


def impulse_Ns(case: CaseResults) -> float:
    return case.integrate(case.normal_N)


def driving_impulse_Ns(case: CaseResults) -> float:
    return case.integrate(np.asarray(case.stroke.tangential_N.sum(axis=1)))


def touchdown_s(case: CaseResults) -> float:
    return float(case.stroke.t_s[case.touchdown])


def contact_time_s(case: CaseResults) -> float:
    # The integral of an indicator counts the time of all contacts, also of separate ones.
    return case.integrate(np.where(case.normal_N > 0.0, 1.0, 0.0))


def largest_hinge_angle_rad(case: CaseResults) -> float:
    # q_rad are absolute angles of the links; a hinge angle is the difference of two.
    return float(np.abs(np.diff(case.stroke.q_rad[case.moving], axis=1)).max())


def largest_hinge_angle_deg(case: CaseResults) -> float:
    return float(np.degrees(largest_hinge_angle_rad(case)))


def bend_deg(case: CaseResults) -> float:
    q = case.stroke.q_rad[case.moving]
    return float(np.degrees(np.abs(q[:, -1] - q[:, 0]).max()))


def hinge_k0_Nm_per_rad(case: CaseResults) -> float:
    return case.rig.leg.k0_Nm_per_rad


def equivalent_stiffness_Nm_per_rad(case: CaseResults, angle_deg: float) -> float:
    return float(bending_stiffness_Nm_per_rad(case.rig.leg, np.radians(angle_deg)))


def strip_used_pct(case: CaseResults) -> float:
    return (
        100.0
        * largest_hinge_angle_rad(case)
        / case.design.cell_m()
        / case.design.strip.breaking_curvature_per_m
    )


def strip_used_short_pct(case: CaseResults) -> float:
    # The length over which the strip bends if k0 is its doing alone, as in `analysis.strips`.
    length_m = case.design.strip.bending_stiffness_Nm2 / case.rig.leg.k0_Nm_per_rad
    return (
        100.0
        * largest_hinge_angle_rad(case)
        / length_m
        / case.design.strip.breaking_curvature_per_m
    )


def strip_used_torque_pct(case: CaseResults) -> float:
    torque = bending_torque_Nm(case.rig.leg, np.array(largest_hinge_angle_rad(case)))
    return 100.0 * float(torque) / case.design.strip.breaking_moment_Nm


def static_torque_Nm(case: CaseResults, angle_deg: float) -> float:
    return _at_rest(case, angle_deg).shaft_torque_Nm


def static_load_N(case: CaseResults, angle_deg: float) -> float:
    return -_at_rest(case, angle_deg).fz_N


def _at_rest(case: CaseResults, angle_deg: float) -> StaticState:
    if case.rig.effects:
        raise OutputMissing(f"statics know the plain leg only, not effect {case.rig.effects[0].id}")
    return follow_static_path(case.rig, case.design.height_m, [float(np.radians(angle_deg))])[-1]


@dataclass(frozen=True)
class Output:
    """One output. `value` has the name of the output, which carries the unit.

    `at` names the argument, in degrees, of an output that is written as name@60.
    """

    value: Callable[..., float]
    words: str
    equation: str
    source: str
    at: str = ""

    @property
    def name(self) -> str:
        return self.value.__name__


# Sources that several outputs share.
TABLE = "Table II, by the estimator of every report"
IMPACT_TEST = (
    "the paper's impact test (IV.A), “a driving force of 188 N under a load of 23.7 kg” for "
    "fy 188 N and fz 232 N at the peak"
)
SENSOR = "what the sensor reads"
GROUND = "the ground's forces in the model"
WORK = "work of the driven joint"
SHAPE = "angles of the model"
STRENGTH = "Table I, as in rfca-rig strip"
REST_AT = "shaft angle"
REST = "eq. (10) with contact, turned there slowly from the start angle"


ALL = (
    Output(
        valley_time_s,
        "time of the valley",
        "t where fz is lowest between touchdown and lift-off",
        TABLE,
    ),
    Output(valley_fz_N, "fz in the valley", "min fz between touchdown and lift-off", TABLE),
    Output(
        peak_force_N,
        "largest force on the mount",
        "max |(fy, fz)|, the spike of touchdown included",
        SENSOR,
    ),
    Output(peak_moment_Nm, "largest moment on the sensor", "max |tx|", SENSOR),
    Output(load_capacity_N, "load capacity, as a force", "-fz(t*)", IMPACT_TEST),
    Output(load_capacity_kg, "load capacity", "-fz(t*) / g", IMPACT_TEST),
    Output(
        driving_force_N,
        "driving force under that load",
        "-fy(t*); above 0 the ground pushes along +y",
        IMPACT_TEST,
    ),
    Output(impulse_Ns, "what the ground bears over a stroke", "integral of sum N_k dt", GROUND),
    Output(driving_impulse_Ns, "net push along +y over a stroke", "integral of sum F_k dt", GROUND),
    Output(touchdown_s, "first contact", "first t with sum N_k > 0", GROUND),
    Output(contact_time_s, "how long the leg touches", "integral of [sum N_k > 0] dt", GROUND),
    Output(
        peak_shaft_torque_Nm,
        "largest torque of the shaft",
        "max |tau|",
        "eq. (16), the driven joint",
    ),
    Output(peak_power_W, "largest power of the shaft", "max tau w", WORK),
    Output(
        energy_J, "energy per stroke", "W = integral of tau w dt, what comes back counted off", WORK
    ),
    Output(
        energy_put_in_J,
        "energy per stroke of a drive that takes nothing back",
        "integral of max(tau w, 0) dt",
        WORK,
    ),
    Output(
        dissipated_J,
        "energy lost in a stroke",
        "W - (E(end) - E(0)), E of links, springs, height, floor",
        "energy balance",
    ),
    Output(
        hinge_loss_J,
        "of that, lost in the hinges' damping",
        "integral of c sum (dphi_i/dt)^2 dt",
        "the hinges' law",
    ),
    Output(largest_hinge_angle_deg, "largest angle of a hinge", "max |phi_i|", SHAPE),
    Output(bend_deg, "largest bend from first to last link", "max |sum phi_i|", SHAPE),
    Output(
        strip_used_pct,
        "strength used, bent over the pitch: kindest",
        "(max |phi_i| / p) (t / 2) E / strength",
        STRENGTH,
    ),
    Output(
        strip_used_short_pct,
        "strength used, bent over EI / k0",
        "(max |phi_i| k0 / EI) (t / 2) E / strength",
        STRENGTH,
    ),
    Output(
        strip_used_torque_pct,
        "strength used if the strips bear a hinge's torque alone",
        "T(max |phi_i|) / (2 EI strength / (E t))",
        STRENGTH,
    ),
    Output(
        hinge_k0_Nm_per_rad,
        "stiffness of a straight hinge",
        "k0 of the leg as simulated",
        "eq. (6) at phi = 0",
    ),
    Output(
        equivalent_stiffness_Nm_per_rad,
        "equivalent stiffness of a hinge",
        "K = dT/dphi = k0 (1 + 3 k2 phi^2)",
        "eq. (6)",
        at="hinge angle",
    ),
    Output(static_torque_Nm, "torque that holds the shaft", "tau at rest", REST, at=REST_AT),
    Output(static_load_N, "load borne at rest", "-fz at rest", REST, at=REST_AT),
)
OUTPUTS: dict[str, Output] = {output.name: output for output in ALL}


# Outputs of a sweep that names none.
DEFAULT_OUTPUTS = (
    "valley_time_s",
    "valley_fz_N",
    "load_capacity_kg",
    "driving_force_N",
    "energy_J",
    "peak_shaft_torque_Nm",
    "largest_hinge_angle_deg",
)


@dataclass(frozen=True)
class RequestedOutput:
    """An output with its argument, if it takes one."""

    name: str
    at_deg: float | None = None

    @property
    def header(self) -> str:
        """The column's name."""
        if self.at_deg is None:
            return self.name
        return f"{self.name}{ANGLE_SEPARATOR}{self.at_deg:g}deg"

    @property
    def output(self) -> Output:
        return OUTPUTS[self.name]

    @property
    def words(self) -> str:
        if self.at_deg is None:
            return self.output.words
        return f"{self.output.words} at {self.at_deg:g} degrees of {self.output.at}"

    def of(self, case: CaseResults) -> float:
        """The value. Raises OutputMissing, SimulationFailed, BadInput."""
        value = self.output.value
        if self.at_deg is None:
            return value(case)
        return value(case, self.at_deg)


def parse_outputs(names: Sequence[str]) -> tuple[RequestedOutput, ...]:
    """Parse the names of outputs. Raises BadInput for a name that is unknown or given twice."""
    outputs = tuple(parse_output(name) for name in names)
    if len(set(outputs)) < len(outputs):
        twice = next(
            output.header for index, output in enumerate(outputs) if output in outputs[:index]
        )
        raise BadInput(f"the output {twice} is named twice")
    return outputs


def parse_output(text: str) -> RequestedOutput:
    """Parse "valley_fz_N" or "static_torque_Nm@60". Raises BadInput."""
    name, at, angle = text.strip().partition(ANGLE_SEPARATOR)
    if name not in OUTPUTS:
        raise BadInput(
            f"{name!r} is no output; {suggest_name(name, OUTPUTS)}rfca-rig sweep --list prints "
            "all there are"
        )
    if not OUTPUTS[name].at:
        if at:
            raise BadInput(f"{text!r}: {name} takes no angle; leave {ANGLE_SEPARATOR}{angle} out")
        return RequestedOutput(name)
    try:
        at_deg = float(angle.removesuffix("deg"))
    except ValueError:
        at_deg = float("nan")
    if not isfinite(at_deg):
        raise BadInput(
            f"{text!r}: {name} needs a {OUTPUTS[name].at} in degrees, as in "
            f"{name}{ANGLE_SEPARATOR}60"
        )
    return RequestedOutput(name, at_deg)
