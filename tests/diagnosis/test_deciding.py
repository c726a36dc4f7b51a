"""When a model to which no effect may be added is said to lack nothing, on a rival built by hand."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.diagnosis import deciding
from rfca_rig.diagnosis.judging import GOOD_FIT
from tests.diagnosis.by_hand import RIG, flaps_of, found_among, recorded

FITS, FITS_NOT = 0.5 * GOOD_FIT, 1.5 * GOOD_FIT


@pytest.fixture(scope="module")
def played():
    return found_among(flaps_of(recorded(RIG, [(215.0, 2.4)])), ["hinge_backlash"])


@pytest.mark.parametrize(
    ("error", "apart", "is_adequate"),
    [
        (FITS, [0.6, 0.7, 1.2], True),
        (FITS, [0.6, 1.4, 2.1], False),  # fits what it was fitted to, and foretells badly
        (FITS, [2.0, 2.0], True),  # two conditions foretell each other badly whatever is missing
        (FITS_NOT, [0.6, 0.7, 0.8], False),
    ],
)
def test_a_model_lacks_nothing_if_it_fits_and_foretells_as_models_do(played, monkeypatch, error, apart, is_adequate):
    found = replace(played, nothing=replace(played.nothing, judgement=replace(played.nothing.judgement, error=error)))
    monkeypatch.setattr(deciding, "left_out", lambda *_: np.array(apart))
    assert deciding._is_adequate(found) == is_adequate


@pytest.mark.parametrize(("apart", "verdict"), [([1.2, 1.3, 1.4], "nothing missing"), ([1.2, 1.3, 4.0], "unexplained")])
def test_what_no_effect_explains_and_no_condition_foretells_is_unexplained(played, monkeypatch, apart, verdict):
    monkeypatch.setattr(deciding, "left_out", lambda *_: np.array(apart))
    assert deciding.decided(replace(played, named=()), candidates=1).verdict == verdict
