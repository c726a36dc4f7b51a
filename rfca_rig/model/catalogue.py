"""The catalogue of effects, and the simulation of a rig with its effects in it.

The catalogue holds every effect of the package, and of every file of a lab's own folder. A lab
keeps its effects as Python files in a folder that RFCA_RIG_EFFECTS names; each defines `EFFECT`.
The package needs no change for it.

A family holds the effects that are hard to tell apart. An effect may belong to several families:
hysteresis both dissipates energy and has memory. A family has one place.
"""

import importlib
import importlib.util
import os
import pkgutil
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path
from types import ModuleType

from rfca_rig.errors import BadInput
from rfca_rig.model import effects
from rfca_rig.model.effect import Effect
from rfca_rig.model.motion import ShaftMotion
from rfca_rig.model.parameters import PresentEffect, RigModel
from rfca_rig.model.setup import Setup
from rfca_rig.model.tabulated_law import TABULATED_LAW, effect_of_table
from rfca_rig.suggestions import suggestion

FOLDER_VARIABLE = "RFCA_RIG_EFFECTS"


def catalogue() -> dict[str, Effect]:
    """All effects by id; a lab's file may replace one of the package's by using its id."""
    return _catalogue(os.environ.get(FOLDER_VARIABLE))


@cache
def _catalogue(folder: str | None) -> dict[str, Effect]:
    modules = (
        importlib.import_module(f"{effects.__name__}.{module.name}")
        for module in pkgutil.iter_modules(effects.__path__)
    )
    packaged: dict[str, Effect] = {
        effect.id: effect for module in modules for effect in module.EFFECTS
    }
    # The lab's entries come last, so that they replace entries of the same id.
    return packaged | {name: effect for name, (effect, _) in _lab_effects(folder).items()}


def lab_texts(ids: Collection[str]) -> dict[str, str]:
    """Source texts, by id, of those of these effects that are a lab's own; a recording stores
    them.
    """
    return {
        name: text
        for name, (_, text) in _lab_effects(os.environ.get(FOLDER_VARIABLE)).items()
        if name in ids
    }


@cache
def _lab_effects(folder: str | None) -> dict[str, tuple[Effect, str]]:
    modules = _lab_modules(Path(folder)) if folder else iter(())
    return {
        (effect := _effect_of(module)).id: (
            effect,
            Path(str(module.__file__)).read_text(encoding="utf-8"),
        )
        for module in modules
    }


def _lab_modules(folder: Path) -> Iterator[ModuleType]:
    if not folder.is_dir():
        raise BadInput(f"{folder}: {FOLDER_VARIABLE} names a folder that is not there")
    for file in sorted(folder.glob("*.py")):
        spec = importlib.util.spec_from_file_location(f"lab_effect_{file.stem}", file)
        if spec is None or spec.loader is None:
            raise BadInput(f"{file}: cannot be loaded as a Python file")
        module = importlib.util.module_from_spec(spec)
        try:
            spec.loader.exec_module(module)
        # A lab's file may raise anything; the user gets its name in one line instead of a
        # traceback.
        except Exception as error:
            raise BadInput(f"{file}: {type(error).__name__}: {error}") from error
        yield module


def _effect_of(module: ModuleType) -> Effect:
    effect = getattr(module, "EFFECT", None)
    if not isinstance(effect, Effect):
        raise BadInput(
            f"{module.__file__}: defines no EFFECT; see docs/add-an-effect.md for the form"
        )
    known = [family.id for family in FAMILIES]
    if effect.family and effect.family not in known:
        raise BadInput(
            f"{module.__file__}: family {effect.family!r} is none of the catalogue; "
            f"{suggestion(effect.family, known)}"
        )
    return effect


# Parts of a setup that move the leg, all but the changes of the sensor.
_MOVING = tuple(part.name for part in fields(Setup) if part.name != "sensor_changes")


