"""The answer in sentences."""

from collections.abc import Sequence

from rfca_rig.diagnosis.result import Grade, NamedEffect, StatedFamily


def describe(grade: Grade, stated: Sequence[NamedEffect], family: StatedFamily | None, explained_share: float) -> str:
    """What is stated, for the grades that state something and for nothing missing.

    Parameters
    ----------
    grade
        Any grade but "unexplained" and "not enough data".
    stated
        The stated effects.
    family
        The stated family.
    explained_share
        Share of the removable held-out misfit that the explanation removes.
    """
    what = " and ".join(f"{effect.left_out} ({effect.id})" for effect in stated)
    if grade == "identified":
        others = sorted({other for effect in stated for other in effect.cannot_tell_from})
        tail = f"; these data cannot tell it from {', '.join(others)}" if others else ""
        return f"The model lacks: {what}{tail}."
    share = f"{100.0 * explained_share:.0f} % of the misfit that can be removed on held-out conditions"
    if grade == "mostly":
        return f"Mostly missing: {what}. It explains {share}; the law is only approximate."
    if grade == "family" and family is not None:
        return f"Of the cause only the family is clear: {family.words}. The best law of it explains {share}."
    return "Nothing is missing that these recordings would show."


def describe_unexplained(suspected: Sequence[str]) -> str:
    """The sentence where something is missing and nothing can be stated."""
    like = f" The closest entry is {' with '.join(suspected)}, which is not stated." if suspected else ""
    return f"Something is missing that no entry of the catalogue explains.{like}"
