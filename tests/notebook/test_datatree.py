"""Draws of a diagnosis: the same numbers as the answer states, and what ArviZ makes of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import multivariate_normal

import rfca_rig as rr
from rfca_rig.diagnosis.likelihood.marginal_likelihood import loo_log_densities, loo_residuals
from rfca_rig.diagnosis.posterior_draws import draw_rivals
from rfca_rig.diagnosis.result_builder import not_enough_data
from rfca_rig.errors import BadInput
from rfca_rig.notebook.analyses import DiagnosisResult

xarray = pytest.importorskip("xarray")

pytestmark = pytest.mark.slow

FREE_SWING = Path(__file__).parents[1] / "data" / "pendulums" / "free-swing"
# Beside dry friction alone, which is stated then.
WITHOUT = ("added_mass", "centre_of_mass", "gravity_tilt", "joint_damping", "joint_inertia")
WITHOUT += ("joint_spring", "joint_stop")
DRAWS = 4000


@pytest.fixture(scope="module")
def found() -> DiagnosisResult:
    return rr.diagnose(FREE_SWING, without=WITHOUT, progress=False)


@pytest.fixture(scope="module")
def drawn(found):
    """The explanation of the answer, with its linear model and its covariance."""
    (finding,) = found.searches.values()
    rival = draw_rivals(finding, 1.0, DRAWS, np.random.default_rng(2))[0]
    search = finding.search
    fitted = finding.decision.explanation.fitted
    assert set(fitted.ids) == set(rival.rival.ids)
    linear = fitted.linear(search.dataset.rows.measured)
    return rival, linear, search.likelihood.level(linear), search.dataset.rows


def test_draws_have_the_values_and_deviations_that_are_stated(found):
    tree = found.to_datatree(draws=1000)
    posterior = tree["posterior"]
    assert found.diagnosis.effects
    stated = dict(found.diagnosis.believed_values)
    for effect in found.diagnosis.effects:
        for name, value in {**effect.parameters, **effect.shape}.items():
            stated[f"{effect.id}.{name}"] = value
    for name, value in stated.items():
        draws = posterior[name].values
        if value.std == 0.0:
            assert (draws == value.value).all()
            continue
        # 4000 independent draws: the mean is known to 0.016, the deviation to 0.011 of itself.
        assert draws.mean() == pytest.approx(value.value, abs=0.08 * value.std), name
        assert draws.std() == pytest.approx(value.std, rel=0.06), name


def test_the_prior_is_that_of_the_model(found):
    prior = found.to_datatree(draws=1000)["prior"]
    for name, value in found.diagnosis.priors.items():
        assert prior[name].values.mean() == pytest.approx(value.value, abs=0.08 * value.std), name
        assert prior[name].values.std() == pytest.approx(value.std, rel=0.06), name


def test_log_likelihood_is_the_density_of_a_condition_given_all_others(drawn):
    rival, linear, whitening, rows = drawn
    # The same random numbers as in the first draws of `draw_rivals`.
    random = np.random.default_rng(2)
    posterior_x = _first_draws(linear, whitening, random)
    covariance = whitening.covariance()
    for draw in range(3):
        residual = linear.target - linear.jacobian @ posterior_x[draw]
        of_all = multivariate_normal.logpdf(residual, cov=covariance)
        for number in range(int(rows.condition.max()) + 1):
            kept = rows.condition != number
            of_others = multivariate_normal.logpdf(
                residual[kept], cov=covariance[np.ix_(kept, kept)]
            )
            expected = pytest.approx(of_all - of_others, abs=1e-5)
            assert rival.log_likelihood[draw, number] == expected


def _first_draws(linear, whitening, random):
    white_jacobian = whitening(linear.jacobian)
    precision = white_jacobian.T @ white_jacobian + np.eye(linear.jacobian.shape[1])
    covariance = np.linalg.inv(precision)
    mean = covariance @ (white_jacobian.T @ whitening(linear.target))
    return random.multivariate_normal(mean, covariance, DRAWS, method="cholesky")


def test_replicated_rows_scatter_as_the_covariance_says(drawn):
    rival, linear, whitening, rows = drawn
    variance = whitening.variance()
    fitted = rival.posterior_predictive.var(axis=0)
    # The unknowns add to it; a sample of 4000 knows a variance to 2.2 %.
    assert (fitted > 0.87 * variance).all()
    residuals = rows.measured - rival.held_out_predictive.mean(axis=0)
    expected = loo_residuals(
        linear, whitening, rows.condition, range(int(rows.condition.max()) + 1)
    )
    error = rival.held_out_predictive.std(axis=0) / np.sqrt(DRAWS)
    np.testing.assert_array_less(np.abs(residuals - expected), 6.0 * error)


# Of conditions that alone decide a value, which ArviZ weighs by importance sampling.
@pytest.mark.filterwarnings("ignore:Estimated shape parameter")
def test_arviz_weighs_conditions_as_the_exact_formula_does(found):
    arviz_stats = pytest.importorskip("arviz_stats")
    pytest.importorskip("arviz_base")
    tree = found.to_datatree(draws=1000)
    loo = arviz_stats.loo(tree)
    (finding,) = found.searches.values()
    search = finding.search
    linear = finding.decision.explanation.fitted.linear(search.dataset.rows.measured)
    condition = search.dataset.rows.condition
    exact = loo_log_densities(
        linear, search.likelihood.level(linear), condition, range(int(condition.max()) + 1)
    )
    assert loo.elpd == pytest.approx(exact.sum(), abs=0.02 * abs(exact.sum()) + 1.0)


@pytest.mark.filterwarnings("ignore:Estimated shape parameter")
@pytest.mark.filterwarnings("ignore:The inplace keyword in DataFrame")
def test_arviz_compares_the_rivals_of_the_table(found):
    arviz_stats = pytest.importorskip("arviz_stats")
    tree = found.to_datatree(draws=250, least_probability=0.0)
    rivals = {name: tree["rivals"][name] for name in tree["rivals"].children}
    listed = {" with ".join(rival.ids) or "nothing" for rival in found.diagnosis.rivals}
    assert listed <= set(rivals)
    compared = arviz_stats.compare(rivals)
    assert set(compared.index[0].split(" with ")) >= {
        effect.id for effect in found.diagnosis.effects
    }


def test_the_tree_is_stored_and_read_again(found, tmp_path):
    pytest.importorskip("h5netcdf")
    tree = found.to_datatree(draws=20)
    tree.to_netcdf(tmp_path / "posterior.nc", engine="h5netcdf")
    with xarray.open_datatree(tmp_path / "posterior.nc", engine="h5netcdf") as again:
        assert again.attrs["sentence"] == found.sentence
        for rival in found.diagnosis.rivals:
            name = " with ".join(rival.ids) or "nothing"
            if name in tree["rivals"].children:
                assert again["rivals"][name].attrs["probability"] == rival.probability
        np.testing.assert_array_equal(
            again["posterior_predictive"]["joint1_position_rad"],
            tree["posterior_predictive"]["joint1_position_rad"],
        )


def test_the_seed_decides_the_draws(found):
    first, again, other = (
        found.to_datatree(draws=10, seed=seed)["posterior"] for seed in (1, 1, 2)
    )
    assert first.identical(again)
    assert not first.equals(other)


def test_a_search_that_was_not_made_is_named(found):
    with pytest.raises(BadInput, match="there are motion"):
        found.to_datatree("forces")


def test_too_few_recordings_for_a_comparison_are_named(found):
    (finding,) = found.searches.values()
    open_answer = not_enough_data(finding.search, "1 usable condition, 2 are needed")
    searches = {"motion": replace(finding, decision=open_answer)}
    with pytest.raises(BadInput, match="too few to compare"):
        replace(found, searches=searches).to_datatree()
