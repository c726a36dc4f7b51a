"""A sweep as data: varied quantities with their values, outputs, and the design of every case by
its number.

Sample points are a Latin hypercube or Sobol's sequence, from a seed that is part of the plan.
First-order Sobol indices of samples are

    S_i = Var(E[y | x_i]) / Var(y)

E[y | x_i] is estimated by least squares of y on a cubic spline of x_i's share u of its range. The
spline has as many even segments as the samples allow (n / 32, at most 12). S_i is the adjusted
coefficient of determination

    S_i = 1 - (RSS / (n - p)) / (TSS / (n - 1)),        p = segments + 3 coefficients

so that a parameter without influence has S_i = 0 on average instead of (p - 1) / (n - 1). Any
independent samples serve; no pairs of sample matrices are needed. The standard error comes from a
bootstrap of the cases. Points of a hypercube or a Sobol sequence are more even than the independent
points of a bootstrap, so it is rather too large. The rest of 1 after all S_i is due to interactions
of parameters.

SALib has RBD-FAST for the same index from any samples. On Ishigami's function, over 20 seeds, both
scatter alike with hypercubes (0.02 to 0.03 with 512 points). With Sobol points, the default here,
RBD-FAST scatters by up to 0.11 and this estimate by up to 0.02 with 128 and 512 points. SALib's
Sobol method needs pairs of sample matrices, n (p + 2) cases for p quantities.

References
----------
Tarantola, Gatelli, Mara, Reliab. Eng. Syst. Saf. 91 (2006) 717 (random balance designs).
Ishigami, Homma, Proc. ISUMA (1990) 398.
"""

import hashlib
import json
import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from functools import cache, cached_property
from math import prod
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rfca_rig import analysis, model, sweep
from rfca_rig.errors import BadInput
from rfca_rig.executors.environment import collect_facts, hash_source
from rfca_rig.model.catalogue import FOLDER_VARIABLE, resolve_effect
from rfca_rig.model.parameters import RigModel
from rfca_rig.recording.atomic import translate_os_errors, write_atomically
from rfca_rig.sweep.outputs import REST_AT, RequestedOutput
from rfca_rig.sweep.quantities import SweepCase, Value, find_quantity

Floats = NDArray[np.float64]
Method = Literal["sobol", "latin hypercube"]
METHODS: tuple[Method, ...] = ("sobol", "latin hypercube")

# Fewest values for an index, values per segment of the spline, and most segments.
MIN_VALUES = 24
PER_SEGMENT = 32
MOST_SEGMENTS = 12
# Bootstrap samples for the standard error.
BOOTSTRAP_SAMPLES = 200

MAX_CASES = 10_000_000

FORMAT = "rfca-sweep/1"
PLAN_FILE = "plan.json"
MADE_WITH = "made_with"


@dataclass(frozen=True)
class Range:
    """Uniform from `low` to `high`, or uniform in the logarithm with `log`."""

    name: str
    low: float
    high: float
    log: bool = False


@dataclass(frozen=True)
class SweepSamples:
    """`n` points in all `ranges` together. The same seed gives the same points on any machine."""

    ranges: tuple[Range, ...]
    method: Method
    n: int
    seed: int

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(quantity.name for quantity in self.ranges)


def why_unbalanced(method: Method, n: int) -> str | None:
    """Why a Sobol sequence should not be cut off after `n` points, or None."""
    # A power of 2 has exactly one bit.
    if method != "sobol" or n.bit_count() == 1:
        return None
    below = 1 << (n.bit_length() - 1)
    return (
        f"n = {n}: Sobol points are balanced in powers of two only; take {below} or "
        f"{2 * below}, or a latin hypercube"
    )


@cache
def points(samples: SweepSamples) -> Floats:
    """Sample points (n, ranges), in the units of their quantities."""
    unit = shares(samples)
    columns = [
        _between(quantity, unit[:, column]) for column, quantity in enumerate(samples.ranges)
    ]
    return np.stack(columns, axis=1)


@cache
def shares(samples: SweepSamples) -> Floats:
    """Sample points (n, ranges) as shares of each range, from 0 to 1, as they are drawn."""
    from scipy.stats import qmc  # noqa: PLC0415 - grids need not pay for it

    dimensions = len(samples.ranges)
    rng = np.random.default_rng(samples.seed)
    # Both kinds are randomised by the seeded generator; scipy scrambles Sobol points by default.
    if samples.method == "sobol":
        kind = qmc.Sobol
    else:
        kind = qmc.LatinHypercube
    return np.asarray(kind(dimensions, seed=rng).random(samples.n))


def _between(over: Range, share: Floats) -> Floats:
    if over.log:
        return np.asarray(np.exp(np.log(over.low) + share * (np.log(over.high) - np.log(over.low))))
    return over.low + share * (over.high - over.low)


@dataclass(frozen=True)
class FirstOrder:
    """First-order index S_i and its standard error."""

    index: float
    std: float


