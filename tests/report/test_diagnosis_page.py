import csv
import json
import pickle
import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.diagnosis.residual_force.law import StatedLaw
from rfca_rig.diagnosis.result import (
    BeforeAfter,
    Criterion,
    Diagnosis,
    ForceMinimum,
    LeftOutCondition,
    LeftOutValley,
    Located,
    MapCell,
    MovedPrior,
    NamedEffect,
    NotSeen,
    Rival,
    SignalOverlay,
    StatedFamily,
    StatedPlace,
    Value,
)
from rfca_rig.errors import RigError
from rfca_rig.model.parameters import PresentEffect
from rfca_rig.reports.diagnosis.files import MOST_LINES, WIDTH, terminal_lines, write_diagnosis
from rfca_rig.reports.diagnosis.opening import (
    GRADE_WORDS,
    GRADE_WORDS_SINCE_REFERENCE,
    name_comparison,
)
from rfca_rig.reports.diagnosis.page import page
from rfca_rig.reports.diagnosis.pictures import RESIDUAL_IN, draw_forest, draw_residual, pictures_of
from rfca_rig.reports.diagnosis.residual_map import EDGES, band, condition_grid, maps_of
from rfca_rig.reports.diagnosis.tables import (
    UNLISTED,
    describe_moved_prior,
    format_probability,
    format_significant,
    format_with_interval_90,
    hypothesis,
)
from rfca_rig.reports.provenance import Origin, PageContext, PageLink, RecordingSource, find_pages
from rfca_rig.reports.style import LEFT_IN, RIGHT_IN, compress_paths
from rfca_rig.reports.text import name_with_unit
from tests.model.legs import PAPER
from tests.report.outline import Outline
from tests.report.test_law_picture import CURVE, law

HEIGHTS = ("195 mm", "215 mm", "235 mm")
CONDITIONS = tuple(
    f"{height}, {speed} rad/s" for height in HEIGHTS for speed in ("2", "2.6", "3.3")
)
PHASES = {"rest": 0.4, "free": 0.9, "touchdown": 2.4, "loading": 9.0, "release": 4.0}
STATIC_PHASES = {"unloading": 4.2, "loading": 6.5}
SIZES = {"fy_N": 0.12, "fz_N": 0.34, "tx_Nm": 0.009, **{f"hinge{i}_deg": 0.2 for i in range(2, 8)}}
OVERLAY_SIGNALS = {"fy_N": 4.0, "fz_N": -12.0, "tx_Nm": 0.4}
KEYS = [
    "format",
    "verdict",
    "located",
    "effects",
    "not_seen",
    "fit",
    "unexplained",
    "next_experiment",
]


def cells():
    flaps = [
        MapCell(
            signal,
            "dynamic",
            phase,
            condition,
            sigmas * SIZES[signal],
            sigmas * (1.0 + 0.06 * place),
        )
        for signal in ("fy_N", "fz_N", "tx_Nm")
        for phase, sigmas in PHASES.items()
        for place, condition in enumerate(CONDITIONS)
    ]
    stages = [
        MapCell(signal, "static", phase, height, sigmas * size, sigmas)
        for signal, size in SIZES.items()
        for phase, sigmas in STATIC_PHASES.items()
        for height in HEIGHTS
    ]
    return (*flaps, *stages)


def overlays():
    t_s = np.linspace(-0.1, 1.2, 66)
    pulse = np.exp(-(((t_s - 0.6) / 0.2) ** 2))
    return tuple(
        SignalOverlay(condition, signal, t_s, size * pulse, 1.2 * size * pulse, 1.01 * size * pulse)
        for signal, size in OVERLAY_SIGNALS.items()
        for condition in CONDITIONS
    )


