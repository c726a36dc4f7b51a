"""Writes the files of a diagnosis: diagnosis.json for programs, diagnosis.html for people, tables
as CSV and LaTeX for papers.

Also its summary for a terminal: at most fifteen lines, the verdict first.
"""

import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path

from rfca_rig.diagnosis.config import EXCLUDED
from rfca_rig.diagnosis.residual_force.law import describe_law
from rfca_rig.diagnosis.result import (
    SHARED_ERROR,
    TIME_WAS_UP,
    Diagnosis,
    Located,
    NamedEffect,
    Value,
)
from rfca_rig.reports.diagnosis.json_file import as_json
from rfca_rig.reports.diagnosis.left_out import (
    describe_left_out,
    left_out_curves_table,
    left_out_table,
)
from rfca_rig.reports.diagnosis.page import page
from rfca_rig.reports.diagnosis.tables import (
    SIGMA,
    acceptance_table,
    before_after_table,
    compare_with_usual_error,
    describe_moved_prior,
    detection_limits_table,
    entries,
    format_change,
    format_p_value,
    format_probability,
    format_with_interval_90,
    hypotheses_table,
    nominal_values_table,
    parameters_table,
    residual_map_table,
    signals_table,
)
from rfca_rig.reports.page_units import convert_diagnosis
from rfca_rig.reports.provenance import Origin, PageContext, find_pages
from rfca_rig.reports.table import as_csv, table_files, write_all
from rfca_rig.reports.text import count_noun, format_significant, signal_words, words_and_unit

WIDTH = 80
MOST_LINES = 15
# Of the located differences, the largest.
PLACES = 3
# Of the misfits, the forces; hinge angles are on the page.
FIGURES = 3
# Remarks without which the answer would be misread, by their beginnings.
SHOWN_REMARKS = (EXCLUDED, SHARED_ERROR, TIME_WAS_UP)
# A console may have no other characters.
ASCII = str.maketrans(
    {
        "\u00a0": " ",
        "\u2212": "-",
        "\u2013": "-",
        "\u2192": "->",
        "±": "+-",
        "²": "2",
        "³": "3",
        SIGMA: "sigma",
    }
)

__all__ = ["terminal_lines", "write_diagnosis"]


def terminal_lines(diagnosis: Diagnosis) -> list[str]:
    """Lines of at most 80 characters, in the units of the page. Where there is too much to show,
    the last items are dropped.
    """
    diagnosis = convert_diagnosis(diagnosis)
    probability = diagnosis.probability
    verdict = diagnosis.grade.upper()
    if probability is not None:
        verdict += f" ({format_probability(probability)})"
    items = [(f"{verdict}: {diagnosis.sentence}", 3)]
    # Sizes in every joint and all rivals: what an effect is about must not be cut.
    items += [(_effect(effect), 4) for effect in diagnosis.effects[:3]]
    items += [(text, 2) for text in _body(diagnosis)]
    lines = [line for text, max_lines in items for line in _wrap(text, max_lines)]
    return lines[:MOST_LINES]


def _body(diagnosis: Diagnosis) -> Iterable[str]:
    if diagnosis.verdict == "not enough data":
        yield from diagnosis.remarks[:3]
    if diagnosis.stated_law is not None:
        law = diagnosis.stated_law.law
        yield f"law at {law.place} over {law.argument}, {describe_law(diagnosis.stated_law)}"
    yield from (remark for remark in diagnosis.remarks if remark.startswith(SHOWN_REMARKS))
    for place in sorted(diagnosis.located, key=lambda place: -place.sigmas)[:PLACES]:
        if diagnosis.is_of_stretches:
            count = count_noun(len(place.conditions), "stretch", "stretches")
        else:
            count = count_noun(len(place.conditions), "condition")
        yield _describe_located(place, count)
    yield from (
        f"remains: {_where(place)}, {compare_with_usual_error(place)}"
        for place in diagnosis.remaining[:1]
    )
    if diagnosis.place is not None:
        yield (
            f"acts on the {diagnosis.place.id} "
            f"({format_probability(diagnosis.place.probability)}): {diagnosis.place.words}"
        )
    yield from (describe_moved_prior(moved_prior) for moved_prior in diagnosis.moved_priors[:2])
    yield from _figures(diagnosis)
    failed = [criterion for criterion in diagnosis.criteria if not criterion.passed]
    if failed and diagnosis.grade != "nothing missing":
        yield "not identified: " + "; ".join(
            f"{criterion.name} ({criterion.found})" for criterion in failed
        )
    # What follows the closest entry repeats the failed criteria.
    yield from (
        f"unexplained: {text}" for text in diagnosis.unexplained[:1] if text.startswith("closest")
    )
    ruled_out = sum(effect.would_have_seen is not None for effect in diagnosis.not_seen)
    if diagnosis.not_seen:
        yield (
            f"ruled out: {count_noun(ruled_out, 'effect')}; not tested by these data: "
            f"{len(diagnosis.not_seen) - ruled_out}"
        )
    if diagnosis.next_experiment:
        yield "next: " + "; ".join(
            f"{name}: {text}" for name, text in entries(diagnosis.next_experiment) if text
        )