def set_up(
    rig: RigModel, height_m: float, motion: ShaftMotion, strokes_before: tuple[int, ...] = ()
) -> Setup:
    """The setup of a rig with all its effects in it; `strokes_before` as in `Setup`.

    Raises BadInput for an effect that is not in the catalogue, and for one whose law needs k2 where
    the hinges follow a measured curve.
    """
    setup = Setup(rig, height_m, motion, strokes_before=strokes_before)
    for present in rig.effects:
        effect, values = resolve_effect(present)
        if effect.needs_k2 and rig.leg.torque_splines:
            raise BadInput(
                f"effect {effect.id}: its law is written in k0 and k2, and the hinges of "
                "this leg follow a measured curve "
                "(leg.torque_rotation); leave out one of them"
            )
        changed = effect.apply(setup, values)
        # By identity, since a motion holds arrays. The function stands for a lab's own effect,
        # which may change under the same id.
        kept = all(getattr(changed, name) is getattr(setup, name) for name in _MOVING)
        if kept:
            setup = changed
        else:
            setup = replace(changed, moved_by=(*setup.moved_by, (effect.apply, present)))
    return setup


def resolve_effect(present: PresentEffect) -> tuple[Effect, dict[str, float]]:
    """The catalogue's entry, and the values by parameter name, with neutral values for optional
    parameters that are not given.

    Raises BadInput where either does not fit.
    """
    if present.id == TABULATED_LAW:
        return effect_of_table(present.table), {}
    effects = catalogue()
    if present.id not in effects:
        raise BadInput(
            f"effect {present.id}: not in the catalogue; there are {', '.join(sorted(effects))}"
        )
    effect = effects[present.id]
    values = dict(present.values)
    required = {parameter.name for parameter in effect.parameters}
    neutral = {parameter.name: parameter.neutral for parameter in (*effect.shape, *effect.begins)}
    # Shape parameters and initial states are optional in a file; all others are required.
    if set(values) - set(neutral) != required:
        raise BadInput(
            f"effect {present.id}: takes {', '.join(sorted(required))}, was given "
            f"{', '.join(sorted(values)) or 'nothing'}"
        )
    return effect, neutral | values


@dataclass(frozen=True)
class Family:
    """Effects that act alike.

    Parameters
    ----------
    id
        Its name in diagnosis.json.
    words
        What is missing, in an engineer's words.
    place
        Where it acts: hinges, tip, ground, drive, rig, surroundings, sensor, or joints or bodies of
        a pendulum or mechanism.
    members
        Ids of effects, of the catalogue and of mechanisms.
    """

    id: str
    words: str
    place: str
    members: frozenset[str]


# Families that the search and the decision refer to.
DRY = "joint_dry_loss"
RISING_WITH_SPEED = "joint_loss_with_speed"

