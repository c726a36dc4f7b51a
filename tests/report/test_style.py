"""One look: colours that can be told apart, and one style sheet for all."""

import re
from importlib import resources

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from rfca_rig.reports import style

SHEETS = ("static.css", "diagnosis.css", "exam.css", "verdict.css")


def text_of(name):
    return resources.files("rfca_rig.reports").joinpath(name).read_text("utf-8")


def luminance(colour):
    parts = [int(colour[place : place + 2], 16) / 255.0 for place in (1, 3, 5)]
    linear = [
        part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts
    ]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one, other):
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("MEASURED", "PAPER"),
        ("SIMULATED", "PAPER"),
        ("MEASURED", "SIMULATED"),
        ("OTHER", "PAPER"),
        ("FAINT", "PAPER"),
    ],
)
def test_lines_stand_out_three_to_one(one, other):
    assert contrast(getattr(style, one), getattr(style, other)) >= 3.0


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("measured", "paper"),
        ("simulated", "paper"),
        ("measured", "simulated"),
        ("other", "paper"),
        ("faint", "paper"),
    ],
)
def test_lines_stand_out_on_dark_paper_too(one, other):
    assert set(style.DARK) == set(style.colours())
    assert contrast(style.DARK[one], style.DARK[other]) >= 3.0


def test_text_stands_out_on_dark_paper():
    dark = text_of("dark.css")
    for name in ("ink", "soft"):
        assert contrast(re.search(rf"--{name}: (#\w+);", dark)[1], style.DARK["paper"]) >= 4.5
    for name in ("b1", "b2", "b3"):
        assert contrast(re.search(rf"--{name}: (#\w+);", dark)[1], "#ececea") >= 4.5


def test_figures_follow_the_page_into_dark_mode_and_scroll_before_they_shrink():
    figure, axes = style.make_panel("force (N)", "time (s)")
    axes.plot([0.0, 1.0], [0.0, 1.0], color=style.MEASURED)
    axes.margins(x=0.0)
    svg = style.inline_svg(
        figure,
        "salt",
        "a line",
        style.hover_values(axes, np.linspace(0.0, 1.0, 9), "s", {"a": np.arange(9.0)}, "N", 3),
    )
    assert style.MEASURED not in svg and "var(--measured)" in svg and "#000000" not in svg
    assert (
        f"--width: {72.0 * style.PANEL_IN[0]:.0f}px" in svg
        and "min-width: var(--width, 0)" in text_of("base.css")
    )
    # A phone is 390 px wide, less margins of 15 px.
    assert 72.0 * style.PANEL_IN[0] <= 360.0
    assert [float(x) for x in re.findall(r"<title>([\d.]+) s: a", svg)] == [0.125, 0.5, 0.875]
    left = 72.0 * style.LEFT_IN
    first = re.search(r'<rect class="hover" x="([\d.]+)"', svg)
    assert float(first[1]) == pytest.approx(left, abs=0.06)


@pytest.mark.parametrize("values", [(-0.0025, 0.0), (-12000.0, 9000.0), (0.0, 1.0)])
def test_no_label_of_a_panel_is_cut(values):
    with style.drawing():
        figure, axes = style.make_panel("residual of shaft angle less command (rad)", "time (s)")
        axes.plot([0.0, 1.0], values)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        renderer = canvas.get_renderer()
        box = figure.get_tightbbox(renderer)
    assert (
        box.x0 >= 0.0
        and box.y0 >= 0.0
        and box.x1 <= style.PANEL_IN[0]
        and box.y1 <= style.PANEL_IN[1]
    )


def test_text_stands_out_four_and_a_half_to_one():
    base = text_of("base.css")
    for name in ("ink", "soft"):
        assert contrast(re.search(rf"--{name}: (#\w+);", base)[1], style.PAPER) >= 4.5
    assert contrast(style.BAD, style.PAPER) >= 4.5 and contrast(style.BAD, "#ffffff") >= 4.5
    for sheet in SHEETS:
        for colour in re.findall(r"(?<!-)color: (#\w{6})", text_of(sheet)):
            assert contrast(colour, style.PAPER) >= 4.5, (sheet, colour)


def test_no_sheet_styles_tables_anew():
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
    assert (
        ".wide { overflow: visible; }" in printed
        and "tr, figure" in printed
        and "break-inside: avoid" in printed
    )
