"""What a reader of diagnosis.html sees first: the verdict with its evidence, what to do next, and
what the answer is worth: of a leg on conditions that were left out, else the residual before and
after.
"""

from collections.abc import Sequence
from math import isfinite
from pathlib import Path

from markupsafe import Markup

from rfca_rig.diagnosis.leg.problem import MODEL
from rfca_rig.diagnosis.result import Diagnosis, name_parts
from rfca_rig.reports.diagnosis.left_out import (
    CAPTION,
    LeftOutRow,
    choose_shown,
    describe_misfit,
    describe_shown,
    draw_left_out,
    list_left_out_rows,
)
from rfca_rig.reports.diagnosis.pictures import draw_residual
from rfca_rig.reports.diagnosis.tables import (
    all_misfits,
    format_change,
    format_probability,
    with_typography,
)
from rfca_rig.reports.elements import (
    EMPTY,
    aside,
    code,
    csv_links,
    division,
    html,
    join,
    legend,
    legend_line,
    mark,
    page_links,
    paragraph,
    verdict,
)
from rfca_rig.reports.html_table import NUMBER, HtmlCell, HtmlColumn, HtmlFoot, card_table
from rfca_rig.reports.provenance import PROGRAM, PageContext, command_line
from rfca_rig.reports.text import NOTHING, format_significant, signal_words

# What a grade means, and what its probability is one of.
GRADE_WORDS = {
    "identified": (
        "One law holds to the usual model error in all conditions.",
        "probability that this is it",
    ),
    "mostly": (
        "These effects are the dominant omission. Their laws are only approximately right.",
        "probability that they are missing",
    ),
    "family": (
        "The data tell what kind of effect is missing, not which law it follows.",
        "probability of this family",
    ),
    "nothing missing": (
        "The model predicts held-out conditions to its usual error.",
        "probability that nothing is missing",
    ),
    "unexplained": (
        "Model and recordings differ, and no entry of the catalogue accounts for it.",
        "probability that something is missing",
    ),
    "not enough data": ("These recordings do not allow an answer.", ""),
}
GRADE_WORDS_SINCE_REFERENCE = {
    "identified": (
        "One change explains the difference from the reference to the usual error.",
        "probability that this is it",
    ),
    "mostly": (
        "These changes are most of the difference. Their laws are only approximately right.",
        "probability that they are there",
    ),
    "family": (
        "The data tell what kind of change it is, not which law it follows.",
        "probability of this family",
    ),
    "nothing missing": (
        "The recordings are as the reference predicts them.",
        "probability that nothing has changed",
    ),
    "unexplained": (
        "The recordings differ from what the reference predicts.",
        "probability that something has changed",
    ),
    "not enough data": ("These recordings do not allow an answer.", ""),
}
LINES_OF_RESIDUAL = (
    legend_line("var(--other)", 1.8, "residual before", "6 3"),
    legend_line("var(--simulated)", 3.5, "after"),
)
LINES_OF_FORCE = (
    legend_line("var(--measured)", 1.4, "measured"),
    legend_line("var(--other)", 1.8, "model before", "6 3"),
    legend_line("var(--simulated)", 3.5, "model after"),
)
LEFT_OUT = (
    HtmlColumn("Left out"),
    HtmlColumn("Valley, time (%)", NUMBER),
    HtmlColumn("Valley, force (%)", NUMBER),
    HtmlColumn("fz, rms (N)", NUMBER),
)
LEFT_OUT_FILES = csv_links("left-out.csv", "left-out-signals.csv")
# Folder for the report of recordings beside the model file of a leg.
COMPARED = "report-after"
UNFINISHED = "Not every effect was tried."
NEXT_STEPS = {
    "identified": (
        "Use the model file beside this page, which has the effect. Check it on a condition not "
        "used here."
    ),
    "mostly": (
        "Use the model file beside this page as a first correction; what remains is listed below."
    ),
    "family": "Do not add a law yet: these data do not tell which one.",
    "nothing missing": "Keep the model. Effects above the detection limits below are excluded.",
    "unexplained": (
        "Do not correct the model yet. Inspect the rig where the difference was located."
    ),
    "not enough data": "Record more: at least three conditions, each with repeats.",
}
NEXT_STEPS_SINCE_REFERENCE = {
    **NEXT_STEPS,
    "identified": "Look at what has changed. The model file beside this page has the change.",
    "mostly": "Look at what has changed first; what remains is listed below.",
    "family": "Look at what the family names; these data do not tell its law.",
    "nothing missing": "Go on. Changes above the detection limits below are excluded.",
    "unexplained": "Inspect the rig where the difference was located.",
}
GIVE_MORE_TIME = "Give the diagnosis more --minutes."


