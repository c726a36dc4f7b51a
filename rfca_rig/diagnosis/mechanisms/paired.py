"""Recordings of a mechanism and their reference, in windows of one length."""

from dataclasses import replace

import numpy as np

from rfca_rig.campaign.experiment import Experiment
from rfca_rig.diagnosis.config import FEWEST_CONDITIONS
from rfca_rig.diagnosis.inference.map_fit import MapFit, without_scatter
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.mechanisms.check import refuse_misread_columns
from rfca_rig.diagnosis.mechanisms.prepared import PreparedMechanism, match_columns
from rfca_rig.diagnosis.window_length import (
    LONGEST_S,
    SHORTEST_S,
    measure_window_errors,
)
from rfca_rig.errors import BadInput, SimulationFailed

Fits = tuple[MapFit, MapFit]
Pair = tuple[PreparedMechanism, PreparedMechanism]


def prepare_reference(
    new: PreparedMechanism, experiment: Experiment, as_is: bool
) -> PreparedMechanism:
    """The reference's recordings with the model, the windows and [known_to] of the new ones.

    Raises
    ------
    BadInput
        Where the reference has other signals or commands, or cannot be used with the model.
    """
    settings = new.experiment
    if experiment.starts_at_rest != settings.starts_at_rest:
        raise BadInput(f"{experiment.path}: [start] differs from that of {settings.path}")
    if [joint.name for joint in experiment.prescribed] != [
        joint.name for joint in settings.prescribed
    ]:
        raise BadInput(f"{experiment.path}: its [[prescribed]] joints differ from {settings.path}")
    mechanism = new.simulator.mechanism
    match = match_columns(experiment, mechanism)
    if match.signals != new.match.signals:
        raise BadInput(
            f"{experiment.path}: its signals are {', '.join(match.signals)}; those of "
            f"{settings.path} are {', '.join(new.match.signals)}; record the same ones"
        )
    if not as_is:
        refuse_misread_columns(experiment, mechanism)
    experiment = replace(
        experiment,
        known_to=settings.known_to,
        window_s=settings.window_s,
        bin_s=settings.bin_s,
    )
    reference = replace(new, experiment=experiment, match=match)
    return _cut_reference(reference, new, settings.window_s)


def choose_common_length(new: PreparedMechanism, reference: PreparedMechanism) -> Pair:
    """Both in windows of one length, so that they begin at the same times of a command.

    The length is halved while errors of the starts are too large, and doubled as long as a fit
    without effects predicts both to their ends; see `window_length`.
    """
    pair = (new, reference)
    if not new.chooses_lengths:
        return pair
    length_s = new.experiment.window_s
    fits = _fit_both(pair)
    while length_s >= 2.0 * SHORTEST_S and not _errors_are_small(pair, fits):
        shorter = _cut_both(pair, 0.5 * length_s)
        if shorter is None:
            return pair
        pair, fits = shorter
        length_s *= 0.5
    shortest_s = min(new.recordings_s + reference.recordings_s)
    while 2.0 * length_s <= min(LONGEST_S, shortest_s):
        longer = _cut_both(pair, 2.0 * length_s)
        if longer is None or not _errors_are_small(*longer):
            return pair
        if min(len(prepared.conditions) for prepared in longer[0]) < FEWEST_CONDITIONS:
            return pair
        pair, fits = longer
        length_s *= 2.0
    return pair


def _cut_both(pair: Pair, length_s: float) -> tuple[Pair, Fits] | None:
    """Both in windows of this length, with their fits; None where that cannot be simulated."""
    new, reference = pair
    try:
        new = new.cut_again((length_s,) * len(new.experiment.runs))
        cut = (new, _cut_reference(reference, new, length_s))
        return cut, _fit_both(cut)
    except (SimulationFailed, BadInput):
        return None


def _cut_reference(
    reference: PreparedMechanism, new: PreparedMechanism, length_s: float
) -> PreparedMechanism:
    """The reference in windows of this length. The same share of them is used as of the new
    recordings, so that those of one command begin at the same times in both.
    """
    lengths_s = (length_s,) * len(reference.experiment.runs)
    return reference.cut_again(lengths_s, new.window_share)


def _fit_both(pair: Pair) -> Fits:
    """Fits without effects. Raises SimulationFailed."""
    new, reference = pair
    return _fit_nothing(new), _fit_nothing(reference)


def _fit_nothing(prepared: PreparedMechanism) -> MapFit:
    optimizer = without_scatter(prepared.dataset)
    coordinates = Parameterization(prepared.space)
    start = optimizer.at(coordinates, np.zeros(coordinates.size))
    if start is None:
        raise SimulationFailed(f"{prepared.experiment.path}: the nominal model cannot be simulated")
    return optimizer.refine(start)


def _errors_are_small(pair: Pair, fits: Fits) -> bool:
    """Whether a simulation still says something at the end of every window."""
    for prepared, fit in zip(pair, fits, strict=True):
        errors = measure_window_errors(prepared, fit)
        if not all(error.are_small for error in errors.values()):
            return False
    return True
