"""Acceptance tests of a report on strokes: its first section, a table, JSON (rfca-acceptance/1),
and the lines of the terminal.
"""

import json
from dataclasses import asdict
from math import isfinite
from typing import Any

from markupsafe import Markup

from rfca_rig.analysis.acceptance import AcceptanceTests, SignalTest, ValleyTest
from rfca_rig.reports.elements import bullets, paragraph
from rfca_rig.reports.html_table import as_html
from rfca_rig.reports.sections import PageSection
from rfca_rig.reports.strokes.tables import round_or_none
from rfca_rig.reports.table import Table, TableColumn, TableRow
from rfca_rig.reports.text import count_noun, words_and_unit

FORMAT = "rfca-acceptance/1"
NAME = "acceptance"
# Of tests that failed, in the terminal and at the head of the page; the table has all.
MOST_LINES = 10

COLUMNS = (
    TableColumn("condition", "Condition"),
    TableColumn("repeat", "Repeat"),
    TableColumn("tested", "Tested"),
    TableColumn("result", "Result"),
    TableColumn("outside", "Outside"),
    TableColumn("samples", "of samples"),
    TableColumn("t_s", "at", digits=4, over="Farthest out"),
    TableColumn("measured", "measured", digits=3, over="Farthest out"),
    TableColumn("simulated", "simulated", digits=3, over="Farthest out"),
    TableColumn("lower", "from", digits=3, over="Band there"),
    TableColumn("upper", "to", digits=3, over="Band there"),
    TableColumn("beyond", "beyond by", digits=3),
    TableColumn("source", role="group"),
    TableColumn("refused", role="note"),
)
CAPTION = (
    "Every repeat against the model. Of a signal: the sample that is farthest outside its band, or "
    "nearest to it where none is outside; forces in N, moments in N m, times from the start of the "
    "motion. Of a valley: its error and the limit in percent."
)
CONVENTION = (
    "The band at a time t goes from the smallest of measured value less tolerance to the largest "
    "of measured value plus tolerance, over the measured samples from t less the permitted lag to "
    "t plus the permitted lead."
)


def make_acceptance_section(tests: AcceptanceTests) -> PageSection:
    """The section of the page."""
    failures = [describe_failure(test) for test in tests.failed[:MOST_LINES]]
    contents: list[Markup] = [paragraph(describe_outcome(tests), "standfirst")]
    if failures:
        contents.append(bullets(failures))
    contents += [as_html(make_acceptance_table(tests), "dense"), paragraph(CONVENTION)]
    return PageSection("Acceptance tests", contents)


def describe_outcome(tests: AcceptanceTests) -> str:
    """How many tests failed, in words."""
    failed = len(tests.failed)
    if failed:
        return f"NOT ACCEPTED: {failed} of {count_noun(tests.count, 'acceptance test')} failed"
    return f"accepted: {count_noun(tests.count, 'acceptance test')} passed"


def list_failures(tests: AcceptanceTests) -> tuple[str, ...]:
    """A line for each of the first tests that failed, and how many more there are."""
    lines = [describe_failure(test) for test in tests.failed[:MOST_LINES]]
    more = len(tests.failed) - MOST_LINES
    if more > 0:
        lines.append(f"and {more} more, in {NAME}.csv")
    return tuple(lines)


def describe_failure(test: SignalTest | ValleyTest) -> str:
    """Where a test failed, and by how much."""
    if isinstance(test, ValleyTest):
        return _describe_valley(test)
    name, unit = words_and_unit(test.signal)
    where = f"{test.source}, {test.condition}, repeat {test.repeat}: {name}"
    if test.refused:
        return f"{where} cannot be tested: {test.refused}"
    return (
        f"{where} is outside at {test.t_s:.4f} s by {test.beyond:.3g} {unit}: simulated "
        f"{test.simulated:.2f}, band {test.lower:.2f} to {test.upper:.2f} around measured "
        f"{test.measured:.2f} {unit}; {test.outside} of {test.samples} samples are outside"
    )


def _describe_valley(test: ValleyTest) -> str:
    where = f"{test.source}, {test.condition}: {test.quantity} of the valley"
    if test.error_pct is None:
        return f"{where} cannot be tested: {test.refused or 'no valley'}"
    return (
        f"{where} is wrong by {test.error_pct:.2f} %, limit {test.limit_pct:g} %, "
        f"{test.error_pct - test.limit_pct:.2f} % too much"
    )


def make_acceptance_table(tests: AcceptanceTests) -> Table:
    """All tests; those that failed are marked."""
    rows = [*map(_valley_row, tests.valleys), *map(_signal_row, tests.signals)]
    # By recording, as the table is divided.
    sources = list(dict.fromkeys(str(row.values["source"]) for row in rows))
    rows.sort(key=lambda row: sources.index(str(row.values["source"])))
    return Table(NAME, CAPTION, COLUMNS, tuple(rows))


def _signal_row(test: SignalTest) -> TableRow:
    values = {**asdict(test), "tested": test.signal, "result": _word(test.is_accepted)}
    if not test.outside:
        values["beyond"] = None
    return TableRow(values, marked=not test.is_accepted)


def _valley_row(test: ValleyTest) -> TableRow:
    beyond = None
    if test.error_pct is not None and not test.is_accepted:
        beyond = test.error_pct - test.limit_pct
    values = {
        "source": test.source,
        "condition": test.condition,
        "tested": f"valley_{test.quantity}_error_pct",
        "result": _word(test.is_accepted),
        "simulated": test.error_pct,
        "lower": 0.0,
        "upper": test.limit_pct,
        "beyond": beyond,
        "refused": test.refused,
    }
    return TableRow(values, marked=not test.is_accepted)


def _word(is_accepted: bool) -> str:
    if is_accepted:
        return "passed"
    return "FAILED"


def acceptance_document(tests: AcceptanceTests) -> dict[str, Any]:
    """The JSON document as plain data; unknown values are null."""
    return {
        "format": FORMAT,
        "accepted": not tests.failed,
        "tests": tests.count,
        "failed": len(tests.failed),
        "valleys": [_plain(test) for test in tests.valleys],
        "signals": [_plain(test) for test in tests.signals],
    }


def acceptance_json(tests: AcceptanceTests) -> str:
    """The JSON document."""
    return json.dumps(acceptance_document(tests), indent=2, ensure_ascii=False) + "\n"


def _plain(test: SignalTest | ValleyTest) -> dict[str, Any]:
    values: dict[str, Any] = {"accepted": test.is_accepted}
    for name, value in asdict(test).items():
        if not isinstance(value, float):
            values[name] = value
        elif isfinite(value):
            values[name] = round_or_none(value, 6)
        else:
            values[name] = None
    return values
