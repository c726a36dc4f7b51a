"""static.html: one self-contained page."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from rfca_rig.analysis.torque_rotation.elastica_curves import Foretold
from rfca_rig.analysis.torque_rotation.remarks import remarks
from rfca_rig.analysis.torque_rotation.static_result import StaticResult
from rfca_rig.recording.form import StaticStage
from rfca_rig.report.overlay import FAINT, MEASURED, SIMULATED
from rfca_rig.report.photo_strip import StripPicture, strips_of
from rfca_rig.report.static_pictures import DASHES, FORETOLD_STYLES, SECOND, rest_picture, stiffness_picture, torque_picture
from rfca_rig.report.static_source import StaticSource
from rfca_rig.report.templates import beside, template
from rfca_rig.report.wording import MARK_MEANINGS, NOTHING, counted, number, unbroken

TABLE_STEP_DEG = 2.5
FEW_LINES = 12


def page(
    result: StaticResult, sources: Sequence[StaticSource], elastica: Sequence[Foretold], model_file: str | None, has_model: bool
) -> str:
    """The page as HTML. `model_file` names the model that was given instead of what was believed; `has_model`: a model.toml is beside."""
    marks = [source.recording.source for source in sources]
    return template("static.html").render(
        style=beside("static.css"),
        title=" · ".join(dict.fromkeys(source.recording.title for source in sources)),
        sources=[{"name": s.name, "mark": s.recording.source, "stages": counted(len(s.recording.static), "static stage")} for s in sources],
        mark_meanings=[meaning for mark, meaning in MARK_MEANINGS.items() if mark in marks],
        values=_values(result),
        standfirst=_standfirst(result),
        remarks=[unbroken(_signs(text)) for text in remarks(result)],
        torque=torque_picture(result, elastica),
        stiffness=stiffness_picture(result, elastica),
        rest=rest_picture(result),
        rest_sentence=_rest_sentence(result),
        curve=_curve_rows(result),
        elastica=[_foretold(one, style) for one, style in zip(elastica, FORETOLD_STYLES, strict=True)],
        hinges=[_hinge(check.hinge, check.stiffer, check.std, check.differs) for check in result.hinges],
        loop_sentence=_loop(result),
        loop_seen=result.loop is not None and result.loop.seen,
        doubts=_doubts(result),
        noise=_noise(result),
        gain_counts_as_exact=all(found.says != "gain of the force sensor" for found in result.doubts),
        repeats=[_repeat(source.name, values) for source, values in zip(sources, result.repeats.each, strict=False)],
        strips=[{"name": name, "pictures": [_photo(picture) for picture in strip]} for name, strip in strips_of(sources)],
        stages=_stages(result, sources),
        several=len(sources) > 1,
        model=f"the model in {model_file}" if model_file else "the model as it was believed",
        has_model=has_model,
        law_holds=result.form.holds,
        colours={"measured": MEASURED, "curve": SIMULATED, "other": SECOND, "faint": FAINT},
        dashes={name: " ".join(f"{2.2 * part:g}" for part in pattern) for name, (_, pattern) in DASHES.items()},
    )


def _signs(text: str) -> str:
    return text.replace("+-", "±").replace("phi^3", "φ³").replace("phi", "φ").replace("chi2", "χ²").replace("k2", "k₂").replace("k0", "k₀")


def _values(result: StaticResult) -> list[dict[str, str]]:
    values = result.values
    pairs = (("k₀", values.k0_Nm_per_rad, values.k0_std, "N m/rad"), ("k₂", values.k2_per_rad2, values.k2_std, "1/rad²"))
    return [
        {"name": name, "value": _fit(value, values.reach * std), "half": _fit(values.reach * std, values.reach * std), "unit": unit,
         "relative": f"{100 * values.reach * std / abs(value):.2g} %"}
        for name, value, std, unit in pairs
    ]  # fmt: skip


def _fit(value: float, error: float) -> str:
    """With the digits that its error leaves."""
    return number(value, _places(error))


def _places(error: float) -> int:
    """Decimals that show two digits of it."""
    return max(0, 1 - int(np.floor(np.log10(error)))) if error > 0.0 else 3


def _standfirst(result: StaticResult) -> str:
    curve = result.curve
    low, high = sorted(abs(float(np.degrees(angle))) for angle in curve.range_rad)
    grid = curve.grid_rad()
    torque, std = curve.torque_Nm(grid)
    half = np.abs(torque) > 0.5 * np.abs(torque).max()
    share = 100 * float((curve.reach * std[half] / np.abs(torque[half])).max())
    law = "the law k₀ (φ + k₂ φ³) holds" if result.form.holds else "the law k₀ (φ + k₂ φ³) does not hold"
    return unbroken(
        f"From {low:.1f} to {high:.1f} degrees {law}; above half the largest torque the curve is known to {share:.2g} % (95 %), "
        f"from {counted(len(result.data.stages), 'stage')} with {counted(int(result.data.seen.sum()), 'hinge angle')}."
    )


def _rest_sentence(result: StaticResult) -> str:
    form = result.form
    if form.holds:
        return unbroken(
            f"Splines bring χ² down by {form.gain:.1f} for {form.more} more numbers, which chance does in {100 * form.chance:.2g} % "
            f"of cases, and part from the law by {abs(form.apart_Nm):.3f} N m at most, "
            f"{abs(100 * form.apart_relative):.2g} % of the largest torque."
        )
    return unbroken(f"χ² is lower by {form.gain:.0f} for the {form.more} more numbers of the splines.")


def _curve_rows(result: StaticResult) -> list[dict[str, str]]:
    curve = result.curve
    low, high = sorted(float(np.degrees(curve.bends * angle)) for angle in curve.range_rad)
    step = TABLE_STEP_DEG * max(1, round((high - low) / TABLE_STEP_DEG / FEW_LINES))
    degrees = np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step
    phi = curve.bends * np.radians(degrees)
    torque, torque_std = curve.torque_Nm(phi)
    stiffness, stiffness_std = curve.stiffness_Nm_per_rad(phi)
    halves = curve.reach * torque_std, curve.reach * stiffness_std
    places = [_places(float(np.median(half))) for half in halves]
    rows = zip(degrees, curve.bends * torque, halves[0], stiffness, halves[1], strict=True)
    return [
        {
            "angle": f"{angle:g}",
            "torque": number(m, places[0]),
            "torque_half": number(dm, places[0]),
            "stiffness": number(k, places[1]),
            "stiffness_half": number(dk, places[1]),
        }
        for angle, m, dm, k, dk in rows
    ]


def _foretold(one: Foretold, style: str) -> dict[str, str]:
    return {
        "says": one.says,
        "free": f"{1e3 * one.free_m:.1f}",
        "k0": number(one.k0_Nm_per_rad, 2),
        "k2": number(one.k2_per_rad2, 2),
        "style": style,
    }


def _hinge(hinge: int, stiffer: float, std: float, differs: bool) -> dict[str, Any]:
    digits = 1 if std > 0.002 else 2
    return {"hinge": hinge, "stiffer": _signed(100 * stiffer, digits), "std": f"{100 * std:.{digits}f}", "differs": differs}


def _signed(value: float, digits: int) -> str:
    said = number(value, digits)
    return f"+{said}" if value > 0 and float(f"{value:.{digits}f}") != 0 else said


def _loop(result: StaticResult) -> str:
    loop = result.loop
    if loop is None:
        return "No hinge turned back far enough to show a loop."
    seen = "a loop is there" if loop.seen else "no loop is seen"
    return unbroken(
        f"Of {counted(loop.bending + loop.unbending, 'angle')} that were clearly turned to, {loop.unbending} came back. Between bending "
        f"and unbending lie {number(2 * loop.half_Nm, 3)} ± {2 * 1.96 * loop.std_Nm:.3f} N m (95 %): {seen}."
    )


def _doubts(result: StaticResult) -> list[dict[str, Any]]:
    return [
        {
            "says": d.says.replace("'", "\u2019"),
            "unit": d.unit,
            "value": _fit(d.value, d.std),
            "std": _fit(d.std, d.std),
            "prior": f"{d.prior_std:.2g}",
            "strained": d.strained,
        }
        for d in result.doubts
    ]


def _noise(result: StaticResult) -> str:
    errors, data, said = result.found.errors, result.data, []
    stated = data.seen & ~data.unstated
    if (data.unstated & data.seen).any():
        said.append(f"hinge angles err by {np.degrees(errors.hinge_std_rad):.2f}°, which the stages themselves tell")
    if stated.any():
        usual = float(np.degrees(np.median(data.hinge_std_rad[stated])))
        said.append(f"hinge angles err as their photos state, {usual:.2f}° in the middle, times {errors.stated_factor:.1f}")
    said.append(f"the mean of fz errs by {errors.force_factor * float(np.median(data.force_std[:, 1])):.3f} N")
    how = "errors of neighbouring hinges go together, as marks between them are shared" if errors.chained else "every hinge errs on its own"
    return unbroken(f"One standard deviation: {'; '.join(said)}; {how}.")


def _repeat(name: str, values: Any) -> dict[str, str]:
    k0, k2 = values.reach * values.k0_std, values.reach * values.k2_std
    return {
        "name": name,
        "k0": f"{_fit(values.k0_Nm_per_rad, k0)} ± {_fit(k0, k0)}",
        "k2": f"{_fit(values.k2_per_rad2, k2)} ± {_fit(k2, k2)}",
    }


def _photo(picture: StripPicture) -> dict[str, str]:
    stage = picture.stage
    return {
        "data": picture.data,
        "missing": picture.missing,
        "doubts": picture.doubts,
        "label": unbroken(f"{1e3 * stage.height_m:g} mm, stage {stage.stage}: {np.degrees(stage.shaft_angle_rad):.0f}°"),
    }


def _stages(result: StaticResult, sources: Sequence[StaticSource]) -> list[dict[str, Any]]:
    """Lines of each source: readings and angles, torques below them."""
    tables = []
    for number_of, source in enumerate(sources):
        rows = [row for row, own in enumerate(result.data.recording) if own == number_of]
        tables.append({"name": source.name, "mark": source.recording.source, "lines": [_stage(result, row) for row in rows]})
    return tables


def _stage(result: StaticResult, row: int) -> dict[str, Any]:
    stage: StaticStage = result.data.stages[row]
    ends, points = result.found.ends[row], result.points
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
    return number(float(value), digits) if np.isfinite(value) else NOTHING
