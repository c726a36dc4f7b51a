"""Link and hinge angles from identified marks, with their standard deviations.

All photos of a leg are fitted together by least squares: the angles of each photo, and what the
photos share. That is the shaft's position, the distances between the marks, and the distance of
each mark from the plane of motion. A mark out of the plane is seen beside its place, so that the
distances between marks seem to change with the pose. From several poses the fit finds the offsets
and corrects for them. From one photo it can only widen the standard deviations.

An angle that is known to worse than 0.3 degrees is None. Where a mark is missing, the known lengths
leave two solutions that are reflections of each other; one is reported only if the other photos of
the leg exclude its reflection.

Marks are glued beside their places within the plane, too. These errors are unknowns of the fit,
with a prior: photos determine a part of them, and the standard deviations hold what is left. They
do not hold the error of the camera's calibration.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.vision.camera_model import CameraModel
from rfca_rig.vision.identify import LENGTH_STD_M, SHAFT_STD_M, IdentifiedMarks
from rfca_rig.vision.leg_marks import MarkPlan, mark_positions

Floats = NDArray[np.float64]

# Lengths this uncertain regularise and do not determine angles: used to find out what the marks
# alone determine.
WEAK_LENGTH_STD_M = 2.0e-3
# Keeps the equations regular where no mark determines an angle.
ANGLE_PRIOR_STD_RAD = float(np.radians(60.0))
# Angles with a larger standard deviation are reported as None.
MAX_REPORTED_STD_RAD = float(np.radians(0.3))
# Standard deviations of the marks' distances from the plane of motion: glued well, badly, on
# spacers. They are equally probable a priori: six photos of a leg often cannot tell 0.1 mm from 1
# mm, and a prior for 0.1 mm would then decide (errors of 0.9 degrees stated as 0.2).
OFFSET_STD_M = (1.0e-4, 1.0e-3, 3.0e-3)
# Smallest weight of a deviation of the offsets that explains the marks as well as the others do. On
# 108 ray-traced legs, of which half each were used, 0, 0.05, 0.1 and 0.2 give a largest error of
# 3.7, 2.8, 2.4 and 2.3 deviations, and state 76, 75, 73 and 68 % of the angles.
MIN_WEIGHT = 0.1
# Largest distance of a mark from the plane that is corrected, and largest misfit of the distances
# between marks.
MAX_OFFSET_M = 5.0e-3
MAX_MISFIT_M = 0.5e-3
# An angle from lengths may be outside the range of the other photos by so much, and its reflection
# must be farther outside.
NEAR_OTHERS_RAD = float(np.radians(4.0))
# Of 1,777 fits to ray-traced photos 88 % converged within 5 full steps and 97 % within 40. Damped
# steps took 38 to 120 for the others; two thirds of these were then still moving slowly, along a
# valley that no mark determines.
FULL_STEPS = 40
DAMPED_STEPS = 120
# Step (rad, m, or a ratio) from which on nothing changes any more.
CONVERGED = 1e-9
# Error of gluing a mark within the plane, standard deviation in each direction: by eye, with a
# template. Between marks that are 39.3 mm apart it turns a hinge angle by sqrt(6) 0.1 / 39.3 rad,
# 0.36 degrees.
GLUING_STD_M = 1.0e-4
# Of the scaled information, where a step has made the fit worse.
FIRST_DAMPING = 1e-4


@dataclass(frozen=True)
class HingeAngles:
    """Absolute link angles and relative hinge angles in rad; the first hinge angle is the shaft's.
    None where it is not determined.

    Standard deviations accordingly. `hinge_reading_std_rad` is the part that remains where it is
    known how the marks are glued: the error of a photo, which differs from photo to photo.
    Covariances (links, links) rad2 are NaN in rows and columns of
    undetermined angles.
    """

    link_rad: tuple[float | None, ...]
    link_std_rad: tuple[float | None, ...]
    link_covariance_rad2: Floats
    hinge_rad: tuple[float | None, ...]
    hinge_std_rad: tuple[float | None, ...]
    hinge_covariance_rad2: Floats
    hinge_reading_std_rad: tuple[float | None, ...]


@dataclass(frozen=True)
class LegFit:
    """Angles of each photo of a leg, and what its photos share.

    `offsets_m` (marks,) are the marks' distances from their mean plane towards the camera, with
    standard deviations `offset_std_m` (marks,); NaN for marks that no photo shows. `misfit_m` is
    the root mean square difference between seen and fitted marks. `refused` says why no angle is
    reported, else "".
    """

    angles: tuple[HingeAngles, ...]
    offsets_m: Floats
    offset_std_m: Floats
    misfit_m: float
    refused: str = ""


@dataclass(frozen=True)
class _Seen:
    """Indices of the seen marks in the plan, their positions (n, 2) m, and the whitening (n, 2,
    2) 1/m of their errors.
    """

    planned: list[int]
    places_m: Floats
    whitening: Floats


def hinge_angles(
    identified: IdentifiedMarks,
    camera: CameraModel,
    plan: MarkPlan,
    link_lengths_m: Sequence[float],
    *,
    shaft_std_m: float = SHAFT_STD_M,
    offset_std_m: Sequence[float] = OFFSET_STD_M,
    gluing_std_m: float = GLUING_STD_M,
) -> HingeAngles:
    """The leg's angles in one photo, as far as the identified marks determine them.

    Parameters
    ----------
    identified : Identified
        The marks.
    camera : CameraModel
        The camera.
    plan : MarkPlan
        Positions of the marks on the leg.
    link_lengths_m : sequence of n floats
        From the shaft outwards.
    shaft_std_m : float
        Standard deviation of the shaft axis in the camera's calibration.
    offset_std_m : sequence of floats
        Possible standard deviations of the marks' distances from the plane of motion.
    gluing_std_m : float
        Standard deviation of the marks' places within the plane, in each direction.

    Returns
    -------
    HingeAngles
        None for angles that are not determined.
    """
    return fit_leg(
        [identified],
        camera,
        plan,
        link_lengths_m,
        shaft_std_m=shaft_std_m,
        offset_std_m=offset_std_m,
        gluing_std_m=gluing_std_m,
    ).angles[0]


def fit_leg(
    photos: Sequence[IdentifiedMarks],
    camera: CameraModel,
    plan: MarkPlan,
    link_lengths_m: Sequence[float],
    *,
    shaft_std_m: float = SHAFT_STD_M,
    offset_std_m: Sequence[float] = OFFSET_STD_M,
    gluing_std_m: float = GLUING_STD_M,
) -> LegFit:
    """The angles in several photos of one leg, whose marks stay where they are glued.

    Parameters
    ----------
    photos : sequence of IdentifiedMarks
        The marks of each photo.
    camera, plan, link_lengths_m, shaft_std_m, offset_std_m, gluing_std_m
        As for `hinge_angles`.

    Returns
    -------
    LegFit
        Angles in the order of the photos. None of them where the marks fit no leg of these lengths.
    """
    lengths = np.asarray(link_lengths_m, dtype=np.float64)
    seen = [_whiten(identified, camera, plan) for identified in photos]
    used = [number for number, marks in enumerate(seen) if marks.planned]
    angles = [_nothing(len(lengths))] * len(photos)
    unknown = np.full(len(plan.marks), np.nan)
    if not used:
        return LegFit(tuple(angles), unknown, unknown, 0.0)
    problem = _Problem(
        tuple(seen[number] for number in used),
        plan,
        lengths,
        np.asarray(-camera.rotation.T @ camera.translation_m),
        shaft_std_m,
    )
    fit = _mix([_solve(problem, LENGTH_STD_M, std, gluing_std_m) for std in offset_std_m])
    offsets, offset_std = _offsets(problem, fit)
    # Twice the mean over both coordinates is the mean squared distance.
    misfit = float(np.sqrt(2.0 * np.mean(np.concatenate(fit.misses_m) ** 2)))
    worst = int(np.nanargmax(np.abs(offsets)))
    refused = ""
    if abs(offsets[worst]) > MAX_OFFSET_M:
        refused = (
            f"the {plan.name(worst)} would be {1e3 * offsets[worst]:+.1f} mm out of the "
            "plane of the others, "
            f"limit {1e3 * MAX_OFFSET_M:g} mm; glue all marks in one plane, check the "
            "lengths; no angles taken"
        )
    elif misfit > MAX_MISFIT_M:
        refused = (
            f"the marks miss a leg of the stated lengths by {1e3 * misfit:.2f} mm rms, "
            f"limit {1e3 * MAX_MISFIT_M:g} mm; "
            "check lengths, places of the marks and calibration; no angles taken"
        )
    if refused:
        return LegFit(tuple(angles), offsets, offset_std, misfit, refused)
    stated = [_photo_angles(problem, fit, index) for index in range(len(used))]
    # What the marks of each photo determine with lengths that do not.
    single = [replace(problem, photos=(photo,)) for photo in problem.photos]
    direct = [
        _photo_angles(photo_problem, _solve(photo_problem, WEAK_LENGTH_STD_M, 0.0, 0.0), 0)
        for photo_problem in single
    ]
    ranges_rad = _ranges(stated, direct)
    for index, number in enumerate(used):
        angles[number] = _only_certain(stated[index], direct[index], ranges_rad)
    return LegFit(tuple(angles), offsets, offset_std, misfit)


def _whiten(identified: IdentifiedMarks, camera: CameraModel, plan: MarkPlan) -> _Seen:
    planned = [i for i, mark in enumerate(identified.marks) if mark is not None]
    marks = [mark for mark in identified.marks if mark is not None]
    px = np.array([mark.px for mark in marks]).reshape(-1, 2)
    std = np.array([mark.std_px for mark in marks]).reshape(-1, 2)
    # Errors in px are independent along x and y: errors in the plane are whitened by mapping them
    # to pixels and dividing there.
    whitening = camera.project_jacobian(camera.on_plane(px)) / std[..., None]
    return _Seen(planned, camera.discs_on_plane(px, plan.diameter_m), whitening)


def _nothing(links: int) -> HingeAngles:
    nothing = (None,) * links
    unknown = np.full((links, links), np.nan)
    return HingeAngles(nothing, nothing, unknown, nothing, nothing, unknown, nothing)


@dataclass(frozen=True)
class _Problem:
    """The seen marks of each photo, the leg, and the camera's position (3,) m in the plane's
    frame.
    """

    photos: tuple[_Seen, ...]
    plan: MarkPlan
    lengths_m: Floats
    camera_m: Floats
    shaft_std_m: float

    @property
    def free(self) -> int:
        """Number of the angles of all photos; shaft (2), stretches (links,), offsets (marks,) and
        gluing (marks, 2 carriers, 2) follow in the values.
        """
        return len(self.photos) * len(self.lengths_m)

    @property
    def gluing(self) -> slice:
        """Places of the gluing errors in the values."""
        marks = len(self.plan.marks)
        return slice(self.free + 2 + len(self.lengths_m) + marks, None)

    @property
    def carriers(self) -> NDArray[np.intp]:
        """Indices (marks, 2) of the links that a mark may be glued to and turn with.

        A mark on a hinge axis is glued to the link before or to the one after. Half of the variance
        is given to each.
        """
        own = [mark.link - 1 for mark in self.plan.marks]
        before = [
            max(mark.link - 2, 0) if mark.along_m == 0.0 else mark.link - 1
            for mark in self.plan.marks
        ]
        return np.array([before, own], dtype=np.intp).T


@dataclass(frozen=True)
class _Solution:
    """Values and their covariance, log evidence, the marks' squared misfit in deviations.

    For each photo the misses (2 n,) in metres, and the misfit per degree of freedom.
    """

    values: Floats
    covariance: Floats
    log_evidence: float
    squared_misfit: float
    misses_m: list[Floats]
    scale: list[float]


def _solve(
    problem: _Problem, length_std_m: float, offset_std_m: float, gluing_std_m: float
) -> _Solution:
    """Least squares with the priors as further rows. Offsets and gluing of zero deviation are
    fixed.
    """
    marks = len(problem.plan.marks)
    links = len(problem.lengths_m)
    starts = [_start(seen, problem.plan, problem.lengths_m) for seen in problem.photos]
    _bend_hidden_hinges(starts, problem)
    nominal = np.concatenate(
        [*starts, np.zeros(2), np.ones(links), np.zeros(marks), np.zeros(4 * marks)]
    )
    precise = (
        [1 / problem.shaft_std_m] * 2
        + list(problem.lengths_m / length_std_m)
        + [1 / max(offset_std_m, 1e-7)] * marks
        # Two carriers share the variance.
        + [np.sqrt(2.0) / max(gluing_std_m, 1e-7)] * (4 * marks)
    )
    # The prior of the angles is on those between neighbouring links: the start angles are the most
    # probable ones.
    prior = _Prior(nominal, _bends(links) / ANGLE_PRIOR_STD_RAD, np.array(precise))
    values, linearization, is_converged = _descend(problem, prior, is_damped=False)
    if not is_converged:
        values, linearization, _ = _descend(problem, prior, is_damped=True)
    covariance, log_size = _form_normal_equations(values, linearization, prior).invert()
    squares = [float(residual @ residual) for residual in linearization.residuals]
    evidence = (
        -0.5 * _cost(values, linearization, prior) - 0.5 * log_size + float(np.log(precise).sum())
    )
    scale = [
        max(1.0, square / max(1, 2 * len(seen.planned) - links))
        for square, seen in zip(squares, problem.photos, strict=True)
    ]
    return _Solution(values, covariance, evidence, sum(squares), linearization.misses_m, scale)


@dataclass(frozen=True)
class _Prior:
    """Nominal values; precision matrices in units of deviations: of each photo's angles (links,
    links), and of what photos share (n,).
    """

    nominal: Floats
    of_angles: Floats
    of_shared: Floats

    def split(self, values: Floats) -> tuple[Floats, Floats]:
        """The angles (photos, links), and what the photos share (n,)."""
        return values[: -len(self.of_shared)].reshape(-1, len(self.of_angles)), values[
            -len(self.of_shared) :
        ]


@dataclass(frozen=True)
class _Linearization:
    """For each photo the whitened residuals (rows,), their Jacobian (rows, links + shared) and
    the misses (rows,) in m.
    """

    residuals: list[Floats]
    jacobians: list[Floats]
    misses_m: list[Floats]


@dataclass(frozen=True)
class _NormalEquations:
    """Information and pull of least squares, scaled to a diagonal of ones: angles, metres and
    ratios differ by orders of magnitude.

    The angles of different photos have no common entries. So only blocks are kept: `own` (photos,
    links, links), `cross` (photos, links, shared), `shared` (shared, shared). The sizes are the
    square roots of the diagonal before.
    """

    own: Floats
    cross: Floats
    shared: Floats
    pull_own: Floats
    pull_shared: Floats
    size_own: Floats
    size_shared: Floats

    def step(self, damping: float) -> Floats:
        """The step of all values, by the Schur complement of the angles."""
        own, shared = (
            block + damping * np.eye(block.shape[-1]) for block in (self.own, self.shared)
        )
        reduced = np.linalg.solve(
            own, np.concatenate([self.cross, self.pull_own[..., None]], axis=-1)
        )
        by_shared = reduced[..., :-1]
        alone = reduced[..., -1]
        transposed = self.cross.swapaxes(1, 2)
        complement = shared - (transposed @ by_shared).sum(axis=0)
        step = np.linalg.solve(
            complement, self.pull_shared - (transposed @ alone[..., None])[..., 0].sum(axis=0)
        )
        return np.concatenate(
            [((alone - by_shared @ step) / self.size_own).ravel(), step / self.size_shared]
        )

    def invert(self) -> tuple[Floats, float]:
        """The covariance of all values, and the logarithm of the determinant of the information."""
        _, links, shared = self.cross.shape
        by_shared = np.linalg.solve(self.own, self.cross)
        complement = self.shared - (self.cross.swapaxes(1, 2) @ by_shared).sum(axis=0)
        mapping = np.concatenate([-by_shared.reshape(-1, shared), np.eye(shared)])
        covariance = mapping @ np.linalg.inv(complement) @ mapping.T
        for photo, inverse in enumerate(np.linalg.inv(self.own)):
            part = slice(photo * links, (photo + 1) * links)
            covariance[part, part] += inverse
        size = np.concatenate([self.size_own.ravel(), self.size_shared])
        log_size = (
            np.linalg.slogdet(self.own)[1].sum()
            + np.linalg.slogdet(complement)[1]
            + 2.0 * np.log(size).sum()
        )
        return covariance / size / size[:, None], float(log_size)


def _form_normal_equations(
    values: Floats, linearization: _Linearization, prior: _Prior
) -> _NormalEquations:
    links = len(prior.of_angles)
    gram = np.array([jacobian.T @ jacobian for jacobian in linearization.jacobians])
    pull = np.array(
        [
            jacobian.T @ residual
            for jacobian, residual in zip(
                linearization.jacobians, linearization.residuals, strict=True
            )
        ]
    )
    angles, shared = prior.split(prior.nominal - values)
    precise = prior.of_angles.T @ prior.of_angles
    own = gram[:, :links, :links] + precise
    of_shared = gram[:, links:, links:].sum(axis=0) + np.diag(prior.of_shared**2)
    size_own = np.sqrt(np.diagonal(own, axis1=1, axis2=2))
    size_shared = np.sqrt(np.diag(of_shared))
    return _NormalEquations(
        own / size_own[:, :, None] / size_own[:, None, :],
        gram[:, :links, links:] / size_own[:, :, None] / size_shared,
        of_shared / size_shared / size_shared[:, None],
        (pull[:, :links] + angles @ precise) / size_own,
        (pull[:, links:].sum(axis=0) + prior.of_shared**2 * shared) / size_shared,
        size_own,
        size_shared,
    )


def _descend(
    problem: _Problem, prior: _Prior, *, is_damped: bool
) -> tuple[Floats, _Linearization, bool]:
    """Values of least squares, from the nominal ones on; residuals, Jacobians and misses there;
    whether the steps have converged.

    Full steps (Gauss-Newton) follow the curved valley of hidden hinges quickly. Where these leave
    two solutions, full steps may jump between them and end at neither; damped ones
    (Levenberg-Marquardt) only go down.
    """
    values = prior.nominal.copy()
    damping = 0.0
    linearization = _linearize(prior.nominal, problem)
    equations = _form_normal_equations(values, linearization, prior)
    for _ in range(DAMPED_STEPS if is_damped else FULL_STEPS):
        step = equations.step(damping)
        trial = _linearize(values + step, problem)
        if is_damped and _cost(values + step, trial, prior) > _cost(values, linearization, prior):
            damping = max(FIRST_DAMPING, 10.0 * damping)
        else:
            values = values + step
            linearization = trial
            damping = 0.1 * damping if damping > FIRST_DAMPING else 0.0
            equations = _form_normal_equations(values, linearization, prior)
        if np.abs(step).max() < CONVERGED:
            return values, linearization, True
    return values, linearization, False


def _cost(values: Floats, linearization: _Linearization, prior: _Prior) -> float:
    """Sum of squares, in deviations, of the residuals and of the differences from the nominal
    values.
    """
    angles, shared = prior.split(values - prior.nominal)
    rows = [
        *linearization.residuals,
        (angles @ prior.of_angles.T).ravel(),
        shared * prior.of_shared,
    ]
    return float(sum(row @ row for row in rows))


def _mix(solutions: Sequence[_Solution]) -> _Solution:
    """Mean and covariance over the possible deviations of the offsets, weighted by how well each
    explains the marks.

    The evidence prefers small offsets, by up to a factor of ten for each mark. That decides where
    the marks hardly do, and a leg that is glued to 1 mm is then stated as one glued to 0.1 mm. So
    each deviation keeps a share, unless the marks exclude it.
    """
    logs = np.array([solution.log_evidence for solution in solutions])
    misfits = np.array([solution.squared_misfit for solution in solutions])
    weights = np.exp(logs - logs.max())
    weights = np.maximum(
        weights / weights.sum(), MIN_WEIGHT * np.exp(-0.5 * (misfits - misfits.min()))
    )
    weights /= weights.sum()
    values = sum(
        (weight * solution.values for weight, solution in zip(weights, solutions, strict=True)),
        np.zeros(1),
    )
    spread = [
        solution.covariance + np.outer(solution.values - values, solution.values - values)
        for solution in solutions
    ]
    covariance = sum(
        (weight * matrix for weight, matrix in zip(weights, spread, strict=True)), np.zeros(1)
    )
    return replace(solutions[int(np.argmax(weights))], values=values, covariance=covariance)


def _bends(links: int) -> Floats:
    """Matrix (links, links) from link angles to hinge angles."""
    return np.eye(links) - np.eye(links, k=-1)


def _bend_hidden_hinges(starts: list[Floats], problem: _Problem) -> None:
    """Give hinges whose mark a photo does not show the median angle of the photos that do:
    straight ones are between two solutions.
    """
    bends = _bends(len(problem.lengths_m))
    on_axis: list[set[int]] = [set() for _ in bends]
    for i, mark in enumerate(problem.plan.marks):
        if 1 <= mark.link <= len(bends) and mark.along_m == mark.across_m == 0.0:
            on_axis[mark.link - 1].add(i)
    shown_by_photo = []
    for seen in problem.photos:
        planned = set(seen.planned)
        shown_by_photo.append([marks <= planned for marks in on_axis])
    shown = np.array(shown_by_photo)
    hinges = np.array([bends @ start for start in starts])
    for photo, start in enumerate(starts):
        for hinge in np.flatnonzero(~shown[photo]):
            others = hinges[shown[:, hinge], hinge]
            if 0 < hinge < len(bends) and len(others):
                # The chord stays, the links beside the hinge turn by half its angle each.
                change = 0.5 * (np.median(others) - hinges[photo, hinge])
                start[hinge - 1] -= change
                start[hinge] += change


def _linearize(values: Floats, problem: _Problem) -> _Linearization:
    links = len(problem.lengths_m)
    free = problem.free
    plan = problem.plan
    shaft = values[free : free + 2]
    stretch = values[free + 2 : free + 2 + links]
    offsets = values[free + 2 + links : problem.gluing.start]
    carriers = problem.carriers
    glued = values[problem.gluing].reshape(*carriers.shape, 2)
    stretched = replace(
        plan,
        marks=tuple(
            replace(mark, along_m=mark.along_m * stretch[mark.link - 1]) for mark in plan.marks
        ),
    )
    away = abs(float(problem.camera_m[0]))
    foot = problem.camera_m[1:]
    along, across = _compute_lever_arms(plan, problem.lengths_m)
    poses = values[:free].reshape(-1, links)
    positions = shaft + mark_positions(poses, problem.lengths_m * stretch, stretched)
    along_link, across_link = _directions(poses)
    # Directions (photos, marks, carriers, 2) of the links that carry the marks.
    outwards = along_link[:, carriers]
    sideways = across_link[:, carriers]
    positions = positions + (glued[..., :1] * outwards + glued[..., 1:] * sideways).sum(axis=2)
    residuals = []
    jacobians = []
    misses = []
    for seen, angles, marks, along_mark, across_mark in zip(
        problem.photos, poses, positions, outwards, sideways, strict=True
    ):
        planned = seen.planned
        predicted = marks[planned]
        near = offsets[planned]
        # A mark nearer to the camera is seen farther from the foot of the camera's normal on the
        # plane.
        wider = (1.0 + near / (away - near))[:, None]
        miss = seen.places_m - foot - (predicted - foot) * wider
        cos = np.cos(angles)
        sin = np.sin(angles)
        rows = np.arange(len(near))
        block = np.zeros((len(near), 2, 2 * links + 2 + len(offsets) + glued.size))
        # By the angles, the shaft's position, the stretches, and the marks' offsets.
        block[:, 0, :links] = -along[planned] * stretch * sin - across[planned] * cos
        block[:, 1, :links] = -along[planned] * stretch * cos + across[planned] * sin
        block[:, 0, links] = block[:, 1, links + 1] = 1.0
        block[:, 0, links + 2 : 2 * links + 2] = along[planned] * cos
        block[:, 1, links + 2 : 2 * links + 2] = -along[planned] * sin
        for carrier in range(2):
            # A turned carrier moves what is glued to it at right angles.
            turned = (
                glued[planned, carrier, :1] * across_mark[planned, carrier]
                - glued[planned, carrier, 1:] * along_mark[planned, carrier]
            )
            block[rows, :, carriers[planned, carrier]] += turned
            first = 2 * links + 2 + len(offsets) + 4 * np.array(planned) + 2 * carrier
            block[rows, :, first] = along_mark[planned, carrier]
            block[rows, :, first + 1] = across_mark[planned, carrier]
        block *= wider[:, None]
        block[rows, :, 2 * links + 2 + np.array(planned)] = (predicted - foot) * (
            away / (away - near) ** 2
        )[:, None]
        residuals.append((seen.whitening @ miss[..., None]).ravel())
        jacobians.append((seen.whitening @ block).reshape(2 * len(near), -1))
        misses.append(miss.ravel())
    return _Linearization(residuals, jacobians, misses)


def _directions(angles_rad: Floats) -> tuple[Floats, Floats]:
    """Unit vectors (..., 2) along links and across them, towards growing angles."""
    cos = np.cos(angles_rad)
    sin = np.sin(angles_rad)
    return np.stack([cos, -sin], axis=-1), np.stack([-sin, -cos], axis=-1)


def _compute_lever_arms(plan: MarkPlan, lengths_m: Floats) -> tuple[Floats, Floats]:
    """Distances (marks, links) along and across each link by which its turn moves each mark."""
    links = np.arange(1, len(lengths_m) + 1)
    is_own_link = np.array([[mark.link] for mark in plan.marks]) == links
    along = np.where(
        np.array([[mark.link] for mark in plan.marks]) > links,
        lengths_m,
        is_own_link * np.array([[mark.along_m] for mark in plan.marks]),
    )
    return along, is_own_link * np.array([[mark.across_m] for mark in plan.marks])


def _start(seen: _Seen, plan: MarkPlan, lengths_m: Floats) -> Floats:
    """Start values of the link angles (links,): each link points from its hinge to the next seen
    mark outwards.
    """
    angles: list[float] = []
    hinge = np.zeros(2)
    for link in range(1, len(lengths_m) + 1):
        target = next((n for n, i in enumerate(seen.planned) if _beyond(plan, i, link)), None)
        angle = angles[-1] if angles else 0.0
        if target is not None:
            mark = plan.marks[seen.planned[target]]
            # A mark beside the link's axis is seen at an angle to it.
            if mark.link == link:
                bearing = np.arctan2(mark.across_m, mark.along_m)
            else:
                bearing = 0.0
            towards = seen.places_m[target] - hinge
            turn = float(np.arctan2(-towards[1], towards[0])) - bearing - angle
            # Wrapped to half a turn either way, so that angles stay continuous along the chain.
            angle += float(np.arctan2(np.sin(turn), np.cos(turn)))
        angles.append(angle)
        hinge = hinge + lengths_m[link - 1] * np.array([np.cos(angle), -np.sin(angle)])
    return np.array(angles)


def _beyond(plan: MarkPlan, index: int, link: int) -> bool:
    mark = plan.marks[index]
    return mark.link > link or (mark.link == link and mark.along_m > 0.0)


def _keep_determined(
    angles_rad: Floats, covariance: Floats, reading_std_rad: Floats
) -> tuple[tuple[float | None, ...], tuple[float | None, ...], Floats]:
    # Gluing is the same in all photos: a mark that is clearly seen is no worse for it.
    determined = reading_std_rad <= MAX_REPORTED_STD_RAD
    shown = np.where(determined[:, None] & determined[None, :], covariance, np.nan)
    std = np.sqrt(np.diag(covariance))
    return _mask(angles_rad, determined), _mask(std, determined), shown


def _mask(values: Floats, determined: NDArray[np.bool_]) -> tuple[float | None, ...]:
    """The values (n,), None for those that are not determined."""
    return tuple(
        float(value) if is_determined else None
        for value, is_determined in zip(values, determined, strict=True)
    )


def _photo_angles(problem: _Problem, fit: _Solution, photo: int) -> HingeAngles:
    """Angles of one photo; a photo that fits badly gets larger deviations (Birge ratio)."""
    links = len(problem.lengths_m)
    part = slice(links * photo, links * (photo + 1))
    angles = fit.values[part]
    by_gluing = _covariance_by_gluing(problem, fit, part)
    reading = (fit.covariance[part, part] - by_gluing) * fit.scale[photo]
    covariance = reading + by_gluing
    bends = _bends(links)
    hinge_reading = bends @ reading @ bends.T
    reading_std = np.sqrt(np.diag(reading))
    hinge_reading_std = np.sqrt(np.diag(hinge_reading))
    return HingeAngles(
        *_keep_determined(angles, covariance, reading_std),
        *_keep_determined(bends @ angles, bends @ covariance @ bends.T, hinge_reading_std),
        _mask(hinge_reading_std, hinge_reading_std <= MAX_REPORTED_STD_RAD),
    )


def _covariance_by_gluing(problem: _Problem, fit: _Solution, part: slice) -> Floats:
    """The part of the covariance (links, links) of a photo's angles that vanishes where the
    gluing errors are known.
    """
    gluing = problem.gluing
    together = fit.covariance[part, gluing]
    return np.asarray(together @ np.linalg.solve(fit.covariance[gluing, gluing], together.T))


def _ranges(stated: Sequence[HingeAngles], direct: Sequence[HingeAngles]) -> Floats:
    """Smallest and largest angle of each hinge (links, 2) over the photos whose marks determine
    it; NaN without any.
    """
    rows = [_select_sure(photo, marks) for photo, marks in zip(stated, direct, strict=True)]
    angles = np.array(rows, np.float64)
    empty = np.atleast_1d(np.isnan(angles).all(axis=0))
    low = np.where(np.isnan(angles), np.inf, angles).min(axis=0)
    high = np.where(np.isnan(angles), -np.inf, angles).max(axis=0)
    return np.where(empty[:, None], np.nan, np.column_stack([low, high]))


def _select_sure(photo: HingeAngles, marks: HingeAngles) -> list[float]:
    """Hinge angles of a photo; NaN where its marks do not determine the angle."""
    angles = []
    for angle, sure in zip(photo.hinge_rad, marks.hinge_rad, strict=True):
        if sure is None or angle is None:
            angles.append(np.nan)
        else:
            angles.append(angle)
    return angles


def _only_certain(angles: HingeAngles, direct: HingeAngles, ranges_rad: Floats) -> HingeAngles:
    """The angles, without those from lengths whose reflection the other photos of the leg, with
    `ranges_rad` (links, 2), do not exclude.
    """
    hinges = [k for k, sure in enumerate(direct.hinge_rad) if sure is None]
    links = [k for k, sure in enumerate(direct.link_rad) if sure is None]
    if all(angles.hinge_rad[k] is None for k in hinges):
        return angles
    # Hinges between two links that the marks do not determine: a reflection turns them the other
    # way.
    middles = [k for k in links if k - 1 in links] or hinges
    values = np.array(
        [np.nan if angles.hinge_rad[k] is None else angles.hinge_rad[k] for k in middles],
        np.float64,
    )
    low = ranges_rad[middles, 0] - NEAR_OTHERS_RAD
    high = ranges_rad[middles, 1] + NEAR_OTHERS_RAD
    is_usual = (low <= values) & (values <= high)
    is_reflection_usual = (low <= -values) & (-values <= high)
    if bool(np.all(is_usual & ~is_reflection_usual)):
        return angles
    return HingeAngles(
        *_without(angles.link_rad, angles.link_std_rad, angles.link_covariance_rad2, links),
        *_without(angles.hinge_rad, angles.hinge_std_rad, angles.hinge_covariance_rad2, hinges),
        _blank(angles.hinge_reading_std_rad, hinges),
    )


def _without(
    angles_rad: Sequence[float | None],
    std_rad: Sequence[float | None],
    covariance: Floats,
    gone: Sequence[int],
) -> tuple[tuple[float | None, ...], tuple[float | None, ...], Floats]:
    shown = covariance.copy()
    shown[list(gone)] = np.nan
    shown[:, list(gone)] = np.nan
    return _blank(angles_rad, gone), _blank(std_rad, gone), shown


def _blank(values: Sequence[float | None], gone: Sequence[int]) -> tuple[float | None, ...]:
    """The values with None at the indices `gone`."""
    return tuple(None if index in gone else value for index, value in enumerate(values))


def _offsets(problem: _Problem, fit: _Solution) -> tuple[Floats, Floats]:
    """Offsets (marks,) m from their mean, and standard deviations (marks,); a common offset is
    one of the camera's calibration.
    """
    seen = np.array(sorted({index for photo in problem.photos for index in photo.planned}))
    first = problem.free + 2 + len(problem.lengths_m)
    centring = np.eye(len(seen)) - 1.0 / len(seen)
    covariance = centring @ fit.covariance[np.ix_(first + seen, first + seen)] @ centring.T
    offsets = np.full(len(problem.plan.marks), np.nan)
    std = np.full(len(problem.plan.marks), np.nan)
    offsets[seen] = centring @ fit.values[first + seen]
    std[seen] = np.sqrt(np.diag(covariance))
    return offsets, std
