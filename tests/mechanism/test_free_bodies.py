"""Bodies on free joints: their poses as positions of six joints, and flights between impacts."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.diagnose import diagnose
from rfca_rig.diagnosis.mechanisms.noise import estimate_noise
from rfca_rig.diagnosis.mechanisms.problem import MechanismProblem
from rfca_rig.errors import BadInput
from rfca_rig.mechanism.free_joints import choose_frame
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.progress import ignore_share
from tests.cli.typed import typed
from tests.mechanism import brick

SHORT = "[windows]\nlength_s = 0.25\n"
TILT_RAD = 0.035
TILTED = (9.81 * np.sin(TILT_RAD), 0.0, -9.81 * np.cos(TILT_RAD))


def throw_all(folder, throw, more=SHORT, seconds=1.6):
    recordings = [brick.record(throw, seconds, seed) for seed in range(6)]
    return brick.write_campaign(folder, recordings, more)


@pytest.fixture(scope="module")
def thrown(tmp_path_factory):
    return throw_all(tmp_path_factory.mktemp("brick") / "thrown", brick.Throw())


def tumble(seed, count=60):
    """Orientations of a body that mostly turns about one axis of the world."""
    random = np.random.default_rng(seed)
    axis = random.standard_normal(3)
    axis /= np.linalg.norm(axis)
    start = Rotation.random(random_state=seed)
    turns = Rotation.from_rotvec(np.outer(np.linspace(0.0, 12.0, count), axis))
    wobble = Rotation.from_rotvec(0.2 * np.sin(np.outer(np.linspace(0.0, 9.0, count), [1, 2, 3])))
    return turns * start * wobble


@pytest.mark.parametrize("seed", range(4))
def test_six_joints_have_the_pose_of_the_free_joint(tmp_path, seed):
    import mujoco

    path = Path(tmp_path) / "model.xml"
    path.write_text(brick.mjcf(), encoding="utf-8")
    recorded = tumble(seed)
    frame = choose_frame("flight", [recorded])
    model = load_mechanism(path, frames=(frame,)).model
    data = mujoco.MjData(model)
    place_m = np.array([0.3, -0.2, 1.5])
    for angles, rotation in zip(frame.read_angles(recorded), recorded, strict=True):
        data.qpos[:] = [*place_m, *angles]
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(data.body("brick").xpos, place_m, atol=1e-9)
        matrix = data.body("brick").xmat.reshape(3, 3)
        np.testing.assert_allclose(matrix, rotation.as_matrix(), atol=1e-7)


@pytest.mark.parametrize("seed", range(4))
def test_the_first_axis_takes_the_turns_without_jumps(seed):
    recorded = tumble(seed)
    angles = choose_frame("flight", [recorded]).read_angles(recorded)
    assert np.ptp(angles[:, 0]) > 11.0
    assert np.abs(np.diff(angles, axis=0)).max() < 0.6
    assert np.abs(angles[:, 1]).max() < 0.7


def test_a_body_that_does_not_turn_has_a_frame_too():
    still = Rotation.from_quat(np.tile([0.0, 0.0, 0.0, 1.0], (5, 1)))
    angles = choose_frame("flight", [still]).read_angles(still)
    np.testing.assert_allclose(angles, 0.0, atol=1e-12)


def test_an_error_of_the_orientation_counts_more_beside_the_singularity(thrown):
    run = read_experiment(thrown).runs[0]
    middle = run.signals[:, 4]
    np.testing.assert_allclose(run.noise_factors[:, 3], 1.0 / np.cos(middle))
    np.testing.assert_allclose(run.noise_factors[:, [0, 1, 2, 4]], 1.0)
    # In spite of impacts and of gaps; fast tumbling adds something.
    noise = estimate_noise(run)
    assert noise[:3] == pytest.approx(brick.POSITION_STD_M, rel=0.3)
    assert (noise[3:] > 0.9 * brick.ANGLE_STD_RAD).all()
    assert (noise[3:] < 1.6 * brick.ANGLE_STD_RAD).all()


def test_rows_have_the_noise_of_their_samples_and_none_is_near_the_singularity(thrown):
    experiment = read_experiment(thrown)
    assert all(np.abs(run.signals[:, 4]).max() <= np.radians(60.0) for run in experiment.runs)
    windows = list_windows(experiment)
    ratios = np.concatenate(
        [(w.sensor_std[3] / w.sensor_std[3].min()) * np.cos(w.measured[4]) for w in windows]
    )
    amplified = np.concatenate([1.0 / np.cos(w.measured[4]) for w in windows])
    assert amplified.max() > 1.5
    # The noise of a row follows its middle angle, up to a factor for each window.
    assert ratios.max() / ratios.min() < 2.1
    assert np.corrcoef(amplified, np.concatenate([w.sensor_std[3] for w in windows]))[0, 1] > 0.5


def list_windows(experiment):
    conditions = MechanismProblem(experiment).prepared.conditions
    return [corrected.window for part in conditions for corrected in part.windows]


def test_windows_are_flights_unless_impacts_are_asked_for(thrown, tmp_path):
    flights = list_windows(read_experiment(thrown))
    with_impacts = throw_all(tmp_path / "thrown", brick.Throw(), f"{SHORT}impacts = true\n")
    everything = list_windows(read_experiment(with_impacts))
    # At an impact the vertical speed jumps up; in a flight it falls as the weight makes it.
    assert max(map(measure_jump, flights)) < 0.05
    assert max(map(measure_jump, everything)) > 0.5
    assert len(everything) > len(flights)


def measure_jump(window):
    """Largest change of the vertical speed from bin to bin in m/s, beyond that of the weight."""
    bin_s = 0.05
    speed = np.diff(window.measured[2][:-1]) / bin_s
    return float(np.abs(np.diff(speed) + 9.81 * bin_s).max())


@pytest.mark.parametrize(
    ("throw", "effects"),
    [
        (brick.Throw(), []),
        (brick.Throw(gravity_m_s2=TILTED), ["gravity_tilt"]),
        (
            brick.Throw(drag_N_s2_per_m2=0.15, turning_drag_Nm_s2_per_rad2=1e-4),
            ["fluid_drag"],
        ),
    ],
    ids=["nothing", "tilt", "drag"],
)
def test_what_acts_in_flight_is_found_between_bounces(tmp_path, throw, effects):
    problem = MechanismProblem(read_experiment(throw_all(tmp_path / "brick", throw)))
    result = diagnose(problem, ignore_share).diagnosis
    assert [effect.id for effect in result.effects] == effects
    if not effects:
        assert result.grade == "nothing missing"
    if effects == ["gravity_tilt"]:
        tilt = result.effects[0].parameters["about_y_rad"]
        assert abs(tilt.value + TILT_RAD) < 2.0 * tilt.std


def test_no_joint_of_a_free_body_rubs(thrown):
    effects = {effect.id for effect in MechanismProblem(read_experiment(thrown)).list_effects()}
    assert effects == {
        "contact_stiffness",
        "contact_damping",
        "contact_friction",
        "gravity_tilt",
        "fluid_drag",
        "added_mass",
    }


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"qw", "qx", "qy", "qz"', '"qw", "qx", "qy", "z"', "has the length"),
        ('joint = "flight"', 'joint = "fall"', "'fall' is no free joint of the model"),
        ("[[free]]", "[[fred]]", "fred"),
        ('unit = "m"', 'unit = "feet"', "unit"),
    ],
)
def test_a_pose_that_cannot_be_read_is_one_line(thrown, tmp_path, old, new, said):
    text = (thrown / "experiment.toml").read_text(encoding="utf-8")
    assert old in text
    for file in thrown.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    (tmp_path / "experiment.toml").write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(BadInput) as refused:
        read_experiment(tmp_path).load_model()
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_free_joint_without_a_pose_is_refused_with_the_fix(tmp_path):
    path = tmp_path / "model.xml"
    path.write_text(brick.mjcf(), encoding="utf-8")
    with pytest.raises(BadInput, match=r"state the columns of its pose in \[\[free\]\]"):
        load_mechanism(path)


def test_commands_take_free_bodies(tmp_path, monkeypatch, capsys):
    throw_all(tmp_path / "brick", brick.Throw(gravity_m_s2=TILTED))
    monkeypatch.chdir(tmp_path)
    checked = typed(monkeypatch, capsys, "check", "brick")
    assert checked.exit_code == 0
    assert "slide flight.x" in checked.out
    diagnosed = typed(monkeypatch, capsys, "diagnose", "brick")
    assert diagnosed.exit_code == 0
    assert "gravity_tilt" in diagnosed.out
    corrected = load_mechanism(tmp_path / "diagnosis" / "model.xml")
    assert corrected.model.opt.gravity[0] == pytest.approx(TILTED[0], rel=0.2)
    assert corrected.joints == tuple(f"flight.{name}" for name in "xyzabc")
