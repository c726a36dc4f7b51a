"""A measured torque-rotation curve in rig, model and campaign files."""

from pathlib import Path

import numpy as np
import pytest

from rfca_rig.analysis.fitting.parameters import ModelPoint, make_prior
from rfca_rig.analysis.fitting.result import make_fitted_sections
from rfca_rig.campaign.reading import read_campaign
from rfca_rig.description.model_file import (
    nominal_model,
    read_curve,
    read_model_file,
    splines_of,
    write_model,
)
from rfca_rig.description.rig_file import read_rig
from rfca_rig.errors import BadInput
from rfca_rig.model.hinge_springs import bending_torque_Nm
from rfca_rig.sweep.quantities import SweepCase, find_quantity
from tests.description.test_sections import RIG

TWIN = Path("calibration/twin.toml").read_text(encoding="utf-8")
LAW = RIG.split("hinge_torque_Nm")[1].split("\nhinge_damping")[0]
PLAIN = (
    RIG.replace(f"hinge_torque_Nm{LAW}\n", "")
    .replace("40]", "40, 40]")
    .replace("43.0]", "43.0, 43.0]")
)
CURVE = """
[leg.torque_rotation]
angles_deg = [3.0, 8.0, 14.0, 20.0]
torques_Nm = [0.58, 1.67, 3.37, 5.80]
standard_deviations_Nm = [0.01, 0.02, 0.03, 0.06]
"""
BAND = float(np.sqrt(0.005 / (0.58**2 + 1.67**2 + 3.37**2 + 5.80**2)))
CSV = (
    "angle_deg, torque_Nm, torque_std_Nm\n3.0, 0.58, 0.01\n8.0, 1.67, 0.02\n14.0, 3.37, "
    "0.03\n20.0, 5.80, 0.06\n"
)


STD = "standard_deviations_Nm = [0.01, 0.02, 0.03, 0.06]"


def covariance_line(others):
    """The variances of CURVE with other numbers at these places."""
    matrix = np.diag([0.01**2, 0.02**2, 0.03**2, 0.06**2])
    for place, value in others.items():
        matrix[place] = value
    return f"covariance_Nm2 = {matrix.tolist()}"


def test_a_covariance_says_how_far_a_fit_may_scale(tmp_path):
    file = read(tmp_path, CURVE.replace(STD, covariance_line({(0, 3): 5e-4, (3, 0): 5e-4})))
    assert file.known_to.k0_relative == pytest.approx(BAND)


def read(tmp_path, curve=CURVE, rig=PLAIN):
    path = tmp_path / "model.toml"
    path.write_text(rig + curve, encoding="utf-8")
    return read_model_file(path)


def test_the_model_bears_the_torques_of_the_file(tmp_path):
    file = read(tmp_path)
    leg = file.model().leg
    torques = bending_torque_Nm(leg, np.radians([-14.0, 0.0, 3.0, 8.0, 14.0, 20.0]))
    assert torques == pytest.approx([-3.37, 0.0, 0.58, 1.67, 3.37, 5.80], abs=1e-12)
    assert leg.k0_Nm_per_rad == pytest.approx(0.58 / np.radians(3.0), rel=0.02)
    assert file.known_to.k0_relative == pytest.approx(BAND)


def test_a_curve_in_a_csv_file_is_the_same_and_counts_from_the_files_folder(tmp_path):
    (tmp_path / "measured.csv").write_text(CSV, encoding="utf-8")
    by_file = read(tmp_path, '\n[leg.torque_rotation]\ncurve = "measured.csv"\n')
    assert by_file.nominal() == read(tmp_path).nominal()
    assert by_file.known_to == read(tmp_path).known_to


def test_a_curve_file_may_begin_at_rest_and_bend_to_the_negative_side(tmp_path):
    back = CSV.replace("\n3.0, 0.58", "\n-3.0, -0.58").replace("\n8.0, 1.67", "\n-8.0, -1.67")
    back = back.replace("\n14.0, 3.37", "\n-14.0, -3.37").replace("\n20.0, 5.80", "\n-20.0, -5.80")
    (tmp_path / "measured.csv").write_text(back, encoding="utf-8")
    leg = read(tmp_path, '\n[leg.torque_rotation]\ncurve = "measured.csv"\n').model().leg
    assert bending_torque_Nm(leg, np.radians([-14.0, 3.0])) == pytest.approx([-3.37, 0.58])