NAMED = Diagnosis(
    title="Leg 4 on the bench, March",
    verdict="named",
    sentence=(
        "The hinges have play: the springs engage only beyond a gap of 1.10 ± 0.16 deg to "
        "either side."
    ),
    located=(
        Located("fz_N", "dynamic", "loading", CONDITIONS, 3.08, "N", 11.0, 0.0002),
        Located("tx_Nm", "dynamic", "loading", CONDITIONS[3:6], 0.081, "N m", 9.9, 0.001),
        Located("hinge3_deg", "static", "loading", HEIGHTS[:2], 1.3, "deg", 6.5, 0.012),
    ),
    cells=cells(),
    effects=(
        NamedEffect(
            "hinge_backlash",
            "play before the spring engages",
            0.968,
            {"half_gap_deg": Value(1.1, 0.1)},
            ("spring_hysteresis",),
            "Law confirmed: one gap serves all conditions and all channels.",
            plausible={"half_gap_deg": (0.05, 4.0)},
        ),
    ),
    criteria=(
        Criterion("probability", True, "0.962 that every effect is there, 0.9 needed"),
        Criterion(
            "held-out misfit",
            False,
            "1.42 of what noise and a usual model error make, 1 at most",
            "1 at most",
        ),
        Criterion("plausible values", True, "all nuisance parameters are near their priors"),
    ),
    rivals=(
        Rival(("hinge_backlash",), 0.968, -120.4, 0.008),
        Rival(("hinge_backlash", "sensor_lag"), 0.021, -124.2, 0.008),
        Rival(("unknown",), 0.0105, -125.0, 0.061),
        Rival(("spring_hysteresis",), 0.0004, -128.1, 0.014),
        Rival((), 0.0, -204.6, 0.029),
    ),
    not_seen=(
        NotSeen("sensor_drift", {"rate_N_per_s": 0.2}),
        NotSeen("spring_relaxation", {"strength_relative": 0.041, "time_constant_s": 0.3}),
        NotSeen("ground_compliance", {"stiffness_N_per_m1p5": 43210.0}),
        NotSeen("tip_mass", {"mass_g": 1.7}),
        NotSeen("sensor_crosstalk", {"fz_per_fy": 0.013}),
        NotSeen("motor_speed_ripple", None),
        NotSeen("gravity_tilt", None),
    ),
    fit={
        "rms_fy_N": BeforeAfter(1.08, 0.11, 0.07),
        "rms_fz_N": BeforeAfter(3.2, 0.31, 0.2),
        "rms_tx_Nm": BeforeAfter(0.081, 0.007, 0.004),
        "rms_hinge3_deg": BeforeAfter(1.3, 0.22, 0.2),
    },
    held_out={
        "held_out_rms_fy_N": BeforeAfter(1.1, 0.13, 0.07),
        "held_out_rms_fz_N": BeforeAfter(3.3, 0.35, 0.2),
        "held_out_rms_tx_Nm": BeforeAfter(0.084, 0.009, 0.004),
    },
    valley={
        "valley_time_error_pct": BeforeAfter(3.1, 0.4),
        "valley_force_error_pct": BeforeAfter(9.0, 0.6),
    },
    unexplained=("fz in release at 235 mm, 3.3 rad/s: 0.6 N rms, 3.4 \u03c3",),
    remarks=("Repeat 3 at 195 mm, 2 rad/s was left out: no contact.",),
    next_experiment={
        "what": "static stages with a weight that keeps the hinges preloaded",
        "heights_mm": [195, 205],
        "tells_apart": ["hinge_backlash"],
    },
    believed_values={
        "mass": Value(320.4, 1.1),
        "k0_relative": Value(0.012, 0.02),
        "friction_coefficient": Value(0.41, 0.0),
    },
    overlays=overlays(),
    settings={
        "model_error": 0.01,
        "priors": {"nothing missing": 0.5, "unknown": 0.1},
        "seed": 7,
        "scatter": {"fz_N": 0.08},
    },
    found_effects=(PresentEffect("hinge_backlash", (("half_gap_deg", 1.1),)),),
    found_rig=PAPER,
    grade="identified",
    probability=0.968,
)
NOTHING_MISSING = replace(
    NAMED,
    verdict="nothing missing",
    grade="nothing missing",
    probability=0.913,
    sentence="The model agrees with everything recorded.",
    located=(),
    effects=(),
    rivals=(Rival((), 0.913, -90.0, 0.007), Rival(("tip_mass",), 0.05, -93.0, 0.007)),
    unexplained=(),
)
UNEXPLAINED = replace(
    NAMED,
    verdict="unexplained",
    grade="unexplained",
    probability=1.0,
    sentence="Something is missing that has no name here.",
    effects=(),
    place=StatedPlace("hinges", "a torque in all hinges alike", 0.93),
    found_effects=(),
)
MOSTLY = replace(
    NAMED,
    verdict="unexplained",
    grade="mostly",
    probability=0.91,
    sentence="Mostly missing: play.",
    explained_share=0.83,
    remaining=(Located("fz_N", "dynamic", "touchdown", CONDITIONS[:2], 0.9, "N", 3.1, 0.001),),
    moved_priors=(
        MovedPrior("hinge_damping", "N m s/rad", Value(0.05, 0.025), Value(0.2, 0.02), 6.0),
    ),
)
FAMILY = replace(
    NAMED,
    verdict="unexplained",
    grade="family",
    probability=0.88,
    sentence="Of the cause only the family is clear.",
    effects=(),
    family=StatedFamily(
        "sensor_late",
        "the sensor is late: a filter or a delay",
        "sensor",
        0.88,
        ("clock_offset", "sensor_lag"),
    ),
    explained_share=0.7,
    found_effects=(),
)
TOO_LITTLE = replace(
    NAMED,
    verdict="not enough data",
    grade="not enough data",
    probability=None,
    sentence="Two conditions without repeats allow no answer.",
    **dict.fromkeys(
        (
            "located",
            "cells",
            "effects",
            "criteria",
            "rivals",
            "not_seen",
            "unexplained",
            "overlays",
            "found_effects",
        ),
        (),
    ),
    **{name: {} for name in ("fit", "held_out", "valley", "believed_values", "settings")},
    next_experiment=None,
)
MOTIONS = tuple(
    f"{run}, repeat 1, {begin}.0 to {begin + 2}.0 s"
    for run in ("sines 1", "sines 2")
    for begin in (0, 2)
)


def motions_of(signal):
    """Cells of a mechanism: the phase of each condition is its run."""
    return tuple(
        MapCell(signal, "motions", one.partition(",")[0], one, 0.1, 9.0) for one in MOTIONS
    )


def motion_overlays(signals):
    t_s = np.linspace(0.0, 4.0, 161)
    wave = np.sin(4.0 * t_s)
    starts_s = np.arange(0.0, 4.0, 0.5)
    return tuple(
        SignalOverlay(
            f"{run}, repeat 1",
            signal,
            t_s,
            wave,
            0.9 * wave,
            0.995 * wave,
            starts_s,
            np.full(161, run),
            MOTIONS[at : at + 2],
        )
        for signal in signals
        for run, at in (("sines 1", 0), ("sines 2", 2))
    )


JOINT_SIGNALS = (
    "joint1_position_rad",
    "joint2_position_rad",
    "joint1_speed_rad_s",
    "joint2_speed_rad_s",
)
MECHANISM = replace(
    NAMED,
    title="Arm on the table",
    sentence="Joint 2 has dry friction: 0.120 \u00b1 0.003 N m.",
    located=(
        Located("joint2_position_rad", "motions", "sines 2", MOTIONS[2:], 0.1, "rad", 9.0, 0.001),
    ),
    cells=tuple(cell for signal in JOINT_SIGNALS for cell in motions_of(signal)),
    effects=(
        NamedEffect(
            "joint_friction",
            "dry friction in a joint",
            0.99,
            {"friction_Nm": Value(0.12, 0.0016)},
            (),
            "",
            plausible={"friction_Nm": (0.004, 1.7)},
        ),
    ),
    not_seen=(
        NotSeen("gravity_tilt", {"about_x_rad": 0.01, "about_y_rad": 0.02}),
        NotSeen("joint_spring", None),
    ),
    fit={f"rms_{signal}": BeforeAfter(0.07, 0.004, 0.002) for signal in JOINT_SIGNALS},
    held_out={
        f"held_out_rms_{signal}": BeforeAfter(0.08, 0.005, 0.002) for signal in JOINT_SIGNALS
    },
    valley={},
    unexplained=("joint2 position in sines 2: 0.004 rad rms, 1.2 \u03c3",),
    remarks=(),
    overlays=motion_overlays(JOINT_SIGNALS),
    believed_values={
        "link2.mass_relative": Value(0.01, 0.008),
        "joint1.zero_offset_rad": Value(0.001, 0.0005),
    },
    priors={"link2.mass_relative": Value(0.0, 0.02), "joint1.zero_offset_rad": Value(0.0, 0.002)},
    next_experiment=None,
    found_effects=(),
)
ALL = {
    "named": NAMED,
    "mechanism": MECHANISM,
    "mostly": MOSTLY,
    "family": FAMILY,
    "nothing missing": NOTHING_MISSING,
    "unexplained": UNEXPLAINED,
    "not enough data": TOO_LITTLE,
}


