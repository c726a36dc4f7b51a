"""Hinges that rest at an angle, in one hinge or in all: which it is, and the angle to a tenth of
a degree.
"""

from dataclasses import replace

import pytest

from rfca_rig.diagnosis.decision.decide import decide
from rfca_rig.diagnosis.inference.model_selection import search_models
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.leg.simulator import make_leg_dataset, nuisances_of
from rfca_rig.model.catalogue import catalogue
from tests.diagnosis.by_hand import KNOWN_TO, RIG, flaps_of, present, recorded

FOUR = ((215.0, 2.433), (215.0, 3.249), (235.0, 2.478), (235.0, 3.276))
RIVALS = (
    "hinge_rest_angle",
    "hinge_rest_angle_of_one",
    "height_offset",
    "stiffness_hardening",
    "ground_tilt",
)


@pytest.mark.long
@pytest.mark.parametrize(
    ("id_", "values", "std_deg"),
    # Without photos, strokes know a single hinge worse than all together: what the others could do
    # counts as its error.
    [
        ("hinge_rest_angle", {"angle_deg": 1.5}, 0.1),
        ("hinge_rest_angle_of_one", {"hinge": 4.0, "angle_deg": 1.5}, 0.3),
    ],
    ids=["all", "one"],
)
def test_a_rest_angle_is_found_to_a_tenth_of_a_degree(id_, values, std_deg):
    strokes = recorded(replace(RIG, effects=(present(id_, **values),)), FOUR)
    dataset = make_leg_dataset(flaps_of(strokes))
    nuisances = Parameterization(nuisances_of(RIG, KNOWN_TO, 0.1))
    (effect,) = decide(
        search_models(dataset, nuisances, [catalogue()[rival] for rival in RIVALS], lambda *_: None)
    ).effects
    assert effect.id == id_
    assert effect.parameters["angle_deg"].value == pytest.approx(1.5, abs=0.1)
    assert effect.parameters["angle_deg"].std < std_deg
    assert "hinge" not in values or effect.parameters["hinge"].value == values["hinge"]
