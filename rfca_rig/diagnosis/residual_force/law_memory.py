"""Memory of a measured law: whether the force at one value of its argument differs between a rising
and a falling argument.

Beside the law f(u), a second one, g(u) sign(du/dt), acts as a force over time along the motion with
the law. The response of the observations to it is linear. It is fitted with everything else free. A
friction that depends on the speed alone leaves g at zero. Presliding, a loop of the spring or play
do not.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.diagnosis.inference.hypotheses import ModelSelectionResult
from rfca_rig.diagnosis.leg.strokes import DynamicCondition
from rfca_rig.diagnosis.likelihood.marginal_likelihood import LinearModel, laplace_posterior
from rfca_rig.diagnosis.mechanisms.windows import Motions
from rfca_rig.diagnosis.residual_force.force_inputs import NominalCondition, arms_of, of_tip
from rfca_rig.diagnosis.residual_force.law import ROUGHNESS, SIZES, Course, MemoryTest, prior_root
from rfca_rig.diagnosis.residual_force.law_arguments import (
    course_of_stroke,
    response_to_branch,
    turning_rate,
)
from rfca_rig.diagnosis.residual_force.spline_force import (
    AT_REST_S,
    Change,
    advance_time,
    make_basis,
    simulate_forced_stroke,
)
from rfca_rig.errors import SimulationFailed
from rfca_rig.executors.parallel import map_in_processes
from rfca_rig.model.kernel.laws import HINGE, TABLE, LawUse
from rfca_rig.model.parameters import LawTable
from rfca_rig.model.setup import Setup, with_law

Floats = NDArray[np.float64]

# of a plausible size: large against the integrator's error, small against what bends the leg
TRIED = 0.1
STEP_S = 1e-3  # of a force over time, as recordings have it
TURNING = 0.02  # of the greatest du/dt, below which the direction fades, so that rest has none
# Log evidence from which on two branches are better than one: laws without memory gained -5 to 15
# on simulated campaigns, dry friction of the pins and a loop of the spring 44 to 450 where the
# recordings turn back.
EVIDENCE = 25.0
BENDING = ("angle_rad", "spring_torque_Nm")  # arguments that grow with the load of a static stage
APART = 0.25  # of the knots at which the branches must be two standard deviations apart


def detect_memory(
    found: ModelSelectionResult,
    linear: LinearModel,
    supposed: Any,
    table: LawTable,
    plausible: float,
    slopes: Floats,
) -> MemoryTest:
    """The two branches of a law.

    Parameters
    ----------
    found
        The result of the search.
    linear
        The hypothesis with the law, linearised around `supposed`.
    supposed
        Input of the simulator with the law.
    table
        The law at k knots.
    plausible
        Plausible size of a value.
    slopes
        (m, k) response of all rows to the values of the table. At a static stage they act in the
        direction of its turn.

    Raises
    ------
    SimulationFailed
        Where the model has no answer.
    """
    # At static stages a bend grows while loading; no rate is left there.
    rows = found.dataset.rows
    turn = np.where(rows.experiment == "static", np.where(rows.phase == "loading", 1.0, -1.0), 0.0)
    if table.argument in BENDING:
        grows = np.sign(table.knots)
    else:
        grows = np.zeros(len(table.knots))
    responses = _responses(found, supposed, table, plausible) + turn[:, None] * slopes * grows
    whitening = found.likelihood.level(linear)
    knots = np.array(table.knots)
    without_branches = laplace_posterior(linear, whitening).log_evidence
    best = None
    root = np.empty(0)
    for size, roughness in product(SIZES, ROUGHNESS):
        trial_root = prior_root(knots, size * plausible, roughness)
        posterior = laplace_posterior(
            LinearModel(linear.target, np.column_stack([linear.jacobian, responses @ trial_root])),
            whitening,
        )
        if best is None or posterior.log_evidence > best.log_evidence:
            best = posterior
            root = trial_root
    assert best is not None
    count = len(knots)
    # g is half the difference of the branches: rising is f + g, falling is f - g.
    half = root @ best.mean[-count:]
    std = np.sqrt(np.diag(root @ best.covariance[-count:, -count:] @ root.T))
    gain = best.log_evidence - without_branches
    values = np.array(table.values)
    # Evidence alone is not enough: the branches must also differ clearly at a quarter of the knots.
    has_memory = gain > EVIDENCE and float(np.mean(np.abs(half) > 2.0 * std)) >= APART
    return MemoryTest(values + half, values - half, 2.0 * std, gain, has_memory)


def _responses(search: ModelSelectionResult, supposed: Any, table: LawTable, size: float) -> Floats:
    """Response (m, k) of all rows to a unit of g at each knot."""
    rows = search.dataset.rows
    count = len(table.knots)
    if isinstance(search.dataset.parts[0], Motions):
        turning = turning_rate(search.dataset, supposed, table, TURNING)
    else:
        turning = 0.0
    jobs = [
        (number, part, knot)
        for number, part in enumerate(search.dataset.parts)
        for knot in range(count)
    ]
    of_strokes = {
        number: _Stroke.of(part, supposed, table)
        for number, part in enumerate(search.dataset.parts)
        if isinstance(part, DynamicCondition)
    }

    def response(job: tuple[int, Any, int]) -> Floats | None:
        number, part, knot = job
        if number in of_strokes:
            return of_strokes[number].response(knot, size)
        if isinstance(part, Motions):
            return response_to_branch(search.dataset, part, supposed, knot, TRIED * size, turning)
        return None

    responses = np.zeros((len(rows.measured), count))
    for (number, _, knot), change in zip(jobs, map_in_processes(response, jobs), strict=True):
        if change is not None:
            responses[rows.condition == number, knot] = change
    return responses


def _branch(course: Course, table: LawTable, knot: int) -> Floats:
    """Share of one knot in g times the direction, over time, (n, hinges)."""
    share = np.interp(course.values, table.knots, np.eye(len(table.knots))[knot])
    rate = np.gradient(course.values, course.t_s, axis=0)
    # A smooth sign: the direction fades where the argument hardly changes.
    return np.asarray(
        share * np.tanh(rate / (TURNING * np.abs(rate).max() + 1e-12)) * course.counts
    )


@dataclass(frozen=True)
class _Stroke:
    """One condition with the law in it: how it moves, and the argument over it."""

    here: NominalCondition
    table: LawTable
    course: Course

    @classmethod
    def of(cls, flap: DynamicCondition, supposed: ModelPoint, table: LawTable) -> "_Stroke":
        stroke = flap.stroke(supposed)
        condition = NominalCondition(flap, supposed, stroke, make_basis(flap), np.empty(0))
        return cls(condition, table, course_of_stroke(flap, supposed, table.place, table.argument))

    def response(self, knot: int, size: float) -> Floats:
        """Change of the rows (m,) per unit of the knot."""
        condition = self.here
        place = self.table.place
        branch = _branch(self.course, self.table, knot)
        if place.startswith("hinge"):
            links = range(1, condition.stroke.q_rad.shape[1])
            if place == "hinges":
                only = list(links)
            else:
                only = [int(place.removeprefix("hinge")) - 1]
            return self._respond_to_torque(branch, only, size)
        if not place.startswith("floor"):
            return condition.rows_of({place: branch[:, 0]})
        down = place == "floor_normal"
        if down:
            force = -branch[:, 0]
        else:
            force = branch[:, 0] * self._friction_per_share()
        return self._respond_to_force(force, down, size)

    def _friction_per_share(self) -> Floats:
        """Friction (n,) per unit of the law, which is a share of the friction coefficient."""
        share = 1.0 + np.interp(self.course.values[:, 0], self.table.knots, self.table.values)
        # The simulated friction has the law in it; the floor avoids a division by nearly nothing.
        return np.asarray(self.here.stroke.tangential_N[:, -1] / np.maximum(share, 0.1))

    def _respond_to_force(self, force: Floats, down: bool, size: float) -> Floats:
        """Response (m,) to a force (n,) on the tip, downwards or along +y: torques about the
        hinges, and the direct part at the mount.
        """
        condition = self.here
        arms = arms_of(condition, of_tip(condition.stroke), down)
        torque = -force * arms[:, 0]
        nothing = np.zeros_like(force)
        fy, fz = (nothing, force) if down else (-force, nothing)
        direct_part = condition.rows_of(
            {
                "fy_N": fy,
                "fz_N": fz,
                "tx_Nm": torque + condition.supposed.rig.sensor.below_shaft_m * fy,
            }
        )
        levers = -force[:, None] * arms[:, 1:]
        return direct_part + self._respond_to_torque(levers, list(range(1, arms.shape[1])), size)

    def _respond_to_torque(self, torque: Floats, only: Sequence[int], size: float) -> Floats:
        """Response (m,) per unit to torques (n, k) over time that resist the hinges `only`; zero
        where the model has no answer.
        """
        condition = self.here
        largest = float(np.abs(torque).max())
        if largest == 0.0:
            return condition.rows_of({})
        scale = TRIED * size / largest
        changes = tuple(
            course_in_hinge(condition.flap.t_s, scale * column, hinge)
            for column, hinge in zip(torque.T, only, strict=True)
        )
        try:
            stroke = simulate_forced_stroke(condition.flap, condition.supposed, changes)
        except SimulationFailed:
            return condition.rows_of({})
        return condition.change_to(stroke, scale)


BEGINS, STEP, COUNT = range(3)


def follow(  # a law takes what its place offers, needed or not
    phi: float,  # noqa: ARG001
    rate: float,  # noqa: ARG001
    elapsed: float,
    k0: float,  # noqa: ARG001
    k2: float,  # noqa: ARG001
    memory: Any,
    parameter: Any,
) -> tuple[float, float, float]:
    """Torque over time from a table of even steps; the derivatives by angle and rate are 0."""
    # `memory[0]` holds the time up to the last accepted step. A very long elapsed time means the
    # rest pose and does not count.
    t = parameter[BEGINS] + memory[0] + (elapsed if elapsed < AT_REST_S else 0.0)
    last = int(parameter[COUNT]) - 1
    x = min(max(t / parameter[STEP], 0.0), float(last))
    i = min(int(x), last - 1)
    before = parameter[TABLE + i]
    after = parameter[TABLE + i + 1]
    return before + (x - i) * (after - before), 0.0, 0.0


def course_in_hinge(t_s: Floats, torque_Nm: Floats, hinge: int) -> Change:
    """A torque over time (n,) that resists the turn of a hinge; hinges count from 1."""
    begin_s = float(t_s[0])
    even = np.arange(begin_s, float(t_s[-1]) + STEP_S, STEP_S)
    values = tuple(float(value) for value in np.interp(even, t_s, torque_Nm))

    def change(setup: Setup) -> Setup:
        row = (setup.begins_s - begin_s, STEP_S, float(len(values)))
        return with_law(setup, LawUse(HINGE, follow, row, advance_time, hinge, values))

    return change
