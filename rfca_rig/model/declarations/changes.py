"""Nominal values that may have changed since a reference was recorded.

Each is an effect like all others, but its law is none: the value itself is another one. They are
candidates only beside a reference. Without one, a nominal value is off within its uncertainty.
"""

from rfca_rig.model.effect import Declaration
from rfca_rig.model.families import FAMILIES_OF_VALUES


def _declare(value: str, where: str, words: str) -> Declaration:
    return Declaration(
        id=f"{value}_change",
        where=where,
        left_out=f"another value of {words}",
        law=f"{value} is another value than in the reference",
        source="the nominal model, with another value",
        families=FAMILIES_OF_VALUES.get(value, ()),
    )


# By the name that the value has among the nuisance parameters.
CHANGES = {
    "k0": _declare("k0", "hinges", "the stiffness of all hinges"),
    "hinge_damping": _declare("hinge_damping", "hinges", "the damping of all hinges"),
    "mass": _declare("mass", "leg", "the mass of the whole leg"),
    "friction": _declare("friction", "ground", "the friction coefficient of the floor"),
    "contact_stiffness": _declare(
        "contact_stiffness", "ground", "the stiffness of the contact with the floor"
    ),
    "start_angle": _declare("start_angle", "shaft", "the zero of the shaft's angle"),
    "height": _declare("height", "rig", "the height of the rack"),
}
VALUE_OF_CHANGE = {declaration.id: value for value, declaration in CHANGES.items()}
