"""Quantities that a sweep can vary, by their names in columns and files."""

import difflib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from rfca_rig.analysis.fitting.parameters import PARAMETERS, ModelPoint
from rfca_rig.analysis.fitting.space import FitParameter as ModelParameter
from rfca_rig.description.sections import MIN_K2_PER_RAD2
from rfca_rig.errors import BadInput
from rfca_rig.model.catalogue import catalogue
from rfca_rig.model.effect import Parameter as OfEffect
from rfca_rig.model.paper.strip import (
    MOST_LINKS,
    Strip,
    cell_m,
    paper_strips,
    table_1_materials,
    with_first_link,
    with_links,
)
from rfca_rig.model.parameters import Leg, PresentEffect, RigModel

FITTED_STRIP = paper_strips(
    {material.name: material for material in table_1_materials()}["CFSP"], 0.8e-3
)

Value = float | str

# Replaced in this order: the unit of k0, N m/rad, becomes Nm_per_rad.
KEY_OF_UNIT = {"N m": "Nm", "1/": "per_", "/": "_per_", " ": "_"}
# Parameter of a fit: the rack's offset. A sweep varies the height itself, and its error is an
# effect.
HEIGHT = "height"

# Descriptions of the nominal values, by the names of `analysis.fitting.parameters`.
NOMINAL_WORDS = {
    "k0": "stiffness of a straight hinge",
    "k2": "hardening: torque is k0 (phi + k2 phi^3)",
    "hinge_damping": "damping of each hinge",
    "mass": "mass of the leg",
    "link_radius": "radius of the circle at each link's end",
    "friction": "Coulomb friction at the floor",
    "contact_stiffness": "Hertz stiffness of the floor",
    "contact_damping": "damping of the floor, per approach speed",
    "presliding": "how far a sticking point yields before it slips",
    "friction_lever": "lever of friction about a link's end",
    "friction_rise": "how high friction acts, as a share of the depth",
    "leaving_damping": "share of the floor's damping while an end leaves",
    "tangential_damping": "viscous share beside Coulomb friction",
    "below_shaft": "how far the sensor sits below the shaft",
    "ramp": "time in which the drive reaches its speed",
    "start_angle": "where a stroke begins, below the horizontal",
}


"""The strip of which the nominal k0 is taken to be: the paper's, two pieces of CFSP of 0.8 mm."""


@dataclass(frozen=True)
class SweepCase:
    """One simulated design. `rig` is the nominal model with its own links and strip; `strip`,
    `links` and `first_link_m` are applied last.

    k0, k2 and hinge damping are therefore always those of the nominal leg. Other links and strips
    are derived from it.
    """

    rig: RigModel
    height_m: float = 0.215
    speed_rad_s: float = 2.433
    turn_rad: float = float(np.radians(200.0))
    strip: Strip = FITTED_STRIP
    links: int | None = None
    first_link_m: float | None = None

    def model(self) -> RigModel:
        """The rig model with strip and links applied. Raises BadInput for impossible links."""
        leg = self._leg()
        if self.links is not None:
            leg = with_links(leg, self.links)
        return replace(self.rig, leg=leg)

    def cell_m(self) -> float:
        """The length of strip that each hinge represents; see `model.paper.strip`. Raises
        BadInput.
        """
        leg = self._leg()
        if self.links is None:
            return cell_m(leg)
        # Fewer hinges share the same strip, so each represents more of it.
        hinges = len(leg.link_lengths_m) - 1
        return cell_m(leg) * (hinges / (self.links - 1))

    def _leg(self) -> Leg:
        """With its strip and first link, before it is divided into other links."""
        leg = replace_strip(self.rig, self.strip).leg
        if self.first_link_m is None:
            return leg
        return with_first_link(leg, self.first_link_m)


def replace_strip(rig: RigModel, strip: Strip) -> RigModel:
    """The rig with another strip in its leg: k0 scales with E I, and the change of the strips' mass
    is spread over the links in proportion.

    Hardening and hinge damping are unchanged, as in `analysis.strips`.
    """
    fitted = FITTED_STRIP
    leg = rig.leg
    # The paper's strip leaves the rig bitwise as it is.
    if strip == fitted:
        return rig
    heavier = 1.0 + (strip.mass_kg - fitted.mass_kg) / sum(leg.link_masses_kg)
    k0 = leg.k0_Nm_per_rad * strip.bending_stiffness_Nm2 / fitted.bending_stiffness_Nm2
    return replace(
        rig,
        leg=replace(
            leg,
            k0_Nm_per_rad=k0,
            link_masses_kg=tuple(heavier * mass for mass in leg.link_masses_kg),
        ),
    )


