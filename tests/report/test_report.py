import csv
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.description.model_file import nominal_model
from rfca_rig.errors import RigError
from rfca_rig.model.parameters import PresentEffect, TorqueSpline
from rfca_rig.model.stroke import simulate_stroke_at_speed
from rfca_rig.reports.problems import _choose_shaft
from rfca_rig.reports.provenance import Origin, RecordingSource
from rfca_rig.reports.strokes.page import GivenModel, write_report
from tests.analysis import traces
from tests.report.outline import Outline
from tests.report.recordings import BELIEVED, recording, stages, strokes

KEYS = [
    "height_mm",
    "speed_rad_s",
    "repeats",
    "measured_time_s",
    "measured_time_std_s",
    "measured_fz_N",
    "measured_fz_std_N",
    "simulated_time_s",
    "simulated_fz_N",
    "time_error_pct",
    "force_error_pct",
]
RUN_TABLES = ("conditions", "hinge-angles", "stages", "static-readings")
TABLES = [f"run-{name}.{kind}" for name in RUN_TABLES for kind in ("csv", "tex")]
PEAKS = [f"peak-forces.{kind}" for kind in ("csv", "json", "tex")]
TRACES = ["strokes-1.csv", "strokes-2.csv"]
TABLE_2 = ["table2.csv", "table2.json", "table2.tex"]
FILES = [*PEAKS, "report.html", *TABLES, "run.html", *TRACES, *TABLE_2]


def written(folder, *recordings, **options):
    write_report(recordings, folder, **options)
    return folder


@pytest.fixture(scope="module")
def mixed(tmp_path_factory):
    return written(tmp_path_factory.mktemp("report"), recording(strokes(), stages()))


def table(folder):
    return json.loads((folder / "table2.json").read_text(), parse_constant=pytest.fail)


def test_json_has_exactly_the_form_that_other_programs_read(mixed):
    document = table(mixed)
    assert list(document) == ["format", "rows", "average"]
    assert document["format"] == "rfca-table2/1"
    assert list(document["average"]) == ["time_error_pct", "force_error_pct"]
    assert [(row["height_mm"], row["speed_rad_s"], row["repeats"]) for row in document["rows"]] == [
        (215.0, 2.433, 2),
        (235.0, 3.25, 2),
    ]
    for row in document["rows"]:
        assert list(row)[: len(KEYS)] == KEYS
        assert all(isinstance(row[key], int | float) for key in KEYS)


def test_the_model_meets_strokes_made_by_itself(mixed):
    document = table(mixed)
    assert document["average"]["time_error_pct"] < 0.3
    assert document["average"]["force_error_pct"] < 0.3
    row = document["rows"][0]
    error = 100.0 * abs(row["simulated_fz_N"] - row["measured_fz_N"]) / abs(row["measured_fz_N"])
    assert row["force_error_pct"] == pytest.approx(error, abs=1e-3)


def test_csv_says_the_same_as_json(mixed):
    with (mixed / "table2.csv").open(newline="") as file:
        lines = list(csv.DictReader(file))
    rows = table(mixed)["rows"]
    assert [{key: float(line[key]) for key in KEYS} for line in lines] == [
        {key: float(row[key]) for key in KEYS} for row in rows
    ]


def test_latex_has_every_row_and_balanced_columns(mixed):
    tex = (mixed / "table2.tex").read_text()
    assert r"\begin{tabular}{rrrrrrrrr}" in tex and r"\end{tabular}" in tex
    rows = [line for line in tex.splitlines() if re.match(r"\$2[13]5\$ &", line)]
    assert len(rows) == 2
    assert all(
        row.count(" & ") == 8 and row.endswith(r" \\") and row.count("$") % 2 == 0 for row in rows
    )
    assert all(re.search(r"\$-\d\d\.\d\d \\pm 0\.\d\d\$", row) for row in rows)


