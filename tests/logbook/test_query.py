"""What is looked for is found, and nothing else."""

from datetime import datetime

import pytest

from rfca_rig.errors import BadInput
from rfca_rig.logbook.entry import (
    Entry,
    LoggedCondition,
    RunQuery,
    Span,
    Verdict,
    ending_of,
    kind_of,
    since_until,
    source_of,
    span_of,
    verdict_of,
)

ENTRY = Entry(
    folder="2026/SIM-table-ii-001",
    title="Table II",
    source="SIM",
    kind="dynamic",
    began_s=datetime(2026, 11, 22, 14, 30).timestamp(),
    operator="M. Kölle",
    sample="Leg 7",
    conditions=(
        LoggedCondition(215.0, 2.433),
        LoggedCondition(235.0, 3.276),
        LoggedCondition(235.0),
    ),
    ended="tripped",
    code="F-02",
    verdict=Verdict("named", ("motor_speed_droop",), 0.999),
)


@pytest.mark.parametrize(
    ("text", "inside", "outside"),
    [
        ("215", (214.5, 215.0, 215.5), (214.4, 215.6)),
        ("2.4", (2.35, 2.433), (2.46, 2.34)),
        ("2.433", (2.4334, 2.4326), (2.434, 2.432)),
        ("2.4..2.5", (2.4, 2.5), (2.39, 2.51)),
        ("..220", (-1.0, 220.0), (220.1,)),
        ("230..", (230.0, 1e9), (229.9,)),
    ],
)
def test_a_number_is_what_rounds_to_it_and_a_range_what_lies_within(text, inside, outside):
    span = span_of(text, "--height")
    assert all(span.holds(value) for value in inside)
    assert not any(span.holds(value) for value in outside)


@pytest.mark.parametrize(
    "text", ["abc", "nan", "inf", "..", "5..2", "1e3", "2,4", "1..2..3", "..nan"]
)
def test_what_is_no_number_is_told_what_one_is(text):
    with pytest.raises(BadInput, match="--speed"):
        span_of(text, "--speed")


@pytest.mark.parametrize(
    "wanted",
    [
        RunQuery(height_mm=span_of("215", "")),
        RunQuery(height_mm=span_of("235", ""), speed_rad_s=span_of("3.2..3.3", "")),
        RunQuery(kind="dynamic", source="SIM", ended="tripped"),
        RunQuery(ended="F-02"),
        RunQuery(verdict="named"),
        RunQuery(verdict="motor_speed_droop"),
        RunQuery(sample="leg", operator="kölle"),
        RunQuery(words=("TABLE", "2026/")),
        RunQuery(began_s=since_until("2026-11-22", "2026-11-22")),
        RunQuery(began_s=since_until("2026-11-22T14:30", "")),
        RunQuery(began_s=since_until("", "2026-11-22T14:30")),
    ],
)
def test_what_fits(wanted):
    assert wanted.fits(ENTRY)


@pytest.mark.parametrize(
    "wanted",
    [
        RunQuery(height_mm=span_of("225", "")),
        RunQuery(height_mm=span_of("215", ""), speed_rad_s=span_of("3.276", "")),
        RunQuery(speed_rad_s=Span(0.0, 1.0)),
        RunQuery(kind="static"),
        RunQuery(source="REAL"),
        RunQuery(ended="done"),
        RunQuery(ended="F-01"),
        RunQuery(verdict="none"),
        RunQuery(verdict="hinge_backlash"),
        RunQuery(sample="leg 8"),
        RunQuery(words=("table", "fatigue")),
        RunQuery(began_s=since_until("2026-11-23", "")),
        RunQuery(began_s=since_until("", "2026-11-21")),
        RunQuery(began_s=since_until("", "2026-11-22T14:29")),
    ],
)
def test_what_does_not(wanted):
    assert not wanted.fits(ENTRY)


def test_names_are_known_whatever_their_case_and_mistakes_get_the_nearest():
    assert (kind_of("Static"), source_of("real"), ending_of("worn-out"), ending_of("f-02")) == (
        "static",
        "REAL",
        "worn out",
        "F-02",
    )
    assert verdict_of("nothing-missing", ()) == "nothing missing"
    assert verdict_of("hinge_backlash", ("hinge_backlash",)) == "hinge_backlash"
    for of, text, meant in (
        (kind_of, "dynmic", "dynamic"),
        (ending_of, "triped", "tripped"),
        (source_of, "sym", "SIM"),
    ):
        with pytest.raises(BadInput, match=f"did you mean {meant}\\?"):
            of(text)
    with pytest.raises(BadInput, match="did you mean motor_speed_droop"):
        verdict_of("motor_speed_drop", ("motor_speed_droop", "hinge_backlash"))


@pytest.mark.parametrize("text", ["yesterday", "2026-13-01", "22.11.2026", "99999-01-01"])
def test_what_is_no_date_is_told_how_one_is_written(text):
    with pytest.raises(BadInput, match="2026-11-01"):
        since_until(text, "")