def opening(diagnosis: Diagnosis, context: PageContext) -> Markup:
    """The head of the page as HTML."""
    marks = dict.fromkeys(recording.mark for recording in context.origin.recordings)
    title = join(" ", [f"Diagnosis of {diagnosis.title}", *map(mark, marks)])
    grade_words = GRADE_WORDS_SINCE_REFERENCE if diagnosis.is_since_reference else GRADE_WORDS
    meaning, number_words = grade_words[diagnosis.grade]
    if diagnosis.is_unfinished:
        meaning = UNFINISHED
    text = name_parts(meaning, diagnosis.is_of_stretches)
    evidence = with_typography(describe_evidence(diagnosis))
    probability = ""
    if diagnosis.probability is not None:
        probability = format_probability(diagnosis.probability)
    stated = verdict(
        diagnosis.grade,
        diagnosis.grade,
        with_typography(diagnosis.sentence),
        f"{text} {evidence}".strip(),
        probability,
        number_words,
    )
    step, command = describe_next_step(diagnosis)
    next_text = html("<b>What to do next.</b> {}", step)
    if command:
        next_text += html(" {}", code(command))
    if compares := name_comparison(diagnosis, context.origin.paths, Path(MODEL)):
        next_text += html(" Recordings beside that model: {}", code(compares))
    next_step = paragraph(next_text, "next")
    links = page_links(context.links)
    shown = choose_shown(diagnosis.left_out)
    if shown is None:
        steps = division("", next_step, links)
        picture = _residual(diagnosis)
    else:
        steps = division("", next_step, links, _show_left_out(diagnosis))
        picture = _figure(draw_left_out(shown), describe_shown(shown), LINES_OF_FORCE)
    return join("\n", [paragraph(title, "of"), stated, division("opening", steps, picture)])


def name_comparison(
    diagnosis: Diagnosis, recordings: Sequence[Path | str], model: Path | str
) -> str:
    """The command that compares recordings of a leg with the model of a diagnosis; "" where that
    model has nothing new. Paths are shown as on a page, texts as they are.
    """
    has_new_values = diagnosis.effects and diagnosis.left_out
    if not (recordings and has_new_values):
        return ""
    options: dict[str, object] = {"--model": model, "--out": COMPARED}
    return command_line("report", *recordings, options=options)


def _show_left_out(diagnosis: Diagnosis) -> Markup:
    """Valleys and forces of the left-out conditions, before and after, a row each."""
    rows, of_all = list_left_out_rows(diagnosis)
    feet = []
    if of_all is not None:
        cells = [HtmlCell(text, NUMBER) for text in _changes(of_all)]
        feet.append(HtmlFoot(of_all.name, 1, tuple(cells)))
    cells_of_rows = [[row.name, *_changes(row)] for row in rows]
    return join(
        "\n",
        [
            card_table("left-out conditions", LEFT_OUT, cells_of_rows, feet),
            aside(join(" ", [CAPTION, LEFT_OUT_FILES])),
        ],
    )


def _changes(row: LeftOutRow) -> list[str]:
    changes = []
    for figure in (row.time_pct, row.force_pct, row.fz_N):
        if figure is None:
            changes.append(NOTHING)
        else:
            changes.append(format_change(figure))
    return changes


def _residual(diagnosis: Diagnosis) -> Markup:
    residual = draw_residual(diagnosis)
    if residual is None:
        return EMPTY
    return _figure(residual.panels[0].svg, residual.caption, LINES_OF_RESIDUAL)


def _figure(svg: str, caption: str, lines: Sequence[Markup]) -> Markup:
    return html(
        "<figure>\n{}\n{}\n<figcaption>{}</figcaption>\n</figure>",
        legend(*lines),
        Markup(svg),
        caption,
    )


def describe_evidence(diagnosis: Diagnosis) -> str:
    """Where the mismatch was located, and what the stated effects do to it, in one sentence; ""
    where nothing was located.
    """
    if not diagnosis.located:
        return ""
    place = max(diagnosis.located, key=lambda located: located.sigmas)
    sentence = (
        f"It shows in {signal_words(place.signal)}, {place.phase}: "
        f"{format_significant(place.size)} {place.unit} rms, "
        f"{format_significant(place.sigmas, 2)} times what noise, scatter and the usual "
        "model error can do"
    )
    if left_out := describe_misfit(diagnosis):
        return f"{sentence}. {left_out}"
    misfit = all_misfits(diagnosis).get(f"rms_{place.signal}")
    if misfit is None or not diagnosis.effects or not isfinite(misfit.after):
        return f"{sentence}."
    change = (
        f"{format_significant(misfit.before, 2)} to {format_significant(misfit.after, 2)} "
        f"{place.unit}"
    )
    return f"{sentence}. With the effect, the signal's misfit falls from {change} rms."


def describe_next_step(diagnosis: Diagnosis) -> tuple[str, str]:
    """What to do with the answer in words, and the command for it, "" where none does it."""
    proposal = diagnosis.next_experiment
    if diagnosis.is_unfinished:
        return GIVE_MORE_TIME, ""
    steps = NEXT_STEPS_SINCE_REFERENCE if diagnosis.is_since_reference else NEXT_STEPS
    step = steps[diagnosis.grade]
    if diagnosis.is_of_stretches:
        step = step.replace("a condition not used", "a recording not used")
        step = step.replace("three conditions, each with repeats", "three stretches of recordings")
    if proposal is None:
        return step, ""
    if proposal.get("protocol") is None:
        return f"{step} Then do the experiment at the end of this page.", ""
    command = f"{PROGRAM} {proposal.get('kind')} run --protocol next-experiment.toml"
    return f"{step} Then record the proposed experiment:", command