FAMILIES = (
    Family(
        "hinge_dissipation",
        "the hinges dissipate energy: friction, damping or hysteresis",
        "hinges",
        frozenset(
            (
                "hinge_coulomb_friction",
                "hinge_viscous_damping",
                "hinge_quadratic_damping",
                "spring_hysteresis",
                "spring_relaxation",
            )
        ),
    ),
    Family(
        "spring_memory",
        (
            "the spring remembers how it was bent: hysteresis, relaxation or dry friction in "
            "the hinges"
        ),
        "hinges",
        frozenset(("spring_hysteresis", "spring_relaxation", "hinge_coulomb_friction")),
    ),
    Family(
        "hinge_stiffness",
        (
            "the torque of the hinges over their angle differs: play, stop, a softer hinge, "
            "another hardening or rest angle, or fading"
        ),
        "hinges",
        frozenset(
            (
                "hinge_backlash",
                "hinge_stop",
                "damaged_hinge",
                "stiffness_hardening",
                "stiffness_fading",
                "hinge_rest_angle",
                "hinge_rest_angle_of_one",
            )
        ),
    ),
    Family(
        "leg_mass",
        "mass sits elsewhere on the leg",
        "tip",
        frozenset(("tip_mass", "heavier_link", "added_mass")),
    ),
    Family(
        "floor_friction",
        "floor friction differs, or is not constant",
        "ground",
        frozenset(("ground_stribeck", "contact_friction")),
    ),
    Family(
        "floor_yields",
        "the floor or what carries it yields",
        "ground",
        frozenset(("ground_compliance", "ground_exponent", "frame_compliance")),
    ),
    Family(
        "contact_compliance",
        "the contacts yield, or lose energy, otherwise than in the model",
        "ground",
        frozenset(("contact_stiffness", "contact_damping", "contact_power")),
    ),
    Family(
        "floor_holds",
        "the floor holds the leg back when it leaves",
        "ground",
        frozenset(("ground_adhesion",)),
    ),
    Family(
        "floor_geometry",
        "the floor is elsewhere than stated: height, slope or a bump",
        "ground",
        frozenset(("height_offset", "ground_tilt", "ground_bump", "prescribed_offset")),
    ),
    Family("rig_tilt", "the rig is not plumb", "rig", frozenset(("gravity_tilt",))),
    Family(
        "rig_yields", "the frame under the shaft yields", "rig", frozenset(("frame_compliance",))
    ),
    Family(
        "drive_yields",
        "the shaft does not turn as commanded: the drive or its coupling yields",
        "drive",
        frozenset(("motor_speed_droop", "motor_torque_limit", "shaft_compliance", "shaft_play")),
    ),
    Family(
        "shaft_friction", "something drags at the shaft", "shaft", frozenset(("shaft_friction",))
    ),
    Family(
        "drive_ripple",
        "the speed of the shaft varies with its angle",
        "drive",
        frozenset(("motor_cogging", "motor_speed_ripple")),
    ),
    Family(
        "air_drag", "the surroundings resist the motion", "surroundings", frozenset(("fluid_drag",))
    ),
    Family(
        "sensor_late",
        "the sensor is late: a filter, a delay or its own swing",
        "sensor",
        frozenset(("sensor_lag", "sensor_ringing", "clock_offset", "sensor_clock_rate")),
    ),
    Family(
        "sensor_scale",
        "the scale of the sensor is wrong: gain, crosstalk or saturation",
        "sensor",
        frozenset(
            (
                "sensor_gain",
                "sensor_gain_of_one",
                "sensor_crosstalk",
                "sensor_crosstalk_matrix",
                "sensor_saturation",
            )
        ),
    ),
    Family(
        "sensor_zero", "the zero of the force sensor moves", "sensor", frozenset(("sensor_drift",))
    ),
    Family(
        "joint_dissipation",
        "the joints dissipate energy: dry, viscous or load-dependent friction",
        "joints",
        frozenset(
            (
                *(
                    "joint_friction",
                    "joint_friction_of_one",
                    "joint_stribeck",
                    "joint_load_friction",
                    "joint_load_friction_of_one",
                ),
                *(
                    "joint_damping",
                    "joint_damping_of_one",
                    "joint_drag",
                    "joint_drag_of_one",
                    "hinge_viscous_damping",
                    "fluid_drag",
                ),
                "joint_hysteresis",
            )
        ),
    ),
    Family(
        DRY,
        "the joints lose torque that hardly depends on their speed: dry or load-dependent friction",
        "joints",
        frozenset(
            (
                *(
                    "joint_friction",
                    "joint_friction_of_one",
                    "joint_stribeck",
                    "joint_load_friction",
                    "joint_load_friction_of_one",
                ),
                "joint_hysteresis",
            )
        ),
    ),
    Family(
        RISING_WITH_SPEED,
        "the joints lose torque that rises with their speed: damping or drag",
        "joints",
        frozenset(
            (
                "joint_damping",
                "joint_damping_of_one",
                "joint_drag",
                "joint_drag_of_one",
                "hinge_viscous_damping",
                "fluid_drag",
            )
        ),
    ),
    Family(
        "joint_position_torque",
        "a torque that follows the position differs: a weight, its lever, a spring or a tilt",
        "joints",
        frozenset(
            ("added_mass", "centre_of_mass", "gravity_tilt", "joint_spring", "joint_spring_of_one")
        ),
    ),
    Family(
        "joint_inertia",
        "the joints carry more inertia",
        "joints",
        frozenset(("joint_inertia", "joint_inertia_of_one", "added_mass")),
    ),
    Family(
        "joint_stiffness",
        "a spring or a stop acts in the joints",
        "joints",
        frozenset(("joint_spring", "joint_spring_of_one", "joint_stop", "joint_hysteresis")),
    ),
    Family(
        "gear_yields",
        "the gears yield between motor and joint: elasticity or play",
        "joints",
        frozenset(
            ("gear_compliance", "gear_compliance_of_one", "gear_backlash", "gear_backlash_of_one")
        ),
    ),
    Family(
        "body_mass",
        "the mass of a body differs, or sits elsewhere",
        "bodies",
        frozenset(("added_mass", "centre_of_mass")),
    ),
    Family(
        "torque_scale",
        "the torque is not what was recorded",
        "joints",
        frozenset(
            (
                *(
                    "torque_scale",
                    "torque_scale_of_one",
                    "torque_lag",
                    "torque_delay",
                    "torque_saturation",
                    "torque_dead_band",
                ),
                *("torque_falls_with_speed", "clock_rate"),
            )
        ),
    ),
)


