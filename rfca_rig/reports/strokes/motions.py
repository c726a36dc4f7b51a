"""report.html of mechanisms: signals of each recording, measured and simulated, with
nominal and with fitted values.

Residuals are drawn over position and speed of a joint, where omitted physics shows as a step, a
slope or a wave.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.result import describe_pair
from rfca_rig.campaign.experiment import Experiment
from rfca_rig.description.sections import AboutSection
from rfca_rig.diagnosis.config import STRAINED
from rfca_rig.diagnosis.mechanisms.fit import MECHANISM_FIT, JointRemainder, MechanismComparison
from rfca_rig.diagnosis.result import SignalOverlay
from rfca_rig.diagnosis.window_fit import SignalError, WindowFit
from rfca_rig.escaping import html_text
from rfca_rig.reports.diagnosis.pictures import Picture, pictures_of
from rfca_rig.reports.diagnosis.tables import list_signal_rows
from rfca_rig.reports.elements import (
    aside,
    html,
    join,
    legend,
    legend_dot,
    legend_line,
    page_links,
    panels,
    paragraph,
)
from rfca_rig.reports.html_table import as_html
from rfca_rig.reports.page_units import convert_fit
from rfca_rig.reports.provenance import Origin, PageLink, find_pages
from rfca_rig.reports.sections import PageSection
from rfca_rig.reports.style import (
    FAINT,
    MEASURED,
    OTHER,
    SIMULATED,
    Panel,
    drawing,
    inline_svg,
    make_panel,
)
from rfca_rig.reports.table import (
    Foot,
    Table,
    TableColumn,
    TableRow,
    as_csv,
    table_files,
    write_all,
)
from rfca_rig.reports.templates import render_page
from rfca_rig.reports.text import MINUS, name_with_unit, words_and_unit

Floats = NDArray[np.float64]

# Points of one series in one panel.
MOST_POINTS = 400
# Share of the x axis at its end where the label of a tick is wider than the margin.
CUT_SHARE = 0.03
POSITION = "_position_"
SPEED = "_speed_"

PAGE = "report.html"
# Beginning of the names of the files beside the page.
STEM = "mechanism"
JSON = f"{STEM}.json"
# Recordings whose signals are drawn: those with the largest errors.
MOST_SHOWN = 12

ERRORS = "Rms error"
ALWAYS = (
    TableColumn("run", role="group"),
    TableColumn("signal", "Signal"),
    TableColumn("unit", "Unit"),
    TableColumn("noise", "Noise", over=ERRORS),
    TableColumn("nominal", "Nominal values", over=ERRORS),
)
OF_FIT = (
    TableColumn("fitted", "Fitted values", over=ERRORS),
    TableColumn("held_out", "Held-out", over=ERRORS),
)
SHIFTS = (
    TableColumn("name", "Value"),
    TableColumn("prior_std", "Prior standard deviation", digits=5),
    TableColumn("value", "Shift from nominal", half="std"),
    TableColumn("std", role="kept"),
)
SIGNALS = tuple(
    TableColumn(key) for key in ("run", "signal", "t_s", "measured", "nominal", "fitted")
)


@dataclass(frozen=True)
class _Series:
    """Points of one colour, all (k,)."""

    color: str
    position: Floats
    speed: Floats
    residual: Floats


def draw_signal_residuals(overlays: Sequence[SignalOverlay], with_fit: bool) -> list[Picture]:
    """One picture for each position and each speed: measured minus nominal, and with `with_fit`
    also measured minus fitted.

    Arrays of the overlays are (m,). A signal that does not belong to a joint has no picture.
    """
    states = {(overlay.condition, overlay.signal): overlay for overlay in overlays}
    pictures = []
    for signal in dict.fromkeys(overlay.signal for overlay in overlays):
        joint, unit = _split(signal)
        position_name = f"{joint}{POSITION}{unit}"
        speed_name = f"{joint}{SPEED}{_speed_unit(unit)}"
        signal_overlays = [overlay for overlay in overlays if overlay.signal == signal]
        if (signal_overlays[0].condition, position_name) not in states:
            continue
        # A speed that was not recorded is derived from the position.
        positions = [states[overlay.condition, position_name] for overlay in signal_overlays]
        speeds = [states.get((overlay.condition, speed_name)) for overlay in signal_overlays]
        position = np.concatenate([overlay.measured for overlay in positions])
        # Where no speed was recorded: central differences of the binned position.
        factor = 1.0
        if unit == "deg":
            factor = np.radians(1.0)
        speed = np.concatenate(
            [
                factor * np.gradient(p.measured, p.t_s) if s is None else s.measured
                for p, s in zip(positions, speeds, strict=True)
            ]
        )
        residuals = [
            (
                OTHER,
                np.concatenate([overlay.measured - overlay.before for overlay in signal_overlays]),
            )
        ]
        if with_fit:
            residuals.append(
                (
                    SIMULATED,
                    np.concatenate(
                        [overlay.measured - overlay.after for overlay in signal_overlays]
                    ),
                )
            )
        series = [_Series(color, position, speed, residual) for color, residual in residuals]
        pictures.append(Picture(name_with_unit(signal), _draw(signal, position_name, series)))
    return pictures


def _split(signal: str) -> tuple[str, str]:
    """Joint and unit of its position, from the name of a position or a speed; empty for other
    signals.
    """
    for kind in (SPEED, POSITION):
        joint, separator, unit = signal.rpartition(kind)
        if separator:
            # A page has angles in degrees, and their speeds in rad/s as the shaft's.
            return joint, unit.removesuffix("_s").replace("rad", "deg")
    return "", ""


def _speed_unit(unit: str) -> str:
    if unit == "deg":
        return "rad_s"
    return f"{unit}_s"


def draw_joint_remainders(joints: Sequence[JointRemainder]) -> list[Picture]:
    """One picture for each joint: the torque that the recorded motion requires and the nominal
    model lacks.
    """
    pictures = []
    for joint in joints:
        if joint.is_slide:
            unit = "m"
            position = joint.position
            name = f"{joint.joint} force_N"
        else:
            unit = "deg"
            position = np.asarray(np.degrees(joint.position))
            name = f"{joint.joint} torque_Nm"
        series = [_Series(MEASURED, position, joint.speed, joint.remainder)]
        pictures.append(
            Picture(name_with_unit(name), _draw(name, f"{joint.joint}{POSITION}{unit}", series))
        )
    return pictures


def _draw(name: str, position: str, series: Sequence[_Series]) -> tuple[Panel, Panel]:
    """Two panels on a common scale, over position and over speed; `name` is that of the
    residual.
    """
    words, unit = words_and_unit(name)
    of_position, unit_of_position = words_and_unit(position)
    over = {
        "position": f"{of_position} ({unit_of_position})",
        "speed": (
            f"{of_position.removesuffix('position')}speed "
            f"({_speed_unit(unit_of_position).replace('_', '/')})"
        ),
    }
    panels = []
    for part, label in over.items():
        with drawing():
            figure, axes = make_panel(f"residual ({unit})", label)
            axes.axhline(0.0, color=FAINT, lw=0.6)
            for points in series:
                # Every n-th point, n rounded up: more points only blacken the panel.
                step = max(1, -(-len(points.residual) // MOST_POINTS))
                axes.plot(
                    getattr(points, part)[::step],
                    points.residual[::step],
                    ls="",
                    marker=".",
                    ms=3.4,
                    mew=0.0,
                    color=points.color,
                )
            # The edge of the figure would cut the label of a tick at the right end.
            low, high = axes.get_xlim()
            axes.set_xticks(
                [
                    tick
                    for tick in axes.get_xticks()
                    if low <= tick <= high - CUT_SHARE * (high - low)
                ]
            )
            axes.set_xlim(low, high)
            svg = inline_svg(
                figure,
                f"residual {name} {part}",
                html_text(f"residual of {words} over {part} of the joint"),
            )
        panels.append(Panel("", svg))
    return panels[0], panels[1]


@dataclass(frozen=True)
class MotionsReport:
    """Texts and names of a page of motions, besides the fit.

    Parameters
    ----------
    title
        Title of the recordings.
    nominal
        Source of the nominal values, as in "the model file arm.xml".
    window_s
        Length of a window in s.
    remainders
        Figures of the torque in each joint that the nominal model lacks.
    about
        Who measured what and when.
    """

    title: str
    nominal: str
    window_s: float
    remainders: Sequence[Picture] = ()
    about: AboutSection = field(default_factory=AboutSection)


def mechanism_report(experiment: Experiment, comparison: MechanismComparison) -> MotionsReport:
    """Texts of the page of a mechanism."""
    return MotionsReport(
        title=experiment.title,
        about=experiment.about,
        nominal=f"the model file {experiment.model.name}",
        window_s=experiment.window_s,
        remainders=draw_joint_remainders(comparison.joints),
    )


def write_motions(report: MotionsReport, fit: WindowFit, out: Path, origin: Origin) -> None:
    """Writes report.html and its tables as CSV, LaTeX and JSON.

    Parameters
    ----------
    report
        Texts and names of the page.
    fit
        Measured and simulated signals in windows, nominal and fitted.
    out
        Folder of the report.
    origin
        Command, recordings and version for the foot of the page.

    Raises
    ------
    RigError
        Where a file cannot be written.
    """
    shown_fit = convert_fit(fit)
    tables = _list_tables(report, fit, is_shown=False)
    shown_tables = _list_tables(report, shown_fit, is_shown=True)
    contents = {
        JSON: json.dumps({"title": report.title, **fit.plain(MECHANISM_FIT)}, indent=1) + "\n",
        **table_files(tables),
        f"{STEM}-signals.csv": as_csv(_signal_table(fit)),
    }
    page = render_page(
        f"{report.title}: measured and simulated motions of a mechanism",
        _opening(report, fit, find_pages(out, origin, (PAGE, "run.html"))),
        [
            _errors_and_values(fit, shown_tables),
            _signals(shown_fit),
            _lacking_torques(report),
            _residuals(shown_fit),
        ],
        origin,
        tuple(contents),
        sheets=("motions.css",),
    )
    write_all(out, {PAGE: page, **contents})


def _opening(report: MotionsReport, fit: WindowFit, links: Sequence[PageLink]) -> Markup:
    if fit.shifts:
        fitted = (
            "Fitted values are these, shifted within their stated uncertainty; no effect is added."
        )
    else:
        fitted = "Nothing is fitted, as [known_to] lists no value."
    contents = [
        paragraph("Measured and simulated motions of a mechanism", "of"),
        html("<h1>{}</h1>", report.title),
        paragraph(f"Nominal values are those of {report.nominal}. {fitted}", "standfirst"),
        page_links(links),
    ]
    return join("\n", contents)


def _errors_and_values(fit: WindowFit, tables: Sequence[Table]) -> PageSection:
    title = "Errors"
    if fit.shifts:
        title = "Errors and fitted values"
    correlated = [describe_pair(pair).replace(" -", f" {MINUS}") for pair in fit.correlated]
    return PageSection(
        title,
        [
            *(as_html(table, "dense") for table in tables),
            *(aside(f"{text}.") for text in correlated),
        ],
    )


def _signals(fit: WindowFit) -> PageSection:
    overlays = list(_worst_recordings(fit))
    recordings = len({overlay.condition for overlay in fit.overlays})
    shown = len({overlay.condition for overlay in overlays})
    ticks = "Ticks at the bottom: there a window starts from the measured state."
    if shown < recordings:
        ticks += f" Of {recordings} recordings the {shown} are drawn that the model misses most."
    entries = [
        legend_line("var(--measured)", 1.4, "measured"),
        legend_line("var(--other)", 1.8, "simulated, nominal values", "6 3"),
    ]
    if fit.shifts:
        entries.append(legend_line("var(--simulated)", 4.5, "simulated, fitted values"))
    contents = [legend(*entries), aside(ticks), *_draw_panels(pictures_of(overlays))]
    return PageSection("Signals", contents)


def _lacking_torques(report: MotionsReport) -> PageSection | None:
    if not report.remainders:
        return None
    how_to_read = (
        "By inverse dynamics: what acts in the recorded motion beyond the inertia, weight, "
        "friction and drive of the nominal model. Dry friction is a step at speed zero, damping a "
        "slope over speed, a spring a slope over position."
    )
    return PageSection(
        "What the nominal model lacks in each joint",
        [aside(how_to_read), *_draw_panels(report.remainders)],
    )


def _residuals(fit: WindowFit) -> PageSection | None:
    residuals = draw_signal_residuals(fit.overlays, with_fit=bool(fit.shifts))
    if not residuals:
        return None
    nominal = "measured less simulated, nominal values"
    entries = [legend_dot("var(--other)", "var(--other)", 2.4, nominal)]
    if fit.shifts:
        fitted = "less simulated, fitted values"
        entries.append(legend_dot("var(--simulated)", "var(--simulated)", 2.4, fitted))
    return PageSection(
        "Residuals over position and speed", [legend(*entries), *_draw_panels(residuals)]
    )


def _draw_panels(pictures: Sequence[Picture]) -> list[Markup]:
    return [
        panels(picture.signal, picture.panels, css="one" if picture.panels[0].wide else "")
        for picture in pictures
    ]


def _list_tables(report: MotionsReport, fit: WindowFit, is_shown: bool) -> list[Table]:
    tables = [_error_table(report, fit)]
    if fit.shifts:
        tables.append(_shift_table(fit, is_shown))
    return tables


def _error_table(report: MotionsReport, fit: WindowFit) -> Table:
    caption = (
        f"Rms of measured less simulated. Each window of {report.window_s:g} s is simulated "
        "from the measured state at its start. "
    )
    columns: tuple[TableColumn, ...] = ALWAYS
    if fit.shifts:
        columns = (*ALWAYS, *OF_FIT)
        caption += (
            "Held-out: each condition of about four windows is predicted with values fitted "
            "to all others."
        )
    feet = tuple(
        Foot(f"All: {', '.join(filter(None, words_and_unit(e.signal)))}", _errors(e), digits=5)
        for e in fit.totals
    )
    # For a single recording the totals would repeat its own errors.
    if len({error.run for error in fit.errors}) == 1:
        feet = ()
    return Table(f"{STEM}-errors", caption, columns, tuple(map(_error_row, fit.errors)), feet)


def _errors(error: SignalError) -> dict[str, float | None]:
    return {
        "noise": error.noise,
        "nominal": error.nominal,
        "fitted": error.fitted,
        "held_out": error.held_out,
    }


def _error_row(error: SignalError) -> TableRow:
    words, unit = words_and_unit(error.signal)
    return TableRow({"run": error.run, "signal": words, "unit": unit, **_errors(error)}, digits=5)


def _shift_table(fit: WindowFit, is_shown: bool) -> Table:
    """Shifts by their keys, as files have them; on the page, where it `is_shown`, in words with
    a column for the unit.
    """
    caption = "Shift of each nominal value that fits all recordings best, ± one standard deviation"
    columns: tuple[TableColumn, ...] = SHIFTS
    if is_shown:
        caption += "."
        columns = (SHIFTS[0], TableColumn("unit", "Unit"), *SHIFTS[1:])
    else:
        caption += "; its unit is the end of its name."
    strained = [abs(shift.value) > STRAINED * shift.prior_std for shift in fit.shifts]
    if any(strained):
        caption += (
            f" Bold: more than {STRAINED:g} prior standard deviations, so that the model "
            "probably lacks an effect."
        )
    rows = []
    for shift, is_far in zip(fit.shifts, strained, strict=True):
        values = dict(shift.__dict__)
        if is_shown:
            words, unit = words_and_unit(shift.name)
            values |= {"name": words, "unit": unit}
        rows.append(TableRow(values, marked=is_far))
    return Table(f"{STEM}-values", caption, columns, tuple(rows))


def _signal_table(fit: WindowFit) -> Table:
    """All signals that are drawn, as means over bins."""
    keys = ("run", "signal", "t_s", "measured", "nominal", "fitted")
    return Table(f"{STEM}-signals", "", SIGNALS, list_signal_rows(fit.overlays, keys))


def _worst_recordings(fit: WindowFit) -> Iterator[SignalOverlay]:
    """Signals of the recordings with the largest errors, in their order. Without a fit, NaN
    takes the place of the fitted signal.
    """
    # Errors of different signals have different units: each is divided by that signal's error over
    # all recordings.
    usual = {total.signal: total.fitted for total in fit.totals}
    misses: dict[str, float] = {}
    for error in fit.errors:
        misses[error.run] = misses.get(error.run, 0.0) + error.fitted / max(
            usual[error.signal], 1e-300
        )
    worst = sorted(misses, key=lambda run: -misses[run])[:MOST_SHOWN]
    chosen = (overlay for overlay in fit.overlays if overlay.condition in worst)
    if fit.shifts:
        return chosen
    return (replace(overlay, after=np.full(len(overlay.after), np.nan)) for overlay in chosen)
