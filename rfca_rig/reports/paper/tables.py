"""Tables of section IV: materials, valleys as in the paper, and predicted valleys with their
intervals.
"""

from collections.abc import Mapping

import numpy as np

from rfca_rig.analysis.reproduction import ReproducedCondition, Reproduction
from rfca_rig.analysis.valley_uncertainty import PredictedQuantity, PredictedValley
from rfca_rig.model.paper.strip import paper_strips, table_1_materials
from rfca_rig.reports.strokes.tables import as_table
from rfca_rig.reports.table import Foot, Table, TableColumn, TableRow, Value
from rfca_rig.reports.text import SHAFT_WORDS, count_noun

MEASURED = "Measured valley"
PREDICTED = "Predicted valley"
ERROR = "Error"
INSIDE = "In the interval"
# Parameters that are named as the source of an interval.
MOST_SOURCES = 2
# A parameter with a smaller share of the variance is not named.
LEAST_SHARE = 0.1

VALLEY_COLUMNS = (
    TableColumn("height_mm", "Rack height", set_value=True),
    TableColumn("speed_rad_s", "Speed", set_value=True),
    TableColumn("measured_time_s", "time", digits=4, half="measured_time_std_s", over=MEASURED),
    TableColumn("measured_time_std_s", role="kept"),
    TableColumn("measured_fz_N", "fz", digits=2, half="measured_fz_std_N", over=MEASURED),
    TableColumn("measured_fz_std_N", role="kept"),
    TableColumn("predicted_time_s", "time", digits=4, half="predicted_time_half_s", over=PREDICTED),
    TableColumn("predicted_time_half_s", role="kept"),
    TableColumn("predicted_fz_N", "fz", digits=2, half="predicted_fz_half_N", over=PREDICTED),
    TableColumn("predicted_fz_half_N", role="kept"),
    TableColumn("time_error_pct", "time", digits=2, over=ERROR),
    TableColumn("force_error_pct", "fz", digits=2, over=ERROR),
    TableColumn("time_inside", "time", over=INSIDE),
    TableColumn("fz_inside", "fz", over=INSIDE),
    TableColumn("sources", role="note"),
)
MATERIAL_COLUMNS = (
    TableColumn("material", "Material"),
    TableColumn("density_g_cm3", "Density (g/cm³)"),
    TableColumn("youngs_modulus_GPa", "Young's modulus (GPa)"),
    TableColumn("specific_modulus", "Specific modulus (GPa cm³/g)"),
    TableColumn("poisson_ratio", "Poisson's ratio"),
    TableColumn("strength_MPa", "Bending strength (MPa)"),
    TableColumn("EI_N_m2", "E I of the pair (N m²)"),
    TableColumn("breaking_moment_Nm", "Breaking moment of the pair (N m)"),
)


def make_table2(reproduction: Reproduction) -> Table:
    """Table II as the paper makes it, with nothing fitted to the strokes."""
    return as_table(reproduction.table2, SHAFT_WORDS["average"])


def make_valley_table(reproduction: Reproduction) -> Table:
    """Measured and predicted valleys along the recorded shaft, with 95 % intervals."""
    rows = []
    for shown in reproduction.by_height:
        is_outside = False in (shown.valley.time.is_inside, shown.valley.fz.is_inside)
        rows.append(TableRow(describe_valley(shown), marked=is_outside))
    table2 = reproduction.table2_recorded
    averages = {
        "time_error_pct": table2.average_time_error_pct,
        "force_error_pct": table2.average_force_error_pct,
    }
    caption = (
        "Valley of fz along the recorded shaft. Measured: mean ± one standard deviation (n - 1) "
        "over the repeats. Predicted ± half of the 95 % interval for the mean of the repeats: the "
        "uncertainty of every value in [known_to], and the scatter of the measured mean."
    )
    counted = count_noun(len(rows), "condition")
    foot = (Foot(f"Average over {counted}", averages),)
    return Table("predicted-valleys", caption, VALLEY_COLUMNS, tuple(rows), foot)


def describe_valley(shown: ReproducedCondition) -> Mapping[str, Value]:
    """A row of the table of predicted valleys under its keys."""
    valley = shown.valley
    row = valley.row
    return {
        "height_mm": round(1e3 * row.height_m, 3),
        "speed_rad_s": round(row.speed_rad_s, 5),
        "measured_time_s": row.time.mean,
        "measured_time_std_s": row.time.std,
        "measured_fz_N": row.fz.mean,
        "measured_fz_std_N": row.fz.std,
        "predicted_time_s": row.simulated_time_s,
        "predicted_time_half_s": valley.time.half_95,
        "predicted_fz_N": row.simulated_fz_N,
        "predicted_fz_half_N": valley.fz.half_95,
        "time_error_pct": row.time_error_pct,
        "force_error_pct": row.force_error_pct,
        "time_inside": _yes_or_no(valley.time),
        "fz_inside": _yes_or_no(valley.fz),
        "sources": _name_sources(valley),
    }


def _yes_or_no(quantity: PredictedQuantity) -> str:
    inside = quantity.is_inside
    if inside is None:
        return "not known"
    if inside:
        return "yes"
    return "no"


def _name_sources(valley: PredictedValley) -> str:
    """The parameters from which most of the intervals comes, with their share of the variance."""
    parts = []
    for words, column in (("time", 0), ("fz", 1)):
        variances = valley.effects[:, column] ** 2
        if not np.isfinite(variances).all() or not variances.sum():
            continue
        shares = variances / variances.sum()
        named = [
            f"{100 * shares[index]:.0f} % {valley.names[index].replace('_', ' ')}"
            for index in np.argsort(-shares)[:MOST_SOURCES]
            if shares[index] > LEAST_SHARE
        ]
        parts.append(f"{words} {', '.join(named)}")
    if not parts:
        return ""
    return f"variance of the model's part of the interval: {'; '.join(parts)}"


def make_material_table() -> Table:
    """Table I of the paper, and what two strips of each material bear."""
    rows = []
    for material in table_1_materials():
        strips = paper_strips(material)
        density_g_cm3 = 1e-3 * material.density_kg_m3
        modulus_GPa = 1e-9 * material.youngs_modulus_Pa
        # Two digits of the softest one, two decimals of the others, as in the paper.
        specific_modulus = f"{modulus_GPa / density_g_cm3:.2f}"
        if modulus_GPa < density_g_cm3:
            specific_modulus = f"{modulus_GPa / density_g_cm3:.2g}"
        rows.append(
            TableRow(
                {
                    "material": material.name,
                    "density_g_cm3": f"{density_g_cm3:.2f}",
                    "youngs_modulus_GPa": f"{modulus_GPa:g}",
                    "specific_modulus": specific_modulus,
                    "poisson_ratio": f"{material.poisson_ratio:g}",
                    "strength_MPa": f"{1e-6 * material.bending_strength_Pa:g}",
                    "EI_N_m2": f"{strips.bending_stiffness_Nm2:.3g}",
                    "breaking_moment_Nm": f"{strips.breaking_moment_Nm:.3g}",
                }
            )
        )
    caption = (
        "Table I of the paper. VMQ, PA12 and CFRP are its estimates for common materials. The last "
        "two columns are computed for a pair of strips of 226 x 25.4 x 0.8 mm."
    )
    return Table("table1", caption, MATERIAL_COLUMNS, tuple(rows))
