"""report.html: one self-contained page."""

import hashlib
from collections.abc import Sequence
from itertools import groupby
from pathlib import PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np

from rfca_rig.analysis.counterpart import Shaft
from rfca_rig.analysis.table2 import PAPER_AVERAGE_ERROR_PCT, Row, Table2
from rfca_rig.recording.form import StaticStage
from rfca_rig.report import overlay
from rfca_rig.report.quantities import quantities_of
from rfca_rig.report.sources import ComparedSource
from rfca_rig.report.templates import template
from rfca_rig.report.wording import (
    DEFINITION,
    MARK_MEANINGS,
    NOTHING,
    SHAFT_WORDS,
    counted,
    number,
    rms_sentence,
    scales_sentence,
    shaft_sentence,
    spread,
    unbroken,
)

LONGEST_TEXT = 160


def page(sources: Sequence[ComparedSource], table: Table2, shaft: Shaft, model_file: str | None = None) -> str:
    """The page as HTML. `model_file` names the one model that all sources were held against; None for what was believed of each."""
    return template("page.html").render(
        title=" · ".join(dict.fromkeys(source.recording.title for source in sources)) or "Nothing recorded",
        standfirst=_standfirst(table),
        sources=[_source(source) for source in sources],
        mark_meanings=[meaning for mark, meaning in MARK_MEANINGS.items() if any(s.recording.source == mark for s in sources)],
        rows_by_source=[_group(source) for source in sources if source.compared],
        figures=_figures(sources, shaft),
        static_tables=[_static_table(source) for source in sources if source.recording.static],
        models=_models(sources, model_file),
        command=f"rfca-rig report PATH... --out DIR --shaft {shaft}" + (f" --model {model_file}" if model_file else ""),
        shaft_words=SHAFT_WORDS[shaft],
        definition=DEFINITION,
        averaged=counted(sum(row.time_error_pct is not None for row in table.rows), "condition"),
        average_time=number(table.average_time_error_pct, 2),
        average_force=number(table.average_force_error_pct, 2),
        paper_time=number(PAPER_AVERAGE_ERROR_PCT[0], 1),
        paper_force=number(PAPER_AVERAGE_ERROR_PCT[1], 1),
        measured=overlay.MEASURED,
        simulated=overlay.SIMULATED,
        simulated_edge=overlay.SIMULATED_EDGE,
    )


def _standfirst(table: Table2) -> str:
    time, force = table.average_time_error_pct, table.average_force_error_pct
    if time is None or force is None:
        return "No valley could be compared." if table.rows else "Static stages; no strokes were recorded."
    paper_time, paper_force = PAPER_AVERAGE_ERROR_PCT
    return (
        f"The model meets the valley of fz to {number(time, 2)} % in time and {number(force, 2)} % in force on average; "
        f"the model of the paper met its rig to {paper_time} % and {paper_force} %."
    )


def _source(source: ComparedSource) -> dict[str, Any]:
    recording = source.recording
    held = []
    if recording.strokes:
        held.append(f"{counted(len(recording.strokes), 'stroke')} at {counted(len(source.compared), 'condition')}")
    if recording.static:
        held.append(counted(len(recording.static), "static stage"))
    origin = [(name.replace("_", " "), _brief(str(text))) for name, text in sorted(recording.provenance.items())]
    return {
        "name": source.name,
        "mark": recording.source,
        "holds": " and ".join(held) or "nothing recorded",
        "origin": origin or [("provenance", "none recorded")],
    }


def _brief(text: str) -> str:
    """Short text as it stands, but of a path only its last part; of long text its length and a hash to know it by."""
    if len(text) > LONGEST_TEXT or "\n" in text.strip():
        return f"text of {counted(len(text.splitlines()), 'line')}, sha256 {hashlib.sha256(text.encode()).hexdigest()[:16]}…"
    if PurePosixPath(text).is_absolute() or PureWindowsPath(text).is_absolute():
        return PureWindowsPath(text).name
    return text