def test_the_example_is_a_curve(tmp_path):
    curve = read_curve(Path("docs/examples/our-hinges.csv"))
    k0, splines = splines_of(curve)
    x = np.radians(curve.angles_deg)
    assert k0 * np.array(splines[0].torques_rad)[1:] == pytest.approx(curve.torques_Nm)
    assert curve.torques_Nm == pytest.approx(10.98 * (x + 4.56 * x**3), rel=0.02)


def test_rig_file_and_campaign_take_it(tmp_path):
    law = TWIN[TWIN.index("hinge_torque_Nm") : TWIN.index("hinge_damping")]
    (tmp_path / "measured.csv").write_text(CSV, encoding="utf-8")
    curve = '[leg.torque_rotation]\ncurve = "measured.csv"\n\n[ground]'
    text = TWIN.replace(law, "").replace("[ground]", curve, 1).replace("k0_relative = 0.03\n", "")
    path = tmp_path / "rig.toml"
    path.write_text(text, encoding="utf-8")
    rig = read_rig(path)
    assert bending_torque_Nm(rig.model().leg, np.radians(14.0)) == pytest.approx(3.37)
    assert rig.known_to is not None
    assert rig.known_to.k0_relative == pytest.approx(BAND)
    sections = {"leg", "ground", "sensor", "drive", "known_to"}
    parts = [
        part
        for part in text.split("\n\n")
        if part.split("]")[0].lstrip("[").split(".")[0] in sections
    ]
    (tmp_path / "static.csv").write_text(
        "height_mm,stage,direction,shaft_angle_rad,fy_N,fz_N,tx_Nm\n215,1,loading,1.0,-1.5,-3.0,1.2\n"
    )
    run = '[[runs]]\nexperiment = "static"\nfile = "static.csv"\n'
    head = 'format = "rfca-campaign/1"\ntitle = "with a curve"\n'
    (tmp_path / "campaign.toml").write_text("\n\n".join([head, *parts, run]), encoding="utf-8")
    recording = read_campaign(tmp_path)
    assert nominal_model(recording.nominal).leg == rig.model().leg
    assert recording.known_to["k0_relative"] == pytest.approx(BAND)


def test_each_hinge_may_have_a_curve_of_its_own(tmp_path):
    each = CURVE.replace(
        "torques_Nm = [0.58, 1.67, 3.37, 5.80]",
        "torques_by_hinge_Nm = [[0.58, 1.67, 3.37, 5.80], [0.4, 1.0, 1.7, 2.3]]",
    )
    without_std = "\n".join(line for line in each.splitlines() if "deviations" not in line)
    leg = read(tmp_path, without_std).model().leg
    assert bending_torque_Nm(leg, np.radians(14.0)) == pytest.approx(0.5 * (3.37 + 1.7))


def test_a_fit_scales_the_curve_within_its_band_and_the_file_that_it_writes_holds_the_result(
    tmp_path,
):
    file = read(tmp_path)
    space = make_prior((), ModelPoint(file.model()), file.known_to.model_dump(exclude_none=True))
    assert space.names == ("k0",)
    assert space.prior_std[0] == pytest.approx(BAND * file.model().leg.k0_Nm_per_rad)
    moved = space.at(np.array([2.0])).rig
    factor = float(np.exp(2.0 * BAND))
    sections = make_fitted_sections(file.nominal(), moved)
    write_model(tmp_path / "fitted.toml", sections, {"k0_relative": 0.001}, ["fitted"])
    fitted = read_model_file(tmp_path / "fitted.toml")
    assert fitted.leg.torque_rotation is not None
    assert fitted.leg.torque_rotation.torques_Nm == pytest.approx(
        factor * np.array([0.58, 1.67, 3.37, 5.80]), rel=1e-6
    )
    assert fitted.leg.torque_rotation.standard_deviations_Nm == pytest.approx(
        factor * np.array([0.01, 0.02, 0.03, 0.06]), abs=1e-7
    )
    assert fitted.model().leg.k0_Nm_per_rad == pytest.approx(moved.leg.k0_Nm_per_rad, rel=1e-6)
    assert fitted.known_to.k0_relative == 0.001