_WEIGHT = ("joint_position_torque", "joint_inertia", "body_mass")
_LOSS = ("joint_dissipation",)
# Families whose effects act much as an error of a nominal value does, by the name of the value
# without that of its joint, body or actuator.
FAMILIES_OF_VALUES = {
    "mass_relative": _WEIGHT,
    "centre_of_mass_m": _WEIGHT,
    "inertia_relative": _WEIGHT,
    "rotor_inertia_kg_m2": ("joint_inertia",),
    "zero_offset_rad": ("joint_position_torque",),
    "zero_offset_m": ("joint_position_torque",),
    "torque_offset_Nm": ("joint_position_torque", "torque_scale"),
    "joint_damping_Nm_s_per_rad": _LOSS,
    "joint_damping_N_s_per_m": _LOSS,
    "joint_friction_Nm": _LOSS,
    "joint_friction_N": _LOSS,
    "command_gain_relative": ("torque_scale",),
    "command_delay_s": ("torque_scale", "joint_inertia"),
    "torque_delay_s": ("torque_scale", "joint_inertia"),
    "contact_stiffness_relative": ("contact_compliance",),
    "contact_damping_relative": ("contact_compliance",),
    "k0": ("hinge_stiffness",),
    "k2": ("hinge_stiffness",),
    "hinge_damping": ("hinge_dissipation",),
    "mass": ("leg_mass",),
    "height": ("floor_geometry",),
    "friction": ("floor_friction",),
    "presliding": ("floor_friction",),
    "tangential_damping": ("floor_friction",),
    "friction_rise": ("floor_friction",),
    "contact_stiffness": ("floor_yields",),
    "command_delay": ("drive_yields", "sensor_late"),
}


def list_effects_like(values: Iterable[str]) -> frozenset[str]:
    """Effects that act much as errors of these nominal values do, for example of
    "link1.mass_relative".
    """
    names = [value.rpartition(".")[2] for value in values]
    return frozenset().union(
        *(members_of(family) for name in names for family in FAMILIES_OF_VALUES.get(name, ()))
    )


def families() -> tuple[Family, ...]:
    """All families, with the lab's own effects that name one of them."""
    return _families(os.environ.get(FOLDER_VARIABLE))


@cache
def _families(folder: str | None) -> tuple[Family, ...]:
    members: dict[str, set[str]] = {}
    for name, (effect, _) in _lab_effects(folder).items():
        members.setdefault(effect.family, set()).add(name)
    return tuple(
        replace(family, members=family.members | members.get(family.id, set()))
        for family in FAMILIES
    )


def families_of(effect_id: str) -> tuple[Family, ...]:
    """The families that an effect belongs to; a lab's own effect that names none is a family of
    its own.
    """
    matches = tuple(family for family in families() if effect_id in family.members)
    return matches or (Family(effect_id, effect_id.replace("_", " "), "", frozenset((effect_id,))),)


def members_of(family_id: str) -> frozenset[str]:
    """The effects of a family; a lab's own effect that names none is the only one of its own."""
    return next(
        (family.members for family in families() if family.id == family_id), frozenset((family_id,))
    )


def list_related(ids: Iterable[str]) -> frozenset[str]:
    """All members of the families of these effects, themselves among them."""
    return frozenset().union(*(family.members for effect in ids for family in families_of(effect)))
