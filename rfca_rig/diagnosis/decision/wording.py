"""The answer of a diagnosis in sentences."""

from rfca_rig.diagnosis.decision.decide import HELD_OUT, Decision, Supported


def describe(decision: Decision) -> str:
    """What is stated, in one or two sentences."""
    stated = " and ".join(f"{effect.left_out} ({effect.id})" for effect in decision.effects)
    explains = f"explains {100.0 * decision.explained_share:.0f} % of the misfit that can be removed on held-out conditions"
    if decision.relieved_strain:
        explains = f"takes the place of an implausible value ({decision.relieved_strain})"
    if decision.grade == "identified":
        others = sorted({other for effect in decision.effects for other in effect.cannot_tell_from})
        tail = f"; these data cannot tell it from {', '.join(others)}" if others else ""
        return f"The model lacks: {stated}{tail}."
    if decision.grade == "mostly":
        is_exact = all(criterion.passed for criterion in decision.criteria if criterion.name == HELD_OUT)
        return f"Mostly missing: {stated}. It {explains}; {'other causes are possible' if is_exact else 'the law is only approximate'}."
    if decision.grade == "family" and decision.family is not None:
        best = " with ".join(decision.explanation.ids)
        return f"Of the cause only the family is clear: {decision.family.words}. The best law of it, {best}, {explains}."
    if decision.grade == "not enough data":
        return f"Not enough data for a verdict: {decision.criteria[0].found}."
    if decision.grade == "nothing missing":
        likely = " and ".join(f"{one.id} ({100.0 * one.probability:.0f} %)" for one in _list_likely(decision))
        tail = f" Likely there, and no more than a model's usual error: {likely}." if likely else ""
        return f"Nothing is missing that these recordings would show.{tail}"
    closest = f" The closest entry is {' with '.join(decision.closest.ids)}, which is not stated." if decision.closest else ""
    return f"Something is missing that no entry of the catalogue explains.{closest}"


def _list_likely(decision: Decision) -> list[Supported]:
    """Effects with a probability above 0.5. Where the model predicts as usual without them, that is not enough to state them."""
    return [one for one in decision.supported if one.kind == "effect" and one.probability > 0.5]


def describe_refusal(decision: Decision) -> tuple[str, ...]:
    """What came closest and why it is not identified, one line each; none where nothing is left to explain."""
    if decision.grade in ("identified", "nothing missing", "not enough data"):
        return ()
    closest = (f"closest is {' with '.join(decision.closest.ids)}, not claimed",) if decision.closest else ()
    return (*closest, *(f"{criterion.name}: {criterion.found}" for criterion in decision.criteria if not criterion.passed))
