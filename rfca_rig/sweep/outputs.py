"""Outputs of a sweep: each with its unit, its definition and its source.

Over a stroke, t runs from the commanded start, 0, to the end of the shaft's turn. N_k and F_k are the ground's forces on the end of link k,
up and along +y. fy, fz, tx are the sensor's values; tau is the torque of the shaft, w its speed; phi_i are hinge angles. The leg presses
where sum N_k > 0 and more than 30 ms have passed since touchdown. t* is the moment of the greatest load, -fz, while it presses.
"""

import difflib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isfinite

from rfca_rig.errors import BadInput
from rfca_rig.sweep import of_energy, of_forces, of_the_leg
from rfca_rig.sweep.computed import CaseResults

ANGLE_SEPARATOR = "@"


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
IMPACT_TEST = "the paper's impact test (IV.A), “a driving force of 188 N under a load of 23.7 kg” for fy 188 N and fz 232 N at the peak"
SENSOR = "what the sensor reads"
GROUND = "the ground's forces in the model"
WORK = "work of the driven joint"
SHAPE = "angles of the model"
STRENGTH = "Table I, as in rfca-rig strip"
REST_AT = "shaft angle"
REST = "eq. (10) with contact, turned there slowly from the start angle"

ALL = (
    Output(of_forces.valley_time_s, "time of the valley", "t where fz is lowest between touchdown and lift-off", TABLE),
    Output(of_forces.valley_fz_N, "fz in the valley", "min fz between touchdown and lift-off", TABLE),
    Output(of_forces.peak_force_N, "largest force on the mount", "max |(fy, fz)|, the spike of touchdown included", SENSOR),
    Output(of_forces.peak_moment_Nm, "largest moment on the sensor", "max |tx|", SENSOR),
    Output(of_forces.load_capacity_N, "load capacity, as a force", "-fz(t*)", IMPACT_TEST),
    Output(of_forces.load_capacity_kg, "load capacity", "-fz(t*) / g", IMPACT_TEST),
    Output(of_forces.driving_force_N, "driving force under that load", "-fy(t*); above 0 the ground pushes along +y", IMPACT_TEST),
    Output(of_forces.impulse_Ns, "what the ground bears over a stroke", "integral of sum N_k dt", GROUND),
    Output(of_forces.driving_impulse_Ns, "net push along +y over a stroke", "integral of sum F_k dt", GROUND),
    Output(of_forces.touchdown_s, "first contact", "first t with sum N_k > 0", GROUND),
    Output(of_forces.contact_time_s, "how long the leg touches", "integral of [sum N_k > 0] dt", GROUND),
    Output(of_forces.peak_shaft_torque_Nm, "largest torque of the shaft", "max |tau|", "eq. (16), the driven joint"),
    Output(of_energy.peak_power_W, "largest power of the shaft", "max tau w", WORK),
    Output(of_energy.energy_J, "energy per stroke", "W = integral of tau w dt, what comes back counted off", WORK),
    Output(of_energy.energy_put_in_J, "energy per stroke of a drive that takes nothing back", "integral of max(tau w, 0) dt", WORK),
    Output(of_energy.dissipated_J, "energy lost in a stroke", "W - (E(end) - E(0)), E of links, springs, height, floor", "energy balance"),
    Output(of_energy.hinge_loss_J, "of that, lost in the hinges' damping", "integral of c sum (dphi_i/dt)^2 dt", "the hinges' law"),
    Output(of_the_leg.largest_hinge_angle_deg, "largest angle of a hinge", "max |phi_i|", SHAPE),
    Output(of_the_leg.bend_deg, "largest bend from first to last link", "max |sum phi_i|", SHAPE),
    Output(of_the_leg.strip_used_pct, "strength used, bent over the pitch: kindest", "(max |phi_i| / p) (t / 2) E / strength", STRENGTH),
    Output(of_the_leg.strip_used_short_pct, "strength used, bent over EI / k0", "(max |phi_i| k0 / EI) (t / 2) E / strength", STRENGTH),
    Output(
        of_the_leg.strip_used_torque_pct,
        "strength used if the strips bear a hinge's torque alone",
        "T(max |phi_i|) / (2 EI strength / (E t))",
        STRENGTH,
    ),
    Output(of_the_leg.hinge_k0_Nm_per_rad, "stiffness of a straight hinge", "k0 of the leg as simulated", "eq. (6) at phi = 0"),
    Output(
        of_the_leg.equivalent_stiffness_Nm_per_rad,
        "equivalent stiffness of a hinge",
        "K = dT/dphi = k0 (1 + 3 k2 phi^2)",
        "eq. (6)",
        at="hinge angle",
    ),
    Output(of_the_leg.static_torque_Nm, "torque that holds the shaft", "tau at rest", REST, at=REST_AT),
    Output(of_the_leg.static_load_N, "load borne at rest", "-fz at rest", REST, at=REST_AT),
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
        return self.name if self.at_deg is None else f"{self.name}{ANGLE_SEPARATOR}{self.at_deg:g}deg"

    @property
    def output(self) -> Output:
        return OUTPUTS[self.name]

    @property
    def words(self) -> str:
        return self.output.words if self.at_deg is None else f"{self.output.words} at {self.at_deg:g} degrees of {self.output.at}"

    def of(self, case: CaseResults) -> float:
        """The value. Raises Missing, SimulationFailed, BadInput."""
        value = self.output.value
        return value(case) if self.at_deg is None else value(case, self.at_deg)


def parse_outputs(names: Sequence[str]) -> tuple[RequestedOutput, ...]:
    """Parse the names of outputs. Raises BadInput for a name that is unknown or given twice."""
    found = tuple(parse_output(name) for name in names)
    if len(set(found)) < len(found):
        twice = next(each.header for place, each in enumerate(found) if each in found[:place])
        raise BadInput(f"the output {twice} is named twice")
    return found


def parse_output(text: str) -> RequestedOutput:
    """Parse "valley_fz_N" or "static_torque_Nm@60". Raises BadInput."""
    name, at, angle = text.strip().partition(ANGLE_SEPARATOR)
    if name not in OUTPUTS:
        close = difflib.get_close_matches(name, OUTPUTS, n=1, cutoff=0.5)
        raise BadInput(f"{name!r} is no output; {f'did you mean {close[0]}? ' if close else ''}rfca-rig sweep --list prints all there are")
    if not OUTPUTS[name].at:
        if at:
            raise BadInput(f"{text!r}: {name} takes no angle; leave {ANGLE_SEPARATOR}{angle} out")
        return RequestedOutput(name)
    try:
        at_deg = float(angle.removesuffix("deg"))
    except ValueError:
        at_deg = float("nan")
    if not isfinite(at_deg):
        raise BadInput(f"{text!r}: {name} needs a {OUTPUTS[name].at} in degrees, as in {name}{ANGLE_SEPARATOR}60")
    return RequestedOutput(name, at_deg)
