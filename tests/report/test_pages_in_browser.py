"""The pages in a browser on a desk and on a phone: nothing is cut off, too small, or wider than
the screen.
"""

from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip(
    "playwright", reason='pages are tested in a browser: pip install "rfca-rig[dev]"'
)

from playwright.sync_api import Page, ViewportSize

from rfca_rig.analysis.reproduction import reproduce_strokes
from rfca_rig.description.model_file import nominal_model
from rfca_rig.exam.cases import split_numbers
from rfca_rig.exam.scored import score_exam
from rfca_rig.reports.exam.page import write_exam
from rfca_rig.reports.paper.page import PaperContext, PaperStep, write_paper
from rfca_rig.reports.provenance import Origin, PageContext
from rfca_rig.reports.run.page import page as run_page
from rfca_rig.reports.run.page import tables_of
from rfca_rig.reports.run.parts import story_of
from rfca_rig.reports.strokes.page import write_report
from rfca_rig.reports.sweep.page import page as sweep_page
from rfca_rig.reports.sweep.pictures import compute_sensitivities
from tests.analysis.torque_rotation.tables import plain
from tests.report import runs
from tests.report.exams import made_up_exam
from tests.report.recordings import BELIEVED, recording, stages, strokes
from tests.report.test_diagnosis_page import ALL
from tests.report.test_diagnosis_page import page as diagnosis_page
from tests.report.test_static_report import noisy, written
from tests.report.test_sweep_page import result_of as sweep_result
from tests.view.browser import WatchedPage, browser

pytestmark = pytest.mark.slow

WIDTHS_PX = (1280, 390)
# Figures that scroll sideways on a phone: none, wide ones are drawn a second time for it.
MAY_SCROLL: set[str] = set()
# Boxes that scroll sideways, by their labels. Of the page itself the width beyond the screen.
SCROLLED = """() => [document.documentElement.scrollWidth - document.documentElement.clientWidth,
  [...document.querySelectorAll("body *")].filter(each => ["auto", "scroll"].includes(getComputedStyle(each).overflowX)
    && each.scrollWidth > each.clientWidth + 1).map(each => each.ariaLabel ?? each.tagName)]"""
# Letters of less than 9 px are not read on a phone. Those of figures scale with them.
SMALL = """() => { const scale = seen => seen ? Math.hypot(seen.a, seen.b) : 1;
  return [...document.querySelectorAll("body *")].filter(each => each.children.length === 0 && each.textContent.trim()
  && each.tagName !== "title" && each.getClientRects().length)
  .map(each => [parseFloat(getComputedStyle(each).fontSize) * scale(each.getScreenCTM?.()), each.textContent.trim()])
  .filter(([size]) => size < 8.95); }"""
# Headings and labels that end beyond their box: of a heading its own, of a label the figure.
CLIPPED = """() => [...document.querySelectorAll("h1, h2, h3, h4, summary, svg text")].filter(each => {
  const svg = each.closest("svg"), box = each.getBoundingClientRect();
  const frame = (svg ?? document.documentElement).getBoundingClientRect();
  const beyond = box.right > frame.right + 1 || box.left < frame.left - 1
    || (svg && (box.top < frame.top - 2 || box.bottom > frame.bottom + 2));
  return box.width && (beyond || (!svg && each.scrollWidth > each.clientWidth + 1));
}).map(each => each.textContent.trim())"""
# Boxes that scroll and that a keyboard does not reach.
UNREACHED = """() => [...document.querySelectorAll("body *")].filter(each => each.tabIndex < 0 && each.scrollWidth > each.clientWidth + 1
  && ["auto", "scroll"].includes(getComputedStyle(each).overflowX)).map(each => each.outerHTML.slice(0, 80))"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """All pages, from made-up results."""
    out = tmp_path_factory.mktemp("pages")
    for name, diagnosis in ALL.items():
        (out / f"diagnosis-{name.replace(' ', '-')}.html").write_text(
            diagnosis_page(diagnosis, PageContext(Origin())), encoding="utf-8"
        )
    for made in (runs.done, runs.tripped, runs.worn):
        story = story_of(made())
        text = run_page(story, tables_of(story), PageContext(Origin()), ())
        (out / f"run-{made.__name__}.html").write_text(text, encoding="utf-8")
    write_report((recording(strokes(), stages()),), out)
    write_exam(score_exam(made_up_exam(out / "exam", split_numbers(90), false_names=0.1)), out)
    for name, swept in (
        (
            "map",
            sweep_result(
                "k0=8:12:5",
                "height_mm=200:240:9",
                value=lambda k0, height_mm: np.nan if k0 > 11.5 else k0 * height_mm,
            ),
        ),
        (
            "curves",
            sweep_result(
                "strip.material=CFSP,PA12",
                "height_mm=200:240:9",
                value=lambda *point: float(point[1]),
            ),
        ),
        ("samples", sweep_result("height_mm=200,220", "k0=8:12", "friction=0.1:0.9", samples=64)),
    ):
        (out / f"sweep-{name}.html").write_text(
            sweep_page(swept, compute_sensitivities(swept), "rfca-rig sweep"), encoding="utf-8"
        )
    (out / "static").mkdir()
    curve, _ = written(out / "static", noisy(plain(), np.random.default_rng(2)))
    reproduction = reproduce_strokes(curve, nominal_model(BELIEVED), {"height_mm": 0.2}, strokes())
    steps = (PaperStep("Strokes", "rfca-rig dynamic run --protocol table2 --model model.toml"),)
    context = PaperContext(Origin(), (("IMPORT", "a campaign"),), steps, "rfca-rig diagnose runs/a")
    write_paper(replace(reproduction, not_checked="MuJoCo is not installed"), out, context)
    return out


@pytest.fixture(scope="module")
def watched():
    with browser() as started:
        yield WatchedPage(started.new_page())


@contextmanager
def opened(watched: WatchedPage, path: Path, width_px: int):
    watched.complaints.clear()
    watched.page.set_viewport_size(ViewportSize(width=width_px, height=900))
    watched.page.goto(path.as_uri())
    yield watched.page
    assert [
        each for each in watched.complaints if not each.startswith("leaves this machine: file:")
    ] == []


def scrolled(page: Page) -> list[str]:
    beyond_px, boxes = page.evaluate(SCROLLED)
    assert beyond_px <= 0
    return boxes


@pytest.mark.parametrize("width_px", WIDTHS_PX)
def test_no_page_is_wider_than_the_screen(folder, watched, width_px, tmp_path):
    pages = sorted(folder.rglob("*.html"))
    assert len(pages) >= 18
    assert {"exam", "diagnosis-mechanism", "paper", "sweep-map", "sweep-samples"} <= {
        path.stem for path in pages
    }
    for path in pages:
        with opened(watched, path, width_px) as page:
            try:
                boxes = scrolled(page)
                # On a desk all fits. On a phone wide figures scroll within their box rather than
                # shrink; rows of tables become cards.
                assert boxes == [] if width_px == WIDTHS_PX[0] else set(boxes) <= MAY_SCROLL, (
                    path.name
                )
                assert (
                    page.evaluate(SMALL) == page.evaluate(CLIPPED) == page.evaluate(UNREACHED) == []
                ), path.name
            except AssertionError:
                # For people: it stays where pytest keeps what failed.
                page.screenshot(path=tmp_path / f"{path.stem}-{width_px}.png", full_page=True)
                raise