def _effect(effect: NamedEffect) -> str:
    values = ", ".join(_value_text(name, value) for name, value in effect.parameters.items())
    if effect.cannot_tell_from:
        others = f"; cannot be told from {', '.join(effect.cannot_tell_from)}"
    else:
        others = ""
    return f"{effect.id} ({format_probability(effect.probability)}): {values} (90 %){others}"


def _value_text(name: str, value: Value) -> str:
    words, unit = words_and_unit(name)
    return f"{words} {format_with_interval_90(value)} {unit}".strip()


def _describe_located(place: Located, count: str) -> str:
    return (
        f"located: {_where(place)}, {format_significant(place.sigmas, 2)} sigma, {count}, p "
        f"{format_p_value(place.p_value)}"
    )


def _where(place: Located) -> str:
    where = ", ".join(filter(None, (signal_words(place.signal), place.experiment, place.phase)))
    return f"{where}: {format_significant(place.size)} {place.unit}"


def _figures(diagnosis: Diagnosis) -> Iterable[str]:
    # Where a leg has left-out conditions at the commanded motion, they say what the answer is
    # worth; along the recorded motion forces fit before an effect of the drive is added.
    if text := describe_left_out(diagnosis):
        yield text
        return
    for name, fit in list(diagnosis.fit.items())[:FIGURES]:
        words, unit = words_and_unit(name)
        held_out = diagnosis.held_out.get(f"held_out_{name}")
        if held_out:
            held_out_text = f"; held out {format_change(held_out)}"
        else:
            held_out_text = ""
        if fit.noise_floor is None:
            floor = ""
        else:
            floor = f" (noise {format_significant(fit.noise_floor, 2)})"
        yield f"{words}: {format_change(fit)} {unit}{floor}{held_out_text}"


def _wrap(text: str, most: int) -> Sequence[str]:
    one_line = " ".join(text.translate(ASCII).split())
    return textwrap.wrap(
        one_line, WIDTH, subsequent_indent="  ", max_lines=most, placeholder=" ..."
    )


def write_diagnosis(diagnosis: Diagnosis, out: Path, origin: Origin | None = None) -> None:
    """Writes all files of a diagnosis into `out`, which is made where it does not exist. The same
    diagnosis gives the same bytes.

    Parameters
    ----------
    diagnosis
        The result to write.
    out
        Folder of the report.
    origin
        Command, recordings and version for the foot of the page; None for a page that no command
        made.

    Raises
    ------
    RigError
        Where a file cannot be written.
    """
    tables = (
        parameters_table(diagnosis),
        nominal_values_table(diagnosis),
        detection_limits_table(diagnosis),
        before_after_table(diagnosis),
        left_out_table(diagnosis),
    )
    # For programs only: long, or with the same content as a figure.
    plain = (
        signals_table(diagnosis),
        left_out_curves_table(diagnosis),
        residual_map_table(diagnosis),
        hypotheses_table(diagnosis),
        acceptance_table(diagnosis),
    )
    contents = {
        "diagnosis.json": as_json(diagnosis),
        **table_files(tables),
        **{f"{table.name}.csv": as_csv(table) for table in plain},
    }
    known = origin or Origin()
    context = PageContext(known, find_pages(out, known, ("diagnosis.html",)))
    write_all(out, {"diagnosis.html": page(diagnosis, context, tuple(contents)), **contents})