def first_order(share: Floats, y: Floats, rng: np.random.Generator) -> FirstOrder | None:
    """First-order index of one parameter; None with fewer than 24 values, or if all are equal.

    Parameters
    ----------
    share : (n,) parameter values as shares of its range, 0 to 1
    y : (n,) output, NaN where there is none
    rng : random numbers of the bootstrap
    """
    known = np.isfinite(y)
    share = share[known]
    y = y[known]
    if y.size < MIN_VALUES or np.ptp(y) <= 1e-12 * np.abs(y).max():
        return None
    B = spline_basis(share, min(max(1, y.size // PER_SEGMENT), MOST_SEGMENTS))
    even = np.full(y.size, 1.0 / y.size)
    # Drawing n cases with replacement is the same as multinomial weights on them.
    repeated = [
        _r2_adjusted(B, y, rng.multinomial(y.size, even).astype(np.float64))
        for _ in range(BOOTSTRAP_SAMPLES)
    ]
    return FirstOrder(_r2_adjusted(B, y, np.ones(y.size)), float(np.std(repeated, ddof=1)))


def _r2_adjusted(B: Floats, y: Floats, weights: Floats) -> float:
    n = y.size
    p = B.shape[1]
    # The total sum of squares is about the weighted mean; the fit does not change, because the
    # splines contain the constant.
    y = y - weights @ y / n
    weighted = B.T * weights
    coefficients, *_ = np.linalg.lstsq(weighted @ B, weighted @ y, rcond=1e-10)
    left = weights @ (y - B @ coefficients) ** 2
    total = weights @ y**2
    return float(1.0 - (left / (n - p)) / (total / (n - 1)))


def spline_basis(share: Floats, segments: int) -> Floats:
    """Cubic B-splines (n, segments + 3) of the shares (n,) on even segments of 0 to 1."""
    from scipy.interpolate import BSpline  # noqa: PLC0415 - grids need not pay for it

    knots = np.concatenate((np.zeros(3), np.linspace(0.0, 1.0, segments + 1), np.ones(3)))
    return np.asarray(BSpline.design_matrix(np.clip(share, 0.0, 1.0), knots, 3).toarray())


@dataclass(frozen=True)
class Axis:
    """A grid over one quantity. `log` marks steps of equal ratio, which only figures need."""

    name: str
    values: tuple[Value, ...]
    log: bool = False


def make_grid(low: float, high: float, steps: int, log: bool) -> tuple[float, ...]:
    """`steps` values from `low` to `high`, both included, rounded to 12 digits so that a step of
    0.1 gives 0.3, not 0.30000000000000004.
    """
    if log:
        values = np.geomspace(low, high, steps)
    else:
        values = np.linspace(low, high, steps)
    return tuple(float(f"{value:.12g}") for value in values)


@dataclass(frozen=True)
class SweepPlan:
    """Every combination of the `axes`' values with every point of the `samples`. `fixed` values are
    set in all cases.

    Cases are numbered with the samples running fastest and the first axis slowest. The plan is sent
    to the workers, which draw the sample points again from their seed.
    """

    title: str
    rig: RigModel
    fixed: tuple[tuple[str, Value], ...]
    axes: tuple[Axis, ...]
    samples: SweepSamples | None
    outputs: tuple[RequestedOutput, ...]

    @property
    def varied(self) -> tuple[str, ...]:
        """Names of the varied quantities, in the order of the columns."""
        names = tuple(axis.name for axis in self.axes)
        if self.samples is None:
            return names
        return (*names, *self.samples.names)

    @cached_property
    def count(self) -> int:
        """Number of cases."""
        count = prod(len(axis.values) for axis in self.axes)
        if self.samples is None:
            return count
        return count * self.samples.n

    def point(self, case: int) -> tuple[Value, ...]:
        """Values of the varied quantities, in the order of `varied`."""
        sampled: tuple[Value, ...] = ()
        if self.samples:
            case, row = divmod(case, self.samples.n)
            sampled = tuple(map(float, points(self.samples)[row]))
        on_grid: list[Value] = []
        # Mixed-radix digits of the case number, the fastest one first.
        for axis in reversed(self.axes):
            case, digit = divmod(case, len(axis.values))
            on_grid.append(axis.values[digit])
        return (*reversed(on_grid), *sampled)

    def design(self, case: int) -> SweepCase:
        """The design of a case."""
        design = SweepCase(self.rig)
        for name, value in (*self.fixed, *zip(self.varied, self.point(case), strict=True)):
            design = find_quantity(name).write(design, value)
        return design


# Share of a range at which no whole number lies, unless the range is a multiple of it.
INNER_SHARE = 0.381966


def check_plan(plan: SweepPlan) -> SweepPlan:
    """Return the plan after checking all of its values. Raises BadInput."""
    if not plan.varied:
        raise BadInput(
            "nothing is varied; name what, as in --vary height_mm=195:255:13, or in the "
            'file with [[vary]] name = "height_mm"'
        )
    if plan.count > MAX_CASES:
        raise BadInput(f"{plan.count} cases: at most {MAX_CASES} in one sweep; take fewer values")
    _check_names((*(name for name, _ in plan.fixed), *plan.varied))
    _check_values(plan)
    effects = plan.design(0).rig.effects
    for present in effects:
        # Refuses an effect of which only some parameters are set.
        try:
            resolve_effect(present)
        except BadInput as error:
            raise BadInput(
                f"{error}; set the others too, as in --set {present.id}.NAME=VALUE, or in "
                "the file under [fixed]"
            ) from None
    at_rest = next((asked.header for asked in plan.outputs if asked.output.at == REST_AT), None)
    if effects and at_rest:
        raise BadInput(
            f"{at_rest}: statics know the plain leg only; leave it out, or the effect "
            f"{effects[0].id}"
        )
    return plan


def _check_names(names: Iterable[str]) -> None:
    setting: dict[str, str] = {}
    for name in names:
        what = find_quantity(name).sets or find_quantity(name).name
        earlier = setting.get(what)
        if earlier == name:
            raise BadInput(f"{name} is set twice")
        if earlier is not None:
            raise BadInput(f"{earlier} and {name} set the same; leave one out")
        setting[what] = name


def _check_values(plan: SweepPlan) -> None:
    for name, value in plan.fixed:
        _check_value(name, value)
    for axis in plan.axes:
        for value in axis.values:
            _check_value(axis.name, value)
    if plan.samples is None:
        return
    # Limits are intervals, so the ends of a range are checked, and a value between them for
    # quantities that take whole numbers only.
    for span in plan.samples.ranges:
        for value in (span.low, span.high, span.low + INNER_SHARE * (span.high - span.low)):
            _check_value(span.name, value)


def _check_value(name: str, value: Value) -> None:
    reason = find_quantity(name).why_not(value)
    if reason is None:
        return
    if isinstance(value, str):
        text = value
    else:
        text = f"{value:g}"
    raise BadInput(f"{name} = {text}: {reason}")


def describe_plan(plan: SweepPlan) -> dict[str, Any]:
    """The plan and its model as plain data, with the versions of the code, because changed code
    gives other numbers.
    """
    # Everything that can change a result to the last digit: versions of the numerical packages, and
    # hashes of our own sources.
    facts = collect_facts()
    versions = {name: facts[name] for name in ("rfca_rig", "numpy", "scipy", "numba", "llvmlite")}
    sources = "".join(
        hash_source(Path(package.__path__[0])) for package in (model, analysis, sweep)
    )
    effects_folder = os.environ.get(FOLDER_VARIABLE)
    own_effects = "none"
    if effects_folder:
        own_effects = hash_source(Path(effects_folder))
    samples = None
    if plan.samples:
        samples = asdict(plan.samples)
    return {
        "format": FORMAT,
        "title": plan.title,
        "model": asdict(plan.rig),
        "fixed": dict(plan.fixed),
        "grid": [{"name": axis.name, "values": list(axis.values)} for axis in plan.axes],
        "samples": samples,
        "outputs": [asked.header for asked in plan.outputs],
        MADE_WITH: {
            **versions,
            "source": digest(sources)[:12],
            "own effects": own_effects,
        },
    }


def as_text(plan: SweepPlan) -> str:
    """The document as JSON text, which is compared byte by byte."""
    return json.dumps(describe_plan(plan), indent=1, ensure_ascii=False) + "\n"


def digest(text: str) -> str:
    """SHA-256 that identifies the plan in shards and results."""
    return hashlib.sha256(text.encode()).hexdigest()


def claim_folder(plan: SweepPlan, folder: Path) -> str:
    """Prepare `folder` for the plan, or check that it belongs to it; returns the plan's digest.
    Raises BadInput for another sweep's folder.
    """
    with translate_os_errors(folder, "the folder cannot be made"):
        folder.mkdir(parents=True, exist_ok=True)
    path = folder / PLAN_FILE
    text = as_text(plan)
    if not path.exists():
        # A folder with other content was most likely named by mistake; nothing may be mixed into
        # it.
        if strangers := sorted(entry.name for entry in folder.iterdir()):
            raise BadInput(
                f"{folder}: holds {strangers[0]}, which is of no sweep; give a new folder "
                "with --out"
            )
        write_atomically(path, text.encode())
    elif (existing := path.read_text("utf-8", errors="replace")) != text:
        raise BadInput(
            f"{folder}: {_difference(existing, describe_plan(plan))}; give a new folder "
            "with --out, or remove this one"
        )
    return digest(text)


def _difference(text: str, wanted: dict[str, Any]) -> str:
    try:
        stored_plan = json.loads(text)
        # Through JSON and back, so that tuples compare equal to lists.
        differing = [
            key.replace("_", " ")
            for key, value in json.loads(json.dumps(wanted)).items()
            if stored_plan.get(key) != value
        ]
    except (ValueError, AttributeError):
        return f"{PLAN_FILE} is damaged"
    if differing == [MADE_WITH.replace("_", " ")]:
        unlike = [
            name
            for name, value in wanted[MADE_WITH].items()
            if stored_plan[MADE_WITH].get(name) != value
        ]
        return (
            f"its sweep was made with another {' and '.join(unlike)}, and results would not "
            "fit together"
        )
    return (
        "holds a sweep with another "
        f"{' and '.join(name for name in differing if name != 'made with') or 'form'}"
    )