def _group(source: ComparedSource) -> dict[str, Any]:
    return {"name": source.name, "mark": source.recording.source, "rows": [_row(row) for row in source.rows]}


def _row(row: Row) -> dict[str, Any]:
    measured = f"({spread(row.time.mean, row.time.std, 3)}, {spread(row.fz.mean, row.fz.std, 2)})"
    simulated = f"({number(row.simulated_time_s, 3)}, {number(row.simulated_fz_N, 2)})"
    return {
        "height": f"{1e3 * row.height_m:g} mm",
        "speed": f"{row.speed_rad_s:.3f}",
        "repeats": row.repeats,
        "measured": measured if row.repeats else "none",
        "simulated": simulated if row.simulated_time_s is not None else "none",
        "time_error": number(row.time_error_pct, 2),
        "force_error": number(row.force_error_pct, 2),
        "refused": row.refused,
    }


def _figures(sources: Sequence[ComparedSource], shaft: Shaft) -> list[dict[str, Any]]:
    several = sum(bool(source.compared) for source in sources) > 1
    all_compared = [(source, compared) for source in sources for compared in source.compared]
    figures = []
    for place, (source, compared) in enumerate(all_compared, start=1):
        drawn = overlay.draw_overlay(compared, salt=f"figure {place}")
        figures.append(
            {
                "number": place,
                "label": compared.condition.label,
                "source": source.name if several else "",
                "svg": drawn.svg,
                "caption": unbroken(f"{shaft_sentence(compared, shaft)} {rms_sentence(compared)} {scales_sentence(drawn)}"),
            }
        )
    return figures


def _static_table(source: ComparedSource) -> dict[str, Any]:
    stages = source.recording.static
    hinges = any(np.isfinite(stage.hinge_deg).any() for stage in stages)
    heads = ["height (mm)", "stage", "direction", "shaft angle (rad)", "fy (N)", "fz (N)", unbroken("tx (N m)")]
    if hinges:
        heads += [f"hinge {i} (°)" for i in range(2, 2 + len(stages[0].hinge_deg))]
    return {"name": source.name, "heads": heads, "lines": [_static_line(stage, hinges) for stage in stages]}


def _static_line(stage: StaticStage, hinges: bool) -> list[str]:
    cells = [f"{1e3 * stage.height_m:g}", str(stage.stage), stage.direction, number(stage.shaft_angle_rad, 4)]
    cells += [number(stage.fy_N, 2), number(stage.fz_N, 2), number(stage.tx_Nm, 3)]
    if hinges:
        cells += [number(float(angle), 2) if np.isfinite(angle) else NOTHING for angle in stage.hinge_deg]
    return cells


def _models(sources: Sequence[ComparedSource], model_file: str | None) -> list[dict[str, Any]]:
    """One table for each model that differs from the others, with the sources that share it."""
    distinct = list(dict.fromkeys(source.rig for source in sources if source.rig is not None))
    tables = []
    for rig in distinct:
        sharing = [source for source in sources if source.rig == rig]
        parts = [(part, list(of_part)) for part, of_part in groupby(quantities_of(rig), key=lambda quantity: quantity.section)]
        tables.append({"says": _model_says(sharing, model_file, len(distinct) > 1), "parts": parts})
    return tables


def _model_says(sharing: Sequence[ComparedSource], model_file: str | None, several: bool) -> str:
    what = f"The model in {model_file}, given for this report" if model_file else "The model as it was believed before the recordings"
    of_whom = f", of {', '.join(source.name for source in sharing)}" if several else ""
    known_to = sharing[0].recording.known_to
    if model_file or not known_to:
        return f"{what}{of_whom}."
    said = ", ".join(f"{name} = {value:g}" for name, value in known_to.items() if isinstance(value, int | float))
    return f"{what}{of_whom}. One standard deviation of what was believed: {said}; what is not listed counts as exact."
