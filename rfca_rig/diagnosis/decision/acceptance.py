"""What a hypothesis must stand before its name is printed. A relative probability alone can never say "none of these"."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.decision.negative_controls import best_decoy, taken_away
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.likelihood.cross_validation import MAX_LOO_RMS, loo_rms
from rfca_rig.diagnosis.likelihood.laplace import Linear, laplace_posterior
from rfca_rig.diagnosis.likelihood.marginal_likelihood import IMPLAUSIBLE
from rfca_rig.diagnosis.result import Gate

Floats = NDArray[np.float64]

FREE_BY = 0.25  # share by which an effect's size may differ between conditions or channels before the data speak
MOST_VARIATION = 0.125  # beyond, the effect behaves only partly like its law
APPROXIMATELY = 0.2  # the same where something is missing for sure: a law that is roughly right says more than none
MOST_IMPROVE = 0.8  # share of conditions that must be foretold better,
WORTH_NAMING = 0.3  # by this share of the misfit at least: a real model's own small errors look a little like everything;
WORTH_ADDING = 0.1  # by this share where an effect is named already
CLOSES = 0.8  # share of the way down to what the best of models leave: a law that is only alike stops before,
CLOSES_NEARLY_ALL = 0.95  # and where nothing missing would almost do, it stops late
AS_USUAL = 1.0  # of what a usual model error explains
ONE_VALUE = "one value in all "  # a gate for conditions, one for channels
AT_A_BOUND = 2.6  # prior deviations of an effect's parameter: a log-uniform one is within 1 % of its end


def acceptance_tests(found: ModelSelectionResult, best: Hypothesis, candidates: int) -> tuple[Gate, ...]:
    """All gates for the best hypothesis, passed or not."""
    signatures, most = _signatures(found, best), _most_variation(found)
    return (
        _evidence(found, best, candidates),
        _each_needed(found, best, candidates),
        _invariance("conditions", [_variation(found, best, signature, found.evidence.rows.condition) for signature in signatures], most),
        _invariance("channels", [_variation(found, best, signature, _channels(found)) for signature in signatures], most),
        _foretold(found, best),
        _no_decoy(found, best),
        _plausible(best),
        _remainder(found, best),
    )


def _evidence(found: ModelSelectionResult, best: Hypothesis, candidates: int) -> Gate:
    """A name is worth more than nothing missing, and would be though the model erred by as much as models do."""
    gain = best.judgement.log_evidence - found.nothing.judgement.log_evidence
    gain, needed = min(gain, at_usual_error(found, best) - at_usual_error(found, found.nothing)), 3.0 + float(np.log(candidates))
    return Gate("evidence", gain >= needed, f"log evidence {gain:.1f} above that of nothing missing, {needed:.1f} needed")


def at_usual_error(found: ModelSelectionResult, hypothesis: Hypothesis) -> float:
    """The log evidence of a hypothesis if the model errs by as much as models do."""
    return laplace_posterior(hypothesis.fitted.linear(found.evidence.rows.measured), found.judge.usual).log_evidence


def _each_needed(found: ModelSelectionResult, best: Hypothesis, candidates: int) -> Gate:
    """Every member of a pair must raise the evidence over the other alone; and foretell conditions clearly better than that does, or let
    a nuisance stand where it is believed that had to leave it.
    """
    if len(best.ids) < 2:
        return Gate("each needed", True, "one effect only")
    needed = 3.0 + float(np.log(candidates))
    alone = _best_part(found, best)
    if alone is None:
        return Gate("each needed", True, "neither explains anything alone")
    gain = best.judgement.log_evidence - alone.judgement.log_evidence
    before, after = (float(left_out(found, h).mean()) for h in (alone, best))
    better = before - after >= WORTH_ADDING * before or _relieves(best, alone)
    text = f"log evidence {gain:.1f} above that of the better one alone, {needed:.1f} needed"
    text += f"; conditions left out are foretold to {after:.2f} instead of {before:.2f}"
    return Gate("each needed", gain >= needed and better, text)


def _best_part(found: ModelSelectionResult, best: Hypothesis) -> Hypothesis | None:
    parts = [h for h in found.named if set(h.ids) < set(best.ids)]
    return max(parts, key=lambda h: h.judgement.log_evidence, default=None)


def _no_decoy(found: ModelSelectionResult, best: Hypothesis) -> Gate:
    """What the last effect adds is more than any decoy would."""
    simpler = _best_part(found, best) or found.nothing
    own, decoy = taken_away(found, best, simpler), best_decoy(found, best, simpler)
    return Gate("no decoy does as well", own > decoy, f"takes away {own:.0f} of chi2, the best decoy {decoy:.0f}")


def _signatures(found: ModelSelectionResult, best: Hypothesis) -> list[Floats]:
    """What each effect does to the rows where the hypothesis fits best, its own nuisances kept."""
    coordinates = best.fitted.coordinates
    signatures = []
    for number in range(len(coordinates.choices)):
        others = [choice for i, choice in enumerate(coordinates.choices) if i != number]
        x = np.delete(best.fitted.x, np.arange(*coordinates.part(number).indices(coordinates.size)))
        without = found.evidence.predicted(coordinates.with_terms(others).supposed(x))
        signatures.append(best.fitted.predicted * 0.0 if without is None else best.fitted.predicted - without)
    return signatures


def _channels(found: ModelSelectionResult) -> NDArray[np.intp]:
    """Counts the signals, static forces with those of strokes, and all hinge angles as one."""
    signal = np.array(["hinges" if name.startswith("hinge") else name for name in found.evidence.rows.signal])
    return np.unique(signal, return_inverse=True)[1]


def _most_variation(found: ModelSelectionResult) -> float:
    """Small where nothing missing would do almost as well, and some effect always imitates what is left."""
    return APPROXIMATELY if float(left_out(found, found.nothing).mean()) > MAX_LOO_RMS else MOST_VARIATION


def _invariance(what: str, varied: Sequence[float], most: float) -> Gate:
    """Whether one size of each effect serves all groups: each group's own size is left free by a quarter, and compared.

    A cause has one value everywhere; what only imitates it does not.
    """
    worst = max(varied, default=0.0)
    return Gate(f"{ONE_VALUE}{what}", worst <= most, f"its size varies between {what} by {100.0 * worst:.0f} %")


def _variation(found: ModelSelectionResult, best: Hypothesis, signature: Floats, group: NDArray[np.intp]) -> float:
    """Root mean square by which the groups' sizes differ from their mean beyond what chance makes, groups that tell nothing left out."""
    columns = [column for g in range(int(group.max()) + 1) if np.any(column := np.where(group == g, signature, 0.0))]
    if len(columns) < 2:
        return 0.0
    linear = best.fitted.linear(found.evidence.rows.measured)
    wider = Linear(linear.target, np.column_stack([linear.jacobian, FREE_BY * np.column_stack(columns)]))
    posterior = laplace_posterior(wider, best.judgement.whitening)
    own = slice(linear.jacobian.shape[1], None)
    size, std = FREE_BY * posterior.mean[own], FREE_BY * np.sqrt(np.diag(posterior.covariance)[own])
    telling = std < 0.5 * FREE_BY
    if telling.sum() < 2:
        return 0.0
    weight = 1.0 / std[telling] ** 2
    apart = size[telling] - np.average(size[telling], weights=weight)
    return float(np.sqrt(max(np.average(apart**2 - std[telling] ** 2, weights=weight), 0.0)))