def written_json(folder, diagnosis):
    write_diagnosis(diagnosis, folder)
    return json.loads(
        (folder / "diagnosis.json").read_text(encoding="utf-8"), parse_constant=pytest.fail
    )


def read(text):
    """What a reader sees, words apart."""
    body = re.sub(r"<[^>]*>", " ", text[text.index("<body>") :])
    return " ".join(unescape(body).split()).replace(" .", ".").replace(" :", ":")


@pytest.fixture(scope="module", autouse=True)
def drawn():
    """Draws the same overlays once for all pages, by their content: most tests are about the words
    around them.

    A page makes overlays of its own from those of the diagnosis, in other units.
    """
    pictures = {}

    def draw_once(overlays, never_folded):
        key = pickle.dumps((list(overlays), sorted(never_folded)))
        if key not in pictures:
            pictures[key] = pictures_of(overlays, never_folded)
        return pictures[key]

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("rfca_rig.reports.diagnosis.page.pictures_of", draw_once)
        yield pictures


@pytest.fixture(scope="module")
def named_page():
    return page(NAMED, PageContext(Origin()))


@pytest.mark.slow
def test_json_has_the_keys_that_other_programs_read(tmp_path):
    document = written_json(tmp_path, NAMED)
    assert list(document)[: len(KEYS)] == KEYS
    assert (document["format"], document["verdict"]) == ("rfca-diagnosis/2", "named")
    assert list(document["located"][0])[:7] == [
        "signal",
        "experiment",
        "phase",
        "conditions",
        "size",
        "unit",
        "p_value",
    ]
    assert document["located"][1]["conditions"] == list(CONDITIONS[3:6])
    assert list(document["effects"][0])[:4] == [
        "id",
        "probability",
        "parameters",
        "cannot_tell_from",
    ]
    assert document["effects"][0]["parameters"] == {"half_gap_deg": {"value": 1.1, "std": 0.1}}
    assert document["not_seen"][0] == {
        "id": "sensor_drift",
        "would_have_seen": {"rate_N_per_s": 0.2},
    }
    assert document["not_tested"] == ["motor_speed_ripple", "gravity_tilt"]
    assert document["fit"]["rms_fz_N"] == {"before": 3.2, "after": 0.31, "noise_floor": 0.2}
    assert document["fit"]["held_out_rms_fz_N"] == {
        "before": 3.3,
        "after": 0.35,
        "noise_floor": 0.2,
    }
    assert document["fit"]["valley_time_error_pct"] == {"before": 3.1, "after": 0.4}
    assert document["next_experiment"]["heights_mm"] == [195, 205]
    assert document["rivals"][2]["ids"] == ["unknown"] and document["rivals"][4]["ids"] == []


def test_a_nuisance_parameter_has_its_prior_its_unit_and_the_key_that_states_it(tmp_path, drawn):
    mass = {
        "priors": {"mass": Value(320.0, 3.0)},
        "nuisance_units": {"mass": "g"},
        "nuisance_keys": {"mass": "mass_relative"},
    }
    stated = replace(NAMED, **mass)
    assert written_json(tmp_path, stated)["priors"] == {
        "mass": {"value": 320.0, "std": 3.0, "unit": "g", "known_to": "mass_relative"}
    }
    rows = {
        row["parameter"]: row
        for row in csv.DictReader(
            (tmp_path / "believed.csv").read_text(encoding="utf-8").splitlines()
        )
    }
    assert [rows["mass"][name] for name in ("unit", "prior_value", "prior_std")] == [
        "g",
        "320.0",
        "3.0",
    ]
    assert "<code>mass_relative</code>" in (tmp_path / "diagnosis.html").read_text()
    assert "Key of the prior" not in page(replace(stated, nuisance_keys={}), PageContext(Origin()))


def test_what_is_not_known_is_null_and_never_nan(tmp_path):
    nan = float("nan")
    holes = replace(
        NAMED,
        cells=(MapCell("fz_N", "dynamic", "free", CONDITIONS[0], nan, np.inf),),
        fit={"rms_fz_N": BeforeAfter(3.2, nan, None)},
        settings={"scatter": np.array([0.1, nan]), "seed": np.int64(7), "unset": None},
        next_experiment=None,
        overlays=(replace(NAMED.overlays[0], before=np.full(66, nan)),),
    )
    document = written_json(tmp_path, holes)
    assert document["fit"]["rms_fz_N"] == {"before": 3.2, "after": None, "noise_floor": None}
    assert document["settings"] == {"scatter": [0.1, None], "seed": 7, "unset": None}
    assert (
        document["cells"][0]["size"],
        document["cells"][0]["sigmas"],
        document["next_experiment"],
    ) == (None, None, None)
    assert not re.search(
        r"\bnan\b|\binf\b|\bNone\b(?! proposed)", read(page(holes, PageContext(Origin())))
    )


@pytest.mark.slow
def test_a_measured_law_is_drawn_and_told(tmp_path):
    stated = StatedLaw(law(), ("hinge_backlash",), CURVE)
    measured = replace(NAMED, stated_law=stated)
    told = written_json(tmp_path, measured)["measured_law"]
    assert (told["place"], told["argument"], told["instead_of"], told["catalogue"]["id"]) == (
        "floor_friction",
        "slip_m_s",
        ["hinge_backlash"],
        CURVE.name,
    )
    assert (
        len(told["knots"]) == len(told["values"]) == len(told["std"]) and told["has_memory"] is None
    )
    said = read(page(measured, PageContext(Origin())))
    assert (
        "The law at floor_friction as measured" in said
        and "in place of what hinge_backlash states there" in said
        and "removes 90 %" in said
    )
    assert written_json(tmp_path, NAMED)["measured_law"] is None and "as measured" not in read(
        page(NAMED, PageContext(Origin()))
    )


