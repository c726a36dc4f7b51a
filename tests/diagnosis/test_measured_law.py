"""The residual force as a function of its argument: on campaigns of the exam's own engine, on a
real pendulum, and in closed form.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.campaign.pendulum import read_pendulum
from rfca_rig.campaign.reading import read_campaign
from rfca_rig.description.model_file import read_model_file
from rfca_rig.diagnosis.config import CLOSE_LOG_EVIDENCE
from rfca_rig.diagnosis.inference.model_selection import search_models
from rfca_rig.diagnosis.inference.parameterization import Parameterization, coordinate_of, value_of
from rfca_rig.diagnosis.leg.model_files import write_measured_model
from rfca_rig.diagnosis.leg.prepared import prepare_leg
from rfca_rig.diagnosis.leg.problem import search_base
from rfca_rig.diagnosis.leg.simulator import make_leg_dataset
from rfca_rig.diagnosis.likelihood.covariance import DiscrepancyWhitening, make_basis
from rfca_rig.diagnosis.likelihood.marginal_likelihood import LinearModel, loo_log_densities
from rfca_rig.diagnosis.mechanisms.joint_law import measure_joint_law, parse_place
from rfca_rig.diagnosis.mechanisms.prepared import prepare_mechanism
from rfca_rig.diagnosis.residual_force.law import NONE, prior_root
from rfca_rig.diagnosis.residual_force.law_arguments import make_argument, place_knots
from rfca_rig.diagnosis.residual_force.measured_law import (
    TableTerm,
    base_without,
    fit_law,
    measure_law,
    with_memory_test,
)
from rfca_rig.diagnosis.residual_force.stated_law import catalogue_curve
from rfca_rig.errors import BadInput
from rfca_rig.exam import simulate_campaign
from rfca_rig.exam.cases import NOTHING, ExamDesign, draw_cases
from rfca_rig.exam.sampled_rig import build_world
from rfca_rig.executors.cores import single_threaded_blas
from rfca_rig.model.catalogue import catalogue
from rfca_rig.model.parameters import LawTable, PresentEffect
from tests.diagnosis.by_hand import RIG, flaps_of, found_among, present, recorded
from tests.public_recordings import write_public_pendulum

DESIGN = ExamDesign(
    tuple((height, speed) for height in (205.0, 220.0, 235.0) for speed in (2.0, 2.6, 3.3)),
    2,
    (215.0,),
)
OTHER = ExamDesign(((212.0, 2.3), (228.0, 3.0)), 2, ())
CONDITIONS = [(205.0, 2.2), (215.0, 2.6), (225.0, 2.2), (235.0, 3.0)]


def campaign(folder, design, **concealed):
    """A campaign of the exam's own engine that conceals this."""
    (case,) = draw_cases(7, {NOTHING: 1})
    simulate_campaign.write_campaign(replace(case, design=design, **concealed), folder)
    return read_campaign(folder)


def searched(folder, **concealed):
    """What a search without a look at the catalogue leaves of such a campaign, and its
    recording.
    """
    recording = campaign(folder / "campaign", DESIGN, **concealed)
    return search_base([recording], lambda *_: None), recording


def deviations(law, truth):
    """How many standard deviations the whole law is off at each knot where the truth does not
    jump.
    """
    smooth = law.knots != 0.0
    return (
        np.abs(law.whole - np.array([truth(u) for u in law.knots]))[smooth] / law.whole_std[smooth]
    )


@pytest.mark.long
def test_a_quadratic_damping_of_the_hinges_is_measured_within_its_band(tmp_path):
    found, _ = searched(
        tmp_path, effects={"hinge_quadratic_damping": {"coefficient_Nm_s2_per_rad2": 0.05}}
    )
    law = measure_law(found, "hinges", found.nothing, ["rate_rad_s", "angle_rad"])
    assert (law.argument, law.unit, law.argument_unit) == ("rate_rad_s", "N m", "rad/s")
    off = deviations(law, lambda u: 0.05 * u + 0.05 * u * abs(u))
    assert np.mean(off < 2.0) > 0.8
    # few samples reach the outermost knots, and the law is straight between them: there it is up to
    # a fifth off
    assert off[1:-1].max() < 4.0
    truth = 0.05 * law.knots + 0.05 * law.knots * np.abs(law.knots)
    assert law.whole[[0, -1]] == pytest.approx(truth[[0, -1]], rel=0.2)
    assert law.explained > 0.6
    assert law.log_density_gain > 100.0
    assert law.memory is not None
    assert not law.memory.has_memory