def _foretold(found: ModelSelectionResult, best: Hypothesis) -> Gate:
    """Each condition left out in turn, all unknowns fitted to the others: is it foretold better with the effect?"""
    before, after, floor = left_out(found, found.nothing), left_out(found, best), _floor(found)
    if len(before) < 3:
        return Gate("foretells", False, f"only {len(before)} conditions: none can be left out to be foretold")
    gains = before - after
    enough = float(gains.mean()) > max(float(gains.std(ddof=1)) / np.sqrt(len(gains)), WORTH_NAMING * float(before.mean()))
    enough = enough or (_relieves(best, found.nothing) and float(gains.mean()) > 0.0 and float(after.mean()) <= AS_USUAL)
    share = max(float(np.mean(gains > 0.0)), share_by_size(gains) if float(after.mean()) < AS_USUAL else 0.0)
    least = _least_left(found)
    strained = float(before.mean()) <= AS_USUAL and _relieves(best, found.nothing)  # what is missing hides in a believed value
    down = strained or comes_down(float(before.mean()), float(after.mean()), least)
    well = down and float(after.mean()) <= MAX_LOO_RMS and not vetoed(before, after, floor)
    text = f"{100 * share:.0f} % of {len(gains)} conditions are foretold better from the others; rms {before.mean():.2f} -> "
    text += f"{after.mean():.2f} of what a usual model error explains, {least:.2f} for the best of models"
    return Gate("foretells", enough and well and share >= MOST_IMPROVE, text)


