"""What can be fitted: every number of the believed model, the height of the rack, and the angle at which the shaft starts."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.model.parameters import RigModel
from rfca_rig.nearest import suggestion

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Supposed:
    """What one simulation supposes: a rig, how much higher the rack stands than it was said to, what the encoder reads too little, and how
    late the drive does what it is told.
    """

    rig: RigModel
    height_offset_m: float = 0.0
    turn_offset_rad: float = 0.0
    command_delay_s: float = 0.0


@dataclass(frozen=True)
class Parameter:
    """One number that a fit may move, in `unit`, the one that people write.

    `known_to` is its key in the section of that name. `relative` ones are scaled, all others shifted. `spread` is how far it may
    reasonably be off where nobody stated it, as a share of the value or in `unit`; it sets steps and bounds but pulls at nothing.
    """

    name: str
    unit: str
    relative: bool
    spread: float
    read: Callable[[Supposed], float]
    write: Callable[[Supposed, float], Supposed]
    known_to: str | None = None
    lowest: float = -np.inf


def _of_leg(name: str, field: str, unit: str, spread: float, scale: float = 1.0, known_to: str | None = None) -> Parameter:
    def write(at: Supposed, value: float) -> Supposed:
        changed: dict[str, Any] = {field: value / scale}
        return replace(at, rig=replace(at.rig, leg=replace(at.rig.leg, **changed)))

    return Parameter(name, unit, True, spread, lambda at: scale * float(getattr(at.rig.leg, field)), write, known_to)


def _of_ground(name: str, field: str, unit: str, spread: float, known_to: str | None = None, scale: float = 1.0) -> Parameter:
    def write(at: Supposed, value: float) -> Supposed:
        changed: dict[str, Any] = {field: value / scale}
        return replace(at, rig=replace(at.rig, ground=replace(at.rig.ground, **changed)))

    return Parameter(name, unit, True, spread, lambda at: scale * float(getattr(at.rig.ground, field)), write, known_to)


def _with_lever(at: Supposed, lever_mm: float) -> Supposed:
    return replace(at, rig=replace(at.rig, ground=replace(at.rig.ground, friction_lever_m=1e-3 * lever_mm)))


def _mass_g(at: Supposed) -> float:
    return 1e3 * sum(at.rig.leg.link_masses_kg)


def _with_mass(at: Supposed, mass_g: float) -> Supposed:
    share = mass_g / _mass_g(at)
    masses_kg = tuple(share * mass_kg for mass_kg in at.rig.leg.link_masses_kg)
    return replace(at, rig=replace(at.rig, leg=replace(at.rig.leg, link_masses_kg=masses_kg)))


def _start_deg(at: Supposed) -> float:
    return float(np.degrees(at.rig.leg.start_angle_rad))


def _with_start(at: Supposed, start_deg: float) -> Supposed:
    """A shaft that follows a recording turns by as much more as the leg is supposed to start later than before."""
    start_rad = float(np.radians(start_deg))
    turn_rad = at.turn_offset_rad + start_rad - at.rig.leg.start_angle_rad
    return replace(at, rig=replace(at.rig, leg=replace(at.rig.leg, start_angle_rad=start_rad)), turn_offset_rad=turn_rad)


def _with_below_shaft(at: Supposed, below_mm: float) -> Supposed:
    return replace(at, rig=replace(at.rig, sensor=replace(at.rig.sensor, below_shaft_m=1e-3 * below_mm)))


def _with_ramp(at: Supposed, ramp_ms: float) -> Supposed:
    return replace(at, rig=replace(at.rig, drive=replace(at.rig.drive, ramp_s=1e-3 * ramp_ms)))


_friction = replace(_of_ground("friction", "friction_coefficient", "", 0.1, "friction_coefficient"), relative=False, lowest=0.0)

PARAMETERS: Mapping[str, Parameter] = {
    parameter.name: parameter
    for parameter in (
        _of_leg("k0", "k0_Nm_per_rad", "N m/rad", 0.1, known_to="k0_relative"),
        _of_leg("k2", "k2_per_rad2", "1/rad2", 0.2, known_to="k2_relative"),
        _of_leg("hinge_damping", "hinge_damping_Nm_s_per_rad", "N m s/rad", 0.5, known_to="hinge_damping_relative"),
        Parameter("mass", "g", True, 0.02, _mass_g, _with_mass, "mass_relative"),
        _of_leg("link_radius", "link_radius_m", "mm", 0.3, scale=1e3),
        _friction,
        _of_ground("contact_stiffness", "stiffness_N_per_m1p5", "N/m1.5", 0.5, "contact_stiffness_relative"),
        _of_ground("contact_damping", "damping_s_per_m", "s/m", 0.5),
        _of_ground("presliding", "presliding_m", "mm", 0.5, scale=1e3),
        Parameter("friction_lever", "mm", False, 4.0, lambda at: 1e3 * at.rig.friction_lever_m, _with_lever),
        replace(_of_ground("friction_rise", "friction_rise_share", "", 0.5), relative=False),
        replace(_of_ground("leaving_damping", "leaving_damping_share", "", 0.5), relative=False, lowest=0.0),
        _of_ground("tangential_damping", "drag_N_s_per_m", "N s/m", 0.5),
        Parameter("below_shaft", "mm", False, 2.0, lambda at: 1e3 * at.rig.sensor.below_shaft_m, _with_below_shaft),
        Parameter("ramp", "ms", True, 0.2, lambda at: 1e3 * at.rig.drive.ramp_s, _with_ramp),
        Parameter("start_angle", "deg", False, 0.5, _start_deg, _with_start, "start_angle_deg"),
        Parameter(
            "height", "mm", False, 1.0, lambda at: 1e3 * at.height_offset_m, lambda at, mm: replace(at, height_offset_m=1e-3 * mm),
            "height_mm",
        ),
    )
}  # fmt: skip

FARTHEST = 5.0  # standard deviations: a value beyond them says that something else is wrong


@dataclass(frozen=True)
class Space:
    """The parameters of one fit around what is supposed at first.

    A point x (p,) counts prior standard deviations, so that one step length suits all: value = centre + std x, or centre exp(std x)
    for relative ones, which keeps them positive. `std` (p,) falls back to `spread` where `has_prior` (p,) is False.
    """

    parameters: tuple[Parameter, ...]
    centre: Supposed
    std: Floats
    has_prior: NDArray[np.bool_]

    @property
    def centres(self) -> Floats:
        """The values at x = 0, in the parameters' units, (p,)."""
        return np.array([parameter.read(self.centre) for parameter in self.parameters])

    @property
    def prior_std(self) -> Floats:
        """The prior's standard deviations in the parameters' units, (p,)."""
        return self.std * self._per_x(self.centres)

    def values(self, x: Floats) -> Floats:
        """The values at x, in the parameters' units, (p,)."""
        relative = self._is_relative
        return np.where(relative, self.centres * np.exp(np.where(relative, self.std * x, 0.0)), self.centres + self.std * x)

    def point(self, name: str, value: float) -> float:
        """The coordinate at which parameter `name` has `value`."""
        i = self.names.index(name)
        centre, std = self.centres[i], self.std[i]
        return float(np.log(value / centre) / std if self.parameters[i].relative else (value - centre) / std)

    def std_in_units(self, x: Floats, std_x: Floats) -> Floats:
        """A standard deviation of x, turned into the parameters' units at x, (p,)."""
        return std_x * self.std * self._per_x(self.values(x))

    def at(self, x: Floats) -> Supposed:
        """What is supposed at x."""
        supposed = self.centre
        for parameter, value in zip(self.parameters, self.values(x), strict=True):
            supposed = parameter.write(supposed, float(value))
        return supposed

    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper x, each (p,)."""
        floors = [-np.inf if p.relative else (p.lowest - c) / s for p, c, s in zip(self.parameters, self.centres, self.std, strict=True)]
        return np.maximum(-FARTHEST, floors), np.full(len(self.std), FARTHEST)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def _is_relative(self) -> NDArray[np.bool_]:
        return np.array([parameter.relative for parameter in self.parameters])

    def _per_x(self, values: Floats) -> Floats:
        return np.where(self._is_relative, np.abs(values), 1.0)


def space_of(names: Sequence[str], centre: Supposed, known_to: Mapping[str, float]) -> Space:
    """The space of the named parameters around `centre`; without names, of all that `known_to` lists.

    `known_to` is the section of that name: one standard deviation per key; a parameter it leaves out has no prior. Raises BadInput for a
    name that is not known or comes twice, and where nothing is left to fit.
    """
    chosen = named(names) or tuple(p for p in PARAMETERS.values() if known_to.get(p.known_to or ""))
    if not chosen:
        raise BadInput(f"nothing to fit: the recording has no [known_to]; name parameters: {', '.join(PARAMETERS)}")
    for parameter in chosen:
        if parameter.relative and parameter.read(centre) == 0.0:
            raise BadInput(f"{parameter.name} is believed to be 0 {parameter.unit} and can only be scaled; believe a small value instead")
    stated = [known_to.get(p.known_to or "") for p in chosen]
    std = [s or p.spread for s, p in zip(stated, chosen, strict=True)]
    return Space(chosen, centre, np.array(std), np.array([bool(s) for s in stated]))


def named(names: Sequence[str]) -> tuple[Parameter, ...]:
    """The parameters of these names. Raises BadInput for a name that is not known or comes twice."""
    if len(set(names)) < len(names):
        raise BadInput(f"a parameter is named twice in {', '.join(names)}")
    return tuple(_parameter(name) for name in names)


def _parameter(name: str) -> Parameter:
    if name not in PARAMETERS:
        raise BadInput(f"{name!r} is no parameter; {suggestion(name, PARAMETERS)}")
    return PARAMETERS[name]