def set_effect_value(rig: RigModel, id_: str, name: str, value: float) -> RigModel:
    """The rig with one parameter of an effect set; an effect that is absent is added."""
    if not any(present.id == id_ for present in rig.effects):
        return replace(rig, effects=(*rig.effects, PresentEffect(id_, ((name, value),))))
    effects = []
    for effect in rig.effects:
        if effect.id == id_:
            values = {**dict(effect.values), name: value}
            effects.append(replace(effect, values=tuple(values.items())))
        else:
            effects.append(effect)
    return replace(rig, effects=tuple(effects))


@dataclass(frozen=True)
class Quantity:
    """One quantity that can be varied. `name` carries its unit. `why_not` gives the reason against
    a value. `choices` lists the words of a quantity that is no number.

    `sets` names what it changes, where another quantity changes the same.
    """

    name: str
    words: str
    write: Callable[[SweepCase, Value], SweepCase]
    why_not: Callable[[Value], str | None]
    choices: tuple[str, ...] = ()
    sets: str = ""


def find_quantity(name: str) -> Quantity:
    """Look up a quantity by its name, also by its name in `fit` or in a model file. Raises
    BadInput for an unknown name.
    """
    known = list_quantities()
    canonical = aliases().get(name, name)
    if canonical not in known:
        hint = suggest_name(name, [*known, *aliases()])
        raise BadInput(
            f"{name!r} cannot be varied; {hint}rfca-rig sweep --list prints all that can"
        )
    return known[canonical]


def suggest_name(name: str, known: Iterable[str]) -> str:
    """`did you mean x? ` for the known name that is nearest; empty where none is near."""
    close = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
    if close:
        return f"did you mean {close[0]}? "
    return ""


@cache
def list_quantities() -> dict[str, Quantity]:
    """All quantities by name: stroke, strip, links, nominal values, effects."""
    design = (*_of_the_stroke(), *_of_the_strip(), *_of_the_links())
    nominal = (_nominal(parameter) for name, parameter in PARAMETERS.items() if name != HEIGHT)
    # The catalogue also holds effects of pendulums, which a leg cannot have.
    of_legs = (effect for _, effect in sorted(catalogue().items()))
    effects = (
        _of_effect(effect.id, parameter) for effect in of_legs for parameter in effect.parameters
    )
    return {quantity.name: quantity for quantity in (*design, *nominal, *effects)}


@cache
def aliases() -> dict[str, str]:
    """Names of the same quantities in `fit` and model files, where they differ."""
    of_fit = {
        name: _with_unit(parameter) for name, parameter in PARAMETERS.items() if name != HEIGHT
    }
    return of_fit | {"friction_coefficient": "friction"}


def _of_the_stroke() -> tuple[Quantity, ...]:
    return (
        Quantity(
            "height_mm",
            "height of the shaft above the ground",
            lambda at, x: replace(at, height_m=1e-3 * _number(x)),
            _between(1.0, 1000.0),
        ),
        Quantity(
            "speed_rad_s",
            "speed of the shaft",
            lambda at, x: replace(at, speed_rad_s=_number(x)),
            _between(0.01, 100.0),
        ),
        Quantity(
            "turn_deg",
            "how far the shaft turns in a stroke",
            lambda at, x: replace(at, turn_rad=float(np.radians(_number(x)))),
            _between(1.0, 330.0),
        ),
        Quantity(
            "start_angle_rad",
            "where a stroke begins, below the horizontal",
            lambda at, x: replace(
                at, rig=replace(at.rig, leg=replace(at.rig.leg, start_angle_rad=_number(x)))
            ),
            _between(-np.pi, np.pi),
            sets="start_angle",
        ),
        Quantity(
            "ramp_s",
            "time in which the drive reaches its speed",
            lambda at, x: replace(
                at, rig=replace(at.rig, drive=replace(at.rig.drive, ramp_s=_number(x)))
            ),
            _above_zero,
            sets="ramp",
        ),
    )


def _of_the_strip() -> tuple[Quantity, ...]:
    materials = tuple(material.name for material in table_1_materials())
    return (
        Quantity(
            "strip.material",
            "material of the strips, of Table I",
            _material,
            partial(_one_of, materials),
            materials,
        ),
        Quantity(
            "strip.thickness_mm",
            "thickness of each strip",
            _set_thickness_mm,
            _above_zero,
        ),
        Quantity("strip.width_mm", "width of each strip", _set_width_mm, _above_zero),
    )


