"""How a run compares with the reference of its rig: one line at its end, and a gate for labs."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rfca_rig.cli.terminal import echo
from rfca_rig.errors import BadInput, Changed, RigError

if TYPE_CHECKING:
    from rfca_rig.diagnosis.result import Diagnosis

Gate = Annotated[
    bool,
    typer.Option(
        "--gate",
        help="Exit code 3 where the rig has changed since its reference (reference set).",
    ),
]
# Grades that say that nothing has changed, or nothing.
UNCHANGED = ("nothing missing", "not enough data")


@dataclass(frozen=True)
class SinceReference:
    """The answer about a run beside its reference.

    Parameters
    ----------
    reference
        Names of the reference's runs.
    diagnosis
        What has changed.
    """

    reference: tuple[str, ...]
    diagnosis: "Diagnosis"

    @property
    def has_changed(self) -> bool:
        """Whether anything has, known or not, with more than even odds."""
        from rfca_rig.diagnosis.config import NOTHING_PROBABILITY

        probability = self.diagnosis.probability
        is_doubtful = (
            self.diagnosis.grade == "unexplained"
            and probability is not None
            and probability < 1.0 - NOTHING_PROBABILITY
        )
        return self.diagnosis.grade not in UNCHANGED and not is_doubtful

    def line(self) -> str:
        """One line for a terminal."""
        from rfca_rig.diagnosis.result import describe_probability

        names = ", ".join(self.reference)
        certainty = ""
        if self.diagnosis.probability is not None:
            certainty = f" ({describe_probability(self.diagnosis.probability)})"
        return f"reference {names}: {self.diagnosis.sentence}{certainty}"

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "reference": list(self.reference),
            "grade": self.diagnosis.grade,
            "sentence": self.diagnosis.sentence,
            "effects": [effect.id for effect in self.diagnosis.effects],
            "has_changed": self.has_changed,
        }


def compare_with_set_reference(run: Path, is_gate: bool, quiet: bool) -> SinceReference | None:
    """The run beside the reference of its rig; None where the rig has none, or the run is part of
    it.

    A run is whole before it is compared, so that a comparison that fails is one line and no error,
    except for a gate. Raises BadInput there, also where a rig without a reference is to pass it.
    """
    from rfca_rig.logbook.references import find_reference

    try:
        reference = find_reference(run)
        if reference:
            return _compare(run, reference, quiet)
    except RigError as error:
        if is_gate:
            raise
        echo(f"not compared with its reference: {error}", err=True)
        return None
    if is_gate:
        raise BadInput(
            f"{run}: its rig has no reference to pass --gate by; rfca-rig reference set RUN names "
            "an earlier run"
        )
    return None


def _compare(run: Path, reference: tuple[Path, ...], quiet: bool) -> SinceReference:
    from rfca_rig.cli.progress import progress
    from rfca_rig.diagnosis.diagnose import diagnose
    from rfca_rig.diagnosis.opening import open_problem
    from rfca_rig.diagnosis.reference.problem import add_reference

    problem = add_reference(open_problem([run]), open_problem(reference))
    with progress(quiet) as bars:
        diagnosis = diagnose(problem, bars.share).diagnosis
    return SinceReference(tuple(path.name for path in reference), diagnosis)


def pass_gate(answer: SinceReference | None, is_gate: bool) -> None:
    """Raise Changed where a gate is asked for and the rig has changed."""
    if is_gate and answer is not None and answer.has_changed:
        raise Changed(f"not as the reference {', '.join(answer.reference)}")
