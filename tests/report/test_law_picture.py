"""The picture of a measured law: the law, its band, the catalogue's beside it, and both branches
where it has memory.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from rfca_rig.diagnosis.residual_force.law import CatalogueCurve, MeasuredLaw, MemoryTest
from rfca_rig.reports.diagnosis.pictures import draw_law

KNOTS = np.linspace(-2.0, 1.0, 7)


def law(memory=None):
    return MeasuredLaw(
        place="floor_friction",
        argument="slip_m_s",
        argument_unit="m/s",
        unit="",
        knots=KNOTS,
        values=0.5 * np.exp(-(KNOTS**2)),
        std=np.full(7, 0.03),
        whole=None,
        whole_std=None,
        visited=(-2.0, 1.0),
        explained=0.9,
        log_density_gain=100.0,
        log_evidence_gain=120.0,
        base=(),
        hypothesis=SimpleNamespace(),
        memory=memory,
    )


CURVE = CatalogueCurve("friction that falls & rises", KNOTS, 0.5 * np.exp(-np.abs(KNOTS)))


def test_it_is_the_same_every_time_and_says_what_it_shows():
    svg = draw_law(law(), CURVE)
    assert svg == draw_law(law(), CURVE)
    assert svg.startswith("<svg ")
    assert (
        'aria-label="measured law of sliding speed of the tip at floor_friction with its '
        "band, and friction that falls &amp; rises"
    ) in svg
    assert "sliding speed of the tip (m/s)" in svg
    assert len(svg) < 30_000


@pytest.mark.parametrize("has_memory", [False, True])
def test_branches_are_drawn_where_the_law_has_memory(has_memory):
    half = np.full(7, 0.1)
    memory = MemoryTest(
        law().values + half, law().values - half, np.full(7, 0.02), 40.0, has_memory
    )
    assert ("while it rises, while it falls" in draw_law(law(memory), None)) is has_memory


def test_without_a_catalogue_entry_the_law_stands_alone():
    svg = draw_law(law(), None)
    assert "catalogue" not in svg
    assert "measured" in svg