def _of_the_links() -> tuple[Quantity, ...]:
    return (
        Quantity(
            "links",
            "number of links, the leg's length, mass and strip as they are",
            lambda at, x: replace(at, links=int(_number(x))),
            _whole_links,
        ),
        Quantity(
            "first_link_mm",
            "length of the first link, the others sharing the rest",
            lambda at, x: replace(at, first_link_m=1e-3 * _number(x)),
            _above_zero,
        ),
    )


def _nominal(parameter: ModelParameter[ModelPoint]) -> Quantity:
    def write(at: SweepCase, value: Value) -> SweepCase:
        # The parameters of a fit serve here too, so that both write the same value in the same way.
        return replace(at, rig=parameter.write(ModelPoint(at.rig), _number(value)).rig)

    return Quantity(
        _with_unit(parameter),
        NOMINAL_WORDS.get(parameter.name, parameter.name.replace("_", " ")),
        write,
        _limits_of(parameter),
        sets=parameter.name,
    )


def _limits_of(parameter: ModelParameter[ModelPoint]) -> Callable[[Value], str | None]:
    if parameter.name == "start_angle":
        return _between(-180.0, 180.0)
    if parameter.name == "friction":
        return _between(0.0, 5.0)
    if parameter.name == "k2":
        return _is_monotone
    if parameter.name in ("hinge_damping", "contact_damping", "tangential_damping"):
        return _not_negative
    if parameter.relative:
        return _above_zero
    return _finite


def _of_effect(id_: str, parameter: OfEffect) -> Quantity:
    return Quantity(
        f"{id_}.{parameter.name}",
        f"effect {id_.replace('_', ' ')}, plausible from {parameter.low:g} to {parameter.high:g}",
        lambda at, x: replace(at, rig=set_effect_value(at.rig, id_, parameter.name, _number(x))),
        lambda x: _finite(x) or parameter.why_not(_number(x)),
    )


def _with_unit(parameter: ModelParameter[ModelPoint]) -> str:
    """Name as in model files: k0 in N m/rad is k0_Nm_per_rad, k2 in 1/rad2 is k2_per_rad2."""
    # A dot in a key would start a sub-table in TOML.
    unit = parameter.unit.replace("m1.5", "m1p5")
    for written, named in KEY_OF_UNIT.items():
        unit = unit.replace(written, named)
    if unit:
        return f"{parameter.name}_{unit}"
    return parameter.name


def _material(at: SweepCase, value: Value) -> SweepCase:
    material = next(candidate for candidate in table_1_materials() if candidate.name == value)
    return replace(at, strip=replace(at.strip, material=material))


def _set_thickness_mm(at: SweepCase, value: Value) -> SweepCase:
    return replace(at, strip=replace(at.strip, thickness_m=_mm_to_m(value)))


def _set_width_mm(at: SweepCase, value: Value) -> SweepCase:
    return replace(at, strip=replace(at.strip, width_m=_mm_to_m(value)))


def _mm_to_m(value: Value) -> float:
    # 0.8 mm is then bitwise the thickness of the paper's strip.
    return round(1e-3 * _number(value), 9)


def _number(value: Value) -> float:
    return float(value)


def _finite(value: Value) -> str | None:
    if isinstance(value, str):
        return "must be a number"
    if np.isfinite(value):
        return None
    return "must be a finite number"


# Each of the following returns why a value is not allowed, or None.
def _above_zero(value: Value) -> str | None:
    if reason := _finite(value):
        return reason
    if _number(value) > 0.0:
        return None
    return "must be above 0"


def _not_negative(value: Value) -> str | None:
    if reason := _finite(value):
        return reason
    if _number(value) >= 0.0:
        return None
    return "must be 0 or more"


def _is_monotone(k2_per_rad2: Value) -> str | None:
    if reason := _finite(k2_per_rad2):
        return reason
    if _number(k2_per_rad2) >= MIN_K2_PER_RAD2:
        return None
    return (
        f"must be {MIN_K2_PER_RAD2:.3f} or more: below, the torque of a hinge falls before 90 "
        "degrees"
    )


def _between(low: float, high: float) -> Callable[[Value], str | None]:
    def why_not(value: Value) -> str | None:
        if reason := _finite(value):
            return reason
        if low <= _number(value) <= high:
            return None
        return f"must be {low:g} to {high:g}"

    return why_not


def _whole_links(value: Value) -> str | None:
    fits = (
        _finite(value) is None and _number(value).is_integer() and 2 <= _number(value) <= MOST_LINKS
    )
    if fits:
        return None
    return f"must be a whole number of 2 to {MOST_LINKS}"


def _one_of(choices: tuple[str, ...], value: Value) -> str | None:
    if value in choices:
        return None
    return f"must be one of {', '.join(choices)}"
