"""`diagnose_pendulum`: recordings of a pendulum in, the same kind of answer out as for a leg.
Fields that only a leg has stay empty.

The torques of pendulums differ by a factor of ten thousand, so the ranges of the catalogue, which
suit a leg, are no use. Here the range of a parameter of a candidate follows from its unit and from
the recordings: torques, speeds, inertias and masses of the rig.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.swings import (
    TORQUE_ERROR,
    SwingProblem,
    apply_nuisances,
    make_swing_problem,
    sample_noise,
)
from rfca_rig.campaign.pendulum import PendulumCampaign, PendulumRun
from rfca_rig.diagnosis.config import (
    FEWEST_CONDITIONS,
    USUAL_ERROR,
    describe_exclusions,
    select_candidates,
)
from rfca_rig.diagnosis.decision.decide import Decision, decide
from rfca_rig.diagnosis.experiment_design.choice import (
    SET_UP_MIN,
    ExperimentDesign,
    list_open_hypotheses,
    list_options,
    propose,
)
from rfca_rig.diagnosis.inference.hypotheses import ModelSelectionResult
from rfca_rig.diagnosis.inference.model_selection import Progress
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.pendulums.windows import (
    BIN_S,
    SWING_EXPERIMENT,
    WINDOW_S,
    PendulumInput,
    PendulumProblem,
    Stretch,
    cut_stretches,
    make_pendulum_problem,
    usual_torque_Nm,
)
from rfca_rig.diagnosis.residual_force.stated_law import (
    OF_PENDULUM,
    check_place,
    measure_stated_law,
)
from rfca_rig.diagnosis.result import Diagnosis
from rfca_rig.diagnosis.result_builder import build_result, compare_held_out, not_enough_data
from rfca_rig.diagnosis.window_length import describe_lengths, search_in_windows
from rfca_rig.errors import BadInput
from rfca_rig.executors.cores import single_threaded_blas
from rfca_rig.mechanism.laws import LARGEST, SMALLEST
from rfca_rig.model.catalogue import catalogue, lab_texts
from rfca_rig.model.effect import OF_PENDULUMS, Effect, Parameter
from rfca_rig.model.effects.joint_torques import torque_trace
from rfca_rig.model.parameters import GRAVITY_M_S2, PresentEffect
from rfca_rig.model.pendulum import Pendulum, make_driven_pendulum

Floats = NDArray[np.float64]

OF_TORQUE = ("torque_scale", "torque_delay", "torque_lag", "joint_load_friction", "angle_lag")
OF_SPEED = ("speed_lag",)
OF_TWO_JOINTS = ("joint_friction_of_one",)
ALSO = ("fluid_drag", "hinge_viscous_damping", "gravity_tilt")


def candidates_of(problem: SwingProblem, without: Collection[str]) -> list[Effect]:
    """The effects that are looked for, with ranges that suit the rig.

    Effects of a lab's own are looked for where the pendulum has a place for them. Effects of the
    torque need a driven run, those of one joint need two joints, and those of the speed channel
    need a recorded speed.
    """
    links = problem.pendulum.links
    windows = problem.windows
    is_shown_by = {
        OF_TORQUE: any(window.trace.powered for window in windows)
        and any(link.driven for link in links),
        OF_TWO_JOINTS: len(links) > 1,
        OF_SPEED: any(len(window.measured) > 1 for window in windows),
    }
    idle = [effect_id for ids, is_shown in is_shown_by.items() if not is_shown for effect_id in ids]
    lab_effects, _ = own_effects(problem.pendulum)
    known = [
        effect
        for effect in catalogue().values()
        if effect.where == OF_PENDULUMS or effect.id in (*ALSO, *lab_effects)
    ]
    ranges = plausible_ranges(problem)
    return [
        _with_ranges(effect, ranges)
        for effect in select_candidates(known, without)
        if effect.id not in idle
    ]


def plausible_ranges(problem: SwingProblem) -> Mapping[str, tuple[float, float]]:
    """Plausible range of a parameter by the unit that ends its name, from the nominal values of
    the rig and its recordings.
    """
    links = problem.pendulum.links
    torque, torques = _extent(usual_torque_Nm(problem.pendulum, problem.windows))
    speed, speeds = _extent(
        np.sqrt(np.mean([window.speed_rad_s**2 for window in problem.windows], axis=0))
    )
    inertia, inertias = _extent(np.array([link.inertia_kg_m2 for link in links]))
    lengths_m = [link.length_m for link in links]
    mass_kg = sum(link.mass_kg for link in links)
    usual = {
        "_Nm": (torque, torques),
        "_Nm_s_per_rad": (torque / speeds, torques / speed),
        # A link that swings about its end feels a drag torque of c w^2 L^4 / 4.
        "_N_s2_per_m3": (
            4.0 * torque / (speeds**2 * sum(lengths_m) ** 4),
            4.0 * torques / (speed**2 * min(lengths_m) ** 4),
        ),
        "_kg_m2": (inertia, inertias),
        "mass_kg": (mass_kg, 3.0 * mass_kg),  # an added mass may well be more than the pendulum
    }
    return {unit: (SMALLEST * low, LARGEST * high) for unit, (low, high) in usual.items()}


def _extent(values: Floats) -> tuple[float, float]:
    """Smallest and largest of values (n,); a joint that hardly moves or bears counts as a tenth
    of the largest.
    """
    largest = max(float(values.max()), 1e-12)
    return max(float(values.min()), 0.1 * largest), largest


def _with_ranges(effect: Effect, ranges: Mapping[str, tuple[float, float]]) -> Effect:
    """The effect with these ranges; a parameter that does not depend on the rig keeps that of
    the catalogue.
    """

    def scale(parameter: Parameter) -> Parameter:
        extents = [extent for unit, extent in ranges.items() if parameter.name.endswith(unit)]
        if extents:
            return replace(parameter, low=extents[0][0], high=extents[0][1])
        return parameter

    return replace(effect, parameters=tuple(map(scale, effect.parameters)))


def own_effects(pendulum: Pendulum) -> tuple[tuple[str, ...], Mapping[str, str]]:
    """Ids of the effects of a lab's own that this pendulum has a place for, and by id why it has
    none for the others.
    """
    fitting = []
    refused = {}
    for effect in (catalogue()[name] for name in lab_texts(catalogue())):
        try:
            # Trial simulation set-up: only the effect itself knows whether it has a place here.
            make_driven_pendulum(
                pendulum,
                [PresentEffect(effect.id, tuple((p.name, _middle(p)) for p in effect.parameters))],
            )
            fitting.append(effect.id)
        except BadInput as error:
            refused[effect.id] = str(error)
    return tuple(fitting), refused


def _middle(parameter: Parameter) -> float:
    """A plausible value: no effect acts at its neutral one."""
    middle = 0.5 * (parameter.low + parameter.high) or parameter.high
    if parameter.whole:
        return float(round(middle))
    return middle


@single_threaded_blas()
def diagnose_pendulum(
    campaign: PendulumCampaign, progress: Progress, without: Collection[str] = (), law_at: str = ""
) -> Diagnosis:
    """The diagnosis of the recordings of a pendulum.

    Parameters
    ----------
    campaign
        The recordings and the nominal pendulum.
    progress
        Called with the current step and the share that is done.
    without
        Ids of effects that are not looked for.
    law_at
        The place where a law is measured too, if not empty.

    Raises
    ------
    BadInput
        Where the recordings are too short.
    SimulationFailed
        Where the nominal model cannot be simulated.
    """
    if law_at:
        # With a single joint, "joints" and "joint1" would be the same law.
        check_place(law_at, OF_PENDULUM[:1] if len(campaign.pendulum.links) == 1 else OF_PENDULUM)
    progress("reading", 0.0)
    problem, search, effects = search_pendulum(make_pendulum_problem(campaign), progress, without)
    progress("summing up", 0.97)
    decision = decide(search)
    diagnosis = _build_result(problem, search, decision, effects)
    if law_at:
        progress(f"measuring the law at {law_at}", 0.98)
        diagnosis = replace(
            diagnosis, stated_law=measure_stated_law(search, decision.explanation, law_at)
        )
    _, refused = own_effects(campaign.pendulum)
    not_tried = tuple(
        f"not looked for: {why}" for effect_id, why in refused.items() if effect_id not in without
    )
    return replace(
        diagnosis, remarks=(*diagnosis.remarks, *describe_exclusions(without), *not_tried)
    )


def search_pendulum(
    problem: PendulumProblem, progress: Progress, without: Collection[str] = ()
) -> tuple[PendulumProblem, ModelSelectionResult, list[Effect]]:
    """The search over all effects that a pendulum may lack, in windows as long as allowed: those
    windows, the result, and the effects.
    """
    effects = candidates_of(problem.swings, without)
    problem, search = search_in_windows(problem, Parameterization(problem.space), effects, progress)
    return problem, search, effects


def _build_result(
    problem: PendulumProblem,
    search: ModelSelectionResult,
    decision: Decision,
    effects: Sequence[Effect],
) -> Diagnosis:
    """The common answer, with its held-out stretches and its next experiment."""
    campaign = problem.campaign
    stretches = len(search.dataset.parts)
    enough = stretches >= FEWEST_CONDITIONS
    if not enough:
        decision = not_enough_data(
            search, f"{stretches} stretches of two seconds, {FEWEST_CONDITIONS} are needed"
        )
    result = build_result(campaign.title, search, decision, effects, SWING_EXPERIMENT)
    # The search calls 1 % usual; figures for people refer to the stated torque error.
    usual = campaign.known_to.get("torque_error_relative", TORQUE_ERROR)
    return replace(
        result,
        unexplained=(*result.unexplained, *_describe_closest(search, decision)),
        next_experiment=propose_swing(campaign, search, decision, enough),
        settings={
            **result.settings,
            "model_error_assumed": f"half-normal, torques wrong by {100.0 * usual:g} %",
            "model_error_found": float(search.nothing.marginal.error) * usual / USUAL_ERROR,
            "window_s": describe_lengths(problem.lengths_s),
            "bin_s": BIN_S,
        },
    )


def _describe_closest(search: ModelSelectionResult, decision: Decision) -> tuple[str, ...]:
    """What the closest effects would improve on held-out stretches, although they are not
    stated.
    """
    if decision.closest is None or decision.effects:
        return ()
    figures = ", ".join(
        f"{name} {f.before:.2g} to {f.after:.2g}"
        for name, f in compare_held_out(search, decision.closest, SWING_EXPERIMENT).items()
    )
    if figures:
        return (
            (
                f"with {' and '.join(decision.closest.ids)} in the model, rms on held-out "
                f"stretches falls: {figures}"
            ),
        )
    return ()


REPEATS = (1, 3)  # a recording holds several stretches already


def propose_swing(
    campaign: PendulumCampaign, found: ModelSelectionResult, decision: Decision, enough: bool
) -> dict[str, object] | None:
    """What to record or to measure next; None where nothing is open or nothing would help. Keys
    as for a leg, `protocol` always None.
    """
    hypotheses = list_open_hypotheses(found, decision, enough)
    if hypotheses is None:
        return None
    return propose(list(list_options(hypotheses, _designs(campaign), enough)))


def _designs(campaign: PendulumCampaign) -> Iterator[ExperimentDesign]:
    """Releases, and sines in each driven joint where there are motors; noise and sample time as
    recorded.
    """
    first = campaign.runs[0]
    links = campaign.pendulum.links
    # Small swing of the first link alone: it sets durations and frequencies.
    weight_Nm = GRAVITY_M_S2 * links[0].mass_kg * links[0].centre_of_mass_m
    frequency_Hz = float(np.sqrt(weight_Nm / links[0].inertia_kg_m2) / (2.0 * np.pi)) or 1.0
    # Eight periods of the small swing, and at least two stretches.
    t_s = np.arange(0.0, max(4.0, 8.0 / frequency_Hz), float(np.median(np.diff(first.t_s))))
    seconds = round(float(t_s[-1]), 1)
    for deg in (
        (20.0, 60.0, 120.0) if weight_Nm > 0.0 else ()
    ):  # nearly linear, usual, and far from it
        words = f"release joint 1 from {deg:g} deg with the motors off and record {seconds:g} s"
        yield _design(
            campaign, {"kind": "release", "start_deg": deg, "seconds": seconds}, words, t_s, None
        )
    torque_Nm = usual_torque_Nm(
        campaign.pendulum, make_swing_problem(campaign, WINDOW_S, BIN_S).windows
    )
    if not any(run.powered for run in campaign.runs):
        return
    for joint in [number for number, link in enumerate(links) if link.driven]:
        # At most the rms torque that weight and drive made so far; slower than the small swing,
        # near it, and faster.
        for share, of_swing in product((0.3, 1.0), (0.3, 0.7, 1.5)):
            a_Nm, f_Hz = (
                float(f"{value:.3g}")
                for value in (share * torque_Nm[joint], of_swing * frequency_Hz)
            )
            settings = {
                "kind": "sine torque",
                "joint": joint + 1,
                "amplitude_Nm": a_Nm,
                "frequency_Hz": f_Hz,
                "seconds": seconds,
            }
            words = (
                f"drive joint {joint + 1} with a sine of {a_Nm:g} N m at {f_Hz:g} Hz from "
                f"hanging at rest and record {seconds:g} s"
            )
            torque = np.outer(
                a_Nm * np.sin(2.0 * np.pi * f_Hz * t_s), np.arange(len(links)) == joint
            )
            yield _design(campaign, settings, words, t_s, torque)


def _design(
    campaign: PendulumCampaign,
    settings: dict[str, object],
    words: str,
    t_s: Floats,
    torque_Nm: Floats | None,
) -> ExperimentDesign:
    """One recording from rest, with a torque over time (m, n), or released with the motors off.

    It returns None where a joint would turn farther than it was recorded to.
    """
    first = campaign.runs[0]
    links = len(campaign.pendulum.links)
    noise = zip(("angle_rad", "speed_rad_s"), sample_noise(first, campaign.noise_std), strict=False)
    like = replace(campaign, noise_std={name: float(std.max()) for name, std in noise})
    widest_rad = np.max([np.abs(run.angle_rad).max(axis=0) for run in campaign.runs], axis=0)
    is_powered = torque_Nm is not None
    kind = str(settings["kind"])
    torque = np.zeros((len(t_s), links)) if torque_Nm is None else torque_Nm
    start_rad = np.append(
        np.radians(float(str(settings.get("start_deg", 0.0)))), np.zeros(links - 1)
    )

    def simulate(at: PendulumInput) -> Stretch | None:
        ready = make_driven_pendulum(
            apply_nuisances(campaign.pendulum, dict(at.off)), at.rig.effects
        )
        motion = ready.swing(
            replace(torque_trace(t_s, torque), powered=is_powered),
            start_rad,
            np.zeros(links),
            t_s[1:],
        )
        angle_rad = np.vstack([start_rad, motion.angle_rad])
        speed_rad_s = np.vstack([np.zeros(links), motion.speed_rad_s])
        if (np.abs(angle_rad).max(axis=0) > widest_rad).any():
            return None
        speed = None if first.speed_rad_s is None else speed_rad_s
        run = PendulumRun(f"{kind}, repeat 1", kind, 1, t_s, angle_rad, speed, torque, is_powered)
        stretches = cut_stretches(make_swing_problem(replace(like, runs=(run,)), WINDOW_S, BIN_S))
        return replace(
            stretches[0],
            windows=tuple(window for stretch in stretches for window in stretch.windows),
        )

    and_back_to_rest_min = 2.0 * float(t_s[-1]) / 60.0
    return ExperimentDesign(settings, words, SET_UP_MIN, and_back_to_rest_min, REPEATS, simulate)
