"""Covariance, evidence and posterior against the textbook's formulas, worked out densely."""

from functools import partial

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from rfca_rig.diagnosis.data import Label, Observations, stack_observations
from rfca_rig.diagnosis.leg.strokes import dynamic_label
from rfca_rig.diagnosis.likelihood.covariance import (
    DiscrepancyWhitening,
    discrepancy_covariance,
    make_basis,
    make_whitening,
)
from rfca_rig.diagnosis.likelihood.marginal_likelihood import (
    LinearModel,
    jackknife_std,
    laplace_posterior,
    loo_residuals,
    products_without,
)


def small_rows(seed=0, bins=12, conditions=2):
    random = np.random.default_rng(seed)
    parts = [
        Observations(
            measured=random.normal(size=bins),
            noise=np.full(bins, 0.1),
            scale=np.abs(random.normal(2.0, 0.5, bins)),
            transient_scale=np.where(np.arange(bins) < 3, 1.0, 0.0),
            progress=np.linspace(0.0, 1.0, bins),
            t_s=np.linspace(0.0, 1.0, bins),
            phase=np.array(["loading"] * bins),
            label=np.zeros(bins, dtype=np.intp),
            condition=np.zeros(bins, dtype=np.intp),
            labels=(dynamic_label(f"{i}", "fz_N"),),
        )
        for i in range(conditions)
    ]
    return stack_observations(parts)


def mixed_rows(seed=6, stages=5):
    """Two strokes of two signals, and a static table of the same signals, up and down."""
    random = np.random.default_rng(seed)
    parts = [signals_of(random, dynamic_label, f"{i}", 10, ["loading"] * 10) for i in range(2)]
    return stack_observations(
        [
            *parts,
            signals_of(
                random,
                partial(Label, "static"),
                "200 mm",
                2 * stages,
                ["loading"] * stages + ["unloading"] * stages,
            ),
        ]
    )


def signals_of(random, label, condition, each, phase):
    count = 2 * each
    return Observations(
        measured=random.normal(size=count),
        noise=random.uniform(0.05, 0.2, count),
        scale=random.uniform(1.0, 3.0, count),
        transient_scale=random.uniform(0.0, 0.5, count),
        progress=np.tile(np.linspace(0.0, 1.0, each), 2),
        t_s=np.tile(np.linspace(0.0, 1.0, each), 2),
        phase=np.tile(phase, 2),
        label=np.repeat([0, 1], each),
        condition=np.zeros(count, dtype=np.intp),
        labels=tuple(label(condition, signal) for signal in ("fy_N", "fz_N")),
    )


def entry_by_entry(rows):
    """The discrepancy's covariance, spelt out for every two rows."""
    count = len(rows.measured)
    found = np.zeros((count, count))
    for i in range(count):
        for j in range(count):
            static = rows.experiment[i] == "static"
            if (
                rows.signal[i] != rows.signal[j]
                or rows.experiment[i] != rows.experiment[j]
                or (static and rows.phase[i] != rows.phase[j])
            ):
                continue
            apart = (rows.progress[i] - rows.progress[j]) / (1.0 if static else 0.06)
            alike = np.exp(-0.5 * apart**2) * (
                1.0 if rows.condition[i] == rows.condition[j] else 0.5
            )
            found[i, j] = rows.scale[i] * rows.scale[j] * alike + (i == j) * (
                1e-3 * rows.scale[i] ** 2 + rows.transient_scale[i] ** 2
            )
    return found


def test_signals_err_apart_and_static_stages_apart_in_each_direction():
    rows = mixed_rows()
    assert np.allclose(discrepancy_covariance(rows), entry_by_entry(rows))


def test_block_by_block_the_covariance_is_that_of_all_rows():
    rows = mixed_rows()
    s = 0.05
    random = np.random.default_rng(8)
    scatter = random.normal(size=(len(rows.measured), 3))
    values = random.normal(size=(len(rows.measured), 2))
    covariance = np.diag(rows.noise**2) + scatter @ scatter.T + s**2 * entry_by_entry(rows)
    whitening = DiscrepancyWhitening(make_basis(rows, scatter), s)
    precision = np.linalg.inv(covariance)
    assert np.allclose(whitening.covariance(), covariance)
    assert np.allclose(whitening.variance(), np.diag(covariance))
    assert whitening.log_det == pytest.approx(np.linalg.slogdet(covariance)[1])
    assert np.allclose(whitening(values).T @ whitening(values), values.T @ precision @ values)
    assert np.allclose(whitening.apply_precision(values), precision @ values)
    some = rows.condition == 1
    assert np.allclose(whitening.precision(some), precision[np.ix_(some, some)])


