"""The search for effects of the drive in the recorded motion of the shaft, and what a shaft that
follows its command excludes.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.analysis.fitting.space import Prior
from rfca_rig.diagnosis.config import DEFAULT_SEARCH, SearchConfig
from rfca_rig.diagnosis.decision.sizes import find_detection_limits
from rfca_rig.diagnosis.inference.hypotheses import ModelSelectionResult
from rfca_rig.diagnosis.inference.map_fit import GaussNewton, without_scatter
from rfca_rig.diagnosis.inference.model_selection import Progress, search_models
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.inference.screening import (
    fit_most_promising,
    grid_points,
    probe_effects,
    terms_of,
)
from rfca_rig.diagnosis.leg.prepared import PreparedLeg
from rfca_rig.diagnosis.leg.shaft_observations import ShaftCondition, tracking_error
from rfca_rig.diagnosis.leg.simulator import make_leg_dataset, nuisances_of_drive
from rfca_rig.diagnosis.result import NotSeen
from rfca_rig.diagnosis.simulator import spread
from rfca_rig.executors.parallel import map_in_processes
from rfca_rig.model.catalogue import catalogue, declarations, members_of
from rfca_rig.model.effect import Effect
from rfca_rig.model.parameters import RigModel


def list_drive_effects(encoders: Collection[str]) -> list[Effect]:
    """The effects that a recorded angle of the shaft shows where its encoder is on one of these
    sides, in the order of their ids.
    """
    ids = {effect.id for effect in declarations() if effect.encoder in encoders}
    return [catalogue()[effect_id] for effect_id in sorted(ids)]


def search_drive(
    prepared: PreparedLeg,
    leg: ModelSelectionResult,
    effects: Sequence[Effect],
    progress: Progress,
    config: SearchConfig,
) -> ModelSelectionResult:
    """Search for effects of the drive in the motion of the shaft, with the leg as the best
    hypothesis has it.

    The model has one drive, so the leg is that of the best hypothesis without a compliant drive. A
    compliant drive may start in two ways. The search is made with the start that suits a single
    compliant drive better, and made again where its result suits the other start.
    """
    stiff = []
    for hypothesis in leg.named:
        places = [choice.effect.where for choice in hypothesis.fitted.coordinates.choices]
        if "drive" not in places:
            stiff.append(hypothesis)
    best = max((leg.nothing, *stiff), key=lambda hypothesis: hypothesis.log_joint)
    supposed = best.fitted.coordinates.supposed(best.fitted.x)
    dataset = make_leg_dataset(prepared.shafts)
    ways = [
        Parameterization(_space_of_drive(supposed, holds, prepared.known_to))
        for holds in (False, True)
    ]
    points = grid_points(
        term
        for effect in effects
        if effect.id in members_of("drive_yields")
        for term in terms_of(effect)
    )

    def fit_compliant(way: Parameterization) -> float:
        optimizer = without_scatter(dataset)
        nominal = optimizer.at(way, np.zeros(way.size))
        fit = None if nominal is None else fit_most_promising(optimizer, nominal, points, 1)
        if fit is None:
            return -np.inf
        return optimizer.log_evidence(fit)

    sagging, holding = map_in_processes(fit_compliant, ways)
    first, second = ways if sagging >= holding else reversed(ways)

    def search(way: Parameterization) -> ModelSelectionResult:
        return search_models(
            dataset,
            way,
            effects,
            lambda text, share: progress(f"the drive: {text}", 0.9 + 0.07 * share),
            config,
        )

    result = search(first)
    if not result.named:
        return result
    optimizer = GaussNewton(dataset, result.likelihood)
    fit = result.named[0].fitted
    other = optimizer.at(second.with_terms(fit.coordinates.choices), fit.x, fit.jacobian)
    suits = other is not None and optimizer.log_evidence(
        optimizer.refine(other)
    ) > optimizer.log_evidence(fit)
    if suits:
        return search(second)
    return result


def _space_of_drive(
    supposed: ModelPoint, holds_start: bool, known_to: Mapping[str, float]
) -> Prior[ModelPoint]:
    rig = replace(supposed.rig, drive=replace(supposed.rig.drive, holds_start=holds_start))
    return nuisances_of_drive(rig, replace(supposed, rig=rig, turn_offset_rad=0.0), known_to)


def find_excluded_sizes(
    shafts: Sequence[ShaftCondition], rig: RigModel, effects: Sequence[Effect]
) -> tuple[NotSeen, ...]:
    """For each of these drive effects that the nominal rig lacks, the size from which on the shaft
    would not have tracked its command.

    Only a few conditions are simulated. The others could only lower the limit.
    """
    present_ids = {present.id for present in rig.effects}
    candidates = [effect for effect in effects if effect.id not in present_ids]
    shafts = [shafts[number] for number in spread(len(shafts), DEFAULT_SEARCH.coarse_conditions)]
    dataset = make_leg_dataset(shafts)
    coordinates = Parameterization(nuisances_of_drive(rig, ModelPoint(rig), {}))
    base = without_scatter(dataset).at(coordinates, np.zeros(coordinates.size))
    if base is None:
        probes = []
    else:
        probes = probe_effects(
            dataset, base, grid_points(term for effect in candidates for term in terms_of(effect))
        )
    ends = np.cumsum([shaft.deviation_rad.size for shaft in shafts])[:-1]

    def power_of(signature: NDArray[np.float64]) -> float:
        """Largest squared tracking error over all shafts, if each moved otherwise by its part of
        the signature (m,).
        """
        deviating = [
            replace(shaft, repeats=away[None])
            for shaft, away in zip(shafts, np.split(signature, ends), strict=True)
        ]
        return max(tracking_error(shaft, rig.drive.ramp_s) for shaft in deviating) ** 2

    # A tracking error of 1 is the limit of `tracks_command`, so this is the power that is needed.
    return find_detection_limits(candidates, probes, power_of, rig, needed=1.0)
