"""Where a search begins."""

import numpy as np
import pytest

from rfca_rig.diagnosis.inference.parameterization import EffectTerm, value_of
from rfca_rig.diagnosis.inference.screening import grid_of
from rfca_rig.model.catalogue import catalogue


@pytest.mark.parametrize("effect", catalogue().values(), ids=lambda effect: effect.id)
def test_every_start_is_a_plausible_value_and_at_rest(effect):
    for parameter in effect.parameters:
        assert all(parameter.low <= value <= parameter.high for value in parameter.starts)
    choice = EffectTerm(effect, tuple((p.name, p.low) for p in effect.parameters if p.whole))
    for z in grid_of(choice):
        values = dict(choice.present(z).values)
        assert len(z) == len(choice.free)
        assert all(parameter.why_not(values[parameter.name]) is None for parameter in effect.parameters)
        assert all(values[begin.name] == 0.0 for begin in effect.begins)
        for shape in effect.shape:
            assert any(values[shape.name] == pytest.approx(start, abs=1e-12) for start in shape.starts or (shape.neutral,))


def test_a_frame_is_looked_for_at_every_tenth_of_its_frequency():
    """It rings: from a start that is soon out of step with it, no descent finds it."""
    frame = catalogue()["frame_compliance"]
    frequency = sorted({value_of(frame.parameters[0], z[0]) for z in grid_of(EffectTerm(frame))})
    assert frequency[0] < 7.0 and frequency[-1] > 45.0
    assert max(np.diff(np.log(frequency))) < np.log(1.1)
