"""Predicted stroke with spring strips of other materials and thicknesses, next to Table I of the
paper.

The fitted hinge stiffness k0 belongs to the CFSP of 0.8 mm and scales with E I. Hardening k2,
damping and the mass of the leg are unchanged, because all strips together weigh 14 g of 320 g.

The strain at the largest hinge angle of the stroke depends on the length over which the strip
bends, which has not been measured. Two lengths bracket it:

- the distance between link centres, which gives the smallest strain;
- E I / k0, the bent length if the fitted k0 comes from the strip alone.

A third figure needs no length: the moment at which the strips break, next to the largest torque of
a hinge. A torque above it cannot be carried by the strips alone.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.phases import Valley, find_valley
from rfca_rig.analysis.prediction import predict_stroke
from rfca_rig.errors import SimulationFailed
from rfca_rig.model.hinge_springs import bending_torque_Nm
from rfca_rig.model.paper.equivalent_stiffness import EncasedStrip, by_its_middle, centre_lay
from rfca_rig.model.paper.strip import Material, Strip, paper_strips, table_1_materials
from rfca_rig.model.parameters import Leg, RigModel
from rfca_rig.progress import ProgressCount, ignore_progress, iterate_with_progress

Floats = NDArray[np.float64]

# The two thicknesses that section II.A of the paper describes.
THICKNESSES_M = (0.8e-3, 0.3e-3)
SWEEP_DEG = 200.0
# Columns of the two printed tables: name, unit, width in characters.
STRIP_COLUMNS = (
    ("density", "g/cm3", 9),
    ("E", "GPa", 9),
    ("strength", "MPa", 10),
    ("EI", "N m2", 10),
    ("K", "N m/rad", 10),
    ("k0", "N m/rad", 10),
)
STROKE_COLUMNS = (
    ("valley", "s", 8),
    ("fz", "N", 9),
    ("angle", "deg", 8),
    ("strain", "%", 8),
    ("stress", "MPa", 8),
    ("used", "%", 17),
)
# The strip of the leg whose k0 was fitted; all other k0 scale from it.
FITTED_STRIP = ("CFSP", 0.8e-3)


@dataclass(frozen=True)
class StrokeWith:
    """The stroke with one strip: valley (or why there is none), largest angle and spring torque
    of any hinge, None if not computed.
    """

    valley_fz_N: float | None
    valley_time_s: float | None
    no_valley: str | None
    largest_angle_rad: float | None
    largest_torque_Nm: float | None


@dataclass(frozen=True)
class Strain:
    """Surface strain of the strip at the largest hinge angle of the stroke. Shares are of the
    bending strength: above 1 the strip breaks.

    `spread` is over the pitch of the links, `concentrated` over E I / k0. `share_torque` holds if
    the strip alone bears the largest torque of a hinge. `needed_length_m` is the bent length per
    hinge above which the strength suffices.
    """

    strain_spread: float
    stress_spread_Pa: float
    share_spread: float
    share_concentrated: float
    share_torque: float
    needed_length_m: float

    def verdict(self) -> str:
        """Whether the strip survives."""
        # A clear verdict needs all three estimates to agree; otherwise the text names the length on
        # which it depends.
        shares = (self.share_spread, self.share_concentrated, self.share_torque)
        if max(shares) <= 1.0:
            return "holds"
        if min(shares) > 1.0:
            return "breaks"
        lives = f"breaks where it bends over less than {1e3 * self.needed_length_m:.1f} mm"
        if self.share_torque > 1.0:
            return f"{lives}, cannot carry the hinge torque alone"
        return lives


@dataclass(frozen=True)
class StripRow:
    """One pair of strips.

    `hinge_Nm_per_rad` is the stiffness of an inner hinge by equation (8), `end_hinge_Nm_per_rad`
    that of the first and last hinge. `k0_Nm_per_rad` is the fitted stiffness, scaled. `strain` is
    None where the stroke could not be computed.
    """

    material: Material
    thickness_m: float
    EI_Nm2: float
    hinge_Nm_per_rad: float
    end_hinge_Nm_per_rad: float
    k0_Nm_per_rad: float
    stroke: StrokeWith
    strain: Strain | None

    def verdict(self) -> str:
        """Whether the strip survives, as far as known."""
        if self.strain is None:
            return "strain not known"
        return self.strain.verdict()

    def describe(self) -> str:
        """The verdict, and why there is no valley."""
        if self.stroke.no_valley is None:
            return self.verdict()
        return f"{self.verdict()}; no valley: {self.stroke.no_valley}"


@dataclass(frozen=True)
class StripComparison:
    """All rows for one stroke."""

    height_m: float
    speed_rad_s: float
    pitch_m: float
    concentrated_m: float
    rows: tuple[StripRow, ...]

    def summary(self) -> dict[str, object]:
        """Plain data, every name with its unit."""
        return {
            **asdict(self),
            "rows": [{**asdict(row), "verdict": row.verdict()} for row in self.rows],
        }

    def lines(self) -> list[str]:
        """Two tables for a terminal, 80 columns wide, and a verdict on each strip."""
        return [
            "two strips of 226 x 25.4 mm, and k0 in proportion to EI:",
            *_table(STRIP_COLUMNS, [_strip_cells(row) for row in self.rows]),
            f"stroke of {1e3 * self.height_m:g} mm, {self.speed_rad_s:g} rad/s:",
            *_table(STROKE_COLUMNS, [_stroke_cells(row) for row in self.rows]),
            (
                f"strength used: spread over {1e3 * self.pitch_m:.1f} mm at each hinge / over "
                f"{1e3 * self.concentrated_m:.1f} mm / by torque"
            ),
            *(f"{_name(row)}  {row.describe()}" for row in self.rows),
        ]


def compare_strips(
    rig: RigModel,
    height_m: float,
    speed_rad_s: float,
    report_progress: ProgressCount = ignore_progress,
) -> StripComparison:
    """Predict one stroke with the four materials of Table I at 0.8 and 0.3 mm.

    Parameters
    ----------
    rig
        Rig whose k0 is taken to be that of the 0.8 mm CFSP.
    height_m, speed_rad_s
        Condition of the stroke.
    report_progress
        Progress callback.

    Raises
    ------
    BadInput
        Where the strip does not fit the leg.

    Notes
    -----
    A strip for which the model cannot be computed keeps its row, with the reason.
    """
    materials = {material.name: material for material in table_1_materials()}
    fitted = paper_strips(materials[FITTED_STRIP[0]], FITTED_STRIP[1])
    strips = list(product(THICKNESSES_M, materials.values()))
    rows = tuple(
        _row(rig, paper_strips(m, t), fitted, height_m, speed_rad_s)
        for t, m in iterate_with_progress(strips, report_progress)
    )
    return StripComparison(
        height_m,
        speed_rad_s,
        _pitch_m(rig.leg),
        fitted.bending_stiffness_Nm2 / rig.leg.k0_Nm_per_rad,
        rows,
    )


def _row(
    rig: RigModel, strip: Strip, fitted: Strip, height_m: float, speed_rad_s: float
) -> StripRow:
    EI = strip.bending_stiffness_Nm2
    # In a pseudo-rigid-body model every hinge stiffness is proportional to E I, so the fitted value
    # scales with it.
    k0 = rig.leg.k0_Nm_per_rad * EI / fitted.bending_stiffness_Nm2
    lay = centre_lay(rig.leg.link_lengths_m, strip.length_m)
    # Stiffness of the unbent strip, equation (8) at phi = 0.
    encased = EncasedStrip(strip.bending_stiffness_Nm2, lay, by_its_middle(lay))
    stiffness = encased.difference_stiffness(np.zeros(lay.pins_m.size))
    stroke = _stroke(replace(rig, leg=replace(rig.leg, k0_Nm_per_rad=k0)), height_m, speed_rad_s)
    angle = stroke.largest_angle_rad
    torque = stroke.largest_torque_Nm
    strain = None
    if angle is not None and torque is not None:
        strain = _strain(strip, angle, torque, _pitch_m(rig.leg), EI / k0)
    return StripRow(
        material=strip.material,
        thickness_m=strip.thickness_m,
        EI_Nm2=EI,
        hinge_Nm_per_rad=float(stiffness[1:-1].mean()),
        end_hinge_Nm_per_rad=float(stiffness[0]),
        k0_Nm_per_rad=k0,
        stroke=stroke,
        strain=strain,
    )


def _strain(
    strip: Strip, angle_rad: float, torque_Nm: float, pitch_m: float, concentrated_m: float
) -> Strain:
    spread = angle_rad / pitch_m
    limit = strip.breaking_curvature_per_m
    return Strain(
        strain_spread=strip.strain_at(spread),
        stress_spread_Pa=strip.stress_at_Pa(spread),
        share_spread=spread / limit,
        share_concentrated=angle_rad / concentrated_m / limit,
        share_torque=torque_Nm / strip.breaking_moment_Nm,
        needed_length_m=angle_rad / limit,
    )


def _pitch_m(leg: Leg) -> float:
    """Mean distance between link centres, of the links between the end links."""
    return float(np.mean(leg.link_lengths_m[1:-1]))


def _stroke(rig: RigModel, height_m: float, speed_rad_s: float) -> StrokeWith:
    try:
        stroke = predict_stroke(rig, height_m, speed_rad_s, SWEEP_DEG).stroke
    except SimulationFailed as error:
        # The text after the semicolon is advice for a rig file, which does not apply to a strip of
        # a table.
        return StrokeWith(None, None, str(error).split(";")[0], None, None)
    angle = float(np.abs(np.diff(stroke.q_rad, axis=1)).max())
    torque = float(bending_torque_Nm(rig.leg, np.array(angle)))
    # Without a free start the stroke has no touchdown, and its minimum of fz would be no valley.
    if stroke.normal_N[0].any():
        return StrokeWith(None, None, "the leg lies on the ground before it starts", angle, torque)
    valley = find_valley(stroke.t_s, stroke.fz_N)
    if isinstance(valley, Valley):
        return StrokeWith(valley.fz_N, valley.time_s, None, angle, torque)
    return StrokeWith(None, None, valley.reason, angle, torque)


def _name(row: StripRow) -> str:
    return f"{row.material.name:4} {1e3 * row.thickness_m:3.1f} mm"


def _table(columns: Sequence[tuple[str, str, int]], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table; `columns` are (name, unit, width), printed to the right of the strip's
    name.
    """
    widths = [width for _, _, width in columns]
    heads = [[name for name, _, _ in columns], [unit for _, unit, _ in columns]]
    return [_line("", widths, head) for head in heads] + [
        _line(row[0], widths, row[1:]) for row in rows
    ]


