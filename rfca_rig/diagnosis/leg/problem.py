"""The leg as a problem of the diagnosis: forces of strokes and stages, and the motion of the shaft
where it was recorded and does not follow the command.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, cast, get_args

import numpy as np

from rfca_rig.analysis.fitting.fit import Search
from rfca_rig.analysis.fitting.parameters import select_parameters
from rfca_rig.analysis.fitting.residuals import StrokeWindow
from rfca_rig.analysis.fitting.result import FitResult, write_model_file
from rfca_rig.analysis.fitting.strokes import StrokeComparison, fit_recordings
from rfca_rig.analysis.matched_simulation import Shaft
from rfca_rig.diagnosis.budget import UNLIMITED, TimeBudget
from rfca_rig.diagnosis.config import DEFAULT_SEARCH, check_known, select_candidates
from rfca_rig.diagnosis.decision.decide import decide
from rfca_rig.diagnosis.experiment_design.leg_experiment import (
    propose_experiment,
    write_next_protocol,
)
from rfca_rig.diagnosis.inference.hypotheses import ModelSelectionResult
from rfca_rig.diagnosis.inference.model_selection import Progress, search_models
from rfca_rig.diagnosis.leg.drive_search import (
    find_excluded_sizes,
    list_drive_effects,
    search_drive,
)
from rfca_rig.diagnosis.leg.findings import LegFindings
from rfca_rig.diagnosis.leg.model_files import write_fitted_model, write_measured_model
from rfca_rig.diagnosis.leg.paired import name_commands, pair_legs
from rfca_rig.diagnosis.leg.prepared import PreparedLeg, prepare_leg
from rfca_rig.diagnosis.leg.result import build_leg_result, has_enough_conditions
from rfca_rig.diagnosis.leg.simulator import NUISANCES_OF_A_DAY
from rfca_rig.diagnosis.problem import (
    AnswerPart,
    DecidedSearch,
    FitOptions,
    Problem,
    RecordingPair,
    Row,
    Solution,
)
from rfca_rig.diagnosis.residual_force.law import StatedLaw
from rfca_rig.diagnosis.residual_force.stated_law import OF_LEG, check_place, measure_stated_law
from rfca_rig.diagnosis.result import Diagnosed, Diagnosis, join_not_seen
from rfca_rig.errors import BadInput
from rfca_rig.executors.cores import single_threaded_blas
from rfca_rig.model.catalogue import catalogue
from rfca_rig.model.effect import LEG_SIDE, MOTOR_SIDE, Effect
from rfca_rig.protocol.plan import Limits
from rfca_rig.recording.layout import identity_of
from rfca_rig.recording.model import Recording

MODEL = "model.toml"
MEASURED_LAW = "measured-law.toml"


@dataclass(frozen=True)
class StrokeFit:
    """Values of the nominal model that were fitted to recordings of strokes.

    Parameters
    ----------
    result
        The fit.
    recordings, sources
        The recordings, and their names for the head of a model file.
    """

    result: FitResult
    recordings: tuple[Recording, ...]
    sources: tuple[str, ...]

    def plain(self) -> dict[str, Any]:
        """Everything as plain data, for JSON."""
        return self.result.plain()

    def lines(self) -> list[str]:
        """The values as lines for a terminal."""
        return self.result.lines()

    def rows(self) -> tuple[Row, ...]:
        """A row per value: prior, fitted value and standard error."""
        return tuple(vars(value) for value in self.result.parameters)

    def write_model(self, path: Path) -> Sequence[str]:
        """Write the model file with the fitted values. Raises RigError."""
        first = self.recordings[0]
        write_model_file(path, self.result, first.nominal, first.known_to, self.sources)
        return ()


@dataclass(frozen=True)
class LegSolution(Solution):
    """The decided searches in the recordings of a leg."""

    prepared: PreparedLeg
    findings: LegFindings
    recording: Recording

    @property
    def searches(self) -> Mapping[str, DecidedSearch]:
        """The search in the forces, and that in the motion of the shaft, where there was one."""
        searches = {"forces": self.findings.forces}
        if self.findings.shaft is not None:
            searches["shaft"] = self.findings.shaft
        return searches

    def describe(self) -> Diagnosis:
        """The answer: forces and shaft together, with valleys and the place of a free force."""
        diagnosis = build_leg_result(self.prepared, self.findings)
        # Where the shaft follows its command, that excludes effects of the drive.
        prepared = self.prepared
        if self.findings.shaft is not None or not (prepared.shafts and prepared.as_commanded):
            return diagnosis
        # Not those that the forces show: a shaft that gives way behind the encoder follows, too.
        suspects = self.findings.forces.decision.suspects
        effects = [
            effect
            for effect in list_drive_effects((MOTOR_SIDE, LEG_SIDE))
            if effect.id not in suspects
        ]
        tracked = find_excluded_sizes(prepared.shafts, prepared.rig, effects)
        return replace(diagnosis, not_seen=join_not_seen(diagnosis.not_seen, tracked))

    def write_model(self, folder: Path, diagnosis: Diagnosis) -> Sequence[str]:
        """Write the nominal model with fitted values and the effects found."""
        write_fitted_model(folder / MODEL, diagnosis, self.recording)
        return ()

    def propose_experiment(self, limits: Limits | None) -> AnswerPart[Mapping[str, Any] | None]:
        """Strokes, static stages or a bench test, with the protocol that a rig runs."""
        enough = has_enough_conditions(self.prepared)
        proposal = propose_experiment(self.prepared, self.findings, enough, limits)

        def write(folder: Path) -> Sequence[str]:
            write_next_protocol(folder, proposal)
            return ()

        return AnswerPart(proposal, write)

    def measure_law(self, place: str) -> AnswerPart[StatedLaw | None]:
        """The law at a place of the leg, its floor or its sensor."""
        if not place:
            return AnswerPart(None, _remove_measured_law)
        forces = self.findings.forces
        stated = measure_stated_law(forces.search, forces.decision.explanation, place)

        def write(folder: Path) -> Sequence[str]:
            write_measured_model(folder / MEASURED_LAW, stated.law, self.recording)
            return ()

        return AnswerPart(stated, write)


def _remove_measured_law(folder: Path) -> Sequence[str]:
    """Remove that of an earlier diagnosis, which would look like a result of this one."""
    (folder / MEASURED_LAW).unlink(missing_ok=True)
    return ()


@dataclass(frozen=True)
class LegProblem(Problem):
    """Recordings of one leg.

    Parameters
    ----------
    recordings_of_leg
        All with the same nominal model.
    paths
        Where they lie; those beyond them were made by the command itself.
    """

    recordings_of_leg: tuple[Recording, ...]
    paths: tuple[Path, ...] = ()

    @cached_property
    def prepared(self) -> PreparedLeg:
        """The recordings as conditions. Raises BadInput where they cannot be used together."""
        return prepare_leg(self.recordings_of_leg)

    @property
    def recordings(self) -> tuple[Diagnosed, ...]:
        """The recordings, with the identity that their files have."""
        return tuple(
            Diagnosed(
                recording.title,
                recording.source,
                identity_of(recording.title, recording.source, recording.provenance),
            )
            for recording in self.recordings_of_leg
        )

    def list_effects(self) -> Sequence[Effect]:
        """Effects of the leg and its surroundings; of the drive where the shaft does not follow."""
        effects = list_candidates(self.prepared)
        if not self.prepared.as_commanded:
            effects += list_drive_effects((MOTOR_SIDE, LEG_SIDE))
        # Some act on both sides of the shaft.
        return list({effect.id: effect for effect in effects}.values())

    def check_effects(self, option: str, names: Collection[str]) -> None:  # noqa: ARG002
        """Raise BadInput for a name that is not in the catalogue."""
        check_known(names)

    def check_place(self, place: str) -> None:
        """Raise BadInput for a place where no law of a leg can be measured."""
        check_place(place, OF_LEG)

    def solve(
        self, without: Collection[str], progress: Progress, budget: TimeBudget = UNLIMITED
    ) -> LegSolution:
        """Search the forces, and where the shaft does not follow its command, its motion."""
        prepared = self.prepared
        effects = select_candidates(list_candidates(prepared), without)
        config = replace(DEFAULT_SEARCH, budget=budget)
        search = search_models(prepared.dataset, prepared.coordinates, effects, progress, config)
        forces = DecidedSearch(effects, search, decide(search))
        shaft = None
        # Where the shaft follows its command, the drive needs no search of its own.
        if not prepared.as_commanded:
            drive_effects = select_candidates(list_drive_effects((MOTOR_SIDE, LEG_SIDE)), without)
            drive = search_drive(prepared, search, drive_effects, progress, config)
            shaft = DecidedSearch(drive_effects, drive, decide(drive))
        return LegSolution(prepared, LegFindings(forces, shaft), self.recordings_of_leg[0])

    def pair_with(
        self, reference: Problem, without: Collection[str], progress: Progress
    ) -> RecordingPair:
        """The forces of both recordings in the same bins, with the nominal model of these."""
        if not isinstance(reference, LegProblem):
            raise BadInput("--reference: name recordings of the same leg")
        progress("reading the reference", 0.0)
        paired = pair_legs(self.recordings_of_leg, reference.recordings_of_leg)
        new = paired.new

        def solve(finding: DecidedSearch) -> LegSolution:
            return LegSolution(new, LegFindings(finding), self.recordings_of_leg[0])

        def clear_proposal(folder: Path) -> Sequence[str]:
            write_next_protocol(folder, None)
            return ()

        return RecordingPair(
            new=paired.new_dataset(),
            reference=paired.reference_dataset(),
            space=new.coordinates.space,
            free=NUISANCES_OF_A_DAY,
            effects=select_candidates(list_candidates(new), without),
            config=DEFAULT_SEARCH,
            solve=solve,
            clear_proposal=clear_proposal,
            name_commands=name_commands,
            is_one_recording=True,
            conditions=len(new.flaps),
        )

    def list_runs(self) -> tuple[Recording, ...]:
        """The recordings."""
        return self.recordings_of_leg

    def with_runs(self, runs: Sequence[Recording]) -> "LegProblem":
        """The same with further recordings."""
        return LegProblem((*self.recordings_of_leg, *runs), self.paths)

    def check_fit(self, options: FitOptions, out: Path | None) -> None:  # noqa: ARG002
        """Raise BadInput for effects, and for names that are no parameters of a leg."""
        if options.effects:
            raise BadInput(
                "--effects: is an option for recordings of a mechanism (experiment.toml); "
                "leave it out here"
            )
        if options.shaft not in get_args(Shaft):
            raise BadInput(f"--shaft {options.shaft}: name one of {', '.join(get_args(Shaft))}")
        select_parameters(options.names)

    def fit(self, options: FitOptions, progress: Progress) -> StrokeFit:
        """Fit to the part of all strokes that `options` names."""
        self.check_fit(options, None)
        comparison = StrokeComparison(
            cast("Shaft", options.shaft),
            StrokeWindow(options.phases, options.after_touchdown_s),
        )
        usual = options.starts * Search().most_evaluations

        def report_progress(simulated: int, chi2: float) -> None:
            # How many sets of values a descent needs is not known before: the share nears 1.
            share = simulated / (simulated + usual)
            progress(f"fitting: {simulated} sets of values, chi2 {chi2:.0f}", share)

        search = Search(
            starts=options.starts,
            rng=np.random.default_rng(options.seed),
            progress=report_progress,
            executor=options.executor,
        )
        result = fit_recordings(self.recordings_of_leg, options.names, comparison, search)
        sources = tuple(
            f"{path} ({recording.source}): {recording.title}"
            for path, recording in zip(self.paths, self.recordings_of_leg, strict=False)
        )
        return StrokeFit(result, self.recordings_of_leg, sources)


def list_candidates(prepared: PreparedLeg) -> list[Effect]:
    """Effects that the leg and its surroundings may lack; where the shaft was recorded, the drive
    is judged by its motion.
    """
    nominal = {present.id for present in prepared.rig.effects}
    judged_apart: set[str] = set()
    if prepared.shafts:
        judged_apart = {effect.id for effect in list_drive_effects((MOTOR_SIDE,))}
    has_curve = bool(prepared.rig.leg.torque_splines)
    candidates = []
    for effect in catalogue().values():
        is_simulated = effect.id not in nominal and effect.id not in judged_apart
        has_parameters = not (effect.needs_k2 and has_curve)
        is_ordered = prepared.strokes_made is not None or not effect.needs_order
        if is_simulated and has_parameters and is_ordered:
            candidates.append(effect)
    return candidates


@single_threaded_blas()
def search_base(recordings: Sequence[Recording], progress: Progress) -> ModelSelectionResult:
    """The fit without effects alone, as the base of a measured law; no effect of the catalogue is
    looked for.

    Raises BadInput where the recordings cannot be used together or at all, SimulationFailed where
    the model cannot be simulated.
    """
    prepared = prepare_leg(recordings)
    return search_models(prepared.dataset, prepared.coordinates, [], progress)