@pytest.mark.long
def test_a_friction_that_differs_by_direction_is_measured_within_its_band(tmp_path):
    found, _ = searched(tmp_path, strangers={"friction_by_direction": {"backward_share": 0.7}})
    law = measure_law(found, "floor_friction", found.nothing)
    assert law.argument == "slip_m_s"
    off = deviations(law, lambda u: 0.45 if u > 0.0 else 0.7 * 0.45)
    assert np.mean(off < 2.0) > 0.8
    assert law.explained > 0.6
    assert law.memory is not None
    assert not law.memory.has_memory


@pytest.fixture(scope="module")
def squared_stribeck(tmp_path_factory):
    """What a search leaves of a friction that falls with the square of the speed, its recording,
    and one at other heights.
    """
    folder = tmp_path_factory.mktemp("squared")

    def squared(*args):
        world = build_world(*args)
        return replace(world, floor=replace(world.floor, stribeck_power=2.0))

    concealed = {"ground_stribeck": {"rise_relative": 0.5, "speed_m_s": 0.28}}
    with pytest.MonkeyPatch.context() as patch, single_threaded_blas():
        patch.setattr(simulate_campaign, "build_world", squared)
        return *searched(folder, effects=concealed), campaign(
            folder / "other heights", OTHER, effects=concealed
        )


@pytest.mark.long
def test_a_stribeck_law_of_another_exponent_is_measured_and_its_model_predicts_new_heights(
    tmp_path, squared_stribeck
):
    found, recording, at_other_heights = squared_stribeck
    with single_threaded_blas():
        law = measure_law(found, "floor_friction", found.nothing, ["slip_m_s"])
    truth = np.array([0.45 * (1.0 + 0.5 * np.exp(-((u / 0.28) ** 2))) for u in law.knots])
    inner = np.abs(law.knots) < 1.5
    # The exam's stick law is another one: with the true law in it this model fits its data worse
    # than with the measured one.
    assert (
        np.abs(law.whole / truth - 1.0)[inner].max() < 0.2
    )  # 13 % in most runs; it depends on where the fit stops, by a few percent
    assert law.explained > 0.85
    write_measured_model(tmp_path / "model.toml", law, recording)
    again = read_model_file(tmp_path / "model.toml").model()
    assert again.effects[-1].table.values == pytest.approx(law.present.table.values, abs=1e-6)
    prepared = prepare_leg([at_other_heights])
    others = make_leg_dataset(prepared.flaps)
    nominal, with_law = (
        np.std(others.rows.measured - others.predicted(ModelPoint(rig)))
        for rig in (prepared.rig, again)
    )
    assert with_law < 0.5 * nominal


@pytest.mark.long
def test_a_friction_law_is_the_same_within_its_band_wherever_its_fit_begins(squared_stribeck):
    found, _, _ = squared_stribeck
    with single_threaded_blas():
        laws = [
            fit_law(found, make_argument("floor_friction", "slip_m_s"), moved_a_little(found, seed))
            for seed in range(5)
        ]
    log_evidence = [law.hypothesis.marginal.log_evidence for law in laws]
    assert np.ptp(log_evidence) < CLOSE_LOG_EVIDENCE
    u = laws[0].knots
    whole = np.array([np.interp(u, law.knots, law.whole) for law in laws])
    std = np.array([np.interp(u, law.knots, law.whole_std) for law in laws])
    scatter_share = np.var(whole, axis=0, ddof=1) / np.mean(std**2, axis=0)
    assert scatter_share.mean() < 1.0
    # Were the band right at a knot, five fits would scatter by more with a probability of 0.5 %
    # there.
    assert scatter_share.max() < chi2.ppf(0.995, len(laws) - 1) / (len(laws) - 1)


def moved_a_little(found, seed):
    """The base with its nuisances a thousandth of a prior deviation off."""
    fitted = found.nothing.fitted
    x = fitted.x + 1e-3 * np.random.default_rng(seed).standard_normal(len(fitted.x))
    return replace(
        found.nothing,
        fitted=replace(
            fitted, x=x, predicted=found.dataset.predicted(fitted.coordinates.supposed(x))
        ),
    )


