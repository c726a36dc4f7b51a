"""When a model to which no effect may be added is said to lack nothing, on a rival built by hand."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.diagnosis.decision import decide as deciding
from rfca_rig.diagnosis.likelihood.marginal_likelihood import GOOD_FIT
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
    assert deciding.decide(replace(played, named=()), candidates=1).verdict == verdict


@pytest.mark.parametrize(
    ("behind", "behind_at_usual", "is_as_good"),
    [
        (2.0, 2.0, True),
        (2.0, 9.0, True),
        (8.0, 1.0, True),  # they are told apart only if the model errs by less than models do
        (8.0, 9.0, False),
    ],
)
def test_a_rival_is_as_good_if_it_is_so_to_a_model_that_errs_as_models_do(played, monkeypatch, behind, behind_at_usual, is_as_good):
    best = played.named[0]
    rival = replace(best, judgement=replace(best.judgement, log_evidence=best.judgement.log_evidence - behind))
    monkeypatch.setattr(deciding, "at_usual_error", lambda _, hypothesis: -behind_at_usual if hypothesis is rival else 0.0)
    assert deciding._is_as_good(played, rival, best) == is_as_good
