"""A law that may act in each joint, actuator or sensor: as an effect in all of them, each with a size of its own, and in one."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.mechanism.load import Mechanism
from rfca_rig.mechanism.plant import Change, Plant
from rfca_rig.model.effect import Effect, Parameter, Values

Floats = NDArray[np.float64]

JOINTS = "joints"
# Shares of what is usual on the rig. Below the first an effect is lost in the usual model error of 1 %; with more than the second the joint
# would hardly move. With a tenth and ten times these bounds the log evidence of friction of a pendulum changes by less than 1.
SMALLEST, LARGEST = 0.002, 0.8


@dataclass(frozen=True)
class PlaceLaw:
    """A law with one size per joint (or actuator): `low` and `high` (k,) are its plausible range, `change` puts it into a plant.

    `groups` are names and places, within `places`, of those that share a size; each has its own where there are none.
    """

    id: str
    left_out: str
    law: str
    source: str
    quantity: str
    units: tuple[str, ...]
    objects: tuple[str, ...]
    places: tuple[int, ...]
    low: Floats
    high: Floats
    change: Change
    noun: str = "joint"
    variant_of: str = ""
    groups: tuple[tuple[str, tuple[int, ...]], ...] = ()


def joint_units(mechanism: Mechanism, of_hinge: str, of_slide: str) -> tuple[str, ...]:
    """What ends the name of a size of each joint."""
    return tuple(of_slide if slides else of_hinge for slides in mechanism.is_slide)


def join_name(*parts: str) -> str:
    """The name of a size, of the parts that are not empty."""
    return "_".join(part for part in parts if part)


def group_places(mechanism: Mechanism, names: tuple[str, ...]) -> tuple[tuple[str, tuple[int, ...]], ...]:
    """The places of those of one make, by the name of their group, or of the only one."""
    found = {
        name: members for name, of_make in mechanism.alike.items() if (members := tuple(names.index(n) for n in of_make if n in names))
    }
    grouped = {member for members in found.values() for member in members}
    single = {name: (place,) for place, name in enumerate(names) if place not in grouped}
    return tuple({**single, **found}.items())


def expand_law(law: PlaceLaw) -> Iterator[Effect]:
    """The law in all its joints, and where there are several in one of them."""
    places, many = law.places, len(law.places) > 1
    groups = law.groups or tuple((one, (place,)) for place, one in enumerate(law.objects))
    names = [join_name(one if len(groups) > 1 else "", law.quantity, law.units[members[0]]) for one, members in groups]

    def in_all(plant: Plant, values: Values) -> Plant:
        for (_, members), name in zip(groups, names, strict=True):
            for member in members:
                law.change(plant, places[member], values[name])
        return plant

    ranges = [(float(law.low[list(members)].min()), float(law.high[list(members)].max())) for _, members in groups]
    parameters = tuple(Parameter(name, low, high, may_be_zero=False) for name, (low, high) in zip(names, ranges, strict=True))
    yield Effect(law.id, JOINTS, law.left_out, law.law, law.source, parameters, in_all, variant_of=law.variant_of)
    if many:
        size = join_name(law.quantity, law.units[0] if len(set(law.units)) == 1 else "SI")

        def in_one(plant: Plant, values: Values) -> Plant:
            law.change(plant, places[int(values[law.noun]) - 1], values[size])
            return plant

        counted = Parameter(law.noun, 1.0, float(len(places)), may_be_zero=False, whole=True)
        sized = Parameter(size, float(law.low.min()), float(law.high.max()), may_be_zero=False)
        words = f"{law.left_out}, of one {law.noun}"
        if places != tuple(range(len(places))):  # numbers are not those of the model
            words += f" ({', '.join(f'{number} is {name}' for number, name in enumerate(law.objects, start=1))})"
        yield Effect(f"{law.id}_of_one", JOINTS, words, law.law, law.source, (counted, sized), in_one, variant_of=law.variant_of or law.id)
