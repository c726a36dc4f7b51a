"""What is proposed next, for rivals built by hand of which a person knows how to tell them
apart.
"""

import tomllib
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from rfca_rig.bench.expectation import predict_loads
from rfca_rig.description.protocol_file import read_dynamic, read_static
from rfca_rig.diagnosis.experiment_design.choice import ExpectedInformation, list_open_hypotheses
from rfca_rig.diagnosis.experiment_design.leg_experiment import (
    NEXT_PROTOCOL,
    SEQUENCES,
    FeasibleRegion,
    _list_options,
    make_protocol,
    make_stage_design,
    propose_experiment,
    write_next_protocol,
)
from rfca_rig.diagnosis.leg.findings import LegFindings
from rfca_rig.diagnosis.leg.prepared import PreparedLeg
from rfca_rig.diagnosis.likelihood.covariance import RepeatScatter
from rfca_rig.diagnosis.simulator import ScatterDirection
from rfca_rig.errors import BadInput
from rfca_rig.protocol.check import Load, check_plan
from rfca_rig.protocol.experiments import flapping_plan, static_plan
from tests.diagnosis.by_hand import (
    NOISE,
    RIG,
    RIG_FILE,
    finding_of,
    flaps_of,
    found_among,
    named,
    nothing_missing,
    prepared_of,
    present,
    recorded,
    shafts_of,
    undecided,
)

THREE = ((215.0, 2.433), (215.0, 3.249), (235.0, 2.478))
ONE_SPEED = ((205.0, 2.433), (215.0, 2.433), (235.0, 2.433))
LIMITS = RIG_FILE.facts().limits


@dataclass(frozen=True)
class Left:
    """Conditions and what is left open of them."""

    prepared: PreparedLeg
    findings: LegFindings


def left(effect, rivals, decision, conditions=THREE):
    rig = replace(RIG, effects=(effect,)) if effect else RIG
    flaps = flaps_of(recorded(rig, conditions))
    found = found_among(flaps, rivals)
    return Left(prepared_of(flaps, found), LegFindings(finding_of(found, decision(found))))


def as_good_as_all(found):
    return named(found, *(h.ids[0] for h in found.named[1:]))


@pytest.fixture(scope="module")
def gain_or_spring():
    return left(
        present("sensor_gain", factor=1.04), ["sensor_gain", "stiffness_hardening"], as_good_as_all
    )


@pytest.fixture(scope="module")
def nothing_open():
    return left(None, ["sensor_gain"], nothing_missing)


def list_open(case):
    return list_open_hypotheses(case.findings.forces.search, case.findings.forces.decision, True)


def proposed(case, limits=None, enough=True):
    return propose_experiment(case.prepared, case.findings, enough, limits)


@pytest.mark.slow
def test_a_small_lag_and_a_clock_are_told_apart_by_a_tap():
    case = left(
        present("sensor_lag", time_constant_s=0.001), ["sensor_lag", "clock_offset"], as_good_as_all
    )
    proposal = proposed(case)
    assert (proposal["kind"], proposal["protocol"]) == ("tap test", None)
    assert proposal["separates"] == [["sensor_lag", "clock_offset", 10.0]]


@pytest.mark.slow
def test_a_gain_and_a_spring_that_the_rig_cannot_tell_apart_are_told_apart_by_a_known_weight():
    case = left(
        present("sensor_gain", factor=1.006), ["sensor_gain", "stiffness_hardening"], as_good_as_all
    )
    assert proposed(case)["kind"] == "known weight on each axis"


@pytest.mark.slow
def test_a_gain_large_enough_shows_under_a_high_rack_where_the_leg_weighs_and_its_springs_do_little(
    gain_or_spring,
):
    proposal = proposed(gain_or_spring)
    assert proposal["kind"] == "dynamic"
    assert proposal["height_mm"] >= 235.0


def test_a_rack_or_a_start_angle_is_told_by_a_gauge():
    case = left(present("height_offset", offset_mm=0.4), ["height_offset"], undecided)
    assert proposed(case)["kind"] == "gauge block"


@pytest.mark.slow
def test_a_drive_seen_at_one_speed_only_is_asked_at_another():
    rig = replace(
        RIG, effects=(present("motor_speed_droop", kp_Nm_s_per_rad=5.0, ki_Nm_per_rad=40.0),)
    )
    strokes = recorded(rig, ONE_SPEED)
    flaps = flaps_of(strokes)
    shafts = shafts_of(strokes, flaps)
    leg = found_among(flaps, [])
    drive = found_among(shafts, ["motor_speed_droop", "motor_speed_ripple"])
    findings = LegFindings(
        finding_of(leg, nothing_missing(leg)), finding_of(drive, undecided(drive))
    )
    proposal = propose_experiment(prepared_of(flaps, leg, shafts), findings, True, LIMITS)
    assert proposal["kind"] == "dynamic"
    assert abs(proposal["speed_rad_s"] / 2.433 - 1.0) > 0.15


