"""The table of all sets of effects with their relative probabilities."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import logsumexp

from rfca_rig.diagnosis.config import PRIOR_UNKNOWN, VISIBLE_PROBABILITY
from rfca_rig.diagnosis.decision.comparison import Comparison
from rfca_rig.diagnosis.result import Rival

UNKNOWN = ("unknown",)
# sets that are named beside a difference that is visible within the usual model error
MOST_ALTERNATIVES = 5


def rank_rivals(comparison: Comparison) -> tuple[Rival, ...]:
    """All sets of effects with their relative probabilities, most probable first; variants of one
    effect count as one.

    "Nothing missing" allows the usual model error only, "unknown" a larger one. The discrepancy
    scale of a set with effects is free.
    """
    joint: dict[tuple[str, ...], list[tuple[float, float, float]]] = {}
    for scaled in comparison.ranked:
        if scaled.ids:
            joint.setdefault(tuple(sorted(scaled.ids)), []).append(
                (scaled.log_joint, scaled.log_joint - scaled.hypothesis.log_prior, scaled.scale)
            )
    nothing = comparison.result.nothing
    unknown = comparison.result.unknown
    joint[()] = [(nothing.log_joint, nothing.marginal.log_evidence, nothing.marginal.error)]
    joint[UNKNOWN] = [
        (unknown.log_evidence + float(np.log(PRIOR_UNKNOWN)), unknown.log_evidence, unknown.error)
    ]
    logs = {}
    for ids, variants in joint.items():
        logs[ids] = float(logsumexp([log_joint for log_joint, _, _ in variants]))
    total = float(logsumexp(list(logs.values())))
    rivals = []
    for ids, variants in joint.items():
        log_joint, evidence, error = max(variants)
        probability = float(np.exp(logs[ids] - total))
        prior = float(np.exp(log_joint - evidence))
        rivals.append(Rival(ids, probability, evidence, error, prior))
    return tuple(sorted(rivals, key=lambda rival: -rival.probability))


def probability_of(ids: Sequence[str], rivals: Sequence[Rival]) -> float:
    """Probability of a set of effects in the table; 0 where it is not listed."""
    return next((rival.probability for rival in rivals if rival.ids == tuple(ids)), 0.0)


def list_alternatives(rivals: Sequence[Rival]) -> tuple[Rival, ...]:
    """The sets of effects of a table that share nearly all of the probability that something is
    missing, most probable first.
    """
    with_effects = [rival for rival in rivals if rival.ids not in ((), UNKNOWN)]
    total = sum(rival.probability for rival in with_effects)
    alternatives: list[Rival] = []
    for rival in with_effects:
        if (
            sum(alternative.probability for alternative in alternatives)
            >= (1.0 - VISIBLE_PROBABILITY) * total
        ):
            break
        alternatives.append(rival)
    return tuple(alternatives[:MOST_ALTERNATIVES])


def combine_tables(forces: Sequence[Rival], shaft: Sequence[Rival]) -> tuple[Rival, ...]:
    """The table of all pairs of rows, most probable first; something unlisted in both parts is
    one row.
    """
    rows: dict[tuple[str, ...], Rival] = {}
    for a in forces:
        for b in shaft:
            ids = tuple(dict.fromkeys((*a.ids, *b.ids)))
            row = Rival(
                ids,
                a.probability * b.probability,
                a.log_evidence + b.log_evidence,
                max(a.model_error, b.model_error),
                None if a.prior is None or b.prior is None else a.prior * b.prior,
            )
            known = rows.get(ids)
            if known is None:
                rows[ids] = row
            else:
                rows[ids] = replace(
                    max(known, row, key=_probability),
                    probability=known.probability + row.probability,
                )
    return tuple(sorted(rows.values(), key=_probability, reverse=True))


def _probability(rival: Rival) -> float:
    return rival.probability