def test_k2_of_a_curve_can_be_neither_fitted_nor_swept(tmp_path):
    rig = read(tmp_path).model()
    with pytest.raises(BadInput, match=r"k2: the hinges of this leg follow a measured curve"):
        make_prior(("k2",), ModelPoint(rig), {})
    with pytest.raises(BadInput, match=r"k2: the hinges of this leg follow a measured curve"):
        find_quantity("k2").write(SweepCase(rig), 3.0)
    scaled = find_quantity("k0").write(SweepCase(rig), 1.1 * rig.leg.k0_Nm_per_rad).rig
    assert bending_torque_Nm(scaled.leg, np.radians(14.0)) == pytest.approx(1.1 * 3.37)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "[3.0, 8.0",
            "[8.0, 3.0",
            (
                "model.toml:21: leg.torque_rotation: this curve: angle 2 (3) is not above "
                "the one before (8); sort them"
            ),
        ),
        (
            "1.67",
            "0.5",
            (
                "leg.torque_rotation: this curve: torque 2 (0.5 N m) is not above the one "
                "before (0.58 N m)"
            ),
        ),
        (
            ", 20.0]",
            "]",
            "leg.torque_rotation: this curve: 3 angles, but 4 torques; give one torque per angle",
        ),
        (", 0.06]", "]", "4 angles, but 3 standard_deviations_Nm; give one per angle"),
        (
            "standard_deviations_Nm = [0.01, 0.02, 0.03, 0.06]",
            "covariance_Nm2 = [[1.0, 0.0], [0.0, 1.0]]",
            "4 rows of 4 numbers",
        ),
        (
            STD,
            covariance_line({(0, 3): 5e-4}),
            "covariance_Nm2 is not symmetric: number j of row i must be number i of row j",
        ),
        (
            STD,
            covariance_line({(0, 3): 7e-4, (3, 0): 7e-4}),
            "covariance_Nm2 belongs to no torques: a correlation is beyond -1 to 1",
        ),
        (
            "torques_Nm = [0.58, 1.67, 3.37, 5.80]\n",
            "",
            "takes angles_deg with either torques_Nm or torques_by_hinge_Nm, or curve",
        ),
        (
            "torques_Nm",
            "torque_Nm",
            "leg.torque_rotation.torque_Nm: unknown key; did you mean torques_Nm?",
        ),
        (
            "angles_deg",
            'curve = "a.csv"\nangles_deg',
            "curve names a file, so angles_deg must be left out",
        ),
        (
            (
                "torques_Nm = [0.58, 1.67, 3.37, 5.80]\nstandard_deviations_Nm = [0.01, "
                "0.02, 0.03, 0.06]"
            ),
            "torques_by_hinge_Nm = [[0.58, 1.67, 3.37, 5.80]]",
            (
                "torque_rotation.torques_by_hinge_Nm has 1 curves, and the leg 2 hinges; "
                "give one per hinge"
            ),
        ),
    ],
)
def test_what_is_no_curve_is_one_line(tmp_path, old, new, said):
    assert old in CURVE
    with pytest.raises(BadInput) as refusal:
        read(tmp_path, CURVE.replace(old, new, 1))
    assert said in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "measured.csv: cannot be read: No such file or directory"),
        ("angle_deg, torque\n1, 2\n", "measured.csv:1: column torque_Nm is missing"),
        (CSV.replace("1.67", "lots"), "measured.csv:3: column 2 should hold a number, not 'lots'"),
        (
            CSV.replace("20.0", "10.0"),
            "measured.csv: this curve: angle 4 (10) is not above the one before (14); sort them",
        ),
    ],
)
def test_a_file_that_holds_no_curve_is_one_line(tmp_path, text, said):
    if text is not None:
        (tmp_path / "measured.csv").write_text(text, encoding="utf-8")
    with pytest.raises(BadInput) as refusal:
        read(tmp_path, '\n[leg.torque_rotation]\ncurve = "measured.csv"\n')
    assert said in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_law_beside_the_curve_is_refused(tmp_path):
    rig = PLAIN.replace("[ground]", CURVE + "\n[ground]").replace(
        "link_radius_mm = 3.0", "link_radius_mm = 3.0\nk0_Nm_per_rad = 11.0"
    )
    with pytest.raises(
        BadInput,
        match=r"torque_rotation takes the place of hinge_torque_Nm, .*; leave out k0_Nm_per_rad",
    ):
        read(tmp_path, "", rig)


@pytest.mark.parametrize(("k2", "is_taken"), [(-0.13, True), (-0.14, False)])
def test_a_law_may_soften_as_far_as_it_grows_up_to_ninety_degrees(tmp_path, k2, is_taken):
    rig = RIG.replace("k2_per_rad2 = 4.2", f"k2_per_rad2 = {k2}")
    if is_taken:
        assert read(tmp_path, "", rig).model().leg.k2_per_rad2 == k2
        return
    with pytest.raises(
        BadInput,
        match=r"leg.k2_per_rad2: below -0.135 the torque falls before 90 degrees; give a curve",
    ):
        read(tmp_path, "", rig)