def dense(rows, scatter, s):
    return np.diag(rows.noise**2) + scatter @ scatter.T + s**2 * discrepancy_covariance(rows)


@pytest.mark.parametrize("s", [0.005, 0.02, 0.3])
def test_one_basis_whitens_at_every_model_error(s):
    rows = small_rows()
    scatter = np.random.default_rng(1).normal(size=(len(rows.measured), 2))
    whitening = DiscrepancyWhitening(make_basis(rows, scatter), s)
    white = whitening(whitening(dense(rows, scatter, s)).T)
    assert np.allclose(white, np.eye(len(white)), atol=1e-8)
    assert whitening.log_det == pytest.approx(np.linalg.slogdet(dense(rows, scatter, s))[1])
    assert np.allclose(whitening.covariance(), dense(rows, scatter, s))


def test_evidence_is_the_density_of_the_rows_with_all_unknowns_integrated_out():
    rows = small_rows()
    random = np.random.default_rng(2)
    jacobian = random.normal(size=(len(rows.measured), 3))
    scatter = np.empty((len(rows.measured), 0))
    covariance = dense(rows, scatter, 0.05)
    found = laplace_posterior(LinearModel(rows.measured, jacobian), make_whitening(covariance))
    density = multivariate_normal(cov=covariance + jacobian @ jacobian.T).logpdf(rows.measured)
    assert found.log_evidence == pytest.approx(
        density + 0.5 * len(rows.measured) * np.log(2.0 * np.pi)
    )


def test_the_posterior_is_that_of_conditioning_a_joint_normal():
    rows = small_rows()
    jacobian = np.random.default_rng(3).normal(size=(len(rows.measured), 2))
    covariance = dense(rows, np.empty((len(rows.measured), 0)), 0.05)
    found = laplace_posterior(LinearModel(rows.measured, jacobian), make_whitening(covariance))
    gain = jacobian.T @ np.linalg.inv(covariance + jacobian @ jacobian.T)
    assert np.allclose(found.mean, gain @ rows.measured)
    assert np.allclose(found.covariance, np.eye(2) - gain @ jacobian)


def test_the_discrepancy_is_alike_between_conditions_in_part_and_ringing_is_not():
    kernel = discrepancy_covariance(small_rows())
    rows = small_rows()
    correlation = kernel / np.sqrt(np.outer(np.diag(kernel), np.diag(kernel)))
    late = 8
    assert correlation[late, late + 12] == pytest.approx(0.5, abs=0.01)
    assert correlation[0, 12] < 0.5
    assert rows.condition[late + 12] == 1


def test_a_condition_is_foretold_as_by_a_fit_to_the_others_alone():
    rows = small_rows(conditions=4)
    random = np.random.default_rng(5)
    m = len(rows.measured)
    whitening = DiscrepancyWhitening(make_basis(rows, random.normal(size=(m, 2))), 0.02)
    linear = LinearModel(random.normal(size=m), random.normal(size=(m, 3)))
    covariance = whitening.covariance()
    assert whitening.variance() == pytest.approx(np.diag(covariance))
    apart = loo_residuals(linear, whitening, rows.condition, [0, 2])
    assert not apart[(rows.condition == 1) | (rows.condition == 3)].any()
    for number in (0, 2):
        out = rows.condition == number
        mean = laplace_posterior(
            linear.kept(~out), make_whitening(covariance[np.ix_(~out, ~out)])
        ).mean
        assert apart[out] == pytest.approx(
            linear.target[out] - linear.jacobian[out] @ mean, abs=1e-9
        )


def test_without_unknowns_all_of_a_held_out_condition_remains():
    rows = small_rows(conditions=3)
    whitening = DiscrepancyWhitening(make_basis(rows, np.empty((len(rows.measured), 0))), 0.02)
    linear = LinearModel(rows.measured, np.empty((len(rows.measured), 0)))
    assert loo_residuals(linear, whitening, rows.condition, range(3)) == pytest.approx(
        rows.measured
    )
    assert jackknife_std(linear, whitening, rows.condition).shape == (0,)


def test_products_without_some_rows_are_those_of_the_others_alone():
    rows = mixed_rows()
    random = np.random.default_rng(9)
    whitening = DiscrepancyWhitening(
        make_basis(rows, random.normal(size=(len(rows.measured), 2))), 0.03
    )
    columns = random.normal(size=(len(rows.measured), 3))
    out = rows.condition == 1
    kept = whitening.covariance()[np.ix_(~out, ~out)]
    products, log_det = products_without(
        columns, whitening.apply_precision(columns), whitening, out
    )
    assert np.allclose(products, columns[~out].T @ np.linalg.solve(kept, columns[~out]))
    assert log_det == pytest.approx(np.linalg.slogdet(kept)[1])
