"""The priors of the nuisance parameters: usual ones, those that [known_to] states, and none
where a value is exact.
"""

import pytest

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.description.sections import KnownToSection
from rfca_rig.diagnosis.leg.simulator import nuisances_of, nuisances_of_drive
from tests.diagnosis.by_hand import RIG

EVERY = {
    "presliding": ("presliding_relative", 0.5),
    "tangential_damping": ("tangential_damping_N_s_per_m", 1.0),
    "friction_rise": ("friction_rise_share", 0.5),
    "leaving_damping": ("leaving_damping_share", 0.5),
    "swing": ("swing_sags", 0.3),
    "swing_rate": ("swing_sags_per_s", 25.0),
    "command_delay": ("command_delay_ms", 2.0),
}


def priors(**known_to):
    """The standard deviations of the leg's nuisance parameters and of the drive's, by name."""
    KnownToSection(**known_to)
    leg = nuisances_of(RIG, known_to, 0.5)
    drive = nuisances_of_drive(RIG, ModelPoint(RIG), known_to)
    return dict(zip(drive.names, drive.std, strict=True)) | dict(
        zip(leg.names, leg.std, strict=True)
    )


@pytest.mark.parametrize("name", EVERY)
def test_a_prior_is_the_usual_one_or_that_of_the_file(name):
    key, usual = EVERY[name]
    assert priors()[name] == usual
    assert priors(**{key: 0.07})[name] == 0.07
    assert set(priors()) - set(priors(**{key: 0.0})) == {name}


def test_all_of_them_may_be_exact():
    assert len(nuisances_of(RIG, {key: 0.0 for key, _ in EVERY.values()}, 0.5).std) == 0
