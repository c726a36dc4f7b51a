"""Limits in the model file that the recordings contradict: stops of joints, and how much an
actuator is allowed.

Files that other programs export always have such limits, and often wrong ones. A recorded motion
beyond a stop cannot be simulated, and a torque that was measured was not cut.
"""

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.experiment import Experiment
from rfca_rig.mechanism.inverse_dynamics import torque_motors
from rfca_rig.mechanism.load import Mechanism

Floats = NDArray[np.float64]

# Share of its range by which a joint may be beyond a stop: rubber yields, and zeros are off.
YIELDS = 0.02
# share of the samples beyond a limit from which it is no single wrong sample
FEWEST_BEYOND = 0.002
# share of a command's limit by which rounding may pass it
ROUNDING = 1e-6


@dataclass(frozen=True)
class LimitConflict:
    """A limit of the model that a column of the recordings passes.

    Parameters
    ----------
    table, column
        "signal" or "command", and the column's name.
    place
        Of the joint or the actuator in the model.
    share
        Of the samples that pass it.
    found
        What is contradicted, in words.
    is_cut
        Whether it cuts the torque of a motor, and is lifted for that reason.
    """

    table: str
    column: str
    place: int
    share: float
    found: str
    is_cut: bool = False

    @property
    def words(self) -> str:
        """What was found, and what to do."""
        if self.is_cut:
            return f"{self.found}; it is simulated uncut: correct the limit in the model"
        return f"{self.found}; correct the limit in the model"


def find_limit_conflicts(experiment: Experiment, mechanism: Mechanism) -> list[LimitConflict]:
    """The limits that any of the recordings passes, those of joints first."""
    return [*_find_passed_stops(experiment, mechanism), *find_cut_commands(experiment, mechanism)]


def _find_passed_stops(experiment: Experiment, mechanism: Mechanism) -> Iterator[LimitConflict]:
    model = mechanism.model
    for index, signal in enumerate(experiment.signals):
        if signal.quantity != "position":
            continue
        joint = mechanism.joint(signal.name, str(experiment.path))
        if not model.jnt_limited[joint]:
            continue
        low, high = (float(end) for end in model.jnt_range[joint])
        tolerance = YIELDS * (high - low)
        recorded = np.concatenate([run.signals[:, index] for run in experiment.runs])
        share = float(np.mean((recorded < low - tolerance) | (recorded > high + tolerance)))
        if share < FEWEST_BEYOND:
            continue
        unit = "rad"
        if mechanism.is_slide[joint]:
            unit = "m"
        yield LimitConflict(
            "signal",
            _column_of(experiment, index),
            joint,
            share,
            f"joint {signal.name} is recorded from {recorded.min():.4g} to {recorded.max():.4g} "
            f"{unit}, and its range in the model is {low:.4g} to {high:.4g} {unit}, which "
            f"{100.0 * share:.2g} % of the samples pass",
        )


def _column_of(experiment: Experiment, index: int) -> str:
    return experiment.described.signals[index].column


def find_cut_commands(experiment: Experiment, mechanism: Mechanism) -> Iterator[LimitConflict]:
    """The commands that a limit of their actuator, or of the force on its joint, would cut."""
    motors = torque_motors(mechanism)
    driven = [run for run in experiment.runs if run.driven]
    if not driven:
        return
    for number, name in enumerate(experiment.actuators):
        actuator = mechanism.actuator(name, str(experiment.path))
        commands = np.concatenate([run.commands[:, number] for run in driven])
        for what, low, high in _list_command_limits(mechanism, actuator):
            slack = ROUNDING * max(abs(low), abs(high))
            share = float(np.mean((commands < low - slack) | (commands > high + slack)))
            if share < FEWEST_BEYOND:
                continue
            column = experiment.described.commands[number].column
            yield LimitConflict(
                "command",
                column,
                actuator,
                share,
                f"{name} is recorded from {commands.min():.4g} to {commands.max():.4g}, and {what} "
                f"in the model cuts it at {low:.4g} and {high:.4g}: {100.0 * share:.2g} % of the "
                "samples",
                is_cut=actuator in motors,
            )


def _list_command_limits(mechanism: Mechanism, actuator: int) -> Iterator[tuple[str, float, float]]:
    """Each limit of a command: what states it, and the least and the largest command."""
    model = mechanism.model
    if model.actuator_ctrllimited[actuator]:
        low, high = model.actuator_ctrlrange[actuator]
        yield "ctrlrange", float(low), float(high)
    if actuator not in torque_motors(mechanism):
        # What another actuator makes of its command depends on the motion.
        return
    gain = float(model.actuator_gainprm[actuator, 0])
    if model.actuator_forcelimited[actuator] and gain:
        yield "forcerange", *_divide(model.actuator_forcerange[actuator], gain)
    gear = float(model.actuator_gear[actuator, 0])
    joint = int(model.actuator_trnid[actuator, 0])
    if model.jnt_actfrclimited[joint] and gain * gear:
        yield (
            "actuatorfrcrange, or the effort of a URDF,",
            *_divide(model.jnt_actfrcrange[joint], gain * gear),
        )


def _divide(span: Floats, by: float) -> tuple[float, float]:
    """A range over a factor that may be negative."""
    ends = sorted(float(end) / by for end in span)
    return ends[0], ends[1]


def lift_cut_commands(mechanism: Mechanism, conflicts: Sequence[LimitConflict]) -> Mechanism:
    """The mechanism without the limits that cut a recorded torque."""
    cut = [conflict.place for conflict in conflicts if conflict.is_cut]
    if not cut:
        return mechanism
    model = copy(mechanism.model)
    for actuator in cut:
        model.actuator_ctrllimited[actuator] = 0
        model.actuator_forcelimited[actuator] = 0
        model.jnt_actfrclimited[model.actuator_trnid[actuator, 0]] = 0
    return replace(mechanism, model=model)