def impact(repeat, factor, **options):
    """A stroke of the paper's impact test by the model, its forces times `factor`."""
    t_s = traces.even(
        2000.0, end_s=0.25
    )  # as the simulation; a sample beside the peak has another fy
    simulated = simulate_stroke_at_speed(nominal_model(BELIEVED), 0.155, 15.0, t_s)
    condition = {"height_m": 0.155, "speed_rad_s": 15.0, "repeat": repeat, **options}
    return traces.stroke(
        t_s,
        factor * simulated.fz_N,
        **condition,
        fy_N=factor * simulated.fy_N,
        shaft_angle_rad=simulated.shaft_angle_rad,
    )


def test_the_forces_at_the_peak_stand_measured_beside_simulated_in_every_file(tmp_path):
    folder = written(tmp_path, recording((impact(1, 0.9), impact(2, 1.1))), shaft="commanded")
    document = json.loads((folder / "peak-forces.json").read_text(), parse_constant=pytest.fail)
    (row,) = document["rows"]
    assert (document["format"], row["height_mm"], row["speed_rad_s"], row["repeats"]) == (
        "rfca-peak-forces/1",
        155.0,
        15.0,
        2,
    )
    for name in ("force", "fy", "fz"):
        simulated = row[f"simulated_{name}_N"]
        assert row[f"measured_{name}_N"] == pytest.approx(simulated, rel=1e-3)
        assert row[f"measured_{name}_std_N"] == pytest.approx(
            0.2 / np.sqrt(2.0) * abs(row[f"measured_{name}_N"]), rel=1e-3
        )
    assert row["simulated_force_N"] == pytest.approx(
        np.hypot(row["simulated_fy_N"], row["simulated_fz_N"]), abs=1e-3
    )
    with (folder / "peak-forces.csv").open(newline="") as file:
        (line,) = csv.DictReader(file)
    numbers = [key for key, value in row.items() if isinstance(value, float)]
    assert len(numbers) > 12 and all(float(line[key]) == row[key] for key in numbers)
    text = Outline((folder / "report.html").read_text()).text
    assert (
        "Forces at the peak" in text
        and f"{row['measured_force_N']:.1f}\u00a0±\u00a0{row['measured_force_std_N']:.1f}" in text
    )
    assert "off the ground at its peak" in text
    tex = (folder / "peak-forces.tex").read_text()
    assert (
        r"$|F|$" in tex
        and rf"${row['measured_fz_N']:.1f} \pm {row['measured_fz_std_N']:.1f}$" in tex
    )


def test_the_papers_own_peak_stands_below_its_condition_alone(tmp_path):
    at_papers, faster = (
        (
            written(
                tmp_path / f"{speed_rad_s}", recording((impact(1, 1.0, speed_rad_s=speed_rad_s),))
            )
            / "peak-forces.tex"
        ).read_text()
        for speed_rad_s in (15.0, 15.1)
    )
    assert all(f"${value}$" in at_papers for value in (299, 188, 232))
    assert "188" not in faster and "own peak" not in faster


def test_the_page_is_whole_and_fetches_nothing(mixed):
    page = (mixed / "report.html").read_text()
    outline = Outline(page)
    inside = {link for link in outline.fetched if link.startswith("#")}
    assert set(outline.fetched) - inside == {"run.html"}
    assert {link[1:] for link in inside} <= set(outline.ids)
    assert len(outline.ids) == len(set(outline.ids)), "two figures must not share a clip path"
    assert not re.search(r"https?:|url\((?!#)|@import", page)
    assert page.count('role="img"') == 2


@pytest.mark.parametrize(("last_deg", "is_said"), [(15.0, True), (30.0, False)])
def test_hinges_that_bend_beyond_their_measured_torque_are_named(tmp_path, last_deg, is_said):
    angles_rad = np.radians([0.0, 5.0, 10.0, last_deg])
    curve = TorqueSpline(tuple(angles_rad), tuple(angles_rad + 4.2 * angles_rad**3))
    rig = nominal_model(BELIEVED)
    measured = replace(rig, leg=replace(rig.leg, k2_per_rad2=0.0, torque_splines=(curve,)))
    given = GivenModel("curve.toml", measured)
    said = (written(tmp_path, recording(strokes()[:1]), given=given) / "report.html").read_text()
    assert (
        "and its torque was measured to 15.0; beyond that the curve is straight." in said
    ) is is_said


