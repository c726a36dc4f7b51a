"""One decision from those about the forces and about the motion of the shaft."""

import numpy as np

from rfca_rig.diagnosis.config import MOST_RIVALS
from rfca_rig.diagnosis.decision.decision import Decision
from rfca_rig.diagnosis.decision.table import combine_tables, list_alternatives
from rfca_rig.diagnosis.result import Grade


def join_decisions(forces: Decision, shaft: Decision) -> Decision:
    """One answer from those about the forces and about the motion of the shaft, treated as
    independent: the weaker of what is stated.

    It is "mostly" where one of the two stays unexplained. The explanation is that of the forces.
    """
    decisions = (forces, shaft)
    grades = {forces.grade, shaft.grade}
    stated = [
        decision for decision in decisions if decision.grade in ("identified", "mostly", "family")
    ]
    # What is visible within the usual error of one of the two says nothing against what is
    # identified in the other.
    if "identified" in grades and all(
        decision.grade in ("identified", "nothing missing") or decision.within_usual
        for decision in decisions
    ):
        grade: Grade = "identified"
    elif forces.effects or shaft.effects:
        grade = "mostly"
    else:
        grade = next(
            candidate
            for candidate in ("family", "unexplained", "nothing missing")
            if candidate in grades
        )
    # Nothing is missing only if nothing is missing in either of them.
    nothing = float(
        np.prod(
            [
                decision.probability
                if decision.grade == "nothing missing"
                else 1.0 - decision.probability
                for decision in decisions
            ]
        )
    )
    rivals = combine_tables(forces.list_rivals(MOST_RIVALS), shaft.list_rivals(MOST_RIVALS))
    families = [decision.family for decision in decisions if decision.family is not None]
    effects = (*forces.effects, *shaft.effects)
    stated_ids = {effect.id for effect in effects}
    # The family of a stated effect says nothing more.
    further_families = [
        family
        for family in (*families[1:], *forces.other_families, *shaft.other_families)
        if stated_ids.isdisjoint(family.members)
    ]
    # What is visible within the usual error is no criterion of what is identified in the other
    # part.
    judged = [
        decision
        for decision in decisions
        if decision.grade != "nothing missing"
        and (grade != "identified" or decision.grade == "identified")
    ]
    if stated:
        probability = min(decision.probability for decision in stated)
    elif grade == "nothing missing":
        probability = nothing
    else:
        probability = 1.0 - nothing
    return Decision(
        grade=grade,
        explanation=forces.explanation,
        closest=next(
            (decision.closest for decision in decisions if decision.closest is not None), None
        ),
        effects=effects,
        not_stated={**forces.not_stated, **shaft.not_stated},
        family=families[0] if families else None,
        other_families=tuple(further_families),
        probability=probability,
        explained_share=min((decision.explained_share for decision in stated), default=1.0),
        relieved_strain=next(
            (decision.relieved_strain for decision in stated if decision.relieved_strain), ""
        ),
        criteria=tuple(criterion for decision in judged for criterion in decision.criteria),
        rivals=rivals,
        supported=(*forces.supported, *shaft.supported),
        alternatives=list_alternatives(rivals) if grade == "unexplained" else (),
        within_usual=forces.within_usual and shaft.within_usual,
    )
