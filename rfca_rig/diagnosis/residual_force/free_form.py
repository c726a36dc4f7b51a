"""Empirical answer where no entry of the catalogue explains the recordings.

It states where a force is missing, how it looks, and which short formula it follows. The cause is
not known.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, softmax

from rfca_rig.diagnosis.config import (
    AS_GOOD_LOG_ODDS,
    CLOSE_LOG_EVIDENCE,
    DOMINANT_SHARE,
    IDENTIFIED_PROBABILITY,
)
from rfca_rig.diagnosis.inference.hypotheses import ModelSelectionResult
from rfca_rig.diagnosis.leg.simulator import select_strokes
from rfca_rig.diagnosis.residual_force.force_localization import (
    ForceScene,
    LocalizedForce,
    localize_force,
    make_scene,
)
from rfca_rig.diagnosis.residual_force.sparse_law import FoundTerm, SparseLaw, sparse_laws
from rfca_rig.diagnosis.result import StatedPlace
from rfca_rig.executors.parallel import map_in_processes

Floats = NDArray[np.float64]

# mean square over what is expected, up to which a channel counts as explained
EXPLAINED_MISFIT = 2.0
# share of the misfit that a large force, whose response is not linear, must remove instead
EXPLAINED_SHARE = 0.9


@dataclass(frozen=True)
class FreeForm:
    """The most probable place of what is missing.

    Parameters
    ----------
    place, words
        The place.
    terms
        A formula for the force; empty where none holds over the conditions.
    ranking
        All places with their log evidence above that of nothing missing, best first.
    is_located
        Whether the force is large enough and explains all channels.
    text
        The answer in words.
    """

    place: str
    words: str
    terms: tuple[FoundTerm, ...]
    ranking: tuple[tuple[str, float], ...]
    is_located: bool
    text: str


@dataclass(frozen=True)
class PlaceCandidate:
    """A place with its free force and its formula."""

    placed: LocalizedForce
    law: SparseLaw

    @property
    def log_evidence(self) -> float:
        """Log evidence of the place: a priori its force is free or follows a formula, with equal
        probability.
        """
        return float(np.logaddexp(self.placed.log_evidence, self.law.log_evidence) - np.log(2.0))


def estimate_free_force(found: ModelSelectionResult) -> FreeForm | None:
    """The answer for a search that identified nothing; None where no stroke was recorded. Raises
    SimulationFailed.
    """
    if not select_strokes(found.dataset.parts):
        return None
    ranked = rank_places(make_scene(found.dataset, found.nothing.fitted, found.scatter.columns))
    best = ranked[0]
    return FreeForm(
        place=best.placed.place.id,
        words=best.placed.place.words,
        terms=best.law.terms,
        ranking=tuple((candidate.placed.place.id, candidate.log_evidence) for candidate in ranked),
        is_located=best.log_evidence >= AS_GOOD_LOG_ODDS and _explains(best),
        text=_describe(ranked),
    )


def rank_places(scene: ForceScene) -> tuple[PlaceCandidate, ...]:
    """All places, most probable first; no formula is sought for those far behind."""
    blocks = map_in_processes(lambda place: place.responses(scene.conditions), scene.places)
    responses = {place.id: block for place, block in zip(scene.places, blocks, strict=True)}
    free = [localize_force(scene, place, responses[place.id]) for place in scene.places]
    best = max(force.log_evidence for force in free)
    near = [force for force in free if force.log_evidence > best - CLOSE_LOG_EVIDENCE]
    laws = sparse_laws(scene, [(force.place, responses[force.place.id]) for force in near])
    # A formula counts only if it explains most of what the free force explains.
    lasting = {
        force.place.id: law
        for force, law in zip(near, laws, strict=True)
        if law.explained > DOMINANT_SHARE * force.explained["all"]
    }
    candidates = [PlaceCandidate(force, lasting.get(force.place.id, SparseLaw())) for force in free]
    return tuple(sorted(candidates, key=lambda candidate: -candidate.log_evidence))


def _explains(best: PlaceCandidate) -> bool:
    """Whether the free force or its formula explains every channel, or most of a misfit that is
    too large to be linear.
    """
    return (
        max(best.placed.misfit.values()) <= EXPLAINED_MISFIT
        or max(best.placed.explained["all"], best.law.explained) >= EXPLAINED_SHARE
    )


def _describe(ranked: Sequence[PlaceCandidate]) -> str:
    best = ranked[0]
    also = [
        other.placed.place.words
        for other in ranked[1:]
        if other.log_evidence > best.log_evidence - AS_GOOD_LOG_ODDS
    ]
    if best.log_evidence < AS_GOOD_LOG_ODDS:
        return "What is missing is too small to say where it acts."
    if not _explains(best):
        return (
            f"No single place explains all channels; {best.placed.place.words} comes closest. "
            "The cause is not known."
        )
    where = f"What is missing acts like {best.placed.place.words}"
    if also:
        where += f", which these data cannot tell from {', '.join(also)}"
    if not best.law.terms:
        return (
            f"{where}; no short formula for it lasts over the conditions. The cause is not known."
        )
    fully = (
        best.law.log_evidence > best.placed.log_evidence
        or best.law.explained > EXPLAINED_SHARE * best.placed.explained["all"]
    )
    how = "follows" if fully else "in part follows"
    return (
        f"{where}, and {how} {formula(best.law.terms)} there: an empirical law, its cause is "
        "not known."
    )


def state_place(free: FreeForm) -> StatedPlace | None:
    """The part of the rig where something acts; all parts are equally probable a priori, and so are
    the force inputs of each.

    None where no force input explains the misfit, or where the part of the best one is less
    probable than IDENTIFIED_PROBABILITY. In benchmark cases one in ten of the stated parts was
    wrong, by hundreds in log evidence, since responses are linear. So no more than
    IDENTIFIED_PROBABILITY is stated.
    """
    of_each: dict[str, list[float]] = {}
    for name, log_evidence in free.ranking:
        of_each.setdefault(_group(name), []).append(log_evidence)
    parts = list(of_each)
    # The mean evidence over the places of a part: many places are no advantage.
    weights = softmax([logsumexp(logs) - np.log(len(logs)) for logs in of_each.values()])
    best = _group(free.place)
    probability = float(weights[parts.index(best)])
    if not free.is_located or probability < IDENTIFIED_PROBABILITY:
        return None
    return StatedPlace(best, free.words, IDENTIFIED_PROBABILITY)


def _group(force_input: str) -> str:
    """Part of the rig that a force input belongs to; a torque on the shaft and a fault of the tx
    channel are the same.
    """
    if force_input.startswith("hinge"):
        return "hinges"
    return {"shaft_angle": "drive", "fy_N": "sensor", "fz_N": "sensor", "shaft": "shaft"}.get(
        force_input, "ground"
    )


def formula(terms: Sequence[FoundTerm]) -> str:
    """The terms as a sum, with one standard deviation and units."""
    return " + ".join(f"({t.coefficient:.3g} ± {t.std:.1g}) {t.unit} * {t.term}" for t in terms)
