"""A law that is measured where an effect is stated: without that effect, beginning at its law,
and drawn beside it.
"""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.diagnosis.residual_force.stated_law import (
    OF_LEG,
    _acts_at,
    check_place,
    measure_stated_law,
)
from rfca_rig.errors import BadInput
from rfca_rig.model.catalogue import catalogue
from tests.diagnosis.by_hand import RIG, flaps_of, found_among, present, recorded
from tests.diagnosis.test_measured_law import CONDITIONS


@pytest.fixture(scope="module")
def stribeck():
    """A floor whose friction falls with speed, and that effect alone in the catalogue."""
    rough = replace(RIG, effects=(present("ground_stribeck", rise_relative=0.6, speed_m_s=0.3),))
    return found_among(flaps_of(recorded(rough, CONDITIONS)), ["ground_stribeck"])


@pytest.mark.slow
def test_the_stated_effect_is_left_out_and_its_law_drawn_beside(stribeck):
    (named, *_) = stribeck.named
    stated = measure_stated_law(stribeck, named, "floor_friction")
    assert stated.instead_of == ("ground_stribeck",) and stated.law.base == ()
    assert stated.law.argument == "slip_m_s" and stated.law.explained > 0.8
    assert stated.curve is not None and stated.curve.name == "ground_stribeck"
    # both are the law that was simulated, the share of friction that slow sliding adds
    slow = (stated.law.knots > -0.3) & (
        stated.law.knots <= 0.0
    )  # the tip hardly slides the other way
    wanted = np.interp(stated.law.knots, stated.curve.argument, stated.curve.values)
    off = (stated.law.values - wanted)[slow]
    # the friction coefficient takes up a part that is the same at all speeds, and how much hangs on
    # the last digits of the fit
    assert np.abs(off - off.mean()).max() < 0.05
    assert (np.abs(off) < 2.0 * stated.law.std[slow]).all() and stated.law.std[slow].max() < 0.2


@pytest.mark.slow
def test_an_effect_elsewhere_stays_in_the_base(stribeck):
    (named, *_) = stribeck.named
    stated = measure_stated_law(stribeck, named, "hinges")
    assert (
        stated.law.base == ("ground_stribeck",) and stated.instead_of == () and stated.curve is None
    )
    assert stated.law.explained < 0.3  # nothing is left to be measured there


def test_every_effect_that_has_a_law_at_a_place_acts_there():
    at = {}
    for place in OF_LEG:
        at[place] = {name for name in catalogue() if _acts_at(name, place)}
    assert {"spring_hysteresis", "hinge_backlash", "hinge_coulomb_friction"} <= at["hinges"]
    assert at["floor_friction"] == {"ground_stribeck"} and "ground_adhesion" in at["floor_normal"]
    of_channels = {
        "sensor_gain",
        "sensor_crosstalk",
        "sensor_crosstalk_matrix",
        "sensor_drift",
        "sensor_saturation",
    }
    assert at["fz_N"] == at["tx_Nm"] == of_channels


def test_a_place_that_a_rig_lacks_is_refused_in_one_line():
    with pytest.raises(
        BadInput,
        match="--law joints: no law can be measured there; name one of hinges, floor_friction",
    ):
        check_place("joints", OF_LEG)