def test_the_page_says_what_it_shows(mixed):
    text = Outline((mixed / "report.html").read_text()).text
    for said in (
        "IMPORT",
        "A <bold> campaign & more",
        "The paper",
        "3.2",
        "2.7",
        "friction coefficient",
        "k0_relative = 0.03",
        "rms: rest",
    ):
        assert said in text
    for said in (
        "fz (N)",
        "residual (N)",
        "time from the start of the motion (s)",
        "Static stages",
        "\u22125.25",
        "over the repeats",
    ):
        assert said in text
    assert not re.search(r"\bnan\b|None|\binf\b", text)


def test_every_picture_marks_the_regions_and_its_caption_gives_their_borders(mixed):
    page = (mixed / "report.html").read_text()
    svgs = re.findall(r"<svg[^>]*role=.img.*?</svg>", page, flags=re.DOTALL)
    captions = re.findall(r"<figcaption>(.*?)</figcaption>", page, flags=re.DOTALL)
    assert len(svgs) == len(captions) == 2
    for svg, caption, row in zip(svgs, captions, table(mixed)["rows"], strict=True):
        for name in ("I", "II", "III"):
            assert len(re.findall(rf">\s*{name}\s*</text>", svg)) == 1, name
        said = re.search(
            (
                r"Regions: I to ([\d.]+)\Ws, II to ([\d.]+)\Ws, III to ([\d.]+)\Ws \(mean "
                r"over the repeats\)"
            ),
            caption,
        )
        first, second, third = map(float, said.groups())
        assert 0.1 < first < second < third < second + 0.1
        assert second == pytest.approx(row["measured_time_s"], abs=6e-4), (
            "region II ends at the valley of Table II"
        )
    assert "I is the free swing" in Outline(page).text


def test_a_leg_in_the_air_has_no_regions_ii_and_iii(tmp_path):
    t_s = traces.even(1000.0)
    folder = written(
        tmp_path, recording((traces.stroke(t_s, np.full(len(t_s), 3.1), height_m=0.5),))
    )
    text = Outline((folder / "report.html").read_text()).text
    assert "No regions II and III" in text and "Regions: " not in text


def test_a_title_is_text_and_never_markup(mixed):
    assert "<bold>" not in (mixed / "report.html").read_text()


def test_the_same_input_gives_the_same_bytes(mixed, tmp_path):
    again = written(tmp_path / "again", recording(strokes(), stages()))
    assert sorted(path.name for path in again.iterdir()) == FILES
    assert all((again / name).read_bytes() == (mixed / name).read_bytes() for name in FILES)


def test_a_refused_stroke_is_told_in_every_file(tmp_path):
    t_s = traces.even(1000.0)
    bad = traces.stroke(t_s, np.full(len(t_s), 3.1), repeat=3)
    folder = written(tmp_path, recording((*strokes(), bad)))
    row = table(folder)["rows"][0]
    assert row["repeats"] == 2
    assert "repeat 3: no contact" in row["refused"][0]
    assert all(
        "repeat 3: no contact" in (folder / name).read_text()
        for name in ("report.html", "table2.csv")
    )


def test_what_is_not_known_is_null_and_never_nan(tmp_path):
    t_s = traces.even(1000.0)
    folder = written(
        tmp_path,
        recording(
            (traces.stroke(t_s, None), traces.stroke(t_s, np.full(len(t_s), 3.1), height_m=0.235))
        ),
    )
    document = table(folder)
    assert all(
        row["measured_time_s"] is None and row["force_error_pct"] is None
        for row in document["rows"]
    )
    assert document["average"] == {"time_error_pct": None, "force_error_pct": None}
    for written_file in folder.iterdir():
        assert not re.search(r"\bnan\b", written_file.read_text(), flags=re.IGNORECASE), (
            written_file.name
        )


