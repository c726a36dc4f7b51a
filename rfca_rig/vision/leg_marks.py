"""Positions of the red marks on the leg."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rfca_rig.errors import BadInput

Floats = NDArray[np.float64]
DIAMETER_M = 0.008


@dataclass(frozen=True)
class PlannedMark:
    """A mark on a link (1 is at the shaft): distance along the link from its hinge, and across
    it, positive towards growing angles.
    """

    link: int
    along_m: float
    across_m: float = 0.0


@dataclass(frozen=True)
class MarkPlan:
    """All marks of a leg in their order from the shaft outwards, and their common diameter."""

    marks: tuple[PlannedMark, ...]
    diameter_m: float = DIAMETER_M

    def __post_init__(self) -> None:
        if not self.marks or not self.diameter_m > 0.0:
            raise BadInput("marks: a plan needs at least one mark and a diameter above zero")
        if any(mark.link < 1 for mark in self.marks):
            raise BadInput("marks: links are counted from 1, the one at the shaft")
        if any(a.link > b.link for a, b in zip(self.marks, self.marks[1:], strict=False)):
            raise BadInput("marks: list the marks in their order from the shaft outwards")

    @classmethod
    def at_hinges(
        cls, link_lengths_m: Sequence[float], diameter_m: float = DIAMETER_M
    ) -> "MarkPlan":
        """A mark on the shaft axis, one on every hinge axis, one at the tip: joints + 1 in all."""
        hinges = [PlannedMark(link, 0.0) for link in range(1, len(link_lengths_m) + 1)]
        return cls(
            (*hinges, PlannedMark(len(link_lengths_m), float(link_lengths_m[-1]))), diameter_m
        )

    def name(self, index: int) -> str:
        """Readable name of the mark."""
        mark = self.marks[index]
        if mark.along_m == 0.0 and mark.across_m == 0.0:
            if mark.link == 1:
                return "shaft mark"
            return f"mark at hinge {mark.link}"
        if index == len(self.marks) - 1 and mark.across_m == 0.0:
            return "tip mark"
        return f"mark on link {mark.link}, {mark.along_m * 1e3:.1f} mm from its hinge"


def mark_positions(link_angles_rad: ArrayLike, link_lengths_m: ArrayLike, plan: MarkPlan) -> Floats:
    """Centres of the planned marks.

    Parameters
    ----------
    link_angles_rad : (..., links) array
        Absolute angles, positive downwards from +y.
    link_lengths_m : (links,) array
        From the shaft outwards.
    plan : MarkPlan
        Positions of the marks on the leg.

    Returns
    -------
    (..., marks, 2) array
        (y, z) in metres from the shaft axis, z up.

    Raises
    ------
    BadInput
        Where the plan names a link that the leg does not have.
    """
    angles = np.asarray(link_angles_rad, dtype=np.float64)
    lengths = np.asarray(link_lengths_m, dtype=np.float64)
    links = np.array([mark.link for mark in plan.marks]) - 1
    if links.max() >= lengths.shape[-1]:
        raise BadInput(
            f"marks: the plan names link {links.max() + 1}, the leg has {lengths.shape[-1]} links"
        )
    outwards = np.stack([np.cos(angles), -np.sin(angles)], axis=-1)
    sideways = np.stack([-np.sin(angles), -np.cos(angles)], axis=-1)
    ends = np.cumsum(outwards * lengths[..., None], axis=-2)
    hinges = np.concatenate([np.zeros_like(ends[..., :1, :]), ends[..., :-1, :]], axis=-2)
    along = np.array([[mark.along_m] for mark in plan.marks])
    across = np.array([[mark.across_m] for mark in plan.marks])
    return np.asarray(
        hinges[..., links, :] + along * outwards[..., links, :] + across * sideways[..., links, :]
    )
