import numpy as np
import pytest

from rfca_rig.analysis.phases import (
    PHASES,
    StrokePhases,
    StrokeRegion,
    phases_of_simulation,
    valley_and_phases,
)
from rfca_rig.model.stroke import simulate_stroke_at_speed
from tests.analysis import traces
from tests.model.legs import PAPER


def test_every_moment_has_the_phase_that_the_conventions_name():
    phases = StrokePhases(touchdown_s=0.3, valley_s=1.0, lift_off_s=1.05)
    t = np.array([-0.1, -1e-9, 0.0, 0.29, 0.3, 0.329, 0.331, 0.99, 1.0, 1.04, 1.06])
    names = [PHASES[i] for i in phases.number(t)]
    expected = [
        "rest",
        "rest",
        "free",
        "free",
        "touchdown",
        "touchdown",
        "loading",
        "loading",
        "release",
        "release",
        "rebound",
    ]
    assert names == expected


def test_without_contact_everything_after_the_start_is_free():
    assert [PHASES[i] for i in StrokePhases().number(np.array([-0.1, 0.5, 9.0]))] == [
        "rest",
        "free",
        "free",
    ]


def test_without_a_valley_loading_lasts_to_lift_off():
    phases = StrokePhases(touchdown_s=0.3, lift_off_s=1.0)
    assert [PHASES[i] for i in phases.number(np.array([0.5, 1.1]))] == ["loading", "rebound"]


def test_the_regions_are_free_swing_loading_and_release():
    regions = StrokePhases(touchdown_s=0.3, valley_s=1.0, lift_off_s=1.05).regions(end_s=1.4)
    assert regions == (
        StrokeRegion("I", 0.0, 0.3),
        StrokeRegion("II", 0.3, 1.0),
        StrokeRegion("III", 1.0, 1.05),
    )


@pytest.mark.parametrize(
    ("phases", "ends_s"),
    [
        (StrokePhases(0.3, 1.0), {"I": 0.3, "II": 1.0, "III": 1.4}),
        (StrokePhases(0.3, 1.5, 1.6), {"I": 0.3, "II": 1.4}),
        (StrokePhases(0.3, lift_off_s=1.05), {"I": 0.3, "II": 1.05}),
        (StrokePhases(), {"I": 1.4}),
    ],
)
def test_a_region_ends_with_the_recording_and_one_that_was_not_reached_is_left_out(phases, ends_s):
    assert {region.name: region.end_s for region in phases.regions(end_s=1.4)} == ends_s


@pytest.mark.parametrize(
    ("height_m", "speed_rad_s"), [(0.215, 2.433), (0.215, 3.249), (0.235, 2.478), (0.235, 4.5)]
)
def test_contact_read_from_noisy_force_agrees_with_the_models_own(height_m, speed_rad_s):
    t = traces.even(1000.0)
    simulated = simulate_stroke_at_speed(PAPER, height_m, speed_rad_s, t)
    _, seen = valley_and_phases(
        t, simulated.fz_N + np.random.default_rng(5).normal(0.0, 0.15, len(t))
    )
    true = phases_of_simulation(simulated, seen.valley_s)
    assert seen.touchdown_s == pytest.approx(true.touchdown_s, abs=0.010)
    assert seen.lift_off_s == pytest.approx(true.lift_off_s, abs=0.010)


def test_a_simulated_stroke_in_the_air_is_free_throughout():
    assert (
        phases_of_simulation(
            simulate_stroke_at_speed(PAPER, 1.0, 2.433, traces.even(1000.0)), np.inf
        )
        == StrokePhases()
    )
