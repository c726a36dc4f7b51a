"""One look: colours that can be told apart, and one style sheet for all."""

import re
from importlib import resources

import pytest

from rfca_rig.reports import style

SHEETS = ("static.css", "diagnosis.css", "exam.css", "verdict.css")
PAGES = ("table2.html", "run.html", "static.html", "diagnosis.html", "exam.html")


def text_of(name):
    return resources.files("rfca_rig.reports").joinpath(name).read_text("utf-8")


def luminance(colour):
    parts = [int(colour[place : place + 2], 16) / 255.0 for place in (1, 3, 5)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one, other):
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize(
    ("one", "other"), [("MEASURED", "PAPER"), ("SIMULATED", "PAPER"), ("MEASURED", "SIMULATED"), ("OTHER", "PAPER"), ("FAINT", "PAPER")]
)
def test_lines_stand_out_three_to_one(one, other):
    assert contrast(getattr(style, one), getattr(style, other)) >= 3.0


def test_text_stands_out_four_and_a_half_to_one():
    base = text_of("base.css")
    for name in ("ink", "soft"):
        assert contrast(re.search(rf"--{name}: (#\w+);", base)[1], style.PAPER) >= 4.5
    assert contrast(style.BAD, style.PAPER) >= 4.5 and contrast(style.BAD, "#ffffff") >= 4.5
    for sheet in SHEETS:
        for colour in re.findall(r"(?<!-)color: (#\w{6})", text_of(sheet)):
            assert contrast(colour, style.PAPER) >= 4.5, (sheet, colour)


def test_every_page_extends_the_base_and_no_sheet_styles_tables_anew():
    for page in PAGES:
        assert text_of(page).startswith('{% extends "base.html" %}'), page
    for sheet in SHEETS:
        rules = re.findall(r"(?:^|\})\s*([^{}@]+)\{", text_of(sheet))
        bare = {selector.strip() for rule in rules for selector in rule.split(",")} & {
            "table",
            "th",
            "td",
            "body",
            "html",
            "h1",
            "h2",
            "caption",
        }
        assert not bare, (sheet, bare)


def test_in_print_nothing_scrolls_and_rows_stay_whole():
    printed = text_of("base.css").split("@media print")[1]
    assert ".wide { overflow: visible; }" in printed and "tr, figure" in printed and "break-inside: avoid" in printed