def test_nothing_is_proposed_where_nothing_is_open(nothing_open):
    assert proposed(nothing_open, LIMITS) is None


def test_too_few_conditions_ask_for_one_that_is_unlike_them(nothing_open):
    flaps = nothing_open.prepared.flaps[:2]
    found = found_among(flaps, [])
    findings = LegFindings(finding_of(found, nothing_missing(found)))
    proposal = propose_experiment(prepared_of(flaps, found), findings, False, LIMITS)
    assert (proposal["kind"], proposal["separates"], proposal["repeats"]) == ("dynamic", [], 3)
    assert all(
        abs(1e3 * f.height_m - proposal["height_mm"]) > 15.0
        or abs(f.turn.speed_rad_s - proposal["speed_rad_s"]) > 1.0
        for f in flaps
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "limits",
    [LIMITS, replace(LIMITS, force_N=45.0), replace(LIMITS, speed_rad_s=2.0)],
    ids=["all", "force", "speed"],
)
def test_no_option_passes_the_rigs_limits(gain_or_spring, limits):
    case = gain_or_spring
    facts = replace(RIG_FILE.facts(), limits=limits)
    contest = list_open(case)
    options = [
        o
        for o in _list_options(case.prepared, case.findings, contest, True, limits)
        if "height_mm" in o.design.settings
    ]
    assert options
    for option in options:
        protocol = make_protocol({**option.design.settings, "repeats": option.repeats})
        if option.design.settings["kind"] == "dynamic":
            plan = flapping_plan(protocol.flapping(), facts)
        else:
            plan = static_plan(protocol.static_stages(), facts)
        for hypothesis in contest.open:
            rig = hypothesis.fitted.coordinates.supposed(hypothesis.fitted.x).rig
            check_plan(plan, predict_loads(plan, rig))


def test_a_rig_without_known_limits_is_asked_for_no_more_than_it_did(gain_or_spring):
    case = gain_or_spring
    contest = list_open(case)
    speeds = [
        o.design.settings.get("speed_rad_s", 0.0)
        for o in _list_options(case.prepared, case.findings, contest, True, None)
    ]
    assert 0.0 < max(speeds) <= 3.249


def test_a_rig_that_may_press_with_nothing_is_left_alone(gain_or_spring):
    assert proposed(gain_or_spring, replace(LIMITS, force_N=3.0))["protocol"] is None


def test_recorded_conditions_are_not_asked_for_again(gain_or_spring):
    contest = list_open(gain_or_spring)
    for option in _list_options(
        gain_or_spring.prepared, gain_or_spring.findings, contest, True, LIMITS
    ):
        if option.design.settings["kind"] == "dynamic":
            same = [
                abs(option.design.settings["height_mm"] - h) < 3.0
                and abs(option.design.settings["speed_rad_s"] / v - 1.0) < 0.1
                for h, v in THREE
            ]
            assert not any(same)


def test_pushing_a_bent_leg_back_is_refused_where_it_wedges_beyond_the_limit():
    def back(force_N):
        design = make_stage_design(
            "slow reversal", 0.215, FeasibleRegion(0.2, 0.25, 5.0, Load(force_N, 50.0)), NOISE
        )
        return design.simulate(SimpleNamespace(rig=RIG, height_offset_m=0.0, turn_offset_rad=0.0))

    assert back(300.0) is not None
    assert back(50.0) is None  # 46 N loading, 65 N and more when the shaft goes back


@pytest.mark.parametrize("kind", SEQUENCES)
def test_a_static_proposal_is_a_protocol_that_a_run_takes(tmp_path, kind):
    settings = make_stage_design(
        kind, 0.215, FeasibleRegion(0.2, 0.25, 5.0, Load(1e3, 1e3)), NOISE
    ).settings
    path = write_next_protocol(
        tmp_path, {**settings, "repeats": 1, "why": "to see", "protocol": NEXT_PROTOCOL}
    )
    protocol = read_static(path)
    assert protocol.heights_mm == (215.0,)
    assert [s.angle_deg for s in protocol.stages] == list(SEQUENCES[kind])
    back = [i for i, s in enumerate(protocol.stages) if s.direction == "unloading"]
    assert back == ([4, 5, 6] if kind == "slow reversal" else [])