def _line(name: str, widths: Sequence[int], cells: Sequence[str]) -> str:
    return f"{name:11}" + "".join(
        f"{cell:>{width}}" for cell, width in zip(cells, widths, strict=True)
    )


def _strip_cells(row: StripRow) -> list[str]:
    m = row.material
    table_1 = [
        f"{m.density_kg_m3 / 1e3:.2f}",
        f"{m.youngs_modulus_Pa / 1e9:.3f}",
        f"{m.bending_strength_Pa / 1e6:.0f}",
    ]
    return [
        _name(row),
        *table_1,
        f"{row.EI_Nm2:.3g}",
        f"{row.hinge_Nm_per_rad:.3g}",
        f"{row.k0_Nm_per_rad:.3g}",
    ]


def _stroke_cells(row: StripRow) -> list[str]:
    strain = row.strain
    angle = row.stroke.largest_angle_rad
    stroke = row.stroke
    has_valley = stroke.valley_time_s is not None and stroke.valley_fz_N is not None
    if has_valley:
        valley = [f"{stroke.valley_time_s:.3f}", f"{stroke.valley_fz_N:.2f}"]
    else:
        valley = ["-", "-"]
    if strain is None or angle is None:
        return [_name(row), *valley, "-", "-", "-", "-"]
    used = (
        f"{100 * strain.share_spread:.0f} / {100 * strain.share_concentrated:.0f} / "
        f"{100 * strain.share_torque:.0f}"
    )
    bent = [
        f"{np.degrees(angle):.1f}",
        f"{100 * strain.strain_spread:.2f}",
        f"{strain.stress_spread_Pa / 1e6:.1f}",
    ]
    return [_name(row), *valley, *bent, used]
