"""`ReferenceProblem`: recordings beside a reference as a problem of the diagnosis."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from rfca_rig.diagnosis.budget import UNLIMITED, TimeBudget
from rfca_rig.diagnosis.config import FEWEST_CONDITIONS, USUAL_ERROR
from rfca_rig.diagnosis.data import rms, unit_of
from rfca_rig.diagnosis.decision.decide import decide, withhold
from rfca_rig.diagnosis.decision.decision import STATED_GRADES, Decision
from rfca_rig.diagnosis.inference.hypotheses import ModelSelectionResult
from rfca_rig.diagnosis.inference.model_selection import Progress, search_models
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.problem import (
    AnswerPart,
    DecidedSearch,
    Fit,
    FitOptions,
    Problem,
    RecordingPair,
    Solution,
)
from rfca_rig.diagnosis.reference.changes import add_changes
from rfca_rig.diagnosis.reference.conditions import (
    ReferencedCondition,
    ReferenceParts,
    compare_pair,
)
from rfca_rig.diagnosis.reference.fit import ReferenceFit, fit_reference, fit_without_effects
from rfca_rig.diagnosis.reference.omissions import add_omission, find_omission, has_matches
from rfca_rig.diagnosis.reference.shared import find_shared_effects
from rfca_rig.diagnosis.residual_force.law import StatedLaw
from rfca_rig.diagnosis.result import SHARED_ERROR, Diagnosed, Diagnosis, name_parts
from rfca_rig.diagnosis.result_builder import Wording, describe, not_enough_data
from rfca_rig.diagnosis.simulator import Dataset
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.declarations.changes import VALUE_OF_CHANGE
from rfca_rig.model.effect import Effect
from rfca_rig.protocol.plan import Limits

SHARE_OF_REFERENCE = 0.15  # of the progress of a diagnosis
# Repeats that are proposed: with two the difference between recordings is known for each command.
REPEATS = 2

SINCE_REFERENCE = Wording(
    lacks="Since the reference, this has changed:",
    mostly="Since the reference, this has changed most:",
    family="Since the reference, something has changed of which only the family is clear:",
    nothing="Since the reference, nothing has changed that these recordings would show.",
    something="Since the reference, something has changed",
    visible=(
        "The difference from the reference is within the usual difference between recordings, but "
        "visible:"
    ),
    doubtful="More probably than not nothing has changed since the reference, though the "
    "recordings differ from it by more than usual",
)


# Where commands differ, what differs may be the model's error.
IN_OTHER_MOTIONS = replace(
    SINCE_REFERENCE,
    nothing="Since the reference, nothing has changed that these recordings would show, though "
    "their commands are other ones.",
    something="The recordings differ from what the reference predicts for their commands, which "
    "are other ones",
    visible="The difference from the reference is within the usual error of the model in other "
    "motions, but visible:",
)


@dataclass(frozen=True)
class ReferenceSolution(Solution):
    """The decided search for what has changed.

    Parameters
    ----------
    inner
        The solution of the kind of rig.
    finding, pair, compared
        The search, the recordings as they are, and the conditions in which it was made.
    fit, reference
        The reference, and the identity of its recordings.
    is_matched
        Whether enough conditions for a verdict have a match in the reference.
    omission
        Effects that the model lacks in the reference, and has in both since.
    shared
        Effects that would have been stated, but that the model lacks in the reference, too.
    """

    inner: Solution
    finding: DecidedSearch
    pair: RecordingPair
    compared: Dataset
    fit: ReferenceFit
    reference: tuple[Diagnosed, ...]
    is_matched: bool
    omission: tuple[str, ...] = ()
    shared: tuple[str, ...] = ()

    @property
    def searches(self) -> Mapping[str, DecidedSearch]:
        """The search for what has changed."""
        return {"changes": self.finding}

    def describe(self) -> Diagnosis:
        """The answer as a change, and apart from it what both recordings have."""
        diagnosis = self.inner.describe()
        if self.shared:
            sentence = (
                f"{' and '.join(self.shared)} would explain how the recordings differ from the "
                "reference. But the model lacks it in the reference, too, and the commands are "
                "other ones, so that it may be no change."
            )
        else:
            words = SINCE_REFERENCE if self.is_matched else IN_OTHER_MOTIONS
            sentence = describe(self.finding.decision, words)
        return replace(
            diagnosis,
            sentence=name_parts(sentence, diagnosis.is_of_stretches),
            remarks=(*self._describe_reference(), *diagnosis.remarks),
            settings={**diagnosis.settings, "reference": self._settings()},
        )

    def write_model(self, folder: Path, diagnosis: Diagnosis) -> Sequence[str]:
        """Write the model with the values of the reference and what has changed."""
        return self.inner.write_model(folder, diagnosis)

    def propose_experiment(
        self,
        limits: Limits | None,  # noqa: ARG002
    ) -> AnswerPart[Mapping[str, Any] | None]:
        """The commands of the reference that these recordings lack, or all of them again where the
        answer is open.
        """
        missing = self._list_commands(is_matched=False)
        is_open = self.finding.decision.grade not in ("identified", "nothing missing")
        if missing:
            why = (
                "what is compared with its own repeat in the reference is free of the model's error"
            )
            commands = missing
        elif is_open:
            why = "more repeats of the same commands show smaller changes"
            commands = self._list_commands(is_matched=True)
        else:
            return AnswerPart(None, self.pair.clear_proposal)
        proposal: dict[str, Any] = {
            "kind": "repeat of the reference",
            "commands": commands,
            "repeats": REPEATS,
            "separates": [],
            "why": f"record {', '.join(commands)} of the reference again: {why}",
            "protocol": None,
        }
        return AnswerPart(proposal, self.pair.clear_proposal)

    def measure_law(self, place: str) -> AnswerPart[StatedLaw | None]:
        """None: a law is measured without a reference."""
        return self.inner.measure_law(place)

    def _list_commands(self, is_matched: bool) -> list[str]:
        """The commands of the reference with, or without, a match: of each the first recording."""
        first_of = {
            match.recording: group[0].recording for group in self.fit.groups for match in group
        }
        matched = {
            first_of.get(match.recording, match.recording)
            for part in self._parts
            for match in part.matches
        }
        rows = self.fit.dataset.rows
        names: dict[int, str] = {}
        for index, number in zip(rows.label, rows.recording, strict=True):
            label = rows.labels[index]
            if first_of.get(int(number), int(number)) == int(number):
                names.setdefault(int(number), label.recording or label.condition)
        return [name for number, name in names.items() if (number in matched) == is_matched]

    @property
    def _parts(self) -> tuple[ReferencedCondition, ...]:
        return tuple(part for part in self.compared.parts if isinstance(part, ReferencedCondition))

    def _describe_reference(self) -> tuple[str, ...]:
        """What both recordings have, and how the comparison was made, a remark each."""
        matched = sum(bool(part.matches) for part in self._parts)
        count = len(self._parts)
        remarks = [
            f"{SHARED_ERROR} {self._describe_shared_error()}; {matched} of {count} parts of the "
            "recordings were compared with the same command in the reference"
        ]
        if self.omission:
            remarks.append(
                f"the model lacks {' and '.join(self.omission)} in the reference already; it was "
                "added to the model of both"
            )
        if matched < count:
            remarks.append(
                "parts without their command in the reference count under the whole error of the "
                f"model in other motions, {100.0 * self.fit.transfer_error:.1f} % of the usual "
                "torques"
            )
        if self.fit.repeats is None:
            remarks.append(
                "the reference has no command twice, so that the usual difference between "
                f"recordings was assumed, {100.0 * USUAL_ERROR:g} % of the usual torques"
            )
        return tuple(remarks)

    def _describe_shared_error(self) -> str:
        """Rms residual of the reference by signal, with the noise."""
        rows = self.fit.dataset.rows
        texts = []
        for signal in dict.fromkeys(rows.signal.tolist()):
            mask = rows.signal == signal
            size = rms(self.fit.residuals[mask])
            noise = rms(rows.noise[mask])
            unit = unit_of(signal)
            texts.append(f"{size:.2g} {unit} in {signal} (noise {noise:.1g} {unit})")
        return ", ".join(texts)

    def _settings(self) -> dict[str, object]:
        repeats = self.fit.repeats
        return {
            "recordings": [asdict(recording) for recording in self.reference],
            "matched": sum(bool(part.matches) for part in self._parts),
            "conditions": len(self._parts),
            "lacked_before": list(self.omission),
            "model_error": self.fit.error,
            "model_error_in_other_motions": self.fit.transfer_error,
            "repeat_error": None if repeats is None else repeats.error,
            "repeats": 0 if repeats is None else repeats.spare,
        }


@dataclass(frozen=True)
class ReferenceProblem(Problem):
    """Recordings, and the reference that they are compared with.

    Parameters
    ----------
    new, reference
        Both of the same kind of rig.
    parts
        What is used of the reference.
    """

    new: Problem
    reference: Problem
    parts: ReferenceParts = field(default_factory=ReferenceParts)

    @property
    def recordings(self) -> tuple[Diagnosed, ...]:
        """The new ones: the answer is about them."""
        return self.new.recordings

    def list_effects(self) -> Sequence[Effect]:
        """The effects that the new recordings could show."""
        return self.new.list_effects()

    def check_effects(self, option: str, names: Collection[str]) -> None:
        """Raise BadInput for a name that is no effect of this rig and no change of a value."""
        self.new.check_effects(option, set(names) - VALUE_OF_CHANGE.keys())

    def check_place(self, place: str) -> None:
        """Raise BadInput: no law is measured beside a reference."""
        raise BadInput(f"--law {place}: is measured in the recordings alone; leave out --reference")

    def pair_with(
        self,
        reference: Problem,  # noqa: ARG002
        without: Collection[str],  # noqa: ARG002
        progress: Progress,  # noqa: ARG002
    ) -> RecordingPair:
        """Raise BadInput: there is one reference."""
        raise BadInput("--reference: is there already; name one reference")

    def solve(
        self, without: Collection[str], progress: Progress, budget: TimeBudget = UNLIMITED
    ) -> ReferenceSolution:
        """Fit the reference, compare, search and decide."""
        # Changes of values are no effects that a kind of rig knows.
        of_rig = set(without) - VALUE_OF_CHANGE.keys()
        pair = self.new.pair_with(self.reference, of_rig, progress)
        pair = replace(pair, config=replace(pair.config, budget=budget))

        def progress_of_reference(text: str, share: float) -> None:
            progress(f"reference: {text}", SHARE_OF_REFERENCE * share)

        is_matched = has_matches(pair)
        omission = None
        without_effects = fit_without_effects(pair, progress_of_reference)
        if not is_matched or not decide(without_effects).within_usual:
            omission = find_omission(pair, of_rig, progress_of_reference)
        plain = pair
        if omission is not None:
            pair = add_omission(pair, omission)
        fit = fit_reference(
            pair, progress_of_reference, without_effects if omission is None else None
        )
        try:
            coordinates, compared = self._compare(pair, fit)
        except SimulationFailed:
            if omission is None:
                raise
            # A law that suits the motions of the reference may diverge in others.
            omission = None
            pair = plain
            fit = fit_reference(pair, progress_of_reference, without_effects)
            coordinates, compared = self._compare(pair, fit)
        effects = add_changes(pair, without)
        search = search_models(
            compared,
            coordinates,
            effects,
            lambda text, share: progress(
                text, SHARE_OF_REFERENCE + (1.0 - SHARE_OF_REFERENCE) * share
            ),
            pair.config,
        )
        decision = _decide(pair, search)
        shared: tuple[str, ...] = ()
        if not is_matched and decision.grade in STATED_GRADES:
            shared = find_shared_effects(decision.explanation, compared, fit)
            # What the model lacks does not cancel there, and an effect may take its place. The
            # priors are those of the reference's motions: that a nominal value would have to leave
            # them shows the model's error as well as a change. What is identified needs no such
            # reason.
            only_relieves = decision.relieved_strain and decision.grade != "identified"
            if shared or decision.fits_poorly or only_relieves:
                decision = withhold(decision, search)
        finding = DecidedSearch(effects, search, decision)
        return ReferenceSolution(
            inner=pair.solve(finding),
            finding=finding,
            pair=pair,
            compared=compared,
            fit=fit,
            reference=self.reference.recordings,
            is_matched=is_matched,
            omission=() if omission is None else omission.ids,
            shared=shared,
        )

    def _compare(self, pair: RecordingPair, fit: ReferenceFit) -> tuple[Parameterization, Dataset]:
        """The unknowns and the compared conditions. Raises SimulationFailed where the model has no
        answer at the values of the reference.
        """
        coordinates = Parameterization(fit.make_prior(self.parts.joint_prior, has_matches(pair)))
        return coordinates, compare_pair(pair, coordinates, fit, self.parts)

    def check_fit(self, options: FitOptions, out: Path | None) -> None:
        """Raise BadInput as the recordings alone do."""
        self.new.check_fit(options, out)

    def fit(self, options: FitOptions, progress: Progress) -> Fit:
        """Fit nominal values to the new recordings alone."""
        return self.new.fit(options, progress)


def add_reference(new: Problem, reference: Problem) -> ReferenceProblem:
    """Recordings beside a reference.

    Raises BadInput where both are the same recordings.
    """
    of_new = {recording.identity for recording in new.recordings}
    of_reference = {recording.identity for recording in reference.recordings}
    if of_new & of_reference:
        title = reference.recordings[0].title
        raise BadInput(
            f"--reference: {title!r} is among the recordings themselves; name earlier ones"
        )
    return ReferenceProblem(new, reference)


def _decide(pair: RecordingPair, search: ModelSelectionResult) -> Decision:
    if pair.conditions >= FEWEST_CONDITIONS:
        return decide(search)
    return not_enough_data(
        search, f"{pair.conditions} usable conditions, {FEWEST_CONDITIONS} are needed"
    )
