"""One table, four ways to show it."""

import csv
import io
import re
from dataclasses import replace
from math import nan

import pytest

from rfca_rig.reports.html_table import as_html, cells_as_text
from rfca_rig.reports.table import (
    Foot,
    Table,
    TableColumn,
    TableRow,
    as_csv,
    as_tex,
    as_text,
    cell,
    places,
    with_common_decimals,
)
from tests.report.outline import Outline

COLUMNS = (
    TableColumn("height_mm", "Rack height", set_value=True),
    TableColumn("fz_N", "fz", digits=2, half="fz_std_N", over="Measured"),
    TableColumn("fz_std_N", role="kept"),
    TableColumn("torque_Nm", "torque", over="Measured"),
    TableColumn("settled"),
    TableColumn("unit"),
    TableColumn("source", role="group"),
    TableColumn("refused", role="note"),
)
ROWS = (
    TableRow(
        {
            "height_mm": 222.8,
            "fz_N": -53.7331999999,
            "fz_std_N": 0.2236,
            "torque_Nm": 1.23456789012345,
            "settled": True,
            "source": "A & B",
        }
    ),
    TableRow(
        {
            "height_mm": 215.0,
            "fz_N": nan,
            "torque_Nm": None,
            "settled": False,
            "source": "C",
            "refused": "repeat 3: no contact",
        },
        marked=True,
    ),
)
TABLE = Table(
    "t",
    "n = 5 & ± one standard deviation",
    COLUMNS,
    ROWS,
    (Foot("Average", {"torque_Nm": 3.2}, digits=1),),
)


def test_csv_holds_everything_at_full_precision_under_names_with_units():
    lines = list(csv.DictReader(io.StringIO(as_csv(TABLE))))
    assert list(lines[0]) == [column.key for column in COLUMNS]
    assert float(lines[0]["torque_Nm"]) == pytest.approx(1.23456789012345, rel=1e-11)
    assert (lines[0]["fz_std_N"], lines[0]["settled"], lines[1]["settled"]) == (
        "0.2236",
        "yes",
        "no",
    )
    assert (lines[1]["fz_N"], lines[1]["torque_Nm"], lines[1]["refused"]) == (
        "",
        "",
        "repeat 3: no contact",
    )


def test_latex_is_balanced_and_nothing_escapes_it():
    tex = as_tex(TABLE)
    lines = tex.splitlines()
    assert (
        r"\usepackage{booktabs}" in lines[0]
        and lines[1] == r"\begin{tabular}{rrrll}"
        and lines[-1] == r"\end{tabular}"
    )
    width = 5
    for line in (line for line in lines if line.endswith(r" \\")):
        spanned = sum(int(span) - 1 for span in re.findall(r"\\multicolumn\{(\d+)\}", line))
        assert len(re.findall(r"(?<!\\)&", line)) + 1 + spanned == width, line
        assert len(re.findall(r"(?<!\\)\$", line)) % 2 == 0 and line.count("{") == line.count("}")
    assert (
        r"$-53.73 \pm 0.22$" in tex
        and r"\cmidrule(lr){2-3}" in tex
        and r"torque (N\,m)" in tex
        and r"A \& B" in tex
    )
    assert r"\multicolumn{2}{l}{Average} & $3.2$ &  &  \\" in tex
    assert "-- & --" in tex and "nan" not in tex


def test_a_title_cannot_break_latex():
    nasty = Table(
        "t",
        "",
        (TableColumn("a"), TableColumn("unit")),
        (TableRow({"a": "50% & A_b {c} \\d ~^ <|>", "unit": "N/m^1.5"}),),
    )
    assert (
        r"50\% \& A\_b \{c\} \textbackslash{}d \textasciitilde{}\textasciicircum{} "
        r"\textless{}\textbar{}\textgreater{}"
    ) in as_tex(nasty)
    assert r"N/m$^{1.5}$" in as_tex(nasty)


