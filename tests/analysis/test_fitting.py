"""Fitting parameters. Recordings here come from the model itself with noise and scatter: that
examines the solver, not the model.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from rfca_rig.analysis.fitting.fit import Search, estimate_covariance, fit
from rfca_rig.analysis.fitting.parameters import PARAMETERS, ModelPoint, make_prior
from rfca_rig.analysis.fitting.residuals import StrokeWindow, make_stroke_problem
from rfca_rig.analysis.fitting.result import write_model_file
from rfca_rig.analysis.fitting.scatter import make_whitening
from rfca_rig.analysis.fitting.strokes import (
    StrokeComparison,
    ValleyRow,
    fit_recordings,
    fit_valleys,
)
from rfca_rig.analysis.phases import StrokePhases, find_valley
from rfca_rig.analysis.repeats import group_by_condition
from rfca_rig.description.model_file import model_of, nominal_model, read_model_file
from rfca_rig.diagnosis.leg.problem import LegProblem
from rfca_rig.diagnosis.problem import FitOptions
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.parameters import PresentEffect
from rfca_rig.model.stroke import simulate_stroke_at_speed, simulate_strokes
from rfca_rig.recording.model import Recording
from rfca_rig.recording.store import write_recording
from tests.analysis import traces
from tests.report.recordings import BELIEVED

KNOWN_TO = {"k0_relative": 0.03, "friction_coefficient": 0.05, "height_mm": 0.2}
NOISE = {"fy_N": 0.10, "fz_N": 0.15, "tx_Nm": 0.006}
SECTIONS = {**BELIEVED, "sensor": {"below_shaft_mm": 45.0, "noise_std": NOISE}}
BELIEF = ModelPoint(nominal_model(SECTIONS))
TRUTH = {"k0": 11.3, "friction": 0.42, "height": 0.12}
CONDITIONS = ((0.215, 3.25), (0.235, 4.5))
COMMANDED = StrokeComparison("commanded")


def supposing(**values: float) -> ModelPoint:
    supposed = BELIEF
    for name, value in values.items():
        supposed = PARAMETERS[name].write(supposed, value)
    return supposed


def recording(
    seed: int,
    repeats: int = 2,
    truth: dict | None = None,
    scatter: bool = True,
    channels=tuple(NOISE),
) -> Recording:
    rng = np.random.default_rng(seed)
    strokes = []
    for height_m, speed_rad_s in CONDITIONS:
        for repeat in range(1, repeats + 1):
            off = rng.normal(0.0, [0.1, 0.005]) * scatter
            true = truth or TRUTH
            supposed = supposing(
                **{**true, "height": true["height"] + off[0], "friction": true["friction"] + off[1]}
            )
            t_s = traces.even(1000.0, end_s=3.6 / speed_rad_s)
            stroke = simulate_stroke_at_speed(
                supposed.rig, height_m + supposed.height_offset_m, speed_rad_s, t_s
            )
            noisy = {
                c: getattr(stroke, c) + rng.normal(0.0, NOISE[c], len(t_s))
                for c in channels
                if c != "fz_N"
            }
            fz_N = stroke.fz_N + rng.normal(0.0, NOISE["fz_N"], len(t_s))
            angle_rad = stroke.shaft_angle_rad + rng.normal(0.0, 5e-4, len(t_s))
            strokes.append(
                traces.stroke(
                    t_s,
                    fz_N,
                    height_m=height_m,
                    speed_rad_s=speed_rad_s,
                    repeat=repeat,
                    shaft_angle_rad=angle_rad,
                    **noisy,
                )
            )
    return Recording("a campaign", "IMPORT", SECTIONS, KNOWN_TO, tuple(strokes), ())


@dataclass(frozen=True)
class Toy:
    """Residuals by a formula of the supposed rig, so that the right answer is known; None where
    the formula gives None.
    """

    formula: Callable[[ModelPoint], np.ndarray | None]
    stroke_of_row: np.ndarray

    def residuals(self, supposed):
        return [self.formula(one) for one in supposed]


def with_encoder_off(stroke, off_rad: float):
    stream = stroke.streams["table"]
    angle = stream.columns["shaft_angle_rad"]
    column = replace(angle, data=angle.data + off_rad)
    return replace(
        stroke,
        streams={"table": replace(stream, columns={**stream.columns, "shaft_angle_rad": column})},
    )


def k0_of(supposed: ModelPoint) -> float:
    return supposed.rig.leg.k0_Nm_per_rad


def mu_of(supposed: ModelPoint) -> float:
    return supposed.rig.ground.friction_coefficient


def one_row(formula) -> Toy:
    return Toy(formula, np.zeros(1, dtype=np.intp))


@pytest.mark.slow
@pytest.mark.parametrize("shaft", ["commanded", "average", "recorded"])
def test_known_parameters_are_found_again(shaft):
    result = fit_recordings([recording(1)], (), StrokeComparison(shaft))
    found = {p.name: p for p in result.parameters}
    assert set(found) == set(TRUTH)
    for name, true in TRUTH.items():
        assert abs(found[name].value - true) < 4.0 * found[name].std, name
    assert found["k0"].value == pytest.approx(TRUTH["k0"], rel=2e-3)
    assert found["friction"].value == pytest.approx(TRUTH["friction"], abs=0.01)
    assert result.converged
    followed = 4.0 if shaft == "recorded" else 1.2  # an encoder's noise, followed, becomes torque
    assert 0.8 * result.residuals < result.chi2 < followed * result.residuals
    assert result.chi2 < 0.2 * result.chi2_before


@pytest.mark.slow
def test_standard_errors_are_the_errors_made():
    z = []
    for seed in range(10):
        result = fit_recordings([recording(100 + seed, repeats=4)], (), COMMANDED)
        z.append([(p.value - TRUTH[p.name]) / p.std for p in result.parameters])
    rms = np.sqrt(np.mean(np.square(z), axis=0))
    assert (rms > 0.4).all() and (rms < 1.9).all(), rms


def test_an_encoder_that_reads_too_little_is_noticed():
    made = recording(9, truth={"k0": 11.0, "friction": 0.45, "height": 0.0})
    off_deg = 0.4
    strokes = tuple(with_encoder_off(stroke, -np.radians(off_deg)) for stroke in made.strokes)
    belief = {**KNOWN_TO, "start_angle_deg": 0.3}
    (start,) = fit_recordings(
        [replace(made, strokes=strokes, known_to=belief)],
        ("start_angle",),
        StrokeComparison("recorded"),
    ).parameters
    true_deg = np.degrees(SECTIONS["leg"]["start_angle_rad"])
    assert start.nominal == pytest.approx(true_deg - off_deg, abs=0.01)
    assert start.value > start.nominal + 0.1


def test_what_differs_from_stroke_to_stroke_is_found():
    result = fit_recordings([recording(7, repeats=8)], (), COMMANDED)
    assert result.scatter["height"] == pytest.approx(0.1, rel=0.3)
    assert result.scatter["friction"] == pytest.approx(0.005, rel=0.4)
    assert result.scatter["start_angle"] < 0.05


def test_nothing_moves_where_nothing_is_off():
    true = {"k0": 11.0, "friction": 0.45, "height": 0.0}
    result = fit_recordings([recording(3, truth=true)], (), COMMANDED)
    assert all(
        abs(p.value - p.nominal) < 3.0 * p.std and abs(p.shift_in_std) < 0.5
        for p in result.parameters
    )


def test_force_alone_is_enough_and_its_noise_need_not_be_stated():
    stated = recording(4, channels=("fz_N",))
    silent = replace(stated, nominal={**SECTIONS, "sensor": {"below_shaft_mm": 45.0}})
    result = fit_recordings([silent], (), COMMANDED)
    assert result.noise == {"fz_N": pytest.approx(0.15, rel=0.1)}
    assert result.parameters[0].value == pytest.approx(TRUTH["k0"], rel=5e-3)


def test_the_prior_holds_what_the_recording_says_nothing_about():
    space = make_prior(("k0", "friction"), BELIEF, KNOWN_TO)
    result = fit(one_row(lambda s: np.array([(k0_of(s) - 12.0) / 1e-3])), space)
    k0, friction = result.parameters
    assert k0.value == pytest.approx(12.0, abs=1e-3)
    assert k0.std == pytest.approx(1e-3, rel=0.05)
    assert (friction.value, friction.std) == (pytest.approx(0.45), pytest.approx(0.05))


def test_prior_and_data_meet_where_their_weights_put_them():
    space = make_prior(("friction",), BELIEF, {"friction_coefficient": 0.05})
    (friction,) = fit(one_row(lambda s: np.array([(mu_of(s) - 0.55) / 0.05])), space).parameters
    assert friction.value == pytest.approx(0.50, abs=1e-5)
    assert friction.std == pytest.approx(0.05 / np.sqrt(2.0), rel=1e-3)
    assert friction.shift_in_std == pytest.approx(1.0, abs=1e-3)


def test_a_parameter_without_prior_is_pulled_at_by_nothing():
    space = make_prior(("friction",), BELIEF, {})
    (friction,) = fit(one_row(lambda s: np.array([(mu_of(s) - 0.55) / 0.05])), space).parameters
    assert (friction.value, friction.prior_std) == (pytest.approx(0.55, abs=1e-5), None)


@pytest.mark.parametrize(("pull", "bound"), [(-5.0, 0.0), (5.0, 0.95)])
def test_no_value_leaves_its_bounds_and_one_that_wants_to_is_named(pull, bound):
    space = make_prior(("friction",), BELIEF, {"friction_coefficient": 0.1})
    result = fit(one_row(lambda s: np.array([(mu_of(s) - pull) / 1e-4])), space)
    assert result.parameters[0].value == pytest.approx(bound, abs=1e-3)
    assert result.parameters[0].value >= 0.0
    assert result.parameters[0].at_bound
    assert any("friction is at its bound" in line for line in result.lines())


def test_a_scaled_parameter_stays_positive():
    space = make_prior(("hinge_damping",), BELIEF, {"hinge_damping_relative": 0.5})
    result = fit(
        one_row(lambda s: np.array([(s.rig.leg.hinge_damping_Nm_s_per_rad + 1.0) / 1e-3])), space
    )
    assert 0.0 < result.parameters[0].value < 0.01


def test_a_point_is_clipped_to_the_lowest_values():
    coulomb = replace(
        BELIEF, rig=replace(BELIEF.rig, ground=replace(BELIEF.rig.ground, drag_N_s_per_m=0.0))
    )
    space = make_prior(("tangential_damping", "friction_rise"), coulomb, {})
    # Damping that drives a sliding point does not exist; friction may act below the lowest point of
    # a print.
    assert space.values(space.clip(np.array([-0.5, -0.5]))) == pytest.approx([0.0, -0.25])
    assert space.at(space.clip(np.array([-0.5, 0.0]))).rig.ground.drag_N_s_per_m == 0.0
    assert space.clip(np.array([0.5, 0.0])).tolist() == [0.5, 0.0]
    scaled = make_prior(("k0",), coulomb, {})
    assert scaled.clip(np.array([-4.0])).tolist() == [-4.0]


def test_two_answers_show_as_starts_that_disagree():
    space = make_prior(("friction",), BELIEF, {})

    def two_answers(s: ModelPoint) -> np.ndarray:
        x = (mu_of(s) - 0.45) / 0.1
        return np.array([10.0 * (x**2 - 4.0), (x + 2.0) / 10.0])

    result = fit(
        Toy(two_answers, np.zeros(2, dtype=np.intp)),
        space,
        Search(starts=8, rng=np.random.default_rng(5)),
    )
    assert result.starts.count == 8
    assert 1 <= result.starts.agreeing < 8
    assert result.parameters[0].value == pytest.approx(0.25, abs=2e-3)


def test_what_nothing_determines_has_a_wide_error():
    space = make_prior(("k0", "k2"), BELIEF, {"k0_relative": 0.03})
    k0, k2 = fit(one_row(lambda s: np.array([(k0_of(s) - 11.1) / 0.01])), space).parameters
    assert k0.std < 0.02
    assert k2.value == pytest.approx(4.2)
    assert k2.std > 0.5 * k2.value


def test_a_warm_start_begins_where_it_is_told():
    space = make_prior(("k0",), BELIEF, {})
    at = []

    def watched(s: ModelPoint) -> np.ndarray:
        at.append(k0_of(s))
        return np.array([k0_of(s) - 12.0])

    fit(one_row(watched), space, Search(start={"k0": 11.7}))
    assert at[1] == pytest.approx(11.7)


def test_a_side_where_the_model_has_no_answer_is_done_without():
    space = make_prior(("friction",), BELIEF, {"friction_coefficient": 0.05})
    result = fit(
        one_row(lambda s: np.array([(mu_of(s) - 0.5) / 1e-3]) if mu_of(s) <= 0.4505 else None),
        space,
    )
    assert 0.45 <= result.parameters[0].value <= 0.4505
    with pytest.raises(SimulationFailed, match="with its nominal values"):
        fit(one_row(lambda _: None), space)


def test_correlated_parameters_are_named():
    space = make_prior(("k0", "friction"), BELIEF, KNOWN_TO)
    result = fit(
        one_row(lambda s: np.array([(k0_of(s) / 11.0 + mu_of(s) / 0.45 - 2.0) / 1e-4])), space
    )
    assert [(a, b) for a, b, c in result.high_correlations() if c < -0.9] == [("k0", "friction")]


def test_whitening_makes_strokes_that_move_together_independent():
    rng = np.random.default_rng(0)
    effect = rng.normal(0.0, 3.0, (30, 2))
    stroke_of_row = np.repeat([0, 1, 2], 10)
    white = make_whitening(effect, stroke_of_row)
    for stroke in range(3):
        mine = stroke_of_row == stroke
        covariance = np.zeros((30, 30))
        covariance[np.ix_(mine, mine)] = np.eye(10) + effect[mine] @ effect[mine].T
        assert np.allclose(white(white(covariance).T)[np.ix_(mine, mine)], np.eye(10), atol=1e-9)


@pytest.mark.parametrize("strokes", [5, 25])
def test_errors_widen_where_strokes_differ_by_more_than_noise(strokes):
    rng = np.random.default_rng(1)
    stroke_of_row = np.repeat(np.arange(strokes), 40)
    jacobian = np.ones((40 * strokes, 1))
    has_prior = np.zeros(1, dtype=bool)
    z = []
    for _ in range(200):
        residuals = rng.normal(size=40 * strokes) + np.repeat(rng.normal(0.0, 2.0, strokes), 40)
        off = residuals.mean()
        covariance, _ = estimate_covariance(residuals - off, jacobian, has_prior, stroke_of_row)
        z.append(off / np.sqrt(covariance[0, 0]))
    assert 0.8 < np.sqrt(np.mean(np.square(z))) < 1.5


def test_only_what_the_window_says_counts():
    t_s = np.array([-0.05, 0.1, 0.21, 0.35, 0.55, 0.75])
    phases = StrokePhases(0.2, 0.7, 0.8)
    assert StrokeWindow().inside(t_s, phases).tolist() == [False, False, False, False, True, False]
    everything = StrokeWindow(("rest", "free", "touchdown", "loading", "release"), 0.0)
    assert everything.inside(t_s, phases).tolist() == [False, True, True, True, True, True]
    with pytest.raises(BadInput, match="'landing' is no phase"):
        StrokeWindow(("landing",))


def test_repeats_are_simulated_once_unless_their_recorded_turns_differ():
    made = recording(5, repeats=3)
    assert (
        len(make_stroke_problem(group_by_condition(made.strokes), 0.05, NOISE, "commanded").turns)
        == 2
    )
    assert (
        len(make_stroke_problem(group_by_condition(made.strokes), 0.05, NOISE, "recorded").turns)
        == 2
    )
    other = with_encoder_off(made.strokes[0], 0.01)
    assert (
        len(
            make_stroke_problem(
                group_by_condition([other, *made.strokes[1:]]), 0.05, NOISE, "recorded"
            ).turns
        )
        == 3
    )


def test_a_stroke_that_cannot_be_used_is_left_out_and_named():
    made = recording(6)
    blind = replace(made.strokes[1], streams={})
    result = fit_recordings(
        [replace(made, strokes=(made.strokes[0], blind, *made.strokes[2:]))], ("k0",), COMMANDED
    )
    assert result.strokes == 3
    assert any("215 mm, 3.25 rad/s, repeat 2: fz was not recorded" in note for note in result.notes)
    with pytest.raises(BadInput, match=r"no stroke to fit to; left out: .*fz was not recorded"):
        fit_recordings([replace(made, strokes=(blind,))], ("k0",), COMMANDED)


def test_unusable_requests_are_refused_in_one_line():
    made = recording(6)
    with pytest.raises(
        BadInput, match=r"'stiffness' is no parameter; did you mean contact_stiffness\?"
    ):
        fit_recordings([made], ("stiffness",))
    with pytest.raises(BadInput, match="named twice"):
        fit_recordings([made], ("k0", "k0"))
    with pytest.raises(BadInput, match="nothing to fit"):
        fit_recordings([replace(made, known_to={})])
    with pytest.raises(BadInput, match="states other nominal values"):
        fit_recordings([made, replace(made, known_to={"k0_relative": 0.1})])


def test_valleys_alone_are_fitted():
    true = supposing(k0=11.6, friction=0.40)
    rows = []
    for height_m, speed_rad_s in ((0.215, 2.433), (0.235, 3.276)):
        (stroke,) = simulate_strokes(
            [ValleyRow(height_m, speed_rad_s, 1.1, -50.0, 0.01, 0.1).job(true)]
        )
        valley = find_valley(stroke.t_s, stroke.fz_N)
        rows.append(ValleyRow(height_m, speed_rad_s, valley.time_s, valley.fz_N, 0.01, 0.1))
    result = fit_valleys(BELIEF.rig, rows, ("k0", "friction"), {})
    assert [p.value for p in result.parameters] == [
        pytest.approx(11.6, abs=0.02),
        pytest.approx(0.40, abs=0.005),
    ]
    assert result.rms["valley_fz_N"] < 0.05 < result.rms_before["valley_fz_N"]


def test_the_fitted_model_is_read_back_as_it_was_written(tmp_path):
    space = make_prior(
        ("k0", "mass", "friction", "start_angle", "height", "k2", "link_radius"),
        BELIEF,
        {**KNOWN_TO, "start_angle_deg": 0.3},
    )
    toy = one_row(lambda s: np.array([(k0_of(s) - 11.4) / 0.1]))
    result = fit(toy, space, Search(start={"mass": 325.0, "start_angle": 13.3}))
    nominal = {**SECTIONS, "sensor": {**SECTIONS["sensor"], "tared": 'without "the" leg\n'}}
    write_model_file(
        tmp_path / "model.toml", result, nominal, {**KNOWN_TO, "mass_relative": 0.01}, ["runs/a\nb"]
    )
    read = read_model_file(tmp_path / "model.toml")
    written = result.supposed.rig
    again = model_of(read)
    assert again.leg.link_masses_kg == pytest.approx(written.leg.link_masses_kg, rel=1e-6)
    assert again.leg.k0_Nm_per_rad == pytest.approx(written.leg.k0_Nm_per_rad, rel=1e-6)
    assert again.leg.start_angle_rad == pytest.approx(written.leg.start_angle_rad, rel=1e-5)
    assert again.ground.friction_coefficient == pytest.approx(
        written.ground.friction_coefficient, rel=1e-6
    )
    assert (again.sensor, again.drive) == (written.sensor, written.drive)
    assert read.sensor.tared == nominal["sensor"]["tared"]
    assert read.sensor.noise_std.fz_N == 0.15
    stds = {p.name: p for p in result.parameters}
    assert read.known_to.k0_relative == pytest.approx(stds["k0"].std / stds["k0"].value, rel=1e-5)
    assert read.known_to.friction_coefficient == pytest.approx(stds["friction"].std, rel=1e-5)
    assert read.known_to.k2_relative == pytest.approx(stds["k2"].std / stds["k2"].value, rel=1e-5)
    assert read.known_to.hinge_damping_relative is None
    text = (tmp_path / "model.toml").read_text()
    assert "The rack stood" in text and "link_radius is known to" in text


def test_effects_that_were_believed_stay_and_a_fitted_height_adds_to_a_believed_offset(tmp_path):
    rack = PresentEffect("height_offset", (("offset_mm", 1.5),))
    play = PresentEffect("hinge_backlash", (("half_gap_deg", 0.7),))
    centre = replace(BELIEF, rig=replace(BELIEF.rig, effects=(rack, play)))
    result = fit(
        one_row(lambda s: np.array([(1e3 * s.height_offset_m - 0.4) / 0.01])),
        make_prior(("height",), centre, {"height_mm": 0.2}),
    )
    nominal = {**SECTIONS, "effects": [{"id": "height_offset", "parameters": {"offset_mm": 1.5}}]}
    write_model_file(tmp_path / "model.toml", result, nominal, KNOWN_TO, [])
    play_again, offset = read_model_file(tmp_path / "model.toml").model().effects
    assert play_again == play
    assert dict(offset.values)["offset_mm"] == pytest.approx(1.9, abs=0.01)


def app() -> typer.Typer:
    from rfca_rig.cli.commands.fit import fit as command

    made = typer.Typer()
    made.command()(command)
    return made


def test_the_command_fits_tells_and_writes(tmp_path):
    write_recording(recording(8), tmp_path / "run.h5")
    out = tmp_path / "model.toml"
    words = [
        str(tmp_path / "run.h5"),
        "--parameters",
        "k0,friction",
        "--shaft",
        "commanded",
        "--out",
        str(out),
    ]
    said = CliRunner().invoke(app(), words)
    assert said.exit_code == 0
    assert "k0" in said.stdout and "without the first 200 ms of contact" in said.stdout
    assert "run.h5 (IMPORT): a campaign" in out.read_text()
    assert read_model_file(out).leg.k0_Nm_per_rad == pytest.approx(TRUTH["k0"], rel=0.01)


def test_json_owns_the_output(tmp_path):
    write_recording(recording(8), tmp_path / "run.h5")
    said = CliRunner().invoke(
        app(), [str(tmp_path / "run.h5"), "--parameters", "k0", "--shaft", "commanded", "--json"]
    )
    answer = json.loads(said.stdout)
    assert said.stderr == ""
    assert answer["format"] == "rfca-fit/1"
    assert answer["parameters"][0]["name"] == "k0"
    assert set(answer["rms"]) == {"fz_N", "fy_N", "tx_Nm"}


def test_the_share_that_a_fit_reports_grows_and_stays_below_1():
    shares: list[float] = []
    problem = LegProblem((recording(3),))
    problem.fit(FitOptions(shaft="commanded"), lambda _, share: shares.append(share))
    assert 0.0 < shares[0] < shares[-1] and max(shares) < 1.0
