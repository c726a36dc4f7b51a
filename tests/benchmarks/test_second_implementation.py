"""Each effect of the catalogue has a second implementation in the exam, and both agree; what
benchmark `second_implementation` prints.
"""

import pytest

from rfca_rig.model.catalogue import catalogue
from tests.benchmarks.second_implementation import (
    OF_LEGS,
    WITHOUT_SECOND,
    compare_in_leg,
)

# Percent of the force: rms over the loading, at size 0, and with the same contacts.
WITHIN_PCT = 0.1
ZERO_PCT = 1e-4
ALONE_PCT = 0.03
# Percent as in the exam, where its simulator differs on purpose or its step shows: a stick,
# the impact of a play, a sensor that rings on from touchdown.
LARGER_PCT = {
    "sensor_ringing": 0.12,
    "shaft_play": 0.2,
}


def test_every_effect_of_the_catalogue_is_compared_or_has_a_reason_why_not():
    assert set(OF_LEGS) | set(WITHOUT_SECOND) == set(catalogue())
    assert not set(WITHOUT_SECOND) & set(OF_LEGS) and all(WITHOUT_SECOND.values())


@pytest.mark.slow
@pytest.mark.parametrize("id_", OF_LEGS)
def test_both_implementations_agree_and_do_nothing_at_size_zero(id_):
    row = compare_in_leg(id_)
    assert row.zero_pct < ZERO_PCT
    assert row.effect_pct > 0.1
    assert row.as_is.rms_pct < LARGER_PCT.get(id_, WITHIN_PCT)
    assert row.alone.rms_pct < ALONE_PCT
