"""Torques of recorded motions as a dataset: nothing is simulated, so that a search in it is quick.

The rows are torques in the joints: those of the actuators are measured, and those that the model
needs for the recorded motion are predicted. They begin a search and do not end it, because
accelerations of noisy positions bias what is fitted to them, and because effects of gears that
yield, of contacts and of sensors do not show in them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.samples import (
    MARGIN_S,
    SMOOTHING_HALF_WIDTH_S,
    local_polynomial,
)
from rfca_rig.campaign.experiment import MechanismRun
from rfca_rig.diagnosis.data import CONDITION_S, Label, Observations, WindowRows, observe
from rfca_rig.diagnosis.mechanisms.noise import read_noise
from rfca_rig.diagnosis.mechanisms.nuisances import MechanismInput
from rfca_rig.diagnosis.mechanisms.prepared import PreparedMechanism, arrange_commands
from rfca_rig.diagnosis.mechanisms.windows import SMOOTH_BINS, MechanismSimulator
from rfca_rig.diagnosis.simulator import Dataset, Simulator, make_dataset, spread
from rfca_rig.mechanism.load import Mechanism
from rfca_rig.mechanism.needed_torque import RecordedStates, compute_missing_torque
from rfca_rig.mechanism.rollout import CommandTrace

Floats = NDArray[np.float64]

TORQUE_EXPERIMENT = "torques"  # name of the experiment in labels
# Bins of the torques in those of the windows: torques change as fast as the speed does, and twice
# as many rows cost four times as much.
BIN_FACTOR = 2
STATES_OF_BIN = 4
FEWEST_BINS = 4
# As many as there are in a recording of a minute: more rows make a search slow, and the model's own
# error limits what they add.
MOST_STRETCHES = 30
# Of fewer joints, single effects are fitted to short windows in as little time: in 3 s for one, in
# 7 s for two, and in 25 s for three, where torques take 6 s.
FEWEST_JOINTS = 3


@dataclass(frozen=True)
class TorqueStretch:
    """A stretch of one recording.

    Parameters
    ----------
    name, run, recording
        In words: with its times, the condition of the recording, and the recording.
    signals
        The torque of each joint; the name ends with its unit.
    start_s, bin_s
        Where it begins, and the length of its bins.
    states
        The motion, STATES_OF_BIN states in each of b bins.
    measured, noise, scale
        (n, b) torques of the actuators, what errors of the positions do to the needed ones, and the
        torques of which USUAL_ERROR is the usual error of the model.
    """

    name: str
    run: str
    recording: str
    signals: tuple[str, ...]
    start_s: float
    bin_s: float
    states: RecordedStates
    measured: Floats
    noise: Floats
    scale: Floats

    @property
    def repeats(self) -> Floats:
        """None: each stretch was recorded once."""
        return np.empty((1, 0))

    def rows(self) -> Observations:
        """The measured rows."""
        labels = tuple(
            Label(
                TORQUE_EXPERIMENT,
                self.name,
                signal,
                recording=self.recording,
                starts_s=(self.start_s,),
            )
            for signal in self.signals
        )
        bins = self.measured.shape[1]
        t_s = self.start_s + self.bin_s * (0.5 + np.arange(bins, dtype=np.float64))
        window = WindowRows(t_s, self.measured, self.noise, self.scale)
        return observe([window], labels, self.run, SMOOTH_BINS * self.bin_s)


@dataclass(frozen=True)
class TorqueSimulator(Simulator):
    """Computes the torques that a mechanism needs for recorded motions.

    Parameters
    ----------
    inner
        Makes the plant of an input.
    """

    inner: MechanismSimulator

    def simulate(self, at: MechanismInput, condition: TorqueStretch) -> Floats:
        """The needed torques, rows (m,), less the change of those of the actuators."""
        return next(self.simulate_each(at, [condition]))

    def simulate_each(
        self, at: MechanismInput, conditions: Sequence[TorqueStretch]
    ) -> Iterator[Floats]:
        """The same of one condition after the other, by one plant."""
        plant = self.inner.plant(at)
        for condition in conditions:
            missing, _ = compute_missing_torque(plant, condition.states)
            yield (condition.measured + _average(missing)).ravel()


def _average(values: Floats) -> Floats:
    """Means (n, b) over the states of each bin, of (k, n)."""
    bins = values.reshape(-1, STATES_OF_BIN, values.shape[1])
    return np.asarray(bins.mean(axis=1).T)


def is_worth_balancing(prepared: PreparedMechanism) -> bool:
    """Whether there are so many joints that torques save time, and all torques of the recorded
    motions are known but for what the model lacks: every joint is measured, and nothing but the
    actuators, the weight and the joints acts.
    """
    mechanism = prepared.simulator.mechanism
    model = mechanism.model
    return len(mechanism.joints) >= FEWEST_JOINTS and not (
        mechanism.unmeasured
        or mechanism.prescribed
        or mechanism.has_contacts
        or prepared.experiment.starts_at_rest
        or model.na
        or model.neq
        or model.ntendon
    )


def make_torque_dataset(prepared: PreparedMechanism) -> Dataset | None:
    """The torques of the recordings, at most MOST_STRETCHES of them, evenly spread, of a mechanism
    that is worth balancing; None where no recording is long enough.
    """
    places: list[tuple[MechanismRun, float, int]] = []
    for run in prepared.experiment.runs:
        for start_s, bins in _cut_run(prepared, run):
            places.append((run, start_s, bins))
    if not places:
        return None
    bin_s = BIN_FACTOR * prepared.experiment.bin_s
    stretches = []
    for number in spread(len(places), MOST_STRETCHES):
        run, start_s, bins = places[number]
        stretches.append(_make_stretch(prepared, run, start_s, bin_s, bins))
    return make_dataset(stretches, TorqueSimulator(prepared.simulator))


def _cut_run(prepared: PreparedMechanism, run: MechanismRun) -> Iterator[tuple[float, int]]:
    """Start in s and number of bins of each stretch of about CONDITION_S of one recording that has
    no gap.
    """
    bin_s = BIN_FACTOR * prepared.experiment.bin_s
    begin_s = float(run.t_s[0]) + max(SMOOTHING_HALF_WIDTH_S, MARGIN_S)
    end_s = float(run.t_s[-1]) - SMOOTHING_HALF_WIDTH_S
    bins = int((end_s - begin_s) / bin_s)
    if bins < FEWEST_BINS:
        return
    count = max(1, round(bins * bin_s / CONDITION_S))
    edges = np.linspace(0, bins, count + 1).round().astype(int)
    for first, last in pairwise(edges):
        start_s = begin_s + bin_s * int(first)
        around = (run.t_s >= start_s - MARGIN_S) & (run.t_s <= start_s + bin_s * (last - first))
        if np.diff(run.t_s[around]).max() <= prepared.experiment.bin_s:
            yield start_s, int(last - first)


def _make_stretch(
    prepared: PreparedMechanism, run: MechanismRun, start_s: float, bin_s: float, bins: int
) -> TorqueStretch:
    mechanism = prepared.simulator.mechanism
    match = prepared.match
    recorded = run.signals[:, match.positions]
    noise = read_noise(prepared.experiment, run)
    step_s = bin_s / STATES_OF_BIN
    moments_s = start_s + step_s * (0.5 + np.arange(bins * STATES_OF_BIN))
    derivatives = []
    errors = []
    for moment_s in moments_s:
        local = local_polynomial(run.t_s, recorded, float(moment_s))
        derivatives.append([local.derivative(order) for order in range(3)])
        of_sample = np.maximum(noise[match.positions], local.missed)
        errors.append(local.std[1] / local.half_s * of_sample)
    position, speed, acceleration = np.moveaxis(np.array(derivatives), 1, 0)
    speed_std = np.array(errors)
    # The mean acceleration in a bin is the difference of the speeds at its ends.
    acceleration_std = np.sqrt(2.0) * speed_std / bin_s
    states = RecordedStates(
        step_s=step_s,
        since_s=start_s - float(run.t_s[0]),
        position=position,
        speed=speed,
        acceleration=acceleration,
        speed_std=np.asarray(speed_std.mean(axis=0)),
        trace=CommandTrace(run.t_s - start_s, arrange_commands(run, mechanism, match), run.driven),
    )
    _, supplied = compute_missing_torque(prepared.simulator.plant(MechanismInput()), states)
    units = ["N" if slides else "Nm" for slides in mechanism.is_slide]
    end_s = start_s + bin_s * bins
    return TorqueStretch(
        name=f"{run.label}, {start_s:.1f} to {end_s:.1f} s",
        run=run.condition,
        recording=run.label,
        signals=tuple(
            f"{joint}_torque_{unit}" for joint, unit in zip(mechanism.joints, units, strict=True)
        ),
        start_s=start_s,
        bin_s=bin_s,
        states=states,
        measured=_average(supplied),
        noise=_average(_weigh(mechanism, position, acceleration_std)),
        scale=np.repeat(prepared.torque[:, None], bins, axis=1),
    )


def _weigh(mechanism: Mechanism, position: Floats, acceleration_std: Floats) -> Floats:
    """Standard deviations (k, n) of the inertial torques at positions (k, n), where accelerations
    have these (k, n), independent from joint to joint.
    """
    import mujoco  # noqa: PLC0415  (optional)

    model = mechanism.model
    square = np.zeros_like(position)
    torque = np.empty(model.nv)
    with mechanism.borrow_data(model) as data:
        for k in range(len(position)):
            data.qpos[:] = position[k]
            mujoco.mj_fwdPosition(model, data)
            for error in np.diag(acceleration_std[k]):
                mujoco.mj_mulM(model, data, torque, error)
                square[k] += torque**2
    return np.sqrt(square)
