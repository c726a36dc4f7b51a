"""`diagnose` for the leg: recordings in, the whole answer out."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.analysis.fitting.space import Prior
from rfca_rig.analysis.phases import Undetermined
from rfca_rig.analysis.repeats import Condition, group_by_condition
from rfca_rig.description.model_file import nominal_model
from rfca_rig.diagnosis.config import DEFAULT_SEARCH, describe_exclusions, select_candidates
from rfca_rig.diagnosis.decision.decide import decide
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
from rfca_rig.diagnosis.leg.findings import Findings, PreparedData
from rfca_rig.diagnosis.leg.result import build_leg_result
from rfca_rig.diagnosis.leg.shaft_observations import (
    ShaftCondition,
    estimate_delay_s,
    make_shaft_condition,
    tracking_error,
    tracks_command,
)
from rfca_rig.diagnosis.leg.simulator import (
    infer_approach,
    make_leg_dataset,
    nuisances_of,
    nuisances_of_drive,
)
from rfca_rig.diagnosis.leg.stages import HOLD_S, StageTable, make_stage_tables
from rfca_rig.diagnosis.leg.strokes import make_dynamic_condition, make_turn
from rfca_rig.diagnosis.result import Diagnosed, Diagnosis, NotSeen, join_not_seen
from rfca_rig.diagnosis.simulator import spread
from rfca_rig.errors import BadInput
from rfca_rig.executors.cores import single_threaded_blas
from rfca_rig.executors.parallel import map_in_processes
from rfca_rig.model.catalogue import catalogue, declarations, members_of
from rfca_rig.model.effect import LEG_SIDE, MOTOR_SIDE, Effect
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.static_stages import StageMoves
from rfca_rig.protocol.plan import Limits
from rfca_rig.recording.layout import identity_of
from rfca_rig.recording.model import Recording, Stroke, collect_strokes_before

Floats = NDArray[np.float64]


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


@single_threaded_blas()
def diagnose(
    recordings: Sequence[Recording],
    progress: Progress,
    limits: Limits | None = None,
    without: Collection[str] = (),
    law_at: str = "",
) -> Diagnosis:
    """The diagnosis of recordings of one rig.

    Parameters
    ----------
    recordings
        All with the same nominal model.
    progress
        Called with the current step and the share that is done.
    limits
        Of the rig that the next experiment is for; None where they are not known.
    without
        Ids of effects that are not looked for.
    law_at
        Place where a law is measured too, if not empty.

    Raises
    ------
    BadInput
        Where the recordings cannot be used together, or not at all.
    SimulationFailed
        Where the nominal model cannot be simulated.
    """
    if law_at:
        # Few diagnoses measure a law, which needs fifty modules more, among them those of
        # mechanisms.
        from rfca_rig.diagnosis.residual_force.stated_law import (  # noqa: PLC0415
            OF_LEG,
            check_place,
            measure_stated_law,
        )

        check_place(law_at, OF_LEG)
    progress("reading", 0.0)
    body, findings = find_omissions(recordings, progress, without)
    progress("summing up", 0.97)
    diagnosis = build_leg_result(body, findings, limits)
    if findings.drive is None and body.shafts:
        tracked = find_excluded_sizes(body.shafts, body.rig, findings.drive_effects)
        diagnosis = replace(diagnosis, not_seen=join_not_seen(diagnosis.not_seen, tracked))
    if law_at:
        progress(f"measuring the law at {law_at}", 0.98)
        diagnosis = replace(
            diagnosis,
            stated_law=measure_stated_law(findings.leg, findings.leg_decision.explanation, law_at),
        )
    identified = tuple(
        Diagnosed(
            recording.title,
            recording.source,
            identity_of(recording.title, recording.source, recording.provenance),
        )
        for recording in recordings
    )
    return replace(
        diagnosis,
        recordings=identified,
        remarks=(*diagnosis.remarks, *describe_exclusions(without)),
    )


def find_omissions(
    recordings: Sequence[Recording], progress: Progress, without: Collection[str] = ()
) -> tuple[PreparedData, Findings]:
    """The searches and their decisions, before wording, localisation and the next experiment.
    Parameters and errors as in `diagnose`.
    """
    body, tables = prepare_data(recordings)
    dataset = make_leg_dataset([*body.flaps, *tables], body.as_commanded)
    effects = select_candidates(_candidates(body), without)
    of_drive = select_candidates(list_drive_effects((MOTOR_SIDE, LEG_SIDE)), without)
    leg = search_models(dataset, body.coordinates, effects, progress)
    # Where the shaft follows its command, the drive needs no search of its own.
    if not body.as_commanded:
        drive = search_drive(body, leg, of_drive, progress)
    else:
        drive = None
    return body, Findings(
        effects, of_drive, leg, decide(leg), drive, None if drive is None else decide(drive)
    )


@single_threaded_blas()
def search_base(recordings: Sequence[Recording], progress: Progress) -> ModelSelectionResult:
    """The fit without effects alone, as the base of a measured law; no effect of the catalogue is
    looked for.

    Raises BadInput where the recordings cannot be used together or at all, SimulationFailed where
    the model cannot be simulated.
    """
    body, tables = prepare_data(recordings)
    return search_models(
        make_leg_dataset([*body.flaps, *tables], body.as_commanded), body.coordinates, [], progress
    )


def prepare_data(recordings: Sequence[Recording]) -> tuple[PreparedData, tuple[StageTable, ...]]:
    """Cut the recordings into conditions, with the nominal rig and its nuisance parameters, and the
    tables of static stages.

    Raises BadInput where the recordings have different nominal models.
    """
    first = recordings[0]
    for other in recordings[1:]:
        if other.nominal != first.nominal or other.known_to != first.known_to:
            raise BadInput(
                f"{other.title!r} believes other values of the rig than {first.title!r}; "
                "diagnose them one by one"
            )
    rig = nominal_model(first.nominal)
    noise_std = first.nominal["sensor"].get("noise_std") or {}
    conditions = group_by_condition(
        stroke for recording in recordings for stroke in recording.strokes
    )
    # Two passes: whether the shaft follows its command must be known before the final turn of each
    # condition is chosen.
    probed = [
        make_dynamic_condition(condition, noise_std, make_turn(condition, False))
        for condition in conditions
    ]
    remarks = tuple(f"left out: {flap.reason}" for flap in probed if isinstance(flap, Undetermined))
    usable = [
        (c, f) for c, f in zip(conditions, probed, strict=True) if not isinstance(f, Undetermined)
    ]
    shafts = tuple(
        s
        for c, f in usable
        if (s := make_shaft_condition(c, float(f.t_s[-1]), rig.drive.ramp_s)) is not None
    )
    as_commanded = all(tracks_command(shaft, rig.drive.ramp_s) for shaft in shafts)
    # A drive cannot be early: a negative delay is noise.
    late = {shaft.label: max(estimate_delay_s(shaft, rig.drive.ramp_s), 0.0) for shaft in shafts}
    flaps = tuple(
        replace(flap, turn=make_turn(condition, not as_commanded, late.get(flap.label, 0.0)))
        for condition, flap in usable
    )
    known_to = {key: float(value) for key, value in first.known_to.items() if value is not None}
    before_s = _before_start_s(condition for condition, _ in usable)
    coordinates = Parameterization(nuisances_of(rig, known_to, before_s))
    stages = [stage for recording in recordings for stage in recording.static]
    tables = make_stage_tables(stages, noise_std, StageMoves(1.0, 0.005, HOLD_S))
    if tables:
        # The approach of static stages is not recorded. The first guess is made at the prior means;
        # the search improves it.
        moves = infer_approach(tables, coordinates.supposed, np.zeros(coordinates.size))
        tables = tuple(replace(table, moves=moves) for table in tables)
    title = "; ".join(recording.title for recording in recordings)
    made = _strokes_made(recordings)
    return PreparedData(
        title, rig, known_to, noise_std, flaps, shafts, as_commanded, coordinates, remarks, made
    ), tables


def _strokes_made(recordings: Sequence[Recording]) -> int | None:
    """How many strokes were made up to the last one; None where the order of strokes and stages is
    not known.

    Each recording counts its own strokes, so the order of two recordings is not known.
    """
    if len(recordings) != 1 or not recordings[0].strokes:
        return None
    (recording,) = recordings
    before = collect_strokes_before((*recording.strokes, *recording.static))
    strokes = len(recording.strokes)
    if before:
        return max([*(count + 1 for count in before[:strokes]), *before[strokes:]])
    return None


def _before_start_s(conditions: Iterable[Condition]) -> float:
    """Time before the start that all recordings cover, to the millisecond; 0 where one begins
    with the motion.
    """
    begins = [_first_s(stroke) for condition in conditions for stroke in condition.strokes]
    # Rounded down, so that every recording covers the whole interval.
    if begins:
        return max(0.0, float(np.floor(-1e3 * max(begins)) / 1e3))
    return 0.0


def _first_s(stroke: Stroke) -> float:
    return min(float(stream.t_s[0]) for stream in stroke.streams.values())


def _candidates(body: PreparedData) -> list[Effect]:
    """Effects that the leg and its surroundings may lack; where the shaft was recorded, the
    drive is judged by its motion.
    """
    nominal = {present.id for present in body.rig.effects}
    if body.shafts:
        judged_apart = [effect.id for effect in list_drive_effects((MOTOR_SIDE,))]
    else:
        judged_apart = []
    known = list(catalogue().values())
    has_curve = bool(body.rig.leg.torque_splines)
    candidates = [
        e
        for e in known
        if e.id not in nominal and e.id not in judged_apart and not (e.needs_k2 and has_curve)
    ]
    return [e for e in candidates if body.strokes_made is not None or not e.needs_order]


def list_drive_effects(encoders: Collection[str]) -> list[Effect]:
    """The effects that a recorded angle of the shaft shows where its encoder is on one of these
    sides, in the order of their ids.
    """
    ids = {effect.id for effect in declarations() if effect.encoder in encoders}
    return [catalogue()[effect_id] for effect_id in sorted(ids)]


def search_drive(
    body: PreparedData, leg: ModelSelectionResult, effects: Sequence[Effect], progress: Progress
) -> ModelSelectionResult:
    """Search for effects of the drive in the motion of the shaft, with the leg as the best
    hypothesis has it.

    A hypothesis with a compliant drive is no such leg: the model has room for one drive only. A
    compliant drive may start in two ways. The search is made for the one that suits a single
    compliant drive better. Only if its result then suits the other one, it is made again.
    """
    stiff = []
    for hypothesis in leg.named:
        places = [choice.effect.where for choice in hypothesis.fitted.coordinates.choices]
        if "drive" not in places:
            stiff.append(hypothesis)
    best = max((leg.nothing, *stiff), key=lambda hypothesis: hypothesis.log_joint)
    supposed = best.fitted.coordinates.supposed(best.fitted.x)
    dataset = make_leg_dataset(body.shafts)
    ways = [
        Parameterization(_space_of_drive(supposed, holds, body.known_to)) for holds in (False, True)
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
