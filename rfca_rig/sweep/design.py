"""One design of leg and stroke, and its rig model."""

from dataclasses import dataclass, replace

import numpy as np

from rfca_rig.model.paper.strip import Strip, cell_m, paper_strips, table_1_materials, with_first_link, with_links
from rfca_rig.model.parameters import Leg, PresentEffect, RigModel

FITTED_STRIP = paper_strips({material.name: material for material in table_1_materials()}["CFSP"], 0.8e-3)
"""The strip of which the nominal k0 is taken to be: the paper's, two pieces of CFSP of 0.8 mm."""


@dataclass(frozen=True)
class SweepCase:
    """One simulated design. `rig` is the nominal model with its own links and strip; `strip`, `links` and `first_link_m` are applied last.

    k0, k2 and hinge damping are therefore always those of the nominal leg. Other links and strips are derived from it.
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
        return replace(self.rig, leg=leg if self.links is None else with_links(leg, self.links))

    def cell_m(self) -> float:
        """The length of strip that each hinge represents; see `model.paper.strip`. Raises BadInput."""
        leg = self._leg()
        hinges = len(leg.link_lengths_m) - 1
        # Fewer hinges share the same strip, so each represents more of it.
        return cell_m(leg) * (1.0 if self.links is None else hinges / (self.links - 1))

    def _leg(self) -> Leg:
        """With its strip and first link, before it is divided into other links."""
        leg = replace_strip(self.rig, self.strip).leg
        return leg if self.first_link_m is None else with_first_link(leg, self.first_link_m)


def replace_strip(rig: RigModel, strip: Strip) -> RigModel:
    """The rig with another strip in its leg: k0 scales with E I, and the change of the strips' mass is spread over the links in proportion.

    Hardening and hinge damping are unchanged, as in `analysis.strips`.
    """
    fitted, leg = FITTED_STRIP, rig.leg
    # The paper's strip leaves the rig bitwise as it is.
    if strip == fitted:
        return rig
    heavier = 1.0 + (strip.mass_kg - fitted.mass_kg) / sum(leg.link_masses_kg)
    k0 = leg.k0_Nm_per_rad * strip.bending_stiffness_Nm2 / fitted.bending_stiffness_Nm2
    return replace(rig, leg=replace(leg, k0_Nm_per_rad=k0, link_masses_kg=tuple(heavier * mass for mass in leg.link_masses_kg)))


def set_effect_value(rig: RigModel, id_: str, name: str, value: float) -> RigModel:
    """The rig with one parameter of an effect set; an effect that is absent is added."""
    if not any(present.id == id_ for present in rig.effects):
        return replace(rig, effects=(*rig.effects, PresentEffect(id_, ((name, value),))))
    return replace(rig, effects=tuple(_with_value(each, name, value) if each.id == id_ else each for each in rig.effects))


def _with_value(present: PresentEffect, name: str, value: float) -> PresentEffect:
    return replace(present, values=tuple({**dict(present.values), name: value}.items()))