@pytest.mark.long
@pytest.mark.parametrize("verdict", ALL)
def test_every_verdict_makes_a_whole_page_that_fetches_nothing(verdict):
    text = page(ALL[verdict], PageContext(Origin()))
    outline = Outline(text)
    assert all(link.startswith("#") and link[1:] in outline.ids for link in outline.fetched)
    assert len(outline.ids) == len(set(outline.ids)), "two pictures must not share a clip path"
    assert not re.search(r"https?:|url\((?!#)|@import", text)
    assert (
        ALL[verdict].grade in outline.text and ALL[verdict].sentence.split(" ")[-1] in outline.text
    )


@pytest.mark.parametrize(
    ("ids", "said"),
    [
        ((), "nothing missing"),
        (("unknown", "unknown"), UNLISTED),
        (("tip_mass", "unknown"), f"tip_mass and {UNLISTED}"),
    ],
)
def test_rivals_have_names(ids, said):
    assert hypothesis(ids) == said


@pytest.mark.slow
def test_the_page_says_everything_once_needed(named_page):
    text = read(named_page)
    for said in (
        "97 % probability that this is it",
        "half gap 1.10 ± 0.16 deg",
        "cannot tell it from spring_hysteresis (rate-independent loop of the spring (Bouc-Wen))",
        "all 9",
        "fz N 3.20 0.31 3.30 0.35 0.20",
        "held-out misfit 1 at most 1.42 of what noise and a usual model error make failed",
        "sensor_drift: rate 0.200 N/s",
        "stiffness 43200 N/m^1.5",
        "Not tested",
        "motor_speed_ripple",
        "valley time error % \u2013 \u2013 3.10 0.40",
        "heights, mm 195, 205",
        "priors: nothing missing 0.5",
        "Repeat 3 at 195 mm, 2 rad/s was left out",
        "something that the catalogue does not list",
        "3.4 \u03c3",
    ):
        assert said in text, said


def test_a_title_is_text_and_never_markup():
    nasty = "<b>&\"leg'"
    overlay = replace(NAMED.overlays[0], condition=nasty, signal="<i>_N")
    text = page(
        replace(
            NAMED,
            title=nasty,
            sentence=nasty,
            overlays=(overlay,),
            remarks=(nasty,),
            cells=(replace(NAMED.cells[0], condition=nasty),),
        ),
        PageContext(Origin()),
    )
    Outline(text)
    assert "<b>&" not in text and "<i>" not in text
    assert "&lt;b&gt;&amp;" in text


def test_the_same_diagnosis_gives_the_same_bytes(tmp_path, drawn):
    # Two signals in two conditions.
    few = replace(
        NAMED,
        overlays=tuple(
            one
            for one in NAMED.overlays
            if one.signal != "tx_Nm" and one.condition in CONDITIONS[:2]
        ),
    )
    for folder in ("one", "two"):
        drawn.clear()
        write_diagnosis(few, tmp_path / folder)
    files = sorted(file.name for file in (tmp_path / "one").iterdir())
    tables = [
        f"{name}.{kind}"
        for name in ("before-after", "believed", "left-out", "parameters", "ruled-out")
        for kind in ("csv", "tex")
    ]
    plain = [
        f"{name}.csv"
        for name in (
            "acceptance-tests",
            "hypotheses",
            "left-out-signals",
            "residual-map",
            "signals",
        )
    ]
    assert files == sorted([*tables, *plain, "diagnosis.html", "diagnosis.json"])
    for name in files:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_the_page_is_light(named_page):
    # 27 panels, each with 24 values for a pointer.
    assert len(named_page.encode()) < 320_000


def test_a_folder_that_cannot_be_made_is_one_clear_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RigError, match="--out"):
        write_diagnosis(TOO_LITTLE, tmp_path / "file" / "below")


@pytest.mark.parametrize("diagnosis", ALL.values(), ids=ALL)
def test_the_terminal_gets_few_short_plain_lines_with_the_verdict_first(diagnosis):
    lines = terminal_lines(diagnosis)
    assert 1 <= len(lines) <= MOST_LINES
    assert all(len(line) <= WIDTH and line.isascii() for line in lines)
    assert lines[0].startswith((diagnosis.grade or diagnosis.verdict).upper())


def test_the_terminal_names_effect_size_and_place():
    said = " ".join(" ".join(terminal_lines(NAMED)).split())
    for part in (
        "IDENTIFIED (97 %)",
        "hinge_backlash (97 %): half gap 1.10 +- 0.16 deg (90 %)",
        "fz, dynamic, loading: 3.08 N, 11 sigma, 9 conditions, p < 0.001",
        "held out 3.3 -> 0.35",
    ):
        assert part in said


def test_the_map_nests_heights_and_speeds_and_frames_what_was_located():
    dynamic, static = maps_of(NAMED)
    assert (
        dynamic.phases == tuple(PHASES)
        and dynamic.columns == ("2", "2.6", "3.3")
        and dynamic.corner == "rad/s"
    )
    assert [len(rows) for _, rows in dynamic.signals] == [3, 3, 3]
    tx = dict(dynamic.signals)["tx, N m"]
    framed = [
        (row.label, place) for row in tx for place, shade in enumerate(row.shades) if shade.located
    ]
    assert framed == [("215 mm", 9), ("215 mm", 10), ("215 mm", 11)], (
        "loading is the fourth phase of three columns each"
    )
    assert tx[1].shades[9].text == "0.081" and tx[1].shades[9].sigmas == "11"
    assert static.phases == ("loading", "unloading") and static.columns == ("195", "215", "235")


def test_a_place_without_a_recording_stays_empty():
    here, *others = [
        cell for cell in NAMED.cells if cell.signal == "fz_N" and cell.experiment == "dynamic"
    ]
    (only,) = maps_of(replace(NAMED, cells=tuple(others)))
    first = only.signals[0][1][0].shades
    assert (here.phase, first[0].text, first[1].text != "") == ("rest", "", True)