def test_a_dynamic_proposal_is_a_protocol_that_a_run_takes(tmp_path, gain_or_spring):
    proposal = proposed(gain_or_spring)
    path = write_next_protocol(tmp_path, proposal)
    (condition,) = read_dynamic(path).conditions
    assert (condition.height_mm, condition.speed_rad_s) == (
        proposal["height_mm"],
        proposal["speed_rad_s"],
    )
    assert tomllib.loads(path.read_text())["repeats"] == proposal["repeats"]


def test_a_protocol_that_is_no_longer_proposed_is_taken_away(tmp_path):
    (tmp_path / NEXT_PROTOCOL).write_text("old")
    assert write_next_protocol(tmp_path, None) is None
    assert not list(tmp_path.iterdir())


def test_a_protocol_that_no_rig_could_take_is_refused():
    with pytest.raises(BadInput, match="height_mm"):
        make_protocol({"height_mm": -1.0, "speed_rad_s": 2.0})


ROWS = 6
HEIGHT = ScatterDirection("height", 0.05, None, None)


@pytest.fixture
def linear_view():
    """Two rivals with one nuisance and one parameter each, linear, far enough apart to see."""
    random = np.random.default_rng(5)
    slopes = random.standard_normal((2, ROWS, 2))
    slopes[1, :, 0] = slopes[0, :, 0]
    predicted = random.standard_normal((2, ROWS))
    rivals = [_rival(slopes[k], np.diag([0.3, 0.2 + 0.1 * k])) for k in range(2)]
    contest = SimpleNamespace(
        open=rivals,
        found=SimpleNamespace(scatter=RepeatScatter({"height": 0.05}, np.empty((ROWS, 0)))),
    )
    dataset = SimpleNamespace(
        predict_all=lambda points: [predicted[k] + slopes[k] @ x for k, x in points],
        parts=(),
        simulator=SimpleNamespace(scatter=lambda *_: [HEIGHT]),
    )
    for k, rival in enumerate(rivals):
        rival.fitted.coordinates.supposed = lambda x, k=k: (k, x)
    return ExpectedInformation(
        contest, dataset, predicted, np.full(ROWS, 0.4), 0.1 * np.eye(ROWS)
    ), slopes


def _rival(jacobian, covariance):
    space = SimpleNamespace(names=("height",), prior_std=np.array([0.2]))
    coordinates = SimpleNamespace(nuisances=1, size=2, space=space)
    fitted = SimpleNamespace(x=np.zeros(2), coordinates=coordinates)
    return SimpleNamespace(
        fitted=fitted, marginal=SimpleNamespace(posterior=SimpleNamespace(covariance=covariance))
    )


def test_expected_log_evidence_is_the_mean_over_many_recordings(linear_view):
    view, slopes = linear_view
    (expected,) = view.expect([4])
    scattered = np.outer(slopes[0][:, 0], slopes[0][:, 0]) * (0.05 / 0.2) ** 2 / 4
    covariance = (
        np.eye(ROWS) * (0.4**2 / 4 + 0.1)
        + scattered
        + slopes[1] @ np.diag([0.3, 0.3]) @ slopes[1].T
    )
    apart = view.predicted[0] - view.predicted[1]
    random = np.random.default_rng(6)
    drawn = view.predicted[0] + random.multivariate_normal(np.zeros(ROWS), covariance, 40_000)
    log_ratio = [_log_density(drawn - view.predicted[k], covariance) for k in range(2)]
    assert expected[0, 1] == pytest.approx(0.5 * apart @ np.linalg.solve(covariance, apart))
    assert expected[0, 1] == pytest.approx(np.mean(log_ratio[0] - log_ratio[1]), rel=0.05)
    assert expected[0, 0] == 0.0


def _log_density(deviations, covariance):
    return -0.5 * np.einsum("ni,ij,nj->n", deviations, np.linalg.inv(covariance), deviations)


def test_what_rivals_may_move_and_scatter_only_take_evidence_away(linear_view):
    view, _ = linear_view
    few, many = view.expect([3, 10])
    assert (few <= many + 1e-12).all()
    assert (many <= view.bound(10) + 1e-12).all()
    assert many[0, 1] < 0.9 * view.bound(10)[0, 1]


def test_a_quantity_whose_recorded_value_is_simulated_takes_no_evidence_away(linear_view):
    view, _ = linear_view
    (scattered,) = view.expect([1])
    corrected = replace(HEIGHT, is_corrected=True)
    view.dataset.simulator.scatter = lambda *_: [corrected]
    (expected,) = view.expect([1])
    assert expected[0, 1] > 1.02 * scattered[0, 1]
    view.hypotheses.found.scatter = RepeatScatter({}, np.empty((ROWS, 0)))
    assert expected == pytest.approx(view.expect([1])[0])
