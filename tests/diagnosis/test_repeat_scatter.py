"""What differs from stroke to stroke is learnt from the repeats."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.diagnosis.leg.simulator import make_leg_dataset
from rfca_rig.diagnosis.likelihood.covariance import estimate_scatter
from rfca_rig.recording.model import Column
from tests.diagnosis.by_hand import NOISE, RIG, flaps_of, recorded

CONDITIONS = ((215.0, 2.433), (235.0, 3.0))


def shifted(stroke, late_s, repeat, seed):
    """The force as a sensor has it whose clock started elsewhere, with noise of its own."""
    stream = stroke.streams["table"]
    random = np.random.default_rng(seed)
    columns = {
        name: Column(
            np.interp(stream.t_s - late_s, stream.t_s, column.values)
            + 0.1 * NOISE[name] * random.standard_normal(len(stream.t_s)),
            "",
        )
        if name in NOISE
        else column
        for name, column in stream.columns.items()
    }
    return replace(stroke, repeat=repeat, streams={"table": replace(stream, columns=columns)})


@pytest.mark.parametrize("std_s", [0.0, 4e-3])
def test_a_trigger_that_jitters_is_learnt_from_the_repeats(std_s):
    first = recorded(RIG, CONDITIONS)
    late_s = std_s * np.random.default_rng(5).standard_normal((4, len(first)))
    strokes = [
        shifted(stroke, late_s[k, n], k + 1, 10 * k + n)
        for k in range(4)
        for n, stroke in enumerate(first)
    ]
    scatter = estimate_scatter(make_leg_dataset(flaps_of(strokes)), ModelPoint(RIG))
    drawn_ms = 1e3 * np.sqrt(np.mean((late_s - late_s.mean(axis=0)) ** 2) * 4.0 / 3.0)
    assert scatter.std["trigger"] == pytest.approx(drawn_ms, rel=0.3, abs=0.1)
    assert scatter.std["height"] < 0.1
