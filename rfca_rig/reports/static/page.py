"""static.html: one self-contained page on the torque-rotation curve and the static stages."""

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from rfca_rig.analysis.torque_rotation.static_result import (
    PredictedHingeCurve,
    StaticResult,
    remarks,
)
from rfca_rig.drivers.photo_files import read_picture
from rfca_rig.errors import BadInput, RigError
from rfca_rig.recording.model import StaticStage
from rfca_rig.reports.provenance import PageContext
from rfca_rig.reports.static.pictures import (
    DASHES,
    ELASTICA_STYLES,
    draw_residuals,
    draw_stiffness,
    draw_torque,
)
from rfca_rig.reports.static.tables import (
    StaticSource,
    curve_table,
    elastica_table,
    hinges_table,
    repeats_table,
    systematic_errors_table,
)
from rfca_rig.reports.table import Table, TableRow, places
from rfca_rig.reports.templates import template
from rfca_rig.reports.text import NOTHING, count_noun, keep_units_together, number

# Photos are embedded in the page: reduced to this width, and with this JPEG quality, to keep it
# small.
WIDTH_PX = 420
QUALITY = 82


@dataclass(frozen=True)
class StagePhoto:
    """Photo of one stage: `data` is the data URI of an <img>; where there is none, `missing`
    states why.
    """

    stage: StaticStage
    data: str
    missing: str
    doubts: str


def photos_of(source: StaticSource) -> list[StagePhoto]:
    """Photos of the stages that have one, preferring the overlay. A missing file is reported on
    the page, and is not an error.
    """
    with_photo = [stage for stage in source.recording.static if stage.photo or stage.overlay]
    return [_picture(source, stage) for stage in with_photo]


def _picture(source: StaticSource, stage: StaticStage) -> StagePhoto:
    path = source.folder / (stage.overlay or stage.photo)
    try:
        image = read_picture(path)
    except BadInput as error:
        return StagePhoto(
            stage, "", str(error).split(";")[0].replace(f"{path.parent}/", ""), stage.photo_doubts
        )
    # As JPEG: the same image gives the same bytes.
    rows, columns = image.shape[:2]
    if columns > WIDTH_PX:
        image = np.asarray(
            cv2.resize(
                image,
                (WIDTH_PX, max(1, round(rows * WIDTH_PX / columns))),
                interpolation=cv2.INTER_AREA,
            ),
            np.uint8,
        )
    done, content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not done:
        raise RigError(f"a picture of {columns} x {rows} pixels cannot be written as JPEG")
    return StagePhoto(
        stage,
        "data:image/jpeg;base64," + b64encode(content.tobytes()).decode("ascii"),
        "",
        stage.photo_doubts,
    )


def photos_by_source(sources: Sequence[StaticSource]) -> list[tuple[str, list[StagePhoto]]]:
    """Photos by source, of the sources that have any."""
    return [(source.name, strip) for source in sources if (strip := photos_of(source))]


def page(
    result: StaticResult,
    sources: Sequence[StaticSource],
    elastica: Sequence[PredictedHingeCurve],
    context: PageContext,
    files: Sequence[str],
) -> str:
    """The page as HTML.

    Parameters
    ----------
    result
        The torque-rotation curve and what it was found from.
    sources
        Recordings in the order of `result.data.recording`.
    elastica
        Curves that the elastica predicts for the paper's strip.
    context
        Origin of the page; `context.model_file` names the model that replaced the recordings'
        nominal one.
    files
        Names of the files beside the page, which it links.
    """
    return template("static.html").render(
        sheets=("static.css",),
        origin=context.origin,
        links=context.links,
        files=files,
        title=" · ".join(dict.fromkeys(source.recording.title for source in sources)),
        sources=[
            {
                "mark": s.recording.source,
                "text": f"{s.name}: {count_noun(len(s.recording.static), 'static stage')}",
            }
            for s in sources
        ],
        values=_values(result),
        standfirst=_standfirst(result),
        remarks=[keep_units_together(_signs(text)) for text in remarks(result)],
        torque=draw_torque(result, elastica),
        stiffness=draw_stiffness(result, elastica),
        rest=draw_residuals(result),
        rest_sentence=_rest_sentence(result),
        angles=count_noun(int(result.data.seen.sum()), "hinge angle"),
        curve=curve_table(result.curve, int(result.data.seen.sum())),
        elastica=[
            {"says": curve.says, "style": style}
            for curve, style in zip(elastica, ELASTICA_STYLES, strict=True)
        ],
        elastica_table=elastica_table(elastica, result),
        hinges=hinges_table(result),
        hinge_numbers=[check.hinge for check in result.hinges],
        loop_sentence=_loop(result),
        loop_seen=result.loop is not None and result.loop.seen,
        common=_with_apostrophes(systematic_errors_table(result)),
        noise=_noise(result),
        gain_counts_as_exact=all(
            error.says != "gain of the force sensor" for error in result.systematic_errors
        ),
        repeats=repeats_table(result, [source.name for source in sources]),
        strips=[
            {"name": name, "pictures": [_photo(picture) for picture in strip]}
            for name, strip in photos_by_source(sources)
        ],
        stages=_stages(result, sources),
        several=len(sources) > 1,
        model=f"the model in {context.model_file}" if context.model_file else "the nominal model",
        has_model="model.toml" in files,
        has_curve="model-curve.toml" in files,
        rest_sentence_of_hinges=_rest_angles(result),
        law_holds=result.form.holds,
        dashes={
            name: " ".join(f"{2.2 * part:g}" for part in pattern)
            for name, (_, pattern) in DASHES.items()
        },
    )


