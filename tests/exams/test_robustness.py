"""Two hundred legs and grounds drawn wide, effects on and off: no failure, and no valley that hangs
on the tolerance.

Run by hand: pytest -m long tests/exams/test_robustness.py -s
"""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.analysis.phases import Valley, find_valley
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.catalogue import catalogue
from rfca_rig.model.chain import Tolerance
from rfca_rig.model.parameters import PresentEffect, RigModel
from rfca_rig.model.stroke import simulate_stroke_at_speed
from tests.model.legs import PAPER

CASES = 200
T = np.arange(1, 1400) * 1e-3
TIGHTER = Tolerance(1e-6, 3e-3)


def drawn(random: np.random.Generator) -> RigModel:
    """Friction 0.2 to 1.3, stiffness of hinges and contact over two decades, damping over one;
    each effect on in one of ten.
    """
    leg = replace(
        PAPER.leg,
        k0_Nm_per_rad=10.98 * 10 ** random.uniform(-1.0, 1.0),
        hinge_damping_Nm_s_per_rad=0.088 * 10 ** random.uniform(-0.5, 0.5),
    )
    ground = replace(
        PAPER.ground,
        friction_coefficient=random.uniform(0.2, 1.3),
        stiffness_N_per_m1p5=10 ** random.uniform(4.5, 6.5),
    )
    effects = []
    for effect in catalogue().values():
        if random.random() < 0.1:
            values = tuple(
                (p.name, float(random.uniform(p.low, p.low + 0.5 * (p.high - p.low))))
                for p in effect.parameters
            )
            effects.append(PresentEffect(effect.id, values))
    return replace(PAPER, leg=leg, ground=ground, effects=tuple(effects))


def verdict(rig: RigModel) -> tuple[str, float]:
    """What came of one rig, and by how much its valley depends on the tolerance [share]."""
    try:
        plain, tight = (
            simulate_stroke_at_speed(rig, 0.215, 2.433, T, tolerance)
            for tolerance in (Tolerance(), TIGHTER)
        )
    except (BadInput, SimulationFailed):
        return "said so", 0.0
    if not (np.isfinite(plain.fz_N).all() and np.isfinite(tight.fz_N).all()):
        return "silent failure", np.inf
    valleys = [find_valley(T, stroke.fz_N) for stroke in (plain, tight)]
    if not all(isinstance(valley, Valley) for valley in valleys):
        return "no valley", 0.0
    return "valley", abs(valleys[0].fz_N / valleys[1].fz_N - 1.0)


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_no_silent_failure_and_no_valley_that_hangs_on_the_tolerance():
    random = np.random.default_rng(2026)
    rigs = [drawn(random) for _ in range(CASES)]
    found = [verdict(rig) for rig in rigs]
    counted = {
        word: sum(word == each for each, _ in found)
        for word in ("valley", "no valley", "said so", "silent failure")
    }
    off = np.array([share for word, share in found if word == "valley"])
    spread = ", ".join(
        f"{name} {value:.1e}"
        for name, value in (
            ("median", np.median(off)),
            ("95 %", np.quantile(off, 0.95)),
            ("worst", off.max()),
        )
    )
    print(
        f"\n{counted}; valley off by {spread}; {(off > 1e-3).sum()} by more than 1e-3. "
        "The worst ten:"
    )
    for share, rig in sorted(
        zip((share for _, share in found), rigs, strict=True), key=lambda pair: -pair[0]
    )[:10]:
        effects = [present.id for present in rig.effects]
        print(
            f"{share:.1e} mu {rig.ground.friction_coefficient:.2f} k0 "
            f"{rig.leg.k0_Nm_per_rad:.1f} {effects}"
        )
    assert counted["silent failure"] == 0
    assert np.quantile(off, 0.9) < 1e-3