def test_angles_are_in_degrees_on_the_page_and_in_radians_beside_it(tmp_path):
    text = read(page(MECHANISM, PageContext(Origin())))
    for said in (
        "joint2 position, deg",
        "5.73 deg",
        "joint1.zero offset 0.00 \u00b1 0.19 0.057 \u00b1 0.047 deg",
        "about x 0.573 deg",
    ):
        assert said in text, said
    assert not re.search(r"(?<!/)\brad\b(?!/)", text.replace("N m/rad", "").replace("rad/s", ""))
    assert "joint2 position in sines 2: 0.23 deg rms" in text
    document = written_json(tmp_path, MECHANISM)
    assert (document["located"][0]["signal"], document["located"][0]["size"]) == (
        "joint2_position_rad",
        0.1,
    )
    assert "joint2_position_rad" in (tmp_path / "residual-map.csv").read_text()
    # The terminal has the units of the page.
    lines = " ".join(terminal_lines(MECHANISM))
    assert (
        "joint2 position, motions, sines 2: 5.73 deg" in lines
        and "rms joint1 position: 4.0 -> 0.23 deg" in lines
    )
    assert not re.search(r"(?<!/)\brad\b(?!/)", lines)


def test_conditions_that_are_one_phase_each_leave_no_place_empty():
    located = (
        Located("joint1_position_rad", "motions", "sines 2", MOTIONS[2:], 0.1, "rad", 9.0, 0.001),
    )
    (only,) = maps_of(replace(NAMED, cells=motions_of("joint1_position_rad"), located=located))
    shades = {
        (row.label, column): shade
        for _, rows in only.signals
        for row in rows
        for column, shade in enumerate(row.shades)
    }
    assert only.phases == ("",) and len(shades) == len(MOTIONS)
    assert all(shade.text for shade in shades.values())
    assert {label for (label, _), shade in shades.items() if shade.located} == {"sines 2"}


def test_a_place_that_all_conditions_with_its_phase_show_does_not_list_them():
    located = (
        Located("joint1_position_rad", "motions", "sines 2", MOTIONS[2:], 0.1, "rad", 9.0, 0.001),
    )
    text = read(
        page(
            replace(NAMED, cells=motions_of("joint1_position_rad"), located=located, overlays=()),
            PageContext(Origin()),
        )
    )
    assert (
        "all 2" in text and MOTIONS[2] not in text.partition("Located")[2].partition("p is the")[0]
    )


def test_the_parts_of_a_recording_are_drawn_as_one():
    t_s = np.linspace(0.0, 4.0, 81)
    late = np.where(t_s > 2.0, 1.0, 0.1)
    whole = SignalOverlay(
        "sines 1, repeat 1",
        "joint1_position_rad",
        t_s,
        late,
        0 * t_s,
        late,
        np.array([0.0, 2.0]),
        np.full(81, "sines 1"),
        MOTIONS[:2],
    )
    located = (
        Located("joint1_position_rad", "motions", "sines 1", MOTIONS[:2], 0.1, "rad", 9.0, 0.001),
    )
    drawn = draw_residual(replace(NAMED, overlays=(whole,), located=located))
    # A phase that is the whole recording is not shaded, and one recording is not the worst of two.
    assert (
        "at sines 1, repeat 1. Rms (sines 1): 0.71" in drawn.caption.replace("\u00a0", " ")
        and "worst" not in drawn.caption
    )
    assert "var(--pale)" not in drawn.panels[0].svg
    assert "1 recording on one scale" in pictures_of([whole])[0].caption


@pytest.mark.parametrize(
    ("conditions", "rows", "columns"),
    [
        (CONDITIONS, 3, 3),
        (CONDITIONS[:1], 1, 1),
        (HEIGHTS, 1, 3),
        ([f"215 mm, {speed} rad/s" for speed in range(9)], 9, 1),
        ([f"{190 + speed} mm, {speed} rad/s" for speed in range(9)], 9, 1),
    ],
)
def test_every_condition_has_one_place_in_the_grid(conditions, rows, columns):
    grid = condition_grid(conditions, 5)
    assert (len(grid.rows), len(grid.columns)) == (rows, columns)
    assert sorted(grid.at.values()) == sorted(conditions)
    assert all(row in grid.rows and column in grid.columns for row, column in grid.at)


def test_light_paths_end_where_the_heavy_ones_did():
    rng = np.random.default_rng(3)
    points = np.round(300.0 + np.cumsum(rng.uniform(-3.0, 3.0, (60, 2)), axis=0), 1)
    heavy = " \n".join(
        f"{'M' if place in (0, 30) else 'L'} {x:.1f} {y:.1f}" for place, (x, y) in enumerate(points)
    )
    light = compress_paths(f'<path d="{heavy} "/>')
    assert len(light) < 0.7 * len(heavy)
    back = []
    for piece in re.findall(r"M[^M\"]*", light):
        numbers = [float(number) for number in re.findall(r"-?(?:\d+\.?\d*|\.\d+)", piece)]
        back.append(np.cumsum(np.reshape(numbers, (-1, 2)), axis=0))
    assert np.concatenate(back) == pytest.approx(points, abs=1e-6)
    assert compress_paths('<path d="M 1.0 2.0 L 3.0 4.0"/>') == '<path d="M 1.0 2.0 L 3.0 4.0"/>'


def test_bands_begin_at_their_edges():
    assert [band(edge) for edge in EDGES] == [1, 2, 3, 4]
    assert [band(edge - 1e-9) for edge in EDGES] == [0, 1, 2, 3]
    assert band(float("nan")) == 0


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("half_gap_deg", "half gap, deg"),
        ("coefficient_Nm_s_per_rad", "coefficient, N m s/rad"),
        ("stiffness_N_per_m1p5", "stiffness, N/m^1.5"),
        ("coefficient_N_s2_per_m3", "coefficient, N s²/m³"),
        ("inertia_kg_m2", "inertia, kg m²"),
        ("k2_per_rad2", "k2, 1/rad²"),
        ("speed_m_s", "speed, m/s"),
        ("cycles_per_turn", "cycles per turn"),
        ("fz_per_fy", "fz per fy"),
        ("strength_relative", "strength, relative"),
        ("hinge3_deg", "hinge 3, deg"),
        ("valley_time_error_pct", "valley time error, %"),
        ("slope", "slope"),
        ("s", "s"),
    ],
)
def test_names_are_read_with_their_units(name, said):
    assert name_with_unit(name) == said


