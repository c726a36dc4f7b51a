"""Figures of a page as SVG files that stand alone, and traces as CSV."""

import csv
import io
from xml.etree import ElementTree

import numpy as np
import pytest

from rfca_rig.analysis.compare import compare_condition
from rfca_rig.analysis.repeats import group_by_condition
from rfca_rig.description.model_file import nominal_model
from rfca_rig.reports.page_figures import extract_figures, write_page_figures
from rfca_rig.reports.strokes.page import write_report
from rfca_rig.reports.strokes.traces import trace_csv
from rfca_rig.reports.style import colours
from tests.report.recordings import BELIEVED, recording, strokes

SVG = "{http://www.w3.org/2000/svg}"
PAGE = (
    '<svg viewBox="0 0 34 12" aria-hidden="true"><path d="M0 6H34"/></svg>'
    '<svg viewBox="0 0 40.5 20" role="img" aria-label="fz over time, 215 mm &lt;a&gt;" style="">'
    '<path style="stroke: var(--measured); fill: currentColor"/>'
    '<rect class="hover" x="1"><title>1 N</title></rect></svg>'
    '<svg class="phone" viewBox="0 0 1 1" role="img" aria-label="the same"><path/></svg>'
    '<svg class="forest" viewBox="0 0 1 1" role="img" aria-label="a cell"><path/></svg>'
    '<svg viewBox="0 0 9 9" role="img" aria-label="torque"><path style="fill: var(--soft)"/></svg>'
)


def test_figures_stand_alone_and_legends_and_second_drawings_are_left_out():
    figures = extract_figures(PAGE)
    assert list(figures) == ["01-fz-over-time-215-mm-lt-a-gt", "02-torque"]
    drawn = ElementTree.fromstring(figures["01-fz-over-time-215-mm-lt-a-gt"].encode())
    assert drawn.get("width") == "40.5pt"
    assert drawn.find(f"{SVG}title").text == "fz over time, 215 mm <a>"
    assert (
        drawn.find(f"{SVG}path").get("style") == f"stroke: {colours()['measured']}; fill: #000000"
    )
    assert drawn.find(f"{SVG}rect") is None
    assert "var(" not in figures["02-torque"]


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    write_report([recording(strokes())], folder)
    return folder


def test_every_figure_of_a_report_is_a_file_and_old_ones_go(report):
    old = report / "figures" / "report-07-gone.svg"
    other = report / "figures" / "run-07-of-another-page.svg"
    old.parent.mkdir(exist_ok=True)
    for file in (old, other):
        file.write_text("")
    written = write_page_figures([report / "report.html"])
    assert len(written) == len(group_by_condition(strokes()))
    assert not old.exists()
    assert other.exists()
    for file in written:
        ElementTree.parse(file)
        assert "var(" not in file.read_text()


def read_columns(text):
    rows = list(csv.DictReader(io.StringIO(text)))
    columns = {}
    for name in rows[0]:
        columns[name] = np.array([float(row[name] or "nan") for row in rows])
    return columns


def test_traces_are_those_of_the_figure(report):
    for number, condition in enumerate(group_by_condition(strokes()), start=1):
        compared = compare_condition(nominal_model(BELIEVED), condition)
        columns = read_columns((report / f"strokes-{number}.csv").read_text())
        model = compared.simulated[0].stroke
        assert columns["simulated_1_fz_N"] == pytest.approx(
            np.interp(columns["t_s"], model.t_s, model.fz_N), rel=1e-4, abs=1e-4
        )
        for repeat in compared.repeats:
            # Samples at 1 kHz: one in each bin.
            measured = columns[f"measured_{repeat.repeat}_fz_N"]
            moving = repeat.fz_N[repeat.t_s >= -1e-9][: len(measured)]
            assert measured == pytest.approx(moving, rel=1e-5, abs=1e-5)
        assert f"strokes-{number}.csv" in (report / "report.html").read_text()


def test_a_trace_is_empty_where_it_has_ended():
    condition = group_by_condition(strokes())[0]
    compared = compare_condition(nominal_model(BELIEVED), condition)
    short = compared.repeats[0]
    kept = short.t_s < 0.5
    cut = type(short)(
        short.repeat,
        short.t_s[kept],
        short.fz_N[kept],
        short.residual_N[kept],
        short.valley,
        short.phases,
    )
    shortened = type(compared)(condition, (cut, *compared.repeats[1:]), compared.simulated)
    columns = read_columns(trace_csv(shortened))
    ended = columns["t_s"] > 0.5
    assert np.isnan(columns["measured_1_fz_N"][ended]).all()
    assert np.isfinite(columns["measured_1_fz_N"][~ended][:-1]).all()
    assert np.isfinite(columns["measured_2_fz_N"]).all()