def _with_apostrophes(table: Table) -> Table:
    """The table with typographic apostrophes."""
    return replace(
        table,
        rows=tuple(
            TableRow(
                {**r.values, "what": str(r.values["what"]).replace("'", "\u2019")},
                r.digits,
                r.marked,
            )
            for r in table.rows
        ),
    )


def _signs(text: str) -> str:
    return (
        text.replace("+-", "±")
        .replace("phi^3", "φ³")
        .replace("phi", "φ")
        .replace("chi2", "χ²")
        .replace("k2", "k₂")
        .replace("k0", "k₀")
    )


def _values(result: StaticResult) -> list[dict[str, str]]:
    values = result.values
    pairs = (
        ("k₀", values.k0_Nm_per_rad, values.k0_std, "N m/rad"),
        ("k₂", values.k2_per_rad2, values.k2_std, "1/rad²"),
    )
    return [
        {
            "name": name,
            "value": _fit(value, values.reach * std),
            "half": _fit(values.reach * std, values.reach * std),
            "unit": unit,
            "relative": f"{100 * values.reach * std / abs(value):.2g} %",
        }
        for name, value, std, unit in pairs
    ]


def _fit(value: float, error: float) -> str:
    """A value with as many decimals as show two digits of its error."""
    return number(value, max(places(error, 2), 0) if error > 0.0 else 3)


def _standfirst(result: StaticResult) -> str:
    curve = result.curve
    low, high = sorted(abs(float(np.degrees(angle))) for angle in curve.range_rad)
    grid = curve.grid_rad()
    torque, std = curve.torque_Nm(grid)
    # A relative error is stated for large torques only: near zero torque it has no meaning.
    half = np.abs(torque) > 0.5 * np.abs(torque).max()
    share = 100 * float((curve.reach * std[half] / np.abs(torque[half])).max())
    if result.form.holds:
        law = "the law k₀ (φ + k₂ φ³) holds"
    else:
        law = "the law k₀ (φ + k₂ φ³) does not hold"
    return keep_units_together(
        f"From {low:.1f} to {high:.1f} degrees {law}; above half the largest torque the "
        f"curve is known to {share:.2g} % (95 %), "
        f"from {count_noun(len(result.data.stages), 'stage')} with "
        f"{count_noun(int(result.data.seen.sum()), 'hinge angle')}. "
        f"{bend_sentence(result)}"
    )


def bend_sentence(result: StaticResult) -> str:
    """Sentence on the largest bend from first to last link, the measure of the paper's bending
    test.
    """
    stage = result.most_bent
    if stage is None:
        return "No stage has all hinge angles, so the bend from first to last link is not known."
    where = f"{1e3 * stage.height_m:g} mm, stage {stage.stage}"
    return (
        f"The leg was bent most at {where}: by {stage.bend_deg:.1f} degrees from first to "
        "last link."
    )


