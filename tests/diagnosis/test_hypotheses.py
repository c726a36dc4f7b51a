"""What a nominal value explains that nobody believes is left to the effect that does the very
same.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from rfca_rig.diagnosis.config import IMPLAUSIBLE
from rfca_rig.diagnosis.inference.hypotheses import weigh_models
from rfca_rig.diagnosis.inference.map_fit import without_scatter
from rfca_rig.diagnosis.inference.parameterization import EffectTerm, Parameterization
from rfca_rig.diagnosis.leg.simulator import make_leg_dataset, nuisances_of
from rfca_rig.model.catalogue import catalogue
from tests.diagnosis.by_hand import KNOWN_TO, RIG, flaps_of, recorded

CONDITIONS = [(205.0, 2.433), (215.0, 2.8), (220.0, 3.249)]
DAMPED, HEAVY = (EffectTerm(catalogue()[name]) for name in ("hinge_viscous_damping", "tip_mass"))


def fits_of(times_damping):
    """Nothing missing, more damping and a heavier tip, each where it fits best to a leg whose
    hinges are damped so many times.
    """
    leg = replace(
        RIG.leg, hinge_damping_Nm_s_per_rad=times_damping * RIG.leg.hinge_damping_Nm_s_per_rad
    )
    dataset = make_leg_dataset(
        flaps_of(recorded(replace(RIG, leg=leg), CONDITIONS, with_shaft=False))
    )
    optimizer = without_scatter(dataset)
    base = Parameterization(nuisances_of(RIG, KNOWN_TO | {"hinge_damping_relative": 0.5}, 0.0))
    fits = [
        optimizer.at(base.with_terms(choices), np.zeros(base.size + len(choices)))
        for choices in ((), (DAMPED,), (HEAVY,))
    ]
    return optimizer, *(optimizer.converge(optimizer.refine(fitted)) for fitted in fits)


@pytest.fixture(scope="module")
def far():
    return fits_of(8.0)


def share_within(optimizer, base):
    """Of nothing missing's posterior, what has a plausible damping."""
    posterior = optimizer.evaluate(base).posterior
    place = base.coordinates.space.names.index("hinge_damping")
    assert posterior.mean[place] > IMPLAUSIBLE
    return norm.logcdf(
        IMPLAUSIBLE, posterior.mean[place], np.sqrt(posterior.covariance[place, place])
    )


@pytest.mark.slow
def test_nothing_missing_does_not_stand_on_hinges_damped_as_nobody_believes(far):
    optimizer, base, damped, _ = far
    nothing, (named,) = weigh_models(optimizer, base, [damped], 20)
    assert nothing.marginal.log_evidence == pytest.approx(
        optimizer.log_evidence(base) + share_within(optimizer, base)
    )
    assert named.marginal.log_evidence == pytest.approx(optimizer.log_evidence(damped))
    assert named.log_joint > nothing.log_joint


def test_it_does_where_no_effect_says_the_same(far):
    optimizer, base, _, heavy = far
    nothing, _ = weigh_models(optimizer, base, [heavy], 20)
    assert nothing.marginal.log_evidence == pytest.approx(optimizer.log_evidence(base))


def test_it_does_where_the_effect_needs_what_nobody_believes_as_well(far):
    optimizer, base, damped, _ = far
    idle = np.column_stack([base.jacobian, np.zeros(len(base.predicted))])
    strained = replace(damped, predicted=base.predicted, x=np.append(base.x, 0.0), jacobian=idle)
    assert optimizer.evaluate(strained).max_nuisance_shift(base.coordinates.nuisances) > IMPLAUSIBLE
    nothing, _ = weigh_models(optimizer, base, [strained], 20)
    assert nothing.marginal.log_evidence == pytest.approx(optimizer.log_evidence(base))


@pytest.mark.slow
def test_a_value_within_belief_keeps_its_evidence():
    optimizer, base, damped, heavy = fits_of(1.5)
    nothing, _ = weigh_models(optimizer, base, [damped, heavy], 20)
    assert nothing.marginal.log_evidence == pytest.approx(optimizer.log_evidence(base), abs=1e-3)