@pytest.mark.long
def test_dry_friction_of_the_pins_has_memory_as_a_function_of_the_angle(tmp_path):
    found, _ = searched(tmp_path, effects={"hinge_coulomb_friction": {"torque_Nm": 0.05}})
    law = with_memory_test(
        found, fit_law(found, make_argument("hinges", "angle_rad"), found.nothing)
    )
    assert law.memory.has_memory
    assert law.memory.log_evidence_gain > 50.0


@pytest.mark.slow
def test_a_stribeck_law_of_the_models_own_kind_is_within_its_band():
    slips = np.linspace(-3.0, 3.0, 121)
    shares = tuple(float(value) for value in 0.4 * np.exp(-((slips / 0.3) ** 2)))
    rougher = PresentEffect(
        "tabulated_law",
        table=LawTable("floor_friction", "slip_m_s", tuple(map(float, slips)), shares),
    )
    found = found_among(flaps_of(recorded(replace(RIG, effects=(rougher,)), CONDITIONS)), [""])
    law = measure_law(found, "floor_friction", found.nothing)
    assert law.argument == "slip_m_s"
    truth = RIG.ground.friction_coefficient * (1.0 + 0.4 * np.exp(-((law.knots / 0.3) ** 2)))
    assert np.mean(np.abs(law.whole - truth) < 2.0 * law.whole_std) > 0.8
    assert law.whole_std[np.abs(law.knots) < 1.0].max() < 0.06
    assert law.explained > 0.5


@pytest.fixture(scope="module")
def crosstalk():
    """A leg whose fz reads a curved share more than it bears, beside a clean catalogue effect."""
    sensed = recorded(RIG, CONDITIONS)
    for stroke in sensed:
        fz = stroke.streams["table"].columns["fz_N"].data
        fz += 2e-3 * fz * np.abs(fz)
    return found_among(flaps_of(sensed), ["sensor_crosstalk"])


@pytest.mark.slow
def test_a_curved_channel_is_measured_as_a_function_of_its_reading(crosstalk):
    law = measure_law(crosstalk, "fz_N", crosstalk.nothing)
    assert law.argument == "reading_N"
    truth = 2e-3 * law.knots * np.abs(law.knots)
    assert np.abs(law.values - truth).max() < 0.2 * np.abs(truth).max()
    assert np.mean(np.abs(law.values - truth) < 2.0 * law.std) > 0.8
    assert law.explained > 0.7
    assert law.whole is None


def test_the_base_may_be_a_hypothesis_less_one_of_its_effects(crosstalk):
    base = base_without(crosstalk, crosstalk.named[0], "sensor_crosstalk")
    assert base.ids == ()
    assert base.marginal.log_evidence == pytest.approx(
        crosstalk.nothing.marginal.log_evidence, abs=3.0
    )
    with pytest.raises(
        BadInput, match="effect tip_mass: is not in the hypothesis, which has sensor_crosstalk"
    ):
        base_without(crosstalk, crosstalk.named[0], "tip_mass")


def test_an_argument_that_a_place_lacks_is_refused(crosstalk):
    with pytest.raises(BadInput, match="at hinges a law cannot depend on 'load_N'"):
        measure_law(crosstalk, "hinges", crosstalk.nothing, ["load_N"])


@pytest.mark.slow
def test_the_friction_of_a_real_servo_is_measured_over_its_speed(tmp_path):
    experiment = read_pendulum(write_public_pendulum("dfki-pendulum/simple", tmp_path))
    problem = prepare_mechanism(experiment, experiment.load_model())
    with single_threaded_blas():
        found = search_models(problem.dataset, Parameterization(problem.space), [], lambda *_: None)
        place = parse_place("joint1", problem.simulator.mechanism)
        law = measure_joint_law(problem, found, found.nothing, place).stated.law
    assert law.argument == "speed_rad_s"
    sliding = (np.abs(law.knots) > 0.4) & (np.abs(law.knots) < 4.0)
    friction = law.whole[sliding] * np.sign(law.knots[sliding])
    assert np.all(
        (friction > 0.05) & (friction < 0.35)
    )  # its makers publish 0.18 N m of dry friction, 0.05 N m s/rad beside it
    assert np.mean(friction) == pytest.approx(0.18, abs=0.05)
    assert law.explained > 0.4