def _rest_sentence(result: StaticResult) -> str:
    form = result.form
    if form.holds:
        return keep_units_together(
            f"Splines bring χ² down by {form.gain:.1f} for {form.more} more numbers, "
            f"which chance does in {100 * form.chance:.2g} % "
            f"of cases, and part from the law by {abs(form.apart_Nm):.3f} N m at most, "
            f"{abs(100 * form.apart_relative):.2g} % of the largest torque."
        )
    return keep_units_together(
        f"χ² is lower by {form.gain:.0f} for the {form.more} more numbers of the splines."
    )


def _rest_angles(result: StaticResult) -> str:
    """Sentence on the rest angles fitted with the law, or with the measured curve where the law
    does not hold.
    """
    rests = result.rests[0 if result.form.holds else 1]
    if rests is None:
        return (
            "The rest angles count as exact. State how well they are known as rest_angle_deg "
            "in [known_to] to have them found."
        )
    return keep_units_together(
        "The rest angles were found together with the curve; their mean is known to "
        f"{np.degrees(rests.common_std_rad):.3f}° and its error "
        f"is correlated by {rests.with_stiffness:+.2f} with that of the stiffness at rest."
    )


def _loop(result: StaticResult) -> str:
    loop = result.loop
    if loop is None:
        return "No hinge turned back far enough to show a loop."
    seen = "a loop is there" if loop.seen else "no loop is seen"
    return keep_units_together(
        f"Of {count_noun(loop.bending + loop.unbending, 'angle')} that were clearly "
        f"turned to, {loop.unbending} came back. Between bending "
        f"and unbending lie {number(2 * loop.half_Nm, 3)} ± {2 * 1.96 * loop.std_Nm:.3f} "
        f"N m (95 %): {seen}."
    )


def _noise(result: StaticResult) -> str:
    errors = result.found.errors
    data = result.data
    parts = []
    stated = data.seen & ~data.unstated
    if (data.unstated & data.seen).any():
        parts.append(
            f"hinge angles err by {np.degrees(errors.hinge_std_rad):.2f}°, which the "
            "stages themselves tell"
        )
    if stated.any():
        usual = float(np.degrees(np.median(data.hinge_std_rad[stated])))
        parts.append(
            f"hinge angles err as their photos state, {usual:.2f}° in the middle, times "
            f"{errors.stated_factor:.1f}"
        )
    parts.append(
        "the mean of fz errs by "
        f"{errors.force_factor * float(np.median(data.force_std[:, 1])):.3f} N"
    )
    if errors.chained:
        how = "errors of neighbouring hinges go together, as marks between them are shared"
    else:
        how = "every hinge errs on its own"
    return keep_units_together(f"One standard deviation: {'; '.join(parts)}; {how}.")


def _photo(picture: StagePhoto) -> dict[str, str]:
    stage = picture.stage
    return {
        "data": picture.data,
        "missing": picture.missing,
        "doubts": picture.doubts,
        "label": keep_units_together(
            f"{1e3 * stage.height_m:g} mm, stage {stage.stage}: "
            f"{np.degrees(stage.shaft_angle_rad):.0f}°"
        ),
    }


def _stages(result: StaticResult, sources: Sequence[StaticSource]) -> list[dict[str, Any]]:
    """Rows for each source: readings and angles, with torques below them."""
    tables = []
    for number_of, source in enumerate(sources):
        rows = [
            row for row, recording in enumerate(result.data.recording) if recording == number_of
        ]
        tables.append(
            {
                "name": source.name,
                "mark": source.recording.source,
                "lines": [_stage(result, row) for row in rows],
            }
        )
    return tables


def _stage(result: StaticResult, row: int) -> dict[str, Any]:
    stage: StaticStage = result.data.stages[row]
    ends = result.found.ends[row]
    points = result.points
    return {
        "height": f"{1e3 * stage.height_m:g}",
        "stage": stage.stage,
        "direction": stage.direction,
        "shaft": f"{np.degrees(stage.shaft_angle_rad):.1f}",
        "forces": [number(stage.fy_N, 2), number(stage.fz_N, 2), number(stage.tx_Nm, 3)],
        "touching": ", ".join(str(end + 1) for end in ends) or "none",
        "angles": [_or_nothing(np.degrees(angle), 2) for angle in points.phi_rad[row]],
        "torques": [_or_nothing(torque, 3) for torque in points.torque_Nm[row]],
    }


def _or_nothing(value: float, digits: int) -> str:
    if np.isfinite(value):
        return number(float(value), digits)
    return NOTHING
