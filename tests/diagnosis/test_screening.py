"""Where a search begins, and what a residual says of the size of an effect."""

from types import SimpleNamespace

import numpy as np
import pytest

from rfca_rig.diagnosis.inference.parameterization import EffectTerm, value_of
from rfca_rig.diagnosis.inference.screening import Projection, grid_of, make_projection
from rfca_rig.model.catalogue import catalogue


@pytest.mark.parametrize("effect", catalogue().values(), ids=lambda effect: effect.id)
def test_every_start_is_a_plausible_value_and_at_rest(effect):
    for parameter in effect.parameters:
        assert all(parameter.low <= value <= parameter.high for value in parameter.starts)
    choice = EffectTerm(effect, tuple((p.name, p.low) for p in effect.parameters if p.whole))
    for z in grid_of(choice):
        values = dict(choice.present(z).values)
        assert len(z) == len(choice.free)
        assert all(
            parameter.why_not(values[parameter.name]) is None for parameter in effect.parameters
        )
        assert all(values[begin.name] == 0.0 for begin in effect.begins)
        for shape in effect.shape:
            assert any(
                values[shape.name] == pytest.approx(start, abs=1e-12)
                for start in shape.starts or (shape.neutral,)
            )


def test_a_frame_is_looked_for_at_every_tenth_of_its_frequency():
    """It rings: from a start that is soon out of step with it, no descent finds it."""
    frame = catalogue()["frame_compliance"]
    frequency = sorted({value_of(frame.parameters[0], z[0]) for z in grid_of(EffectTerm(frame))})
    assert frequency[0] < 7.0 and frequency[-1] > 45.0
    assert max(np.diff(np.log(frequency))) < np.log(1.1)


def test_a_size_is_excluded_only_as_far_as_the_residual_speaks_against_it():
    """Whitened rows, no unknowns: chi-square of a residual r with f times a signature w less
    that without it.
    """

    def whitening(values):
        return values

    w = np.array([3.0, 4.0])
    needed = 12.0
    for part in (0.0, 0.4, -0.4):
        projection = Projection(whitening, np.zeros((2, 0)), np.zeros((0, 0)), part * w)
        power = projection.speaks_against(w, needed)
        # With a part along the signature only much larger sizes are excluded; one against it does
        # not help to exclude.
        factor = np.sqrt(needed / power)
        assert factor**2 * 25.0 - 2.0 * factor * max(part, 0.0) * 25.0 == pytest.approx(needed)
    assert (
        Projection(whitening, np.zeros((2, 0)), np.zeros((0, 0)), w).speaks_against(
            np.zeros(2), needed
        )
        == 0.0
    )


def test_a_nuisance_parameter_without_prior_can_take_the_place_of_an_effect():
    """One nuisance parameter that does what the effect does: under its prior some power remains,
    without it none.
    """
    w = np.array([3.0, 4.0])
    fit = SimpleNamespace(
        jacobian=w[:, None],
        linear=lambda measured: SimpleNamespace(target=measured, jacobian=w[:, None]),
    )
    held, free = (
        make_projection(fit, np.zeros(2), lambda values: values, moved).power(w)
        for moved in ((), (0,))
    )
    assert held == pytest.approx(25.0 / 26.0)
    assert free < 1e-5
