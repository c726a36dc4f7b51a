"""The band of the curve holds the truth, also where the accepted law is only nearly right; glued
marks make no remarks on hinges.
"""

from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
from scipy.integrate import quad

from rfca_rig.analysis.torque_rotation.averaging import share_of_richer_form
from rfca_rig.analysis.torque_rotation.checks import FormCheck
from rfca_rig.analysis.torque_rotation.static_result import remarks
from tests.analysis.torque_rotation.photographed import (
    LAWS,
    find_curve,
    photograph,
    plain_leg,
    share_inside_band,
    stand,
    true_values,
)

pytestmark = pytest.mark.skipif(
    find_spec("mujoco") is None,
    reason='MuJoCo is not installed: pip install "rfca-rig[crosscheck]"',
)


def curve_of(leg, seed):
    random = np.random.default_rng(seed)
    return find_curve(photograph(stand(leg, random), random)[0])


@pytest.mark.parametrize("law", LAWS)
def test_the_band_holds_the_true_curve_and_the_intervals_k0_and_k2(law):
    result = curve_of(plain_leg(law), 1)
    assert share_inside_band(result, law) >= 0.9
    k0, k2 = true_values(result, law)
    values = result.values
    assert abs(values.k0_Nm_per_rad - k0) <= values.reach * values.k0_std
    assert abs(values.k2_per_rad2 - k2) <= values.reach * values.k2_std


def test_what_the_law_leaves_out_is_in_the_band_although_the_law_holds():
    result = curve_of(plain_leg("softening, tanh"), 1)
    assert result.form.holds
    assert result.form.is_rejected
    phi = result.curve.grid_rad()
    torque, std = result.curve.torque_Nm(phi)
    values = result.values
    by_law = values.k0_Nm_per_rad * (phi + values.k2_per_rad2 * phi**3)
    assert torque == pytest.approx(by_law, abs=1e-9)
    apart = np.abs(torque - result.model.torque_Nm(phi)[0])
    assert apart.max() > 0.001 * np.abs(torque).max()
    assert (result.curve.reach * std > apart).all()


def test_the_band_of_a_cubic_is_narrow():
    result = curve_of(plain_leg("cubic"), 1)
    torque, std = result.curve.torque_Nm(result.curve.grid_rad())
    assert result.curve.reach * np.median(std) < 1e-3 * np.abs(torque).max()
    assert result.values.k0_std < 0.003 * result.values.k0_Nm_per_rad


@pytest.mark.parametrize("law", LAWS)
def test_marks_glued_to_a_tenth_of_a_millimetre_make_no_remarks_on_hinges(law):
    texts = remarks(curve_of(plain_leg(law), 0))
    assert not [text for text in texts if "inge " in text or "All hinges" in text]


def test_the_deviations_of_angles_hold_the_gluing_of_marks():
    """The gluing of a leg is one draw for all its photos, so that many legs are needed."""
    errors = []
    deviations = []
    scatter = []
    readings = []
    for seed in range(30):
        random = np.random.default_rng([9, seed])
        stages = stand(plain_leg("cubic"), random)
        measured, _ = photograph(stages, random)
        error = np.subtract(
            [stage.hinge_deg for stage in measured], [stage.hinge_deg for stage in stages]
        )
        errors.append(error)
        scatter.append(error - error.mean(axis=0))
        deviations.append([stage.hinge_std_deg for stage in measured])
        readings.append([stage.hinge_reading_std_deg for stage in measured])
    stated, true, reading, scattered = (
        float(np.sqrt(np.mean(np.concatenate(values) ** 2)))
        for values in (deviations, errors, readings, scatter)
    )
    assert 0.85 < stated / true < 1.2
    assert true > 3.0 * scattered
    assert 0.9 < reading / scattered < 1.6


def test_a_softer_hinge_is_noticed_and_its_mark_named_first():
    plain = plain_leg("cubic")
    stiffness = plain.stiffness.copy()
    stiffness[2] = 0.9
    texts = remarks(curve_of(replace(plain, stiffness=stiffness), 3))
    on_hinges = [text for text in texts if "than the curve of all" in text]
    assert len(on_hinges) == 1
    assert on_hinges[0].startswith("Hinge 4 is ")
    assert on_hinges[0].endswith(
        "Look first whether its mark and the marks beside it sit on their axes."
    )


def test_a_hinge_that_rests_elsewhere_is_noticed():
    plain = plain_leg("cubic")
    rest_rad = np.radians([0.0, 0.0, 2.0, 0.0, 0.0, 0.0])
    texts = remarks(curve_of(replace(plain, rest_rad=rest_rad), 3))
    (text,) = [text for text in texts if "inge " in text]
    assert text.startswith("Hinge 4 looks as if it rests at +")
    assert "Look first whether its mark and the marks beside it sit on their axes." in text


@pytest.mark.parametrize(("gain", "more"), [(0.0, 2), (1.0, 1), (9.0, 3), (400.0, 4)])
def test_moments_of_the_share_by_quadrature(gain, more):
    def posterior(w):
        return (1.0 - w) ** (0.5 * more) * np.exp(-0.5 * (1.0 - w) * gain)

    whole, mean, square = (
        quad(lambda w, n=n: w**n * posterior(w), 0.0, 1.0, points=[0.9, 0.99])[0] for n in range(3)
    )
    share = share_of_richer_form(FormCheck(gain, more, 1.0, 0.0, 0.0, 0.0))
    assert share.mean == pytest.approx(mean / whole, rel=1e-6)
    assert share.mean_square == pytest.approx(square / whole, rel=1e-6)
    assert share.of_other_form.mean_square == pytest.approx(
        quad(lambda w: (1.0 - w) ** 2 * posterior(w), 0.0, 1.0, points=[0.9, 0.99])[0] / whole,
        rel=1e-6,
    )