def test_the_log_density_of_a_condition_is_that_of_all_rows_less_that_of_the_others():
    flaps = flaps_of(recorded(RIG, CONDITIONS[:2]))
    rows = make_leg_dataset(flaps).rows
    count = len(rows.measured)
    random = np.random.default_rng(1)
    linear = LinearModel(random.standard_normal(count), random.standard_normal((count, 3)))
    whitening = DiscrepancyWhitening(
        make_basis(rows, 0.1 * random.standard_normal((count, 2))), 0.02
    )
    covariance = whitening.covariance() + linear.jacobian @ linear.jacobian.T

    def log_density(kept):
        block = covariance[np.ix_(kept, kept)]
        y = linear.target[kept]
        return -0.5 * float(
            y @ np.linalg.solve(block, y)
            + np.linalg.slogdet(block)[1]
            + kept.sum() * np.log(2.0 * np.pi)
        )

    for number, found in enumerate(loo_log_densities(linear, whitening, rows.condition, range(2))):
        everything = np.ones(count, dtype=bool)
        others = rows.condition != number
        assert found == pytest.approx(log_density(everything) - log_density(others), rel=1e-8)


def test_knots_of_a_speed_stand_denser_around_zero_which_is_one_of_them():
    knots = place_knots((-2.0, 0.7), is_signed=True)
    assert (knots[0], knots[-1]) == pytest.approx((-2.0, 0.7))
    assert 0.0 in knots
    steps = np.diff(knots)
    near = int(np.flatnonzero(knots == 0.0)[0])
    assert steps.min() > 0.0
    assert steps[near] < 0.2 * steps[0]


def test_a_smooth_prior_leaves_a_straight_line_free_and_may_know_that_nothing_is_nothing():
    knots = np.linspace(-1.0, 1.0, 9)
    root = prior_root(knots, 2.0, 0.03)
    covariance = root @ root.T
    bend = np.diff(np.eye(9), 2, axis=0)
    assert np.sqrt(np.diag(bend @ covariance @ bend.T)).max() <= 2.0 * 0.03
    assert np.sqrt(covariance[0, 0]) > 1.0
    known = prior_root(knots, 2.0, 0.3, zero_at_zero=True)
    assert np.sqrt((known @ known.T)[4, 4]) == pytest.approx(2.0 * NONE, rel=0.1)


def test_the_coordinates_of_a_tabulated_term_are_standard_normal():
    term = TableTerm(
        catalogue()["tip_mass"],
        argument=make_argument("hinges", "angle_rad"),
        knots=(0.0, 1.0),
        root=((2.0, 0.0), (1.0, 3.0)),
    )
    assert [value_of(parameter, 0.7) for parameter in term.free] == pytest.approx([0.7, 0.7])
    assert coordinate_of(term.free[0], -1.3) == pytest.approx(-1.3)
    assert term.present(np.array([1.0, -1.0])).table.values == pytest.approx((2.0, -2.0))


U = np.linspace(-1.0, 1.0, 9)


@pytest.mark.parametrize(
    ("effect", "place", "argument", "wanted"),
    [
        (
            present("ground_stribeck", rise_relative=0.5, speed_m_s=0.3),
            "floor_friction",
            "slip_m_s",
            0.5 * np.exp(-np.abs(U) / 0.3),
        ),
        (
            present("hinge_coulomb_friction", torque_Nm=0.1),
            "hinges",
            "rate_rad_s",
            0.1 * np.sign(U),
        ),
        (
            present("hinge_viscous_damping", coefficient_Nm_s_per_rad=0.1),
            "hinges",
            "rate_rad_s",
            0.1 * U,
        ),
        (present("sensor_gain", factor=1.1), "fz_N", "reading_N", 0.1 * U),
        (present("sensor_drift", rate_N_per_s=2.0), "fz_N", "time_s", 2.0 * U),
        (
            present("hinge_stop", angle_deg=28.64789, stiffness_Nm_per_rad=20.0),
            "hinge3",
            "angle_rad",
            20.0 * np.sign(U) * np.maximum(np.abs(U) - 0.5, 0.0),
        ),
    ],
)
def test_the_catalogue_says_its_law_as_a_function_of_the_argument(effect, place, argument, wanted):
    assert catalogue_curve(RIG, effect, place, argument, U) == pytest.approx(wanted, abs=1e-5)


def test_the_catalogue_says_nothing_where_an_effect_does_nothing():
    assert (
        catalogue_curve(
            RIG, PresentEffect("tip_mass", (("mass_g", 20.0),)), "hinges", "rate_rad_s", U
        )
        is None
    )
    assert (
        catalogue_curve(
            RIG,
            present("ground_stribeck", rise_relative=0.5, speed_m_s=0.3),
            "floor_friction",
            "load_N",
            U,
        )
        is None
    )
