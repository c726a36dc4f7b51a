"""A flapping run on the twin, through the drivers and every byte of the wires."""

import numpy as np
import pytest

from rfca_rig.analysis.phases import Valley, stroke_valley
from rfca_rig.engine.run import run_plan
from rfca_rig.model.motion import follow
from rfca_rig.model.stroke import simulate_stroke
from tests.engine.rigs import changed, nothing, one_condition, recorder_on, twin_rig


def run(path, rig, seed=1, repeats=1):
    with recorder_on(rig, path, seed) as (bench, recorder, file):
        run_plan(one_condition(rig, repeats), bench, recorder, nothing)
        health = bench.sensor.health()
        return file.finish(), health


@pytest.fixture(scope="module")
def flapped(tmp_path_factory):
    return run(tmp_path_factory.mktemp("run") / "run", twin_rig(), repeats=2)


@pytest.mark.slow
def test_every_record_of_the_sensor_arrives_once(flapped):
    recording, health = flapped
    assert (health.lost, health.duplicate, health.out_of_order, health.malformed) == (0, 0, 0, 0)
    for stroke in recording.strokes:
        assert np.all(np.diff(stroke.streams["force"].columns["rdt_sequence"].values) == 1)


def test_time_comes_from_the_sample_counters(flapped):
    stroke = flapped[0].strokes[0]
    assert np.diff(stroke.streams["force"].t_s) == pytest.approx(1 / 7000, rel=1e-9)
    assert np.diff(stroke.streams["shaft"].t_s) == pytest.approx(2e-3, rel=1e-9)


def test_time_zero_is_where_the_commanded_motion_starts(flapped):
    for stroke in flapped[0].strokes:
        t, angle = stroke.channel("shaft_angle_rad")
        assert t[0] < -0.1
        assert np.ptp(angle[t < 0]) < 1e-3
        t, speed = stroke.channel("shaft_speed_rad_s")
        rising = t[speed > 0.05 * 3.249][0]
        assert 0.0 < rising < 0.012


def test_before_the_start_the_sensor_reads_the_weight_of_the_leg(flapped):
    t, fz = flapped[0].strokes[0].channel("fz_N")
    assert fz[t < 0].mean() == pytest.approx(0.32 * 9.81, abs=0.02)


def test_the_recorded_shaft_explains_the_recorded_force_through_the_model(flapped):
    """Force and motion belong together: the model, told how the shaft turned, gives what the
    sensor felt.
    """
    stroke = flapped[0].strokes[0]
    t_shaft, angle = stroke.channel("shaft_angle_rad")
    t, fz = stroke.channel("fz_N")
    rig = twin_rig().model()
    model = simulate_stroke(rig, 0.215, follow(t_shaft, angle), t[t < 0.8])
    loading = (t[t < 0.8] > 0.35) & (t[t < 0.8] < 0.78)
    misfit = (fz[t < 0.8] - model.fz_N)[loading]
    assert (
        abs(misfit.mean()) < 0.6
    )  # friction of the floor scatters by 0.008 from touchdown to touchdown
    assert misfit.std() < 0.4


def test_the_soft_drive_sags_under_load_and_surges_after_it(flapped):
    stroke = flapped[0].strokes[0]
    t, speed = stroke.channel("shaft_speed_rad_s")
    valley = stroke_valley(stroke)
    assert isinstance(valley, Valley)
    loading = (t > 0.4) & (t < 0.7)
    after = (t > valley.time_s) & (t < valley.time_s + 0.1)
    assert speed[loading].mean() < 0.97 * 3.249
    assert speed[after].max() > 1.05 * 3.249


def test_repeats_differ_as_floors_do(flapped):
    depths = [stroke_valley(stroke).fz_N for stroke in flapped[0].strokes]
    assert 0.01 < abs(depths[0] - depths[1]) < 3.0


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(tmp_path):
    rig = changed(twin_rig(), "motor", encoder_period_ms=1.0)
    for name, seed in (("a", 5), ("b", 5), ("c", 6)):
        run(tmp_path / name, rig, seed)
    first, again, other = ((tmp_path / name / "run.h5").read_bytes() for name in "abc")
    assert first == again
    assert first != other


def test_gear_direction_and_zero_of_the_encoder_change_nothing_at_the_shaft(flapped, tmp_path):
    rig = changed(twin_rig(), "motor", gear_ratio=6.0, direction=-1, zero_turns=3.21)
    recording, _ = run(tmp_path / "run", rig)
    ours, plain = (
        recorded.strokes[0].channel("shaft_angle_rad")[1] for recorded in (recording, flapped[0])
    )
    count = min(len(ours), len(plain))
    assert ours[:count] == pytest.approx(plain[:count], abs=2e-3)
