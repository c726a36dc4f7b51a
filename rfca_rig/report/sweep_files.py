"""Writes the summary of a sweep: sweep.html and sweep.json, beside sweep.h5 and sweep.csv."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from rfca_rig import __version__
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.report.sweep_page import page
from rfca_rig.report.sweep_sensitivities import OutputSensitivity, compute_sensitivities
from rfca_rig.report.sweep_text import value_text, with_unit
from rfca_rig.report.text import count_noun
from rfca_rig.sweep.result import SweepResult

FORMAT = "rfca-sweep-summary/1"
HTML, JSON = "sweep.html", "sweep.json"


def write_summary(result: SweepResult, folder: Path, command: str) -> None:
    """Writes sweep.html and sweep.json into `folder`.

    The same result and command give the same bytes. Raises RigError where a file cannot be written.
    """
    sensitivities = compute_sensitivities(result)
    write_atomically(
        folder / JSON, (json.dumps(summary(result, sensitivities), indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()
    )
    write_atomically(folder / HTML, page(result, sensitivities, command).encode())


def summary(result: SweepResult, found: list[OutputSensitivity]) -> dict[str, Any]:
    """Content of sweep.json: varied and fixed quantities, outputs with their extremes and where those are, failures, sensitivities."""
    plan = result.plan
    return {
        "format": FORMAT,
        "version": __version__,
        "title": plan.title,
        "cases": plan.count,
        "failed": result.failed,
        "incomplete": result.incomplete,
        "reasons": [{"reason": reason, "cases": count} for reason, count in result.reasons()],
        "varied": list(plan.varied),
        "fixed": dict(plan.fixed),
        "outputs": [_output(result, place) for place in range(len(plan.outputs))],
        "sensitivities": [_sensitivity(each) for each in found],
    }


def _output(result: SweepResult, place: int) -> dict[str, Any]:
    asked, values = result.plan.outputs[place], result.values[:, place]
    description = {"name": asked.header, "words": asked.words, "equation": asked.output.equation, "source": asked.output.source}
    # nanargmin raises an error where all values are NaN.
    if np.isnan(values).all():
        return {**description, "lowest": None, "highest": None}
    return {
        **description,
        "lowest": _end(result, values, int(np.nanargmin(values))),
        "highest": _end(result, values, int(np.nanargmax(values))),
    }


def _end(result: SweepResult, values: np.ndarray[Any, Any], case: int) -> dict[str, Any]:
    plan = result.plan
    return {"value": float(values[case]), "case": case, "at": dict(zip(plan.varied, plan.point(case), strict=True))}


def _sensitivity(each: OutputSensitivity) -> dict[str, Any]:
    found = {"index": each.found.index, "std": each.found.std} if each.found else {"index": None, "std": None}
    return {"at": dict(each.at), "output": each.output, "of": each.name, **found}


def lines(result: SweepResult) -> list[str]:
    """Summary for a terminal: the extremes of each output, and where they are."""
    content = summary(result, [])
    text = [f"{result.plan.title}: {count_noun(result.plan.count, 'case')}{_failures(result)}"]
    for output in content["outputs"]:
        low, high = output["lowest"], output["highest"]
        text.append(
            f"{output['name']}: none" if low is None else f"{output['name']}: {_end_line(result, low)} to {_end_line(result, high)}"
        )
    return text + [f"  {reason['cases']} times: {reason['reason']}" for reason in content["reasons"]]


def _end_line(result: SweepResult, end: dict[str, Any]) -> str:
    """An extreme with its point on the grid. Sampled values are left out: they are in sweep.csv."""
    place = [
        with_unit(name, value) for name, value in end["at"].items() if result.plan.samples is None or name not in result.plan.samples.names
    ]
    return f"{value_text(end['value'])} ({', '.join(place)})" if place else value_text(end["value"])


def _failures(result: SweepResult) -> str:
    parts = [(result.failed, "failed"), (result.incomplete, "without some output"), (result.mistakes, "met a mistake of rfca-rig")]
    return "".join(f", {count} {words}" for count, words in parts if count)
