"""static.html: one self-contained page on the torque-rotation curve and the static stages, as a
list of its sections.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from markupsafe import Markup

from rfca_rig.analysis.repeats import STDS_OF_95
from rfca_rig.analysis.torque_rotation.static_result import (
    PredictedHingeCurve,
    StaticResult,
    remarks,
)
from rfca_rig.recording.model import StaticStage
from rfca_rig.reports.elements import (
    EMPTY,
    aside,
    bullets,
    code,
    css_class,
    division,
    figure,
    html,
    join,
    legend,
    legend_dot,
    legend_line,
    list_sources,
    mark,
    page_links,
    paragraph,
    subheading,
)
from rfca_rig.reports.html_table import as_html
from rfca_rig.reports.provenance import PageContext
from rfca_rig.reports.sections import PageSection, Sections, SideBySide
from rfca_rig.reports.static.photos import StagePhoto, photos_by_source
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
from rfca_rig.reports.templates import render_page
from rfca_rig.reports.text import NOTHING, count_noun, keep_units_together, number

# Headings of the table of stages with the classes of their cells, before those of the hinges.
STAGE_HEADS = (
    ("Height (mm)", "n"),
    ("Stage", "n"),
    ("Direction", ""),
    ("Shaft (°)", "n"),
    ("fy (N)", "n"),
    ("fz (N)", "n"),
    ("tx (N\u00a0m)", "n"),
    ("Touching", ""),
    ("Hinge", ""),
)
METHOD = (
    "At every stage the shaft, each hinge and the forces must balance: weight of the links, what "
    "the floor does to every link end that touches, and the readings of fy, fz and tx. Friction "
    "that holds has no sign of its own, so it is taken from fy. A link end presses as deep as the "
    "angles put it into the floor. Angles and forces are moved as little as their errors ask for "
    "until all of this holds with one curve for all hinges; noise that is not stated is estimated "
    "from the residuals (least squares with errors in all variables, noise by restricted "
    "likelihood). Links, weight and floor are those of"
)


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
    sections: Sections = [
        _curve(result, elastica),
        SideBySide("sides", [[_values_of_curve(result)], [_elastica(result, elastica)]]),
        PageSection("Is it one curve?", []),
        SideBySide(
            "sides",
            [
                [_hinges(result), _loop(result), _repeats(result, sources), _noise(result)],
                [_systematic_errors(result)],
            ],
        ),
        _photos(sources),
        _stages(result, sources),
        _method(context.model_file, files),
    ]
    title = " · ".join(dict.fromkeys(source.recording.title for source in sources))
    return render_page(
        f"{title}: torque over rotation",
        _opening(title, result, sources, context),
        sections,
        context.origin,
        files,
        sheets=("static.css",),
    )


def _opening(
    title: str, result: StaticResult, sources: Sequence[StaticSource], context: PageContext
) -> Markup:
    described = [
        (s.recording.source, f"{s.name}: {count_noun(len(s.recording.static), 'static stage')}")
        for s in sources
    ]
    doubts = [keep_units_together(_signs(text)) for text in remarks(result)]
    doubt_list = EMPTY
    if doubts:
        doubt_list = bullets(doubts, "remarks")
    return join(
        "\n",
        [
            paragraph("Torque over rotation of the hinges", "of"),
            html("<h1>{}</h1>", title),
            list_sources(described),
            division("values", *_values(result)),
            paragraph(_standfirst(result), "standfirst"),
            page_links(context.links),
            doubt_list,
        ],
    )


def _curve(result: StaticResult, elastica: Sequence[PredictedHingeCurve]) -> PageSection:
    angles = count_noun(int(result.data.seen.sum()), "hinge angle")
    law_holds = result.form.holds
    if law_holds:
        drawn = "law"
        other = "splines"
    else:
        drawn = "splines"
        other = "the nearest law"
    predicted = [
        legend_line("var(--faint)", 1.4, f"elastica, {curve.words}", _svg_dash(style))
        for curve, style in zip(elastica, ELASTICA_STYLES, strict=True)
    ]
    colours = legend(
        legend_dot("var(--measured)", "var(--measured)", 2.8, "measured, one angle"),
        legend_dot("var(--measured)", "none", 3.8, "after the hinge turned back"),
        legend_line("var(--simulated)", 4, f"{drawn}, with 95 % band"),
        legend_line("var(--other)", 1.4, other, _svg_dash("other")),
        *predicted,
    )
    torque = figure(
        "Torque",
        draw_torque(result, elastica),
        f"Every measured hinge angle with the torque that balances the hinge there, {angles}; "
        "bars are one standard deviation, the band is the curve\u2019s 95 %.",
        1,
    )
    stiffness = figure(
        "Equivalent stiffness",
        draw_stiffness(result, elastica),
        "The derivative of the torque. The band holds at each angle by itself, with 95 %.",
        2,
    )
    if result.loop is not None and result.loop.seen:
        loop = " Dotted: the two sides of the loop."
    else:
        loop = ""
    residual = figure(
        "Residual torque",
        draw_residuals(result),
        f"Measured torque less the curve\u2019s at the measured angle, {angles}; bars are one "
        "standard deviation and take in the errors of both, the band is 95 %."
        f"{loop} {_rest_sentence(result)}",
        3,
        css="low",
    )
    return PageSection("The curve", [colours, division("figures", torque, stiffness), residual])


def _svg_dash(style: str) -> str:
    """A dash of the figures as SVG has it, as long as there."""
    return " ".join(f"{2.2 * part:g}" for part in DASHES[style][1])


def _values_of_curve(result: StaticResult) -> PageSection:
    values = curve_table(result.curve, int(result.data.seen.sum()))
    return PageSection("Values", [as_html(values)], level=3)


def _elastica(result: StaticResult, elastica: Sequence[PredictedHingeCurve]) -> PageSection:
    text = (
        "How the shells hold the strips the paper leaves open. Sliding in its grooves a strip "
        "hardens little; what is measured beyond that is not its bending alone."
    )
    predicted = as_html(elastica_table(elastica, result))
    return PageSection("What the elastica predicts", [predicted, aside(text)], level=3)


def _hinges(result: StaticResult) -> PageSection:
    return PageSection("Hinge by hinge", [as_html(hinges_table(result))], level=3)


def _loop(result: StaticResult) -> PageSection:
    return PageSection("Loading and unloading", [paragraph(_loop_sentence(result))], level=3)


def _repeats(result: StaticResult, sources: Sequence[StaticSource]) -> PageSection | None:
    repeats = repeats_table(result, [source.name for source in sources])
    if not repeats.rows:
        return None
    return PageSection("Recording by recording", [as_html(repeats)], level=3)


def _noise(result: StaticResult) -> PageSection:
    return PageSection("Noise", [paragraph(_noise_sentence(result))], level=3)


def _systematic_errors(result: StaticResult) -> PageSection:
    errors = _with_apostrophes(systematic_errors_table(result))
    contents = [as_html(errors), aside(_rest_angles(result))]
    if all(error.words != "gain of the force sensor" for error in result.systematic_errors):
        pattern = (
            "The gain of the force sensor counts as exact: 1 % in it is 1 % of every torque. "
            "State it with {}."
        )
        contents.append(aside(html(pattern, code("--force-gain-pct"))))
    return PageSection("Common to all stages, with an uncertainty", contents, level=3)


def _photos(sources: Sequence[StaticSource]) -> PageSection | None:
    contents = []
    for name, photos in photos_by_source(sources):
        if len(sources) > 1:
            contents.append(subheading(name))
        contents.append(division("strip", *map(_photo, photos)))
    if contents:
        return PageSection("Photos", contents)
    return None


def _photo(photo: StagePhoto) -> Markup:
    stage = photo.stage
    label = keep_units_together(
        f"{1e3 * stage.height_m:g} mm, stage {stage.stage}: "
        f"{np.degrees(stage.shaft_angle_rad):.0f}°"
    )
    if photo.data:
        shown = html('<img src="{}" alt="the leg at {}">', photo.data, label)
    else:
        shown = html('<div class="gone">{}</div>', photo.missing)
    doubts = EMPTY
    if photo.doubts:
        doubts = html("<br><b>{}</b>", photo.doubts)
    return html("<figure>\n{}\n<figcaption>{}{}</figcaption>\n</figure>", shown, label, doubts)


def _stages(result: StaticResult, sources: Sequence[StaticSource]) -> PageSection:
    """Readings and angles of each stage, with torques below them."""
    pattern = (
        "Readings are means after settling. Below each hinge\u2019s angle stands the torque that "
        "balances it; their standard deviations are in {}. <i>Touching</i> names the links whose "
        "ends press on the floor, as the balance of moments has it."
    )
    contents = [paragraph(html(pattern, code("stages.csv")))]
    for number_of, source in enumerate(sources):
        rows = [
            row for row, recording in enumerate(result.data.recording) if recording == number_of
        ]
        if len(sources) > 1:
            contents.append(subheading(html("{} {}", mark(source.recording.source), source.name)))
        contents.append(_stages_as_html(result, source.name, rows))
    return PageSection("Stages", contents)


def _stages_as_html(result: StaticResult, name: str, rows: Sequence[int]) -> Markup:
    """A table of two lines for each stage, of which the second has the torques of its hinges."""
    hinges = [str(check.hinge) for check in result.hinges]
    heads = [html('<th scope="col"{}>{}</th>', css_class(css), head) for head, css in STAGE_HEADS]
    for hinge in hinges:
        css = css_class("n last" if hinge is hinges[-1] else "n")
        heads.append(html('<th scope="col"{}>{}</th>', css, hinge))
    return html(
        '<div class="wide" tabindex="0" role="region" aria-label="stages of {}">\n'
        '<table class="stages stack">\n<thead><tr>{}</tr></thead>\n{}\n</table>\n</div>',
        name,
        join("", heads),
        join("\n", [_stage(result, row, hinges) for row in rows]),
    )


def _stage(result: StaticResult, row: int, hinges: Sequence[str]) -> Markup:
    stage: StaticStage = result.data.stages[row]
    ends = result.found.ends[row]
    points = result.points
    readings = (
        ("height (mm)", "n", f"{1e3 * stage.height_m:g}"),
        ("stage", "n", str(stage.stage)),
        ("direction", "", stage.direction),
        ("shaft (°)", "n", f"{np.degrees(stage.shaft_angle_rad):.1f}"),
        ("fy (N)", "n", number(stage.fy_N, 2)),
        ("fz (N)", "n", number(stage.fz_N, 2)),
        ("tx (N\u00a0m)", "n", number(stage.tx_Nm, 3)),
        ("touching", "", ", ".join(str(end + 1) for end in ends) or "none"),
    )
    cells = [_stage_cell(*reading) for reading in readings]
    angles = [
        _stage_cell(f"hinge {hinge}, °", "n hinge", _or_nothing(np.degrees(angle), 2))
        for hinge, angle in zip(hinges, points.phi_rad[row], strict=True)
    ]
    torques = [
        _stage_cell("N\u00a0m", "n hinge", _or_nothing(torque, 3))
        for torque in points.torque_Nm[row]
    ]
    return html(
        '<tbody>\n<tr>{}<td class="half">°</td>{}</tr>\n<tr class="torques">'
        '<td colspan="8"></td><td class="half">N\u00a0m</td>{}</tr>\n</tbody>',
        join("", cells),
        join("", angles),
        join("", torques),
    )


def _stage_cell(head: str, css: str, text: str) -> Markup:
    return html('<td data-head="{}"{}>{}</td>', head, css_class(css), text)


def _method(model_file: str | None, files: Sequence[str]) -> PageSection:
    model = "the nominal model"
    if model_file:
        model = f"the model in {model_file}"
    contents = [paragraph(f"{METHOD} {model}.")]
    if "model.toml" in files:
        pattern = "{} is the model with these hinges, for {}, {} and {} with {}."
        words = ("model.toml", "predict", "dynamic run", "report", "--model")
        contents.append(paragraph(html(pattern, *map(code, words))))
    if "model-curve.toml" in files:
        pattern = "{} holds the measured curve and its covariance in place of k₀ and k₂."
        contents.append(paragraph(html(pattern, code("model-curve.toml"))))
    return PageSection("How this was computed", contents)


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


def _values(result: StaticResult) -> list[Markup]:
    """The coefficients of the law with their 95 % intervals, in large letters."""
    values = result.values
    coefficients = (
        ("k₀", values.k0_Nm_per_rad, values.k0_std, "N m/rad"),
        ("k₂", values.k2_per_rad2, values.k2_std, "1/rad²"),
    )
    pattern = (
        '<p><span class="name">{}</span> <b>{}</b> <span class="half">± {}</span> '
        '<span class="unit">{}</span><span class="relative">{}, 95 %</span></p>'
    )
    shown = []
    for name, value, std, unit in coefficients:
        half = values.reach * std
        relative = f"{100 * half / abs(value):.2g} %"
        shown.append(html(pattern, name, _fit(value, half), _fit(half, half), unit, relative))
    return shown


def _fit(value: float, error: float) -> str:
    """A value with as many decimals as show two digits of its error."""
    if error > 0.0:
        return number(value, max(places(error, 2), 0))
    return number(value, 3)


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
            f"which chance does in {100 * form.p_value:.2g} % "
            f"of cases, and part from the law by {abs(form.apart_Nm):.3f} N m at most, "
            f"{abs(100 * form.apart_relative):.2g} % of the largest torque. "
            "The band and the intervals of k₀ and k₂ hold how far the truth may be from the law."
        )
    return keep_units_together(
        f"χ² is lower by {form.gain:.0f} for the {form.more} more numbers of the splines."
    )


def _rest_angles(result: StaticResult) -> str:
    """Sentence on the rest angles fitted with the law, or with the measured curve where the law
    does not hold.
    """
    rests = result.rests_of_curve
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


def _loop_sentence(result: StaticResult) -> str:
    loop = result.loop
    if loop is None:
        return "No hinge turned back far enough to show a loop."
    if loop.seen:
        seen = "a loop is there"
    else:
        seen = "no loop is seen"
    return keep_units_together(
        f"Of {count_noun(loop.bending + loop.unbending, 'angle')} that were clearly "
        f"turned to, {loop.unbending} came back. Between bending "
        f"and unbending lie {number(2 * loop.half_Nm, 3)} ± {2 * STDS_OF_95 * loop.std_Nm:.3f} "
        f"N m (95 %): {seen}."
    )


def _noise_sentence(result: StaticResult) -> str:
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
            f"hinge angles err as stated, {usual:.2f}° in the middle for marks glued exactly, "
            f"times {errors.stated_factor:.1f}"
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


def _or_nothing(value: float, digits: int) -> str:
    if np.isfinite(value):
        return number(float(value), digits)
    return NOTHING