def comes_down(before: float, after: float, least: float) -> bool:
    """Whether a name takes away nearly all that could be: rms of what is foretold, of which `least` remains where nothing is missing.

    A spring that relaxes does much of what one with hysteresis does, a filter much of what a late clock does; the less there is to take
    away, the more of it.
    """
    return before - after >= (CLOSES if before > MAX_LOO_RMS else CLOSES_NEARLY_ALL) * (before - least)


def _least_left(found: ModelSelectionResult) -> float:
    """What noise and the least error that any model is granted leave, in units of noise and usual model error."""
    least, usual = found.judge.named[0], found.judge.usual
    return float(np.sqrt(np.mean(least.variance() / usual.variance())))


def vetoed(before: Floats, after: Floats, floor: Floats) -> bool:
    """Whether a condition comes out worse with the effect, by more than chance does (`floor`).

    Where something is missing for sure, one that is still foretold as well as models usually do says nothing against a name.
    """
    worse = after - before > floor
    if float(before.mean()) > MAX_LOO_RMS:
        worse &= after > AS_USUAL
    return bool(worse.any())


def share_by_size(gains: Floats) -> float:
    """How much of all that changes gets better: a stop that few conditions reach leaves the others to chance."""
    return float(gains[gains > 0.0].sum() / max(np.abs(gains).sum(), 1e-300))


def left_out(found: ModelSelectionResult, hypothesis: Hypothesis) -> Floats:
    """How well a hypothesis foretells each condition, (conditions,), as `rms_left_out` has it."""
    rows = found.evidence.rows
    return loo_rms(hypothesis.fitted.linear(rows.measured), found.judge.usual, rows)


def _floor(found: ModelSelectionResult) -> Floats:
    """By how much each condition may come out worse, (conditions,): what chance does to an rms of as many rows."""
    return np.asarray(3.0 / np.sqrt(2.0 * np.bincount(found.evidence.rows.condition)))


def _plausible(best: Hypothesis) -> Gate:
    """No size on a bound of what is plausible, and no nuisance far from where it is believed.

    A shape parameter of a law may be: pins that slip at once have none of the presliding that the law allows for.
    """
    coordinates, mean = best.fitted.coordinates, best.judgement.posterior.mean
    strained = [
        f"{choice.effect.id} {parameter.name}"
        for number, choice in enumerate(coordinates.choices)
        for parameter, z in zip(choice.free, mean[coordinates.part(number)], strict=True)
        if parameter in choice.sizes and abs(z) > AT_A_BOUND
    ]
    off = describe_strain(best)
    problems = strained + ([off] if off else [])
    return Gate("plausible", not problems, "; ".join(problems) or "all values within what is plausible")


def _relieves(best: Hypothesis, simpler: Hypothesis) -> bool:
    """Whether nuisances that had to leave what they are believed to be under the simpler hypothesis need not under the best."""
    return bool(describe_strain(simpler)) and not describe_strain(best)


def describe_strain(hypothesis: Hypothesis) -> str:
    """The nuisances that had to leave what they are believed to be, in words; empty where none had to."""
    names, mean = hypothesis.fitted.coordinates.space.names, hypothesis.judgement.posterior.mean
    return "; ".join(f"{name} {z:+.1f} deviations from believed" for name, z in zip(names, mean, strict=False) if abs(z) > IMPLAUSIBLE)


def _remainder(found: ModelSelectionResult, best: Hypothesis) -> Gate:
    s = best.judgement.error
    largest = found.judge.named[-1].s
    return Gate("nothing left over", s < 0.75 * largest, f"what is left is like a model error of {100 * s:.1f} %")