def test_numbers_show_what_is_known_of_them():
    assert format_with_interval_90(Value(94321.0, 4000.0)) == "94300 ± 6600"
    assert format_with_interval_90(Value(4.0, 0.0)) == "4.000"
    assert (
        format_significant(0.04321),
        format_significant(1234.5),
        format_significant(-0.5),
        format_significant(None),
        format_significant(0.0),
    ) == (
        "0.0432",
        "1230",
        "\u22120.500",
        "\u2013",
        "0",
    )
    assert [
        format_probability(p).replace("\u00a0", " ") for p in (1.0, 0.9949, 0.968, 0.004, 0.0)
    ] == [
        "> 99.9 %",
        "99.5 %",
        "97 %",
        "0.4 %",
        "< 0.1 %",
    ]


@pytest.mark.slow
def test_a_graded_answer_says_what_remains_and_which_prior_moved(tmp_path):
    text = read(page(MOSTLY, PageContext(Origin())))
    for words in (
        "mostly",
        "83",
        "What remains",
        "hinge damping moved to",
        "6.0 prior standard deviations",
        "the fit stops at 4",
    ):
        assert words in text
    document = written_json(tmp_path, MOSTLY)
    assert (document["verdict"], document["grade"], document["statement"]["probability"]) == (
        "unexplained",
        "mostly",
        0.91,
    )
    assert document["effects"][0]["id"] == "hinge_backlash"
    assert document["remaining"][0]["phase"] == "touchdown"
    assert any(
        line.startswith("MOSTLY (91.0") or line.startswith("MOSTLY (91")
        for line in terminal_lines(MOSTLY)
    )


@pytest.mark.slow
def test_a_family_is_given_with_its_members_and_a_place_with_its_probability():
    text = read(page(FAMILY, PageContext(Origin())))
    assert "a filter or a delay (sensor)" in text and "clock_offset , sensor_lag" in text
    beside = StatedFamily(
        "leg_mass", "the mass of the leg", "hinges", 0.83, ("heavier_link", "tip_mass")
    )
    text = read(page(replace(FAMILY, other_families=(beside,)), PageContext(Origin())))
    assert (
        "Beside it, only the family is clear: the mass of the leg, 83" in text
        and "heavier_link , tip_mass" in text
    )
    assert "hinges (93" in read(page(UNEXPLAINED, PageContext(Origin())))


def test_the_first_screen_has_verdict_next_step_and_the_located_residual(named_page):
    opening = named_page.partition("<main>")[0]
    text = read(opening + "</body>")
    assert "What to do next. Use the model file beside this page, which has the effect" in text
    assert "It shows in fz, loading: 3.08 N rms, 11 times" in text
    assert "With the effect, the signal's misfit falls from 3.2 to 0.31 N rms" in text
    assert opening.count('role="img"') == 1 and "residual of fz (N)" in text


LEFT_OUT_S = np.linspace(-0.1, 1.1, 61)
LEFT_OUT_N = -50.0 * np.exp(-(((LEFT_OUT_S - 1.0) / 0.3) ** 2))


def left_out_condition(condition, before, after, valley=None):
    """fz that the nominal model misses by `before`, and the accepted one by `after`, all along."""
    overlay = SignalOverlay(
        condition,
        "fz_N",
        LEFT_OUT_S,
        LEFT_OUT_N,
        LEFT_OUT_N - before,
        LEFT_OUT_N - after,
        floor=np.full(61, 0.05),
    )
    return LeftOutCondition(condition, (overlay,), valley)


ROW = LeftOutValley(
    ForceMinimum(1.0, -50.0), ForceMinimum(1.04, -51.0), ForceMinimum(1.0031, -50.1)
)
OF_LEG = replace(
    NAMED,
    left_out=(
        left_out_condition(CONDITIONS[0], 3.0, 0.06, ROW),
        left_out_condition(CONDITIONS[1], 5.0, 0.08),
    ),
    valley={
        "valley_time_error_pct": BeforeAfter(4.0, 0.31),
        "valley_force_error_pct": BeforeAfter(2.0, 0.2),
    },
)


def test_the_first_screen_of_a_leg_shows_conditions_that_were_left_out():
    context = PageContext(Origin(paths=(Path("runs/a"), Path("runs/b c"))))
    opening = page(OF_LEG, context).partition("<main>")[0]
    text = read(opening + "</body>")
    # The condition that the nominal model misses most.
    assert f"{CONDITIONS[1]}, left out: fz misses by 5.0 N rms before, by 0.080 N after" in text
    assert "fz is missed by 4.1 N rms before and by 0.071 N after" in text
    assert f"{CONDITIONS[0]} 4.0 \u2192 0.31 2.0 \u2192 0.20 3.0 \u2192 0.060" in text
    assert f"{CONDITIONS[1]} \u2013 \u2013 5.0 \u2192 0.080" in text
    assert "rfca-rig report runs/a 'runs/b c' --model model.toml --out report-after" in text
    assert opening.count('role="img"') == 1


def test_page_terminal_and_files_state_the_same_improvement(tmp_path):
    write_diagnosis(OF_LEG, tmp_path)
    said = " ".join(" ".join(terminal_lines(OF_LEG)).split())
    assert "fz 4.1 -> 0.071 N (noise and scatter 0.050)" in said
    assert "valley 4.0 -> 0.31 % in time, 2.0 -> 0.20 % in force" in said
    rows = list(
        csv.DictReader((tmp_path / "left-out.csv").read_text(encoding="utf-8").splitlines())
    )
    assert [row["condition"] for row in rows] == list(CONDITIONS[:2])
    assert float(rows[1]["fz_after_N"]) == pytest.approx(0.08)
    stated = json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))["left_out"]
    assert stated[0]["rms_fz_N"] == {"before": 3.0, "after": 0.06, "noise_floor": 0.05}
    assert stated[0]["valley"]["after"] == {"time_s": 1.0031, "fz_N": -50.1}
    assert stated[1]["valley"] is None
    curves = list(
        csv.DictReader((tmp_path / "left-out-signals.csv").read_text(encoding="utf-8").splitlines())
    )
    assert len(curves) == 122 and float(curves[0]["floor"]) == 0.05


