"""The rounds of `rfca-rig diagnose --close-the-loop`: run the proposed experiment, diagnose old
and new together, repeat.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rfca_rig.bench.recorder import Recorder
from rfca_rig.campaign.opening import open_with_nominal_model
from rfca_rig.cli.progress import make_marked_say
from rfca_rig.cli.run_config import RunConfig
from rfca_rig.cli.run_experiment import run_and_record
from rfca_rig.cli.terminal import Say
from rfca_rig.description.model_file import ModelFile
from rfca_rig.description.protocol_file import read_plan
from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.diagnosis.experiment_design.leg_experiment import NEXT_PROTOCOL
from rfca_rig.diagnosis.problem import Problem
from rfca_rig.diagnosis.result import Diagnosis
from rfca_rig.errors import BadInput
from rfca_rig.protocol.plan import Stage
from rfca_rig.recording.model import Recording
from rfca_rig.toml import read_text, validate

Diagnosing = Callable[[Problem], Diagnosis]


@dataclass(frozen=True)
class ClosedLoop:
    """The options: the rig, the largest number of rounds, where new runs go, and the folder of
    the diagnosis.
    """

    rig_path: Path
    rounds: int
    runs: Path
    out: Path
    seed: int | None
    quiet: bool


def close_the_loop(loop: ClosedLoop, problem: Problem, diagnose: Diagnosing) -> Diagnosis:
    """Runs the rounds and returns the last diagnosis.

    It ends when nothing is open, nothing more would help, only a person could do the next test, or
    the rounds are used up. A real rig must be armed in every round.

    Parameters
    ----------
    loop : ClosedLoop
        The options.
    problem : Problem
        The recordings so far.
    diagnose : callable
        Diagnoses recordings and writes the result, with the next protocol, into `loop.out`.

    Raises
    ------
    BadInput
        The rig must not or cannot run the proposed experiment, or no rig runs experiments on what
        was recorded.
    """
    rig = read_rig(loop.rig_path)
    say = make_marked_say("REAL" if rig.is_real else "SIM", loop.quiet)
    first = problem.list_runs()[0]
    diagnosis = diagnose(problem)
    for number in range(1, loop.rounds + 1):
        proposal = diagnosis.next_experiment
        if proposal is None or proposal["protocol"] is None:
            break
        say(f"round {number} of {loop.rounds}: {proposal['why']}")
        folder = _run(loop, rig, first, number)
        problem = problem.with_runs(open_with_nominal_model([folder]))
        diagnosis = diagnose(problem)
        say(f"round {number} of {loop.rounds}: {folder}: {diagnosis.sentence}")
    say(_ending(diagnosis))
    return diagnosis


def _ending(diagnosis: Diagnosis) -> str:
    proposal = diagnosis.next_experiment
    if proposal is not None and proposal["protocol"] is None:
        return f"the next experiment is not one for the rig: {proposal['kind']}, {proposal['why']}"
    if proposal is not None:
        return f"the rounds are used up; next: {proposal['why']}"
    settled = diagnosis.verdict in ("named", "nothing missing") and not any(
        effect.cannot_tell_from for effect in diagnosis.effects
    )
    if settled:
        return "nothing is left open"
    return "nothing more that this rig can do would help"


def _run(loop: ClosedLoop, rig: RigFile, first: Recording, number: int) -> Path:
    """Runs the proposed protocol like the run commands: plan printed and checked, a real rig
    armed by typing.
    """
    path = loop.out / NEXT_PROTOCOL
    model, model_text = nominal_model_of(rig, first)
    # Differs from round to round: equal noise would make a repeat look exact.
    if rig.is_real or rig.twin is None:
        seed = None
    elif loop.seed is None:
        seed = rig.twin.seed + number
    else:
        seed = loop.seed + number
    config = RunConfig(
        rig=rig,
        rig_text=read_text(loop.rig_path),
        protocol_text=read_text(path),
        plan=read_plan(path, rig.facts()),
        seed=seed,
        runs=loop.runs,
        quiet=loop.quiet,
        dry=False,
        model=model,
        model_text=model_text,
        rig_path=loop.rig_path,
    )
    folder, _ = run_and_record(config, _print_nothing)
    if folder is None:
        raise BadInput(f"{path}: nothing was recorded")
    return folder


def _print_nothing(stage: Stage, recorder: Recorder, say: Say) -> None:
    """Stages only show in the progress bar, none on a line of its own."""


def nominal_model_of(rig: RigFile, first: Recording) -> tuple[ModelFile | None, str]:
    """The recordings' nominal model, where it differs from the rig file's: only recordings of
    one nominal model go together.
    """
    if rig.known_to:
        known_to = rig.known_to.model_dump(exclude_none=True)
    else:
        known_to = {}
    if rig.nominal() == first.nominal and known_to == first.known_to:
        return None, ""
    stated = {key: value for key, value in first.known_to.items() if value is not None}
    model = validate({**first.nominal, "known_to": stated}, ModelFile, first.title)
    # A file of another version may lose values on the way; a new recording must state the very same
    # model.
    if (
        model.nominal() != first.nominal
        or model.known_to.model_dump(exclude_none=True) != first.known_to
    ):
        raise BadInput(
            f"{first.title}: its nominal values cannot be taken over for new runs; run "
            "the proposed protocol by hand"
        )
    return model, json.dumps({**first.nominal, "known_to": first.known_to})
