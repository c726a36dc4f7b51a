"""Parameters that can be fitted: values of the nominal model, the height of the rack, and the
start angle of the shaft.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.space import FitParameter, Prior
from rfca_rig.errors import BadInput
from rfca_rig.model.declarations.changes import VALUE_OF_CHANGE
from rfca_rig.model.parameters import PresentEffect, RigModel
from rfca_rig.suggestions import suggestion

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ModelPoint:
    """Values that one simulation uses: a rig, the true height of the rack above the stated one, the
    angle by which the encoder reads too little, and the delay of the drive behind its command.

    `unchanged` is the same before values changed since a reference; None where none has.
    """

    rig: RigModel
    height_offset_m: float = 0.0
    turn_offset_rad: float = 0.0
    command_delay_s: float = 0.0
    unchanged: "ModelPoint | None" = None

    @property
    def effects(self) -> tuple[PresentEffect, ...]:
        """The effects of the rig."""
        return self.rig.effects

    def replace_effects(self, effects: tuple[PresentEffect, ...]) -> "ModelPoint":
        """The same with these effects of the rig instead."""
        return replace(self, rig=replace(self.rig, effects=effects))

    def with_effects(self, effects: tuple[PresentEffect, ...]) -> "ModelPoint":
        """The same with these effects added to those of the rig, and with these changes of values
        made.
        """
        point = self
        added = []
        for effect in effects:
            if effect.id in VALUE_OF_CHANGE:
                point = _change_value(point, effect)
            else:
                added.append(effect)
        if point is not self:
            point = replace(point, unchanged=self)
        return replace(point, rig=replace(point.rig, effects=(*point.rig.effects, *added)))


def _change_value(point: ModelPoint, effect: PresentEffect) -> ModelPoint:
    """The point with the value of one parameter changed since a reference."""
    parameter = PARAMETERS[VALUE_OF_CHANGE[effect.id]]
    before = parameter.read(point)
    ((_, size),) = effect.values
    if parameter.relative:
        return parameter.write(point, before * size)
    return parameter.write(point, before + size)


def _of_leg(
    name: str, field: str, unit: str, spread: float, scale: float = 1.0, known_to: str | None = None
) -> FitParameter[ModelPoint]:
    def write(at: ModelPoint, value: float) -> ModelPoint:
        changed: dict[str, Any] = {field: value / scale}
        return replace(at, rig=replace(at.rig, leg=replace(at.rig.leg, **changed)))

    return FitParameter(
        name,
        unit,
        True,
        spread,
        lambda at: scale * float(getattr(at.rig.leg, field)),
        write,
        known_to,
    )


def _k2_per_rad2(at: ModelPoint) -> float:
    # A leg with a measured curve has no k2; scaling it would change nothing without notice.
    if at.rig.leg.torque_splines:
        raise BadInput(
            "k2: the hinges of this leg follow a measured curve (leg.torque_rotation), "
            "which has none; take k0, which scales it"
        )
    return at.rig.leg.k2_per_rad2


def _with_k2(at: ModelPoint, k2_per_rad2: float) -> ModelPoint:
    _k2_per_rad2(at)
    return replace(at, rig=replace(at.rig, leg=replace(at.rig.leg, k2_per_rad2=k2_per_rad2)))


def _of_ground(
    name: str, field: str, unit: str, spread: float, known_to: str | None = None, scale: float = 1.0
) -> FitParameter[ModelPoint]:
    def write(at: ModelPoint, value: float) -> ModelPoint:
        changed: dict[str, Any] = {field: value / scale}
        return replace(at, rig=replace(at.rig, ground=replace(at.rig.ground, **changed)))

    return FitParameter(
        name,
        unit,
        True,
        spread,
        lambda at: scale * float(getattr(at.rig.ground, field)),
        write,
        known_to,
    )


def _with_lever(at: ModelPoint, lever_mm: float) -> ModelPoint:
    return replace(
        at, rig=replace(at.rig, ground=replace(at.rig.ground, friction_lever_m=1e-3 * lever_mm))
    )


def _shift_of_ground(
    name: str, field: str, unit: str, spread: float, known_to: str, lowest: float = 0.0
) -> FitParameter[ModelPoint]:
    return replace(_of_ground(name, field, unit, spread, known_to), relative=False, lowest=lowest)


def _mass_g(at: ModelPoint) -> float:
    return 1e3 * sum(at.rig.leg.link_masses_kg)


def _with_mass(at: ModelPoint, mass_g: float) -> ModelPoint:
    # The distribution of mass along the leg stays.
    share = mass_g / _mass_g(at)
    masses_kg = tuple(share * mass_kg for mass_kg in at.rig.leg.link_masses_kg)
    return replace(at, rig=replace(at.rig, leg=replace(at.rig.leg, link_masses_kg=masses_kg)))


def _start_deg(at: ModelPoint) -> float:
    return float(np.degrees(at.rig.leg.start_angle_rad))


def _with_start(at: ModelPoint, start_deg: float) -> ModelPoint:
    """Sets the start angle. A shaft that follows a recording is turned by the same difference."""
    start_rad = float(np.radians(start_deg))
    turn_rad = at.turn_offset_rad + start_rad - at.rig.leg.start_angle_rad
    return replace(
        at,
        rig=replace(at.rig, leg=replace(at.rig.leg, start_angle_rad=start_rad)),
        turn_offset_rad=turn_rad,
    )


def _with_below_shaft(at: ModelPoint, below_mm: float) -> ModelPoint:
    return replace(
        at, rig=replace(at.rig, sensor=replace(at.rig.sensor, below_shaft_m=1e-3 * below_mm))
    )


def _with_ramp(at: ModelPoint, ramp_ms: float) -> ModelPoint:
    return replace(at, rig=replace(at.rig, drive=replace(at.rig.drive, ramp_s=1e-3 * ramp_ms)))


PARAMETERS: Mapping[str, FitParameter[ModelPoint]] = {
    parameter.name: parameter
    for parameter in (
        _of_leg("k0", "k0_Nm_per_rad", "N m/rad", 0.1, known_to="k0_relative"),
        FitParameter("k2", "1/rad2", True, 0.2, _k2_per_rad2, _with_k2, "k2_relative"),
        _of_leg(
            "hinge_damping",
            "hinge_damping_Nm_s_per_rad",
            "N m s/rad",
            0.5,
            known_to="hinge_damping_relative",
        ),
        FitParameter("mass", "g", True, 0.02, _mass_g, _with_mass, "mass_relative"),
        _of_leg("link_radius", "link_radius_m", "mm", 0.3, scale=1e3),
        _shift_of_ground("friction", "friction_coefficient", "", 0.1, "friction_coefficient"),
        _of_ground(
            "contact_stiffness", "stiffness_N_per_m1p5", "N/m1.5", 0.5, "contact_stiffness_relative"
        ),
        _of_ground("contact_damping", "damping_s_per_m", "s/m", 0.5),
        _of_ground("presliding", "presliding_m", "mm", 0.5, "presliding_relative", 1e3),
        FitParameter(
            "friction_lever",
            "mm",
            False,
            4.0,
            lambda at: 1e3 * at.rig.friction_lever_m,
            _with_lever,
        ),
        _shift_of_ground(
            "friction_rise", "friction_rise_share", "", 0.5, "friction_rise_share", lowest=-np.inf
        ),
        _shift_of_ground(
            "leaving_damping", "leaving_damping_share", "", 0.5, "leaving_damping_share"
        ),
        _shift_of_ground(
            "tangential_damping", "drag_N_s_per_m", "N s/m", 1.0, "tangential_damping_N_s_per_m"
        ),
        FitParameter(
            "below_shaft",
            "mm",
            False,
            2.0,
            lambda at: 1e3 * at.rig.sensor.below_shaft_m,
            _with_below_shaft,
        ),
        FitParameter("ramp", "ms", True, 0.2, lambda at: 1e3 * at.rig.drive.ramp_s, _with_ramp),
        FitParameter("start_angle", "deg", False, 0.5, _start_deg, _with_start, "start_angle_deg"),
        FitParameter(
            "height",
            "mm",
            False,
            1.0,
            lambda at: 1e3 * at.height_offset_m,
            lambda at, mm: replace(at, height_offset_m=1e-3 * mm),
            "height_mm",
        ),
    )
}


def make_prior(
    names: Sequence[str], centre: ModelPoint, known_to: Mapping[str, float]
) -> Prior[ModelPoint]:
    """The space of the named parameters around `centre`; without names, of all that `known_to`
    lists.

    `known_to` is the section of that name: one standard deviation per key. A parameter without a
    key has no prior. Raises BadInput for a name that is unknown or given twice, and where nothing
    is left to fit.
    """
    chosen = select_parameters(names) or tuple(
        p for p in PARAMETERS.values() if known_to.get(p.known_to or "")
    )
    if not chosen:
        raise BadInput(
            "nothing to fit: the recording has no [known_to]; name parameters: "
            f"{', '.join(PARAMETERS)}"
        )
    for parameter in chosen:
        # Relative parameters are multiplied by exp(std x), which cannot leave 0.
        if parameter.relative and parameter.read(centre) == 0.0:
            raise BadInput(
                f"{parameter.name} is nominally 0 {parameter.unit} and can only be "
                "scaled; state a small value instead"
            )
    stated = [known_to.get(p.known_to or "") for p in chosen]
    std = [s or p.spread for s, p in zip(stated, chosen, strict=True)]
    return Prior(chosen, centre, np.array(std), np.array([bool(s) for s in stated]))


def select_parameters(names: Sequence[str]) -> tuple[FitParameter[ModelPoint], ...]:
    """The parameters of these names. Raises BadInput for a name that is unknown or given twice."""
    if len(set(names)) < len(names):
        raise BadInput(f"a parameter is named twice in {', '.join(names)}")
    return tuple(_parameter(name) for name in names)


def _parameter(name: str) -> FitParameter[ModelPoint]:
    if name not in PARAMETERS:
        raise BadInput(f"{name!r} is no parameter; {suggestion(name, PARAMETERS)}")
    return PARAMETERS[name]