def test_the_page_says_why_a_partner_is_not_stated():
    why = "its calibrated probability is 0.34, and 0.9 is needed"
    context = PageContext(Origin())
    shown = page(replace(NAMED, not_stated={"ground_bump": why}), context)
    assert f"<code>ground_bump</code> is not stated: {why}." in shown
    assert "is not stated:" not in page(NAMED, context)
    # Where nothing is stated, the acceptance tests say so.
    silent = replace(NAMED, effects=(), not_stated={"ground_bump": why})
    assert "is not stated:" not in page(silent, context)


def test_no_command_compares_with_a_model_that_has_nothing_new():
    recordings = (Path("runs/a"),)
    assert name_comparison(OF_LEG, recordings, Path("model.toml"))
    assert not name_comparison(replace(OF_LEG, effects=()), recordings, Path("model.toml"))
    assert not name_comparison(NAMED, recordings, Path("model.toml"))
    assert not name_comparison(OF_LEG, (), Path("model.toml"))


def test_the_located_phase_is_shaded_and_its_rms_stated():
    t_s = np.linspace(0.0, 1.0, 101)
    phase = np.where((t_s >= 0.4) & (t_s < 0.6), "loading", "free")
    bump = np.where(phase == "loading", 2.0, 0.0)
    # The other condition differs less, and is not drawn.
    overlays = [
        SignalOverlay(name, "fz_N", t_s, size * bump, 0 * t_s, 0.9 * size * bump, phase=phase)
        for name, size in (("a", 1), ("b", 3))
    ]
    located = (Located("fz_N", "dynamic", "loading", ("a", "b"), 2.0, "N", 5.0, 0.001),)
    drawn = draw_residual(replace(NAMED, overlays=tuple(overlays), located=located))
    assert "at b" in drawn.caption and "6.0\u00a0N before and 0.60\u00a0N after" in drawn.caption
    (area,) = re.findall(
        r'<path d="M ([\d.]+) [\d.]+\s+L ([\d.]+)[^"]*"[^>]*style="fill: var\(--pale\)',
        drawn.panels[0].svg,
    )
    wide = 72.0 * (RESIDUAL_IN[0] - LEFT_IN - RIGHT_IN)
    begin, end = ((float(x) - 72.0 * LEFT_IN) / wide for x in area)
    assert (min(begin, end), max(begin, end)) == pytest.approx((0.40, 0.59), abs=0.005)


def test_the_next_experiment_is_a_sentence_and_its_values_are_folded():
    proposal = {
        "kind": "sine",
        "minutes": 2.2,
        "separates": [["joint_stribeck", "joint_friction", 43.8]],
        "why": "move all joints along a sine at 0.84 Hz",
        "protocol": None,
    }
    text = page(replace(NAMED, next_experiment=proposal), PageContext(Origin())).partition(
        "Next experiment</h2>"
    )[2]
    assert "<p>Move all joints along a sine at 0.84" in text
    folded = text.partition("<details>")[2].partition("</details>")[0]
    assert "joint_stribeck from joint_friction: 44" in folded and "minutes" in folded
    assert "protocol" not in folded and "43.8" not in folded
    linked = page(
        replace(NAMED, next_experiment={**proposal, "protocol": "next-experiment.toml"}),
        PageContext(Origin()),
    )
    assert '<a href="next-experiment.toml">' in linked.partition("Next experiment</h2>")[2]


def shaft_overlays():
    t_s = np.linspace(0.0, 1.0, 50)
    return tuple(
        SignalOverlay(name, "shaft_angle_rad", t_s, -0.1 * t_s, 0 * t_s, -0.099 * t_s)
        for name in CONDITIONS[:2]
    )


def test_the_shaft_has_its_row_and_says_that_it_is_a_deviation(tmp_path):
    drive = replace(NAMED, overlays=(NAMED.overlays[0], *shaft_overlays()))
    text = read(page(drive, PageContext(Origin())))
    assert re.search(r"shaft angle less command deg 3\.325 0\.033", text)
    assert written_json(tmp_path, drive)["fit"]["rms_shaft_angle_rad"]["before"] == pytest.approx(
        0.0580, abs=1e-4
    )
    assert (
        "difference,unit" in (tmp_path / "before-after.csv").read_text()
        and "shaft angle less command" in text
    )


def test_signals_whose_curves_coincide_are_folded_unless_something_is_located_there():
    two = [one for one in overlays() if one.signal != "tx_Nm" and one.condition in CONDITIONS[:2]]
    same = tuple(replace(one, before=1.004 * one.measured, after=one.measured) for one in two)
    found = {one.signal: one.summary for one in pictures_of(same, {"fz_N"})}
    assert found["fy (N)"].startswith("fy: all curves coincide, rms ") and found["fz (N)"] == ""
    of_a_condition = [overlay for overlay in overlays() if overlay.condition == CONDITIONS[0]]
    assert all(picture.summary == "" for picture in pictures_of(of_a_condition))
    text = page(replace(NAMED, overlays=same), PageContext(Origin()))
    assert text.count("<details><summary>fy: all curves") == 1 and "<summary>fz" not in text


def test_signals_with_phases_of_their_own_have_a_map_of_their_own():
    shaft = tuple(
        MapCell("shaft_angle_rad", "dynamic", phase, one, 0.1, 9.0)
        for phase in ("rest", "turning")
        for one in CONDITIONS
    )
    maps = maps_of(replace(NAMED, cells=(*cells(), *shaft)))
    assert [one.phases for one in maps] == [
        tuple(PHASES),
        tuple(reversed(STATIC_PHASES)),
        ("rest", "turning"),
    ]
    assert all(
        shade.text
        for one in maps
        for _, rows in one.signals
        for row in rows
        for shade in row.shades
    )


