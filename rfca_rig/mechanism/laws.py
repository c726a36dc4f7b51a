"""Makes effects of a law that may act in each joint, actuator or sensor: one in all of them, each with its own size, and one in one."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.mechanism.load import Mechanism
from rfca_rig.mechanism.plant import Change, Plant
from rfca_rig.model.effect import Effect, Parameter, Values

Floats = NDArray[np.float64]

JOINTS = "joints"
# Shares of the usual magnitude on the rig. A smaller effect is lost in the usual model error of 1 %; with a larger one the joint
# would hardly move. With a tenth and ten times these bounds the log evidence of friction of a pendulum changes by less than 1.
SMALLEST, LARGEST = 0.002, 0.8


@dataclass(frozen=True)
class PlaceLaw:
    """A law with one size per joint (or actuator): `low` and `high` (k,) are its plausible range, `change` puts it into a plant.

    `groups` are names and places, within `places`, of those that share a size; each has its own where there are none. `starts` are values
    from which the search of a law with one size begins.
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
    starts: tuple[float, ...] = ()


def joint_units(mechanism: Mechanism, of_hinge: str, of_slide: str) -> tuple[str, ...]:
    """Unit at the end of the parameter's name, for each joint."""
    return tuple(of_slide if slides else of_hinge for slides in mechanism.is_slide)


def join_name(*parts: str) -> str:
    """Name of a parameter from the parts that are not empty."""
    return "_".join(part for part in parts if part)


def group_places(mechanism: Mechanism, names: tuple[str, ...]) -> tuple[tuple[str, tuple[int, ...]], ...]:
    """Indices of objects of the same type by the name of their group, and of each other one by its own name."""
    groups = {
        name: members for name, of_make in mechanism.alike.items() if (members := tuple(names.index(n) for n in of_make if n in names))
    }
    grouped = {member for members in groups.values() for member in members}
    single = {name: (place,) for place, name in enumerate(names) if place not in grouped}
    return tuple({**single, **groups}.items())


def expand_law(law: PlaceLaw) -> Iterator[Effect]:
    """The effect of the law in all its joints; with several joints, the effect in one of them, too."""
    places, many = law.places, len(law.places) > 1
    groups = law.groups or tuple((one, (place,)) for place, one in enumerate(law.objects))
    names = [join_name(one if len(groups) > 1 else "", law.quantity, law.units[members[0]]) for one, members in groups]

    def in_all(plant: Plant, values: Values) -> Plant:
        for (_, members), name in zip(groups, names, strict=True):
            for member in members:
                law.change(plant, places[member], values[name])
        return plant

    ranges = [(float(law.low[list(members)].min()), float(law.high[list(members)].max())) for _, members in groups]
    starts = law.starts if len(groups) == 1 else ()
    parameters = tuple(
        Parameter(name, low, high, may_be_zero=False, starts=starts) for name, (low, high) in zip(names, ranges, strict=True)
    )
    yield Effect(law.id, JOINTS, law.left_out, law.law, law.source, parameters, in_all, variant_of=law.variant_of)
    if many:
        size = join_name(law.quantity, law.units[0] if len(set(law.units)) == 1 else "SI")

        def in_one(plant: Plant, values: Values) -> Plant:
            law.change(plant, places[int(values[law.noun]) - 1], values[size])
            return plant

        counted = Parameter(law.noun, 1.0, float(len(places)), may_be_zero=False, whole=True)
        sized = Parameter(size, float(law.low.min()), float(law.high.max()), may_be_zero=False)
        words = f"{law.left_out}, of one {law.noun}"
        # The numbers are not those of the model, so the text lists them.
        if places != tuple(range(len(places))):
            words += f" ({', '.join(f'{number} is {name}' for number, name in enumerate(law.objects, start=1))})"
        yield Effect(f"{law.id}_of_one", JOINTS, words, law.law, law.source, (counted, sized), in_one, variant_of=law.variant_of or law.id)
