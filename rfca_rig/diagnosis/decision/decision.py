"""The graded answer of a decision, and the calibrated support of an effect or a family."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from rfca_rig.diagnosis.config import (
    IDENTIFIED_PROBABILITY,
    LAW_ERROR,
    VISIBLE_PROBABILITY,
    WORTH_ADDING,
)
from rfca_rig.diagnosis.decision.calibration import Kind
from rfca_rig.diagnosis.decision.table import UNKNOWN
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis
from rfca_rig.diagnosis.result import (
    Criterion,
    Grade,
    NamedEffect,
    Rival,
    StatedFamily,
    Verdict,
)
from rfca_rig.model.catalogue import list_related

# Grades with effects or a family.
STATED_GRADES = ("identified", "mostly", "family")
HELD_OUT = "held-out misfit"
PLAUSIBLE = "plausible values"
PROBABLE = "probability"


@dataclass(frozen=True)
class Supported:
    """One effect, or family, with its calibrated probability and the values that this rests on.

    Parameters
    ----------
    kind, id
        Whether it is an effect or a family, and which one.
    probability
        Calibrated probability.
    values
        Its support as plain numbers.
    cannot_tell_from
        Effects that explain the data as well.
    is_variation
        Whether another effect of the best explanation belongs to one of its families, so that it
        may only make up for that one's law.
    is_at_bound
        Whether the fit has one of its sizes at the end of its plausible range. Another law looks so
        through this one.
    """

    kind: Kind
    id: str
    probability: float
    values: Mapping[str, float]
    cannot_tell_from: tuple[str, ...] = ()
    is_variation: bool = False
    is_at_bound: bool = False

    @property
    def is_needed(self) -> bool:
        """Whether the laws of the other effects leave more than approximate laws usually do, or
        almost nothing remains with it.

        A variation of another law always removes most of what that law leaves, so that only the
        first counts for it.
        """
        is_small = self.values["law_error_without"] <= LAW_ERROR
        return not is_small or (
            self.values["removed_share"] > 1.0 - WORTH_ADDING and not self.is_variation
        )


@dataclass(frozen=True)
class Decision:
    """The graded answer about one set of observations.

    Parameters
    ----------
    grade
        What is stated.
    explanation
        The hypothesis behind the statement, with the posterior at its own discrepancy scale. It is
        the one without effects where nothing is stated.
    closest
        The best explanation where it is not stated as a whole; None where no hypothesis beats the
        one without effects.
    effects, family
        What is stated. A family is given beside effects, too.
    not_stated
        Each effect of the best explanation, and of the first set of the table, that is not stated,
        and why.
    other_families
        Families, as probable as an identified effect, of those effects of the best explanation that
        are neither stated nor in `family`.
    probability
        Probability of the statement: the least of its effects, or that of the family. For other
        grades, that something is, or is not, missing.
    explained_share
        Share of the removable held-out misfit that the explanation removes.
    relieved_strain
        The implausible nuisance parameters whose place the explanation takes, in words; empty where
        its share supports it.
    criteria
        What `identified` requires, with what was found.
    rivals
        All hypotheses with their relative probabilities, most probable first.
    supported
        The effects and families of the best explanation.
    alternatives
        Where nothing is stated and something is missing or visible: the sets of effects that may be
        behind it.
    within_usual
        Whether the model without effects predicts as models usually do.
    is_unfinished
        Whether the time was up before every effect was tried.
    """

    grade: Grade
    explanation: Hypothesis
    closest: Hypothesis | None = None
    effects: tuple[NamedEffect, ...] = ()
    not_stated: Mapping[str, str] = field(default_factory=dict)
    family: StatedFamily | None = None
    other_families: tuple[StatedFamily, ...] = ()
    probability: float = 1.0
    explained_share: float = 1.0
    relieved_strain: str = ""
    criteria: tuple[Criterion, ...] = ()
    rivals: tuple[Rival, ...] = ()
    supported: tuple[Supported, ...] = ()
    alternatives: tuple[Rival, ...] = ()
    within_usual: bool = False
    is_unfinished: bool = False

    @property
    def verdict(self) -> Verdict:
        """The grade in the words of rfca-diagnosis/1."""
        if self.grade == "identified":
            return "named"
        # Two comparisons, since they narrow the type.
        if self.grade == "mostly" or self.grade == "family":  # noqa: PLR1714
            return "unexplained"
        return self.grade

    @property
    def suspects(self) -> frozenset[str]:
        """Effects that no detection limit may exclude.

        These are the effects that are stated or closest, every one that is not surely absent or
        part of a set that is not, and all that the data hardly distinguish from them: their
        families.
        """
        possible = {
            effect.id
            for effect in self.supported
            if effect.kind == "effect" and effect.probability > 1.0 - IDENTIFIED_PROBABILITY
        }
        in_table = {
            effect_id
            for rival in self.rivals
            if rival.probability > VISIBLE_PROBABILITY
            for effect_id in rival.ids
        }
        stated = {
            *self.explanation.ids,
            *(other for effect in self.effects for other in effect.cannot_tell_from),
        }
        closest = () if self.closest is None else self.closest.ids
        return list_related({*possible, *(in_table - set(UNKNOWN)), *stated, *closest})

    @property
    def predicts_as_usual(self) -> bool:
        """Whether the explanation predicts held-out conditions as models usually do, with plausible
        values.

        Otherwise what remains may hide an effect.
        """
        if not self.explanation.ids:
            return self.within_usual
        return all(criterion.passed for criterion in self.criteria if criterion.name != PROBABLE)

    @property
    def fits_poorly(self) -> bool:
        """Whether the best explanation neither predicts as models usually do nor has plausible
        values.
        """
        failed = {criterion.name for criterion in self.criteria if not criterion.passed}
        return failed.issuperset((HELD_OUT, PLAUSIBLE))

    def list_rivals(self, most: int) -> tuple[Rival, ...]:
        """The first rows of the table of sets, with those of nothing and of the stated set
        wherever they stand.
        """
        always = ((), tuple(sorted(effect.id for effect in self.effects)))
        return tuple(
            rival
            for number, rival in enumerate(self.rivals)
            if number < most or tuple(sorted(rival.ids)) in always
        )
