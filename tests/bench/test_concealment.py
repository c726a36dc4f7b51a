"""An effect of the twin that its nominal model lacks: drawn, sealed, and in the twin alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.bench.concealment import (
    LEAST_N,
    MOST_N,
    PLACES,
    conceal,
    draw_concealed,
    open_seal,
    seal,
)
from rfca_rig.bench.factory import _plant
from rfca_rig.description.rig_file import RigFile
from rfca_rig.errors import BadInput
from rfca_rig.model.catalogue import catalogue
from rfca_rig.model.parameters import PresentEffect
from rfca_rig.model.stroke import simulate_stroke_at_speed
from rfca_rig.toml import model_of

USUAL = (Path(__file__).parents[2] / "calibration" / "twin.toml").read_text(encoding="utf-8")
RIG = model_of(USUAL, RigFile, Path("twin.toml"))
PLAY = PresentEffect("hinge_backlash", (("half_gap_deg", 0.7),))


def concealed(effect):
    return model_of(conceal(USUAL, effect), RigFile, Path("riddle.toml"))


@pytest.mark.parametrize("seed", range(1, 9))
def test_what_is_drawn_shows_in_a_stroke_and_is_of_the_leg_or_its_surroundings(seed):
    drawn = draw_concealed(RIG, np.random.default_rng(seed))
    assert catalogue()[drawn.id].where in PLACES
    t_s = np.arange(0.0, 0.75, 1e-3)
    changes = []
    for height_m, speed_rad_s in ((0.215, 2.433), (0.235, 3.276)):
        model = RIG.model()
        forces = [
            simulate_stroke_at_speed(rig, height_m, speed_rad_s, t_s).fz_N
            for rig in (model, replace(model, effects=(drawn,)))
        ]
        changes.append(np.sqrt(np.mean((forces[1] - forces[0]) ** 2)))
    # Up to the valley, which another stroke reaches at another time.
    assert 0.3 * LEAST_N < max(changes) < 2.0 * MOST_N


def test_a_seed_has_its_own_effect_whatever_was_drawn_before():
    first = [draw_concealed(RIG, np.random.default_rng(seed)) for seed in range(1, 9)]
    again = draw_concealed(RIG, np.random.default_rng(5))
    assert again == first[4]
    assert len({effect.id for effect in first}) > 3


def test_the_twin_has_it_and_its_nominal_model_lacks_it():
    rig = concealed(PLAY)
    assert rig.model().effects == ()
    assert _plant(rig, rig.twin, np.random.default_rng(1)).rig.effects == (PLAY,)
    assert _plant(RIG, RIG.twin, np.random.default_rng(1)).rig.effects == ()
    # The drive follows, so that nothing but the concealed effect is missing.
    assert rig.twin.drive.speed_gain_Nm_s_per_rad > 5.0 * RIG.twin.drive.speed_gain_Nm_s_per_rad
    assert rig.leg == RIG.leg and rig.known_to == RIG.known_to


def test_the_rig_file_does_not_name_it():
    text = conceal(USUAL, PLAY)
    assert PLAY.id not in text and "0.7" not in seal([PLAY])
    assert open_seal(concealed(PLAY).twin.concealed) == (PLAY,)
    assert open_seal("") == ()


@pytest.mark.parametrize(
    "damage", ["spring_hysteresis", "-", "0123456789ab-AAAA", "x", "\u00e9-\u00e9"]
)
def test_a_damaged_seal_is_refused(damage):
    with pytest.raises(BadInput, match="concealed: is not what rfca-rig twin conceal wrote"):
        open_seal(damage)


def test_a_seal_of_other_content_is_refused():
    digest, _, _ = seal([PLAY]).partition("-")
    _, _, packed = seal([]).partition("-")
    with pytest.raises(BadInput, match="concealed"):
        open_seal(f"{digest}-{packed}")