def test_a_page_shows_what_is_known_with_true_signs():
    page = str(as_html(TABLE))
    text = Outline(page).text
    assert (
        "\u221253.73\u00a0±\u00a00.22" in text
        and "\u2013" in text
        and "A & B" in text
        and "repeat 3: no contact" in text
    )
    assert 'class="marked"' in page and page.count('scope="col') == 6
    shown = cells_as_text(TABLE)
    assert [len(row.cells) for _, rows in shown.groups for row in rows] == [5, 5]
    assert shown.foot[0].span + len(shown.foot[0].cells) == 5
    assert shown.groups[0][1][0].cells[0].content == "222.8"


def test_one_group_has_no_heading_and_a_table_without_rows_is_whole():
    one = Table("t", "", COLUMNS, ROWS[:1])
    assert [name for name, _ in one.groups()] == [""]
    empty = Table("t", "", COLUMNS, ())
    assert as_csv(empty).count("\n") == 1 and as_tex(empty).count(r"\midrule") == 1
    assert Outline(str(as_html(empty))).text


def test_a_terminal_gets_columns():
    first, *lines = as_text(TABLE).splitlines()
    assert "Measured: fz (N)" in first and len(lines) == 2
    assert "-53.73 +- 0.22" in lines[0] and all(line.isascii() for line in lines)
    assert first.index("(N)") + 3 == lines[0].index("0.22") + 4


@pytest.mark.parametrize(
    ("size", "digits"), [(0.0123, 3), (9.99, 1), (123.0, -1), (0.0, 1), (1.0, 1)]
)
def test_places_show_two_digits(size, digits):
    assert places(size, 2) == digits


def test_values_have_the_digits_that_their_uncertainty_leaves():
    column = TableColumn("k0_Nm_per_rad", half="half")
    rows = [TableRow({"k0_Nm_per_rad": 10.97812, "half": half}) for half in (0.011, 0.012, 3.0)]
    assert [(cell(column, row).text, cell(column, row).half) for row in rows] == [
        ("10.978", "0.011"),
        ("10.978", "0.012"),
        ("11.0", "3.0"),
    ]
    sure = with_common_decimals(column, rows)
    assert [cell(sure, row).half for row in rows] == ["0.011", "0.012", "3.000"]
    assert cell(column, TableRow({"k0_Nm_per_rad": -0.00001, "half": 0.1})).text == "0.00"


def test_a_small_value_does_not_round_to_none():
    column = TableColumn("noise")
    said = []
    for value in (2e-5, 0.0, 5e-5, -2e-5):
        said.append(cell(column, TableRow({"noise": value}, digits=4)).text)
    assert said == ["< 0.0001", "0.0000", "0.0001", "0.0000"]
    assert "2e-05" in as_csv(Table("t", "", (column,), (TableRow({"noise": 2e-5}, digits=4),)))


def test_a_wide_table_is_a_list_of_cards_on_a_phone_and_a_narrow_one_stays_a_table():
    def html(table):
        return str(as_html(table))

    narrow = Table(
        "n",
        "",
        (TableColumn("name"), TableColumn("value"), TableColumn("unit")),
        (TableRow({"name": "a", "value": 1.0, "unit": "s"}),),
    )
    assert "stack" not in html(narrow) and "data-head" not in html(narrow)
    wide = html(replace(TABLE, columns=(*COLUMNS, TableColumn("following_error_deg"))))
    assert 'class="stack"' in wide
    # Cells state their heading with its unit, rows the unit of their line, and feet the headings of
    # their own columns.
    assert (
        'data-head="Measured, fz (N)"' in wide
        and 'data-head="Measured, torque (N\u00a0m)"' in wide.partition("<tfoot>")[2]
    )
    long = replace(
        narrow,
        columns=(*narrow.columns, *(TableColumn(f"value{at}_Nm_per_rad") for at in range(6))),
    )
    assert '<td data-head="name" data-unit="s">a</td>' in html(
        long
    ) and 'class="unit-column"' in html(long)