def test_one_repeat_has_no_standard_deviation(tmp_path):
    row = table(written(tmp_path, recording(strokes()[:1])))["rows"][0]
    assert (row["repeats"], row["measured_time_std_s"], row["measured_fz_std_N"]) == (1, None, None)


def test_static_stages_alone_make_a_report(tmp_path):
    folder = written(tmp_path, recording(static=stages(hinge=float("nan"))))
    text = Outline((folder / "report.html").read_text()).text
    assert table(folder)["rows"] == []
    assert (folder / "table2.csv").read_text().startswith("height_mm,speed_rad_s,repeats,")
    assert "Static stages" in text and "Table II" not in text and "hinge 2" not in text


def test_sources_stay_apart_with_their_names_and_models(tmp_path):
    twin = recording(
        strokes(),
        title="Twin run",
        source="SIM",
        provenance={"seed": "7", "plan": "/home/lab/plans/table2.toml"},
    )
    folder = written(tmp_path, twin, recording(strokes()[:1], title="Twin run"))
    assert [row["source"] for row in table(folder)["rows"]] == [
        "Twin run (1)",
        "Twin run (1)",
        "Twin run (2)",
    ]
    text = Outline((folder / "report.html").read_text()).text
    assert "SIM was recorded on simulated twins" in text and "IMPORT came from" in text
    run = Outline((folder / "run-1.html").read_text()).text
    assert "table2.toml" in run and "/home/lab" not in run + text
    assert text.count("friction coefficient") == 1, "two recordings that share a model show it once"


def test_a_given_model_takes_the_place_of_the_believed_one(tmp_path):
    slippery = {**BELIEVED, "ground": {**BELIEVED["ground"], "friction_coefficient": 0.2}}
    folder = written(
        tmp_path, recording(strokes()), given=GivenModel("slippery.toml", nominal_model(slippery))
    )
    assert table(folder)["average"]["force_error_pct"] > 5.0
    text = Outline((folder / "report.html").read_text()).text
    assert "The model in slippery.toml, given for this report" in text


@pytest.mark.parametrize(
    ("effect", "shaft"),
    [
        (PresentEffect("motor_speed_droop", ()), "commanded"),
        (PresentEffect("tip_mass", ()), "average"),
        (None, "average"),
    ],
)
def test_a_drive_in_the_given_model_makes_its_own_motion(effect, shaft):
    effects = () if effect is None else (effect,)
    rig = replace(nominal_model(BELIEVED), effects=effects)
    assert _choose_shaft(GivenModel("model.toml", rig)) == shaft
    assert _choose_shaft(None) == "average"


@pytest.mark.parametrize("shaft", ["commanded", "average", "recorded"])
def test_the_page_ends_with_what_remakes_it(tmp_path, shaft):
    recorded = RecordingSource("IMPORT", "A title", "runs/a", "run.h5", "ab" * 32)
    origin = Origin(f"rfca-rig report runs/a --shaft {shaft}", (recorded,), "0.1.0, git 0123")
    folder = written(tmp_path, recording(strokes()[:1]), shaft=shaft, origin=origin)
    for page in ("report.html", "run.html"):
        text = Outline((folder / page).read_text()).text
        assert (
            text.index(origin.command)
            < text.index(recorded.sha256)
            < text.index("Written by rfca-rig 0.1.0, git 0123")
        )


def test_fifteen_kilohertz_does_not_make_the_page_heavier(mixed, tmp_path):
    fast = written(tmp_path, recording(strokes(rate_Hz=15000.0), stages()))
    assert (fast / "report.html").stat().st_size < 1.1 * (mixed / "report.html").stat().st_size


def test_a_folder_that_cannot_be_made_is_said_in_one_line(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(RigError, match=r"file/out: the folder for the report cannot be made"):
        write_report([recording(static=stages())], tmp_path / "file" / "out")


def test_the_title_of_a_campaign_is_said_once(tmp_path):
    folder = written(tmp_path, recording(strokes()[:1], title="Table II"))
    opening = (folder / "report.html").read_text().partition("<body>")[2].partition("<table")[0]
    assert opening.count("Table II") == 1
