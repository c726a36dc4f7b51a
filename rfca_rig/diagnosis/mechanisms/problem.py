"""A mechanism that MuJoCo simulates as a problem of the diagnosis: its recordings in windows."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from rfca_rig.campaign.experiment import Experiment
from rfca_rig.campaign.pendulum import is_pendulum
from rfca_rig.diagnosis.budget import UNLIMITED, TimeBudget
from rfca_rig.diagnosis.config import DEFAULT_SEARCH, FEWEST_CONDITIONS
from rfca_rig.diagnosis.data import WINDOWS_OF_CONDITION
from rfca_rig.diagnosis.decision.decide import decide
from rfca_rig.diagnosis.decision.decision import Decision
from rfca_rig.diagnosis.experiment_design.mechanism_experiment import (
    propose_motion,
    write_excitation,
)
from rfca_rig.diagnosis.inference.hypotheses import ModelSelectionResult
from rfca_rig.diagnosis.inference.model_selection import Progress
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.mechanisms.check import refuse_misread_columns
from rfca_rig.diagnosis.mechanisms.column_checks import check_columns
from rfca_rig.diagnosis.mechanisms.fit import MechanismFit, fit_prepared, select_nuisances
from rfca_rig.diagnosis.mechanisms.joint_law import measure_joint_law, parse_place
from rfca_rig.diagnosis.mechanisms.limits import find_limit_conflicts
from rfca_rig.diagnosis.mechanisms.model_files import (
    describe_effects,
    write_law_table,
    write_plant,
)
from rfca_rig.diagnosis.mechanisms.paired import choose_common_length, prepare_reference
from rfca_rig.diagnosis.mechanisms.prepared import PreparedMechanism, prepare_mechanism
from rfca_rig.diagnosis.mechanisms.torque_balance import is_worth_balancing, make_torque_dataset
from rfca_rig.diagnosis.mechanisms.windows import MOTION_EXPERIMENT
from rfca_rig.diagnosis.problem import (
    AnswerPart,
    DecidedSearch,
    FitOptions,
    Problem,
    RecordingPair,
    Solution,
)
from rfca_rig.diagnosis.reference.matching import name_signals
from rfca_rig.diagnosis.residual_force.law import StatedLaw, describe_law
from rfca_rig.diagnosis.result import Diagnosed, Diagnosis
from rfca_rig.diagnosis.result_builder import build_result, not_enough_data
from rfca_rig.diagnosis.window_length import describe_lengths, search_in_windows
from rfca_rig.errors import BadInput
from rfca_rig.executors.cores import single_threaded_blas
from rfca_rig.mechanism.nuisances import NUISANCES_OF_A_DAY
from rfca_rig.mechanism.plant import Plant
from rfca_rig.model.catalogue import catalogue, lab_texts
from rfca_rig.model.effect import Effect
from rfca_rig.protocol.plan import Limits
from rfca_rig.recording.layout import identity_of_tables

# Twelve single effects are enough for a leg. Of a hopper whose force was 15 % too small the right
# one promised only the fourteenth most, since a motion with contacts is not linear in it; what was
# fitted instead were three effects that do the same together.
SEARCH = replace(DEFAULT_SEARCH, singles_coarse=18)


MODEL = "model.xml"
LAWS = "laws.py"
MEASURED_MODEL = "measured-law.xml"
MEASURED_LAWS = "measured_law.py"
MEASURED_TABLE = "measured-law.csv"
NEXT_COMMANDS = "next-commands.csv"


@dataclass(frozen=True)
class MechanismSolution(Solution):
    """The decided search in the recordings of a mechanism.

    Parameters
    ----------
    prepared, finding
        The recordings in the windows that were chosen, and the search in them.
    short
        The same in the windows with which the search began. A proposed motion is short, so it is
        judged in short windows.
    """

    prepared: PreparedMechanism
    finding: DecidedSearch
    short: PreparedMechanism

    @property
    def searches(self) -> Mapping[str, DecidedSearch]:
        """The search in the motion."""
        return {"motion": self.finding}

    @cached_property
    def plant(self) -> Plant:
        """The mechanism with the stated effects; effects and nuisance parameters are at their
        posterior means.
        """
        stated = self.finding.search.nothing
        # Effects enter the model only if they are stated.
        if self.finding.decision.effects:
            stated = self.finding.decision.explanation
        coordinates = stated.fitted.coordinates
        return self.prepared.simulator.plant(coordinates.supposed(stated.marginal.posterior.mean))

    def describe(self) -> Diagnosis:
        """The answer, with what the windows were."""
        prepared = self.prepared
        experiment = prepared.experiment
        finding = self.finding
        result = build_result(
            experiment.title, finding.search, finding.decision, finding.effects, MOTION_EXPERIMENT
        )
        simulator = prepared.simulator
        settings = {
            "window_s": describe_lengths(prepared.lengths_s),
            "bin_s": experiment.bin_s,
            "step_s": simulator.step_s,
            "integrator": "implicit" if simulator.mechanism.is_implicit else "RK4",
            "windows": prepared.windows,
        }
        remarks = [*result.remarks]
        if prepared.windows < prepared.recorded_windows:
            remarks.append(
                f"{prepared.windows} of {prepared.recorded_windows} recorded windows were used, "
                "evenly spread; windows.at_most uses more"
            )
        remarks += [
            f"{warning.table} {warning.column}: {warning.words}"
            for warning in check_columns(experiment)
        ]
        remarks += [
            f"{conflict.table} {conflict.column}: {conflict.words}"
            for conflict in find_limit_conflicts(experiment, experiment.load_model())
        ]
        return replace(
            result,
            remarks=(*remarks, *_describe_unused_effects()),
            settings={**result.settings, **settings},
        )

    def write_model(self, folder: Path, diagnosis: Diagnosis) -> Sequence[str]:
        """Write MJCF with the stated effects, and Python functions for what it cannot express."""
        effects = self.prepared.simulator.effects
        return write_plant(self.plant, folder, MODEL, LAWS, describe_effects(diagnosis, effects))

    def propose_experiment(
        self,
        limits: Limits | None,  # noqa: ARG002
    ) -> AnswerPart[Mapping[str, Any] | None]:
        """A motion of the joints, a release or a bench test, with the commands that it takes."""
        finding = self.finding
        enough = has_enough_conditions(self.prepared)
        motion = propose_motion(self.short, finding.search, finding.decision, enough)
        proposal = None if motion is None else motion.proposal
        excitation = None if motion is None else motion.excitation

        def write(folder: Path) -> Sequence[str]:
            path = folder / NEXT_COMMANDS
            if excitation is None:
                path.unlink(missing_ok=True)  # of an earlier diagnosis
                return ()
            write_excitation(path, self.plant.mechanism, excitation)
            return (f"{path}: the proposed motion of the joints, and the commands that it takes",)

        return AnswerPart(proposal, write)

    def measure_law(self, place: str) -> AnswerPart[StatedLaw | None]:
        """The law in a joint."""
        if not place:
            return AnswerPart(None, _remove_measured_law)
        law = measure_joint_law(
            self.prepared,
            self.finding.search,
            self.finding.decision.explanation,
            parse_place(place, self.prepared.simulator.mechanism),
        )

        def write(folder: Path) -> Sequence[str]:
            measured = law.stated.law
            write_law_table(folder / MEASURED_TABLE, measured)
            words = f"The law of {measured.place} over {measured.argument}"
            return write_plant(
                law.plant,
                folder,
                MEASURED_MODEL,
                MEASURED_LAWS,
                [f"{words}, {describe_law(law.stated)}."],
            )

        return AnswerPart(law.stated, write)


def has_enough_conditions(prepared: PreparedMechanism) -> bool:
    """Whether there are enough conditions for a verdict."""
    return len(prepared.conditions) >= FEWEST_CONDITIONS


def _decide(prepared: PreparedMechanism, search: ModelSelectionResult) -> Decision:
    if has_enough_conditions(prepared):
        return decide(search)
    length_s = WINDOWS_OF_CONDITION * prepared.experiment.window_s
    count = len(prepared.conditions)
    return not_enough_data(
        search, f"{count} stretches of {length_s:g} s, {FEWEST_CONDITIONS} are needed"
    )


def _remove_next_commands(folder: Path) -> Sequence[str]:
    """Remove those of an earlier diagnosis, which would look like a result of this one."""
    (folder / NEXT_COMMANDS).unlink(missing_ok=True)
    return ()


def _remove_measured_law(folder: Path) -> Sequence[str]:
    """Remove those of an earlier diagnosis, which would look like a result of this one."""
    for name in (MEASURED_MODEL, MEASURED_LAWS, MEASURED_TABLE):
        (folder / name).unlink(missing_ok=True)
    return ()


@dataclass(frozen=True)
class MechanismProblem(Problem):
    """Recordings of a mechanism.

    Parameters
    ----------
    experiment
        The recordings and the model file.
    as_is
        Take columns that probably have another sign or unit than stated, too.
    """

    experiment: Experiment
    as_is: bool = False

    @cached_property
    def prepared(self) -> PreparedMechanism:
        """The recordings in windows.

        Raises BadInput where recordings and model do not fit together, a column is probably
        misread, or the recordings are too short; SimulationFailed where the nominal model cannot be
        simulated.
        """
        mechanism = self.experiment.load_model()
        if not self.as_is:
            refuse_misread_columns(self.experiment, mechanism)
        return prepare_mechanism(self.experiment, mechanism)

    @property
    def recordings(self) -> tuple[Diagnosed, ...]:
        """The folder as a whole; its identity ties an answer to these files, wherever they lie."""
        title = self.experiment.title
        identity = identity_of_tables(title, self.experiment.path.parent)
        return (Diagnosed(title, "IMPORT", identity),)

    def list_effects(self) -> Sequence[Effect]:
        """Effects for which the model has a place, at their ranges for these motions."""
        return tuple(self.prepared.simulator.effects.values())

    def check_effects(self, option: str, names: Collection[str]) -> None:
        """Raise BadInput for a name that is no effect of this mechanism."""
        self.prepared.check_effects(option, names)

    def check_place(self, place: str) -> None:
        """Raise BadInput for a place that is no joint."""
        parse_place(place, self.prepared.simulator.mechanism)

    def solve(
        self, without: Collection[str], progress: Progress, budget: TimeBudget = UNLIMITED
    ) -> MechanismSolution:
        """Search in windows as long as the recordings allow."""
        short = self.prepared
        effects = [effect for effect in self.list_effects() if effect.id not in without]
        prepared, search = search_in_windows(
            short,
            Parameterization(short.space),
            effects,
            progress,
            replace(SEARCH, budget=budget),
            make_torque_dataset(short) if is_worth_balancing(short) else None,
        )
        return MechanismSolution(
            prepared, DecidedSearch(effects, search, _decide(prepared, search)), short
        )

    def pair_with(
        self, reference: Problem, without: Collection[str], progress: Progress
    ) -> RecordingPair:
        """Both recordings in windows of one length, the reference with the model of these."""
        if not isinstance(reference, MechanismProblem):
            raise BadInput("--reference: name recordings of the same mechanism")
        progress("reading the reference", 0.0)
        paired = prepare_reference(self.prepared, reference.experiment, self.as_is)
        progress("choosing windows", 0.01)
        new, paired = choose_common_length(self.prepared, paired)
        effects = [effect for effect in self.list_effects() if effect.id not in without]
        free = [name for name in new.space.names if name.rpartition(".")[2] in NUISANCES_OF_A_DAY]

        def solve(finding: DecidedSearch) -> MechanismSolution:
            return MechanismSolution(new, finding, self.prepared)

        return RecordingPair(
            new=new.dataset,
            reference=paired.dataset,
            space=new.space,
            free=frozenset(free),
            effects=effects,
            config=SEARCH,
            solve=solve,
            clear_proposal=_remove_next_commands,
            name_commands=name_signals,
            is_one_recording=False,
            conditions=len(new.conditions),
        )

    def check_fit(self, options: FitOptions, out: Path | None) -> None:
        """Raise BadInput for options of a leg, and for a model file of another kind."""
        options.refuse_leg_options()
        endings = (".xml", ".toml") if is_pendulum(self.experiment) else (".xml",)
        if out is not None and out.suffix not in endings:
            raise BadInput(
                f"{out}: the model of a mechanism is MJCF; name a file that ends with .xml"
            )

    @single_threaded_blas()
    def fit(self, options: FitOptions, progress: Progress) -> MechanismFit:
        """Fit the nominal values of [known_to], and the sizes of the effects in `options`."""
        prepared = self.prepared
        prepared.check_effects("--effects", options.effects)
        space = select_nuisances(prepared.space, options.names)
        if not (space.parameters or options.effects):
            raise BadInput(
                f"{self.experiment.path}: nothing to fit: [known_to] lists no value that these "
                "recordings depend on; name --effects"
            )
        # An effect that is named twice is added once.
        effects = [prepared.simulator.effects[name] for name in dict.fromkeys(options.effects)]
        return fit_prepared(prepared, space, effects, progress)


def _describe_unused_effects() -> tuple[str, ...]:
    """The effects of a lab's own that no mechanism can have, a remark each."""
    return tuple(
        f"not looked for: effect {name} has no joint_torque, the law of a joint"
        for name in lab_texts(catalogue())
        if catalogue()[name].joint_torque is None
    )