def test_parameters_and_rivals_are_drawn_with_prior_and_posterior():
    rivals = (replace(NAMED.rivals[0], prior=0.01), *NAMED.rivals[1:])
    priors = {"mass": Value(320.0, 3.0)}
    text = page(
        replace(NAMED, rivals=rivals, priors=priors, nuisance_units={"mass": "g"}),
        PageContext(Origin()),
    )
    assert "hinge_backlash: 97\u00a0%, before the data 1\u00a0%" in unescape(text)
    assert "mass: 320.4 ± 1.8 g, prior 320.0 ± 4.9 g" in unescape(text)
    # Gap: a plausible range in the catalogue. Without a prior there is no grey bar.
    assert text.count('class="prior"') == 3
    row = draw_forest((-1.0, 0.0, 1.0), (0.0, 1.0, 9.0), (-2.0, 2.0), "x & y")
    assert "M47.0 9H133.0" in row and 'cx="133.0"' in row and "H176.0" in row and "x &amp; y" in row


def test_the_range_and_the_words_of_an_effect_are_those_of_its_rig():
    text = unescape(page(MECHANISM, PageContext(Origin())))
    assert "plausible 0.00400 to 1.70 N m" in text.replace("\u00a0", " ")
    assert "a spring in the joints" in text


def test_a_pointer_finds_the_values_of_all_curves(named_page):
    assert re.search(
        (
            r"<title>0\.\d{3} s: measured \u2212?[\d.]+, before \u2212?[\d.]+, after "
            r"\u2212?[\d.]+ N</title>"
        ),
        named_page,
    )


def test_dumps_of_settings_are_folded(named_page):
    assert "priors: nothing missing" in named_page.partition("<summary>Settings")[2]
    assert "priors: nothing missing" not in named_page.partition("<summary>Settings")[0]


def test_report_and_diagnosis_of_the_same_recordings_link_each_other(tmp_path):
    origin = Origin("", (RecordingSource("SIM", "a", "run-1", "run.h5", "abc123"),))
    (tmp_path / "report").mkdir()
    (tmp_path / "report" / "report.html").write_text("of another recording")
    write_diagnosis(TOO_LITTLE, tmp_path / "diagnosis", origin)
    text = (tmp_path / "diagnosis" / "diagnosis.html").read_text(encoding="utf-8")
    assert "../report/report.html" not in text and "<code>rfca-rig report run-1</code>" in text
    (tmp_path / "report" / "report.html").write_text("SHA-256 abc123")
    write_diagnosis(TOO_LITTLE, tmp_path / "diagnosis", origin)
    assert 'href="../report/report.html"' in (tmp_path / "diagnosis" / "diagnosis.html").read_text(
        encoding="utf-8"
    )
    (link,) = find_pages(tmp_path / "report", origin, ("report.html", "run.html"))
    assert link == PageLink("../diagnosis/diagnosis.html", "Diagnosis")


@pytest.mark.parametrize(
    ("name", "unit", "words"),
    [
        (
            "link1.centre_of_mass_m",
            "m",
            (
                "link1.centre of mass moved to 0.300\u00a0m, 3.5 prior standard deviations "
                "from 0 ± 0.050\u00a0m: "
            ),
        ),
        (
            "pendulum.mass_relative",
            "",
            (
                "pendulum.mass moved to 0.300\u00a0relative, 3.5 prior standard deviations "
                "from 0 ± 0.050\u00a0relative: "
            ),
        ),
    ],
)
def test_a_moved_prior_has_its_unit_once(name, unit, words):
    assert describe_moved_prior(
        MovedPrior(name, unit, Value(0.0, 0.05), Value(0.3, 0.01), 3.5)
    ).startswith(words)


def test_what_remains_is_compared_with_the_usual_error():
    (place,) = MOSTLY.remaining
    for sigmas, words in (
        (0.25, "0.25 times the usual error: real, but too small to matter"),
        (1.5, "it may matter"),
        (3.1, ": it matters"),
    ):
        small = replace(MOSTLY, remaining=(replace(place, sigmas=sigmas),))
        assert words in read(page(small, PageContext(Origin())))
        (line,) = (
            line
            for line in terminal_lines(small)
            if line.startswith("remains: fz, dynamic, touchdown: 0.900 N")
        )
        assert "p <" not in line


def test_stretches_of_recordings_are_not_called_conditions():
    stretches = tuple(
        replace(one, parts=(f"{one.condition}, 0 to 2 s", f"{one.condition}, 2 to 4 s"))
        for one in MOSTLY.overlays
    )
    for diagnosis, is_said, is_not in (
        (MOSTLY, "condition", "stretch"),
        (replace(MOSTLY, overlays=stretches), "stretch", "condition"),
    ):
        text = read(
            page(
                replace(diagnosis, settings={}, remarks=(), sentence="", effects=()),
                PageContext(Origin()),
            )
        ).lower()
        assert is_said in text and is_not not in text
        assert any(f" {is_said}" in line for line in terminal_lines(diagnosis))


def test_ratios_are_stated_in_percent():
    limits = (
        NotSeen("torque_scale", {"factor": 3.0}),
        NotSeen("torque_saturation", {"limit_relative": 0.536}),
    )
    text = read(page(replace(NAMED, not_seen=limits), PageContext(Origin()))).replace("\u00a0", " ")
    assert "factor 3.00 (+200 %)" in text and "limit 53.6 %" in text


@pytest.mark.parametrize("grade", ["identified", "mostly", "family", "nothing missing"])
def test_beside_a_reference_the_page_speaks_of_changes(grade):
    text = unescape(page(replace(NAMED, grade=grade), PageContext(Origin())))
    changed = replace(NAMED, grade=grade, settings={**NAMED.settings, "reference": {}})
    since = unescape(page(changed, PageContext(Origin())))
    of_model, number_of_model = GRADE_WORDS[grade]
    of_change, number_of_change = GRADE_WORDS_SINCE_REFERENCE[grade]
    assert of_model in text and number_of_model in text
    assert of_change in since and number_of_change in since
    assert of_model not in since
    assert ">Changed</th>" in since and ">Missing</th>" not in since


def test_a_page_of_a_search_whose_time_was_up_asks_for_more():
    settings = {**NAMED.settings, "unfinished": True}
    text = page(replace(NAMED, grade="unexplained", settings=settings), PageContext(Origin()))
    assert "Not every effect was tried." in text
    assert "Give the diagnosis more --minutes." in text
    assert "no entry of the catalogue accounts for it" not in text
