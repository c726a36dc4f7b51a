"""From the weighed hypotheses to a verdict: which name may be printed, with what probability, and what it cannot be told from."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expit, logsumexp

from rfca_rig.diagnosis.decision.acceptance import AS_USUAL, ONE_VALUE, acceptance_tests, at_usual_error, describe_strain, left_out
from rfca_rig.diagnosis.decision.comparison import Comparison, compare
from rfca_rig.diagnosis.decision.grade import Statement, Supported, describe_effect, state, support_of_best
from rfca_rig.diagnosis.inference.hypotheses import PRIOR_UNKNOWN, Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.likelihood.cross_validation import MAX_LOO_RMS
from rfca_rig.diagnosis.likelihood.marginal_likelihood import GOOD_FIT
from rfca_rig.diagnosis.result import Gate, Grade, NamedEffect, Rival, Verdict
from rfca_rig.model.families import related

CLEARLY_NEEDED = 120.0  # log evidence that a second effect adds to one that fits well: less, and the first law may be a little off
AS_GOOD = 3.0  # log evidence within which these data do not tell two effects apart
SURE = 0.9
LARGEST_CLASS = 5
# Share of what it explains that the law of a right effect may leave: friction laws of real gears are right to 20 to 40 % of themselves, so
# a second law of the same family that leaves less could be the true one.
LAW_ERROR = 0.2
UNKNOWN = ("unknown",)


@dataclass(frozen=True)
class Decision:
    """The verdict on one body of evidence: the hypothesis that is accepted (nothing missing if none is), and why."""

    verdict: Verdict
    accepted: Hypothesis
    effects: tuple[NamedEffect, ...]
    gates: tuple[Gate, ...]
    rivals: tuple[Rival, ...]
    suspected: Hypothesis | None
    probability_nothing: float
    statement: Statement | None = None
    supported: tuple[Supported, ...] = ()

    @property
    def grade(self) -> Grade:
        """What is stated."""
        if self.verdict == "named":
            return "identified"
        return self.verdict if self.statement is None else self.statement.grade

    @property
    def explanation(self) -> Hypothesis:
        """The hypothesis behind the statement, nothing missing where nothing is stated."""
        return self.accepted if self.statement is None else self.statement.explanation

    @property
    def suspects(self) -> frozenset[str]:
        """The effects that no detection limit may exclude: those of the explanation and, where its law is approximate, of its families."""
        if self.verdict != "unexplained":
            return frozenset(self.accepted.ids).union(*(effect.cannot_tell_from for effect in self.effects))
        closest = (*self.explanation.ids, *(self.suspected.ids if self.suspected is not None else ()))
        return frozenset(closest) | related(closest)

    @property
    def stated(self) -> tuple[NamedEffect, ...]:
        """The effects that are stated, at whatever grade."""
        return self.effects if self.statement is None else self.statement.effects


def decide(found: ModelSelectionResult, candidates: int) -> Decision:
    """The verdict, and what can be stated where no law holds to the usual model error.

    Parameters
    ----------
    found
        What the search left.
    candidates
        How many effects were looked for.
    """
    comparison = compare(found)
    decision = _decide_strictly(comparison, candidates)
    supported = support_of_best(comparison)
    statement = state(comparison, supported) if decision.verdict == "unexplained" else None
    if statement is not None:
        statement = replace(statement, effects=_with_family_rivals(statement.effects, comparison))
    return replace(decision, statement=statement, supported=supported, effects=_with_family_rivals(decision.effects, comparison))


def _with_family_rivals(effects: Sequence[NamedEffect], comparison: Comparison) -> tuple[NamedEffect, ...]:
    """The stated effects; they cannot be told from laws of the same family that are wrong by no more than laws usually are, or than they
    are themselves.
    """
    others = {effect.id for effect in effects}
    own = next((comparison.law_error(one) for one in comparison.ranked if set(one.ids) == others), LAW_ERROR)
    found = []
    for effect in effects:
        kept = others - {effect.id}
        swapped = [one for one in comparison.ranked if len(one.ids) == len(others) and kept <= set(one.ids)]
        rivals = {name for one in swapped if comparison.law_error(one) <= max(LAW_ERROR, own) for name in set(one.ids) - others}
        alike = sorted((rivals & related((effect.id,))) | set(effect.cannot_tell_from))
        found.append(replace(effect, cannot_tell_from=tuple(alike)))
    return tuple(found)


def _decide_strictly(comparison: Comparison, candidates: int) -> Decision:
    """The verdict where a law must hold to the usual model error.

    Where the likeliest hypothesis fails a gate, the simpler ones inside it are asked: what is surely there keeps its name though a
    partner is refused.
    """
    found = comparison.result
    rivals = _rivals(found)
    nothing = _probability(rivals, ())
    best = _simplest(found, candidates)
    if best is None or nothing > 0.5:
        gates = _gates_of_nothing(found)
        verdict: Verdict = "nothing missing" if all(gate.passed for gate in gates) else "unexplained"
        return Decision(verdict, found.nothing, (), gates, rivals, None, nothing)
    attempts = [_attempt(comparison, h, candidates, rivals, nothing) for h in (best, *_inside(found, best))]
    return next((attempt for attempt in attempts if attempt.verdict == "named"), attempts[0])


def _inside(found: ModelSelectionResult, best: Hypothesis) -> list[Hypothesis]:
    return [h for h in found.named if set(h.ids) < set(best.ids)]


def _attempt(comparison: Comparison, best: Hypothesis, candidates: int, rivals: tuple[Rival, ...], nothing: float) -> Decision:
    """The verdict if this hypothesis is the one."""
    found = comparison.result
    classes = [_class_of(found, best, number) for number in range(len(best.ids))]
    probability = _class_probability(rivals, best, classes)
    gates = (
        *acceptance_tests(found, best, candidates),
        Gate("probability", probability >= SURE, f"{probability:.3f} that it is this or one of its class, {SURE:g} needed"),
        Gate("told apart", max(map(len, classes)) <= LARGEST_CLASS, f"as good are {max(map(len, classes))} others at most"),
    )
    if nothing <= 0.1 and all(gate.passed for gate in gates):
        return Decision("named", best, _named(comparison, best, classes, probability, gates), gates, rivals, None, nothing)
    unproven = nothing > 0.1 or not gates[0].passed
    adequate = _is_likelier(found, rivals) if unproven else _is_adequate(found)
    verdict: Verdict = "nothing missing" if adequate and not describe_strain(found.nothing) else "unexplained"
    return Decision(verdict, found.nothing, (), gates, rivals, best, _nothing_or_unknown(found))


def _gates_of_nothing(found: ModelSelectionResult) -> tuple[Gate, ...]:
    """What a model must stand that no effect makes likelier, before it is said to lack nothing."""
    strained, apart = describe_strain(found.nothing), _apart(found)
    foretold = f"conditions are foretold from the others to {apart:.2f} of what a usual model error explains"
    return (
        Gate("plausible", not strained, strained or "all values within what is plausible"),
        Gate("foretells", apart <= MAX_LOO_RMS, foretold),
    )


def _is_likelier(found: ModelSelectionResult, rivals: Sequence[Rival]) -> bool:
    """Whether the model without effects is likelier than something unlisted, and some explanation."""
    return _probability(rivals, UNKNOWN) < 0.5 and _apart(found) <= MAX_LOO_RMS


def _is_adequate(found: ModelSelectionResult) -> bool:
    """Whether the model without effects errs no more than models do, in the conditions that it was fitted to and in those left out."""
    return found.nothing.judgement.error < GOOD_FIT and _apart(found) <= AS_USUAL


def _apart(found: ModelSelectionResult) -> float:
    """How well the model without effects foretells conditions, as `left_out` has it; 0 where they are too few to tell."""
    apart = left_out(found, found.nothing)
    return float(apart.mean()) if len(apart) > 2 else 0.0


def _nothing_or_unknown(found: ModelSelectionResult) -> float:
    """The probability of nothing missing where what has a name was refused one: only something unlisted is left beside it."""
    return float(expit(found.nothing.log_joint - found.unknown.log_evidence - np.log(PRIOR_UNKNOWN)))


def _rivals(found: ModelSelectionResult) -> tuple[Rival, ...]:
    """All hypotheses with their probabilities, most probable first; variants of one effect are one."""
    joint: dict[tuple[str, ...], list[tuple[float, float, float]]] = {}
    for h in (found.nothing, *found.named):
        joint.setdefault(tuple(sorted(h.ids)), []).append((h.log_joint, h.judgement.log_evidence, h.judgement.error))
    unknown = found.unknown
    joint[UNKNOWN] = [(unknown.log_evidence + float(np.log(PRIOR_UNKNOWN)), unknown.log_evidence, unknown.error)]
    logs = {ids: float(logsumexp([entry[0] for entry in entries])) for ids, entries in joint.items()}
    total = float(logsumexp(list(logs.values())))
    rivals = [Rival(ids, float(np.exp(logs[ids] - total)), max(entries)[1], max(entries)[2]) for ids, entries in joint.items()]
    return tuple(sorted(rivals, key=lambda rival: -rival.probability))


def _probability(rivals: Sequence[Rival], ids: tuple[str, ...]) -> float:
    return next((rival.probability for rival in rivals if rival.ids == tuple(sorted(ids))), 0.0)


def _simplest(found: ModelSelectionResult, candidates: int) -> Hypothesis | None:
    """The best hypothesis each of whose members is needed; None where none was fitted.

    A further effect is hardly needed where the model errs no more than usual without it and no nuisance is strained: what it adds may be
    the law of the first being not quite the real one.
    """
    needed = 3.0 + float(np.log(max(candidates, 1)))
    for hypothesis in found.named:
        if all(_adds(found, hypothesis, part, needed) for part in found.named if set(part.ids) < set(hypothesis.ids)):
            return hypothesis
    return None


def _adds(found: ModelSelectionResult, hypothesis: Hypothesis, part: Hypothesis, needed: float) -> bool:
    """Whether it says so much more than its part."""
    enough = hypothesis.judgement.log_evidence - part.judgement.log_evidence >= needed
    if not enough or not part.judgement.fits_well(part.fitted.coordinates.nuisances):
        return enough
    return at_usual_error(found, hypothesis) - at_usual_error(found, part) >= CLEARLY_NEEDED


def _class_of(found: ModelSelectionResult, best: Hypothesis, number: int) -> tuple[str, ...]:
    """The effects that could stand in the place of one of the hypothesis's, the others kept."""
    others = set(best.ids) - {best.ids[number]}
    in_its_place = [h for h in found.named if len(h.ids) == len(best.ids) and others <= set(h.ids)]
    good = [h for h in in_its_place if _is_as_good(found, h, best)]
    return tuple(sorted({name for h in good for name in h.ids} - set(best.ids)))


def _is_as_good(found: ModelSelectionResult, rival: Hypothesis, best: Hypothesis) -> bool:
    """Whether these data do not tell them apart, or would not if the model erred by as much as models do."""
    behind = best.judgement.log_evidence - rival.judgement.log_evidence
    return min(behind, at_usual_error(found, best) - at_usual_error(found, rival)) < AS_GOOD


def _class_probability(rivals: Sequence[Rival], best: Hypothesis, classes: Sequence[tuple[str, ...]]) -> float:
    """That each place is taken by the name or one of its class; larger hypotheses that hold them agree with it."""
    allowed = [{name, *others} for name, others in zip(best.ids, classes, strict=True)]
    return sum(r.probability for r in rivals if len(r.ids) >= len(best.ids) and all(set(r.ids) & names for names in allowed))


def _named(
    comparison: Comparison, best: Hypothesis, classes: Sequence[tuple[str, ...]], probability: float, gates: Sequence[Gate]
) -> tuple[NamedEffect, ...]:
    varies = "; ".join(gate.found for gate in gates if gate.name.startswith(ONE_VALUE))
    words = f"all acceptance tests passed; {varies}"
    return tuple(describe_effect(comparison, best, number, probability, others, words) for number, others in enumerate(classes))
