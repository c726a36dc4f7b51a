"""A sweep as its user states it: a sweep file (sweeps/*.toml), or the options --vary, --set and
--samples.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import Field, model_validator

from rfca_rig.errors import BadInput
from rfca_rig.model.parameters import RigModel
from rfca_rig.sweep.outputs import DEFAULT_OUTPUTS, parse_outputs
from rfca_rig.sweep.plan import (
    METHODS,
    Axis,
    Method,
    Range,
    SweepPlan,
    SweepSamples,
    check_plan,
    make_grid,
    why_unbalanced,
)
from rfca_rig.sweep.quantities import Quantity, Value, find_quantity
from rfca_rig.toml import Key, Section, place_of, read_toml

Made = TypeVar("Made")
Steps = Annotated[int, Field(ge=2, le=100_000)]
Fixed = dict[str, float | str | dict[str, float | str]]

MOST_SAMPLES = 1_000_000

LOG = "log"
GRID_SYNTAX = "NAME=FROM:TO:STEPS, NAME=FROM:TO:STEPS:log, or NAME=A,B,C"
RANGE_SYNTAX = "NAME=FROM:TO or NAME=FROM:TO:log"


class VarySection(Section):
    """[[vary]]: one quantity over `values`, or over `steps` values between `from` and `to`, both
    included; `log` for equal ratios.
    """

    name: str = Field(description="quantity, as in `rfca-rig sweep --help`")
    values: Annotated[tuple[float | str, ...], Field(min_length=1, strict=False)] | None = Field(
        default=None, description="list of values"
    )
    from_: Annotated[float | None, Field(alias="from")] = None
    to: float | None = Field(default=None, description="last value")
    steps: Steps | None = Field(default=None, description="number of values")
    log: bool = Field(default=False, description="equal ratios instead of equal steps")

    @model_validator(mode="after")
    def _check_values(self) -> "VarySection":
        parts = (self.from_, self.to, self.steps)
        has_range = None not in parts
        has_part_of_range = any(part is not None for part in parts)
        # Either a list of values or a complete range, never a mixture.
        if self.values is None:
            is_valid = has_range
        else:
            is_valid = not has_part_of_range
        if not is_valid:
            raise ValueError("takes either values, or all of from, to and steps")
        if self.values is None:
            _check_log(self.log, self.from_, self.to)
        return self

    def axis(self) -> Axis:
        """The grid. Raises BadInput for an unknown name."""
        return Axis(find_quantity(self.name).name, self._values(), self.log)

    def _values(self) -> tuple[Value, ...]:
        if self.values is not None:
            return self.values
        assert self.from_ is not None and self.to is not None and self.steps is not None
        return make_grid(self.from_, self.to, self.steps, self.log)


class RangeSection(Section):
    """[[samples.vary]]: one quantity between `from` and `to`, evenly, or with `log` evenly in
    its logarithm.
    """

    name: str = Field(description="quantity")
    from_: Annotated[float, Field(alias="from")]
    to: float = Field(description="largest value")
    log: bool = Field(default=False, description="even in the logarithm")

    @model_validator(mode="after")
    def _ascending(self) -> "RangeSection":
        if not self.from_ < self.to:
            raise ValueError(f"from = {self.from_:g} must be below to = {self.to:g}")
        _check_log(self.log, self.from_, self.to)
        return self

    def range(self) -> Range:
        """The range. Raises BadInput for an unknown name."""
        return Range(find_quantity(self.name).name, self.from_, self.to, self.log)


class SamplesSection(Section):
    """[samples]: `n` points of a Latin hypercube or of a Sobol sequence in all the ranges at
    once, drawn from `seed`.
    """

    method: Method = Field(default="sobol", description="Sobol sequence or Latin hypercube")
    n: Annotated[int, Field(ge=2, le=MOST_SAMPLES)] = Field(description="number of samples")
    seed: Annotated[int, Field(ge=0)] = Field(description="seed of the random numbers")
    vary: Annotated[tuple[RangeSection, ...], Field(min_length=1, strict=False)]

    @model_validator(mode="after")
    def _is_balanced(self) -> "SamplesSection":
        if reason := why_unbalanced(self.method, self.n):
            raise ValueError(reason)
        return self


class SweepFile(Section):
    """A whole sweep file.

    `rig` is a name in calibration/ or a rig file, `model` a model file; their paths count from this
    file's folder.
    """

    title: str = Field(description="name of the sweep")
    rig: str | None = Field(default=None, description="name or rig file")
    model: str | None = Field(default=None, description="model file, in place of the rig")
    outputs: Annotated[tuple[str, ...], Field(min_length=1, strict=False)] = Field(
        default=DEFAULT_OUTPUTS, description="quantities to compute"
    )
    fixed: Annotated[Fixed, Field(default_factory=dict)]
    vary: Annotated[tuple[VarySection, ...], Field(strict=False)] = ()
    samples: SamplesSection | None = None

    @model_validator(mode="after")
    def _check_model(self) -> "SweepFile":
        if self.rig is not None and self.model is not None:
            raise ValueError("rig and model are both given; name one of them")
        return self


def read_sweep(path: Path) -> SweepFile:
    """Read the sweep in `path`. Raises BadInput, with file and line, where it cannot be used."""
    return read_toml(path, SweepFile)


def make_plan(file: SweepFile, rig: RigModel, path: Path) -> SweepPlan:
    """The plan of a file that was read from `path`. Raises BadInput with the line of the faulty
    key.
    """
    axes = tuple(
        _at(path, ("vary", index, "name"), section.axis) for index, section in enumerate(file.vary)
    )
    samples = None
    if file.samples:
        section = file.samples
        ranges = tuple(
            _at(path, ("samples", "vary", index, "name"), quantity.range)
            for index, quantity in enumerate(section.vary)
        )
        samples = SweepSamples(ranges, section.method, section.n, section.seed)
    fixed = _at(
        path,
        ("fixed",),
        lambda: tuple(
            (find_quantity(name).name, value) for name, value in flatten_names(file.fixed)
        ),
    )
    outputs = _at(path, ("outputs",), lambda: parse_outputs(file.outputs))
    # The whole plan was checked, not a single key, so no line can be given.
    try:
        return check_plan(SweepPlan(file.title, rig, fixed, axes, samples, outputs))
    except BadInput as error:
        raise BadInput(f"{path}: {error}") from None


def flatten_names(fixed: Fixed) -> list[tuple[str, Value]]:
    """Names with dots and their values: TOML reads strip.thickness_mm = 0.8 as a table in a
    table.
    """
    settings: list[tuple[str, Value]] = []
    for name, value in fixed.items():
        if isinstance(value, dict):
            settings += [(f"{name}.{inner}", inner_value) for inner, inner_value in value.items()]
        else:
            settings.append((name, value))
    return settings


def _at(path: Path, key: Key, make: Callable[[], Made]) -> Made:
    """Calls `make`; its BadInput is extended by the line of `key`."""
    try:
        return make()
    except BadInput as error:
        raise BadInput(f"{place_of(path, key)}: {error}") from None


def _check_log(log: bool, low: float | None, high: float | None) -> None:
    if log and (low is None or high is None or not min(low, high) > 0.0):
        raise ValueError("log = true needs from and to above 0")


def plan_from_options(
    rig: RigModel,
    vary: Sequence[str],
    fixed: Sequence[str],
    outputs: str,
    samples: int | None,
    method: str,
    seed: int,
) -> SweepPlan:
    """The plan of the command line's options. Raises BadInput, naming the option."""
    parts = [_split_option("--vary", option) for option in vary]
    # One colon makes FROM:TO, a range to sample; two make FROM:TO:STEPS, a grid.
    ranges = [
        (varied, text) for varied, text in parts if text.removesuffix(f":{LOG}").count(":") == 1
    ]
    if ranges and samples is None:
        raise BadInput(
            f"--vary {ranges[0][0].name}={ranges[0][1]}: a range is for --samples N; for "
            f"a grid say how many steps, {GRID_SYNTAX}"
        )
    if samples is not None and not ranges:
        raise BadInput(f"--samples {samples}: name the ranges to draw from, --vary {RANGE_SYNTAX}")
    axes = tuple(_axis(varied, text) for varied, text in parts if (varied, text) not in ranges)
    if samples is None:
        drawn = None
    else:
        drawn = _samples([_range(varied, text) for varied, text in ranges], samples, method, seed)
    asked_outputs: Sequence[str] = DEFAULT_OUTPUTS
    if outputs:
        asked_outputs = outputs.split(",")
    names = parse_outputs(asked_outputs)
    set_ = []
    for option in fixed:
        quantity, text = _split_option("--set", option)
        set_.append((quantity.name, _value(quantity, text)))
    return check_plan(
        SweepPlan(
            f"Sweep over {', '.join(varied.name for varied, _ in parts)}",
            rig,
            tuple(set_),
            axes,
            drawn,
            names,
        )
    )


def _split_option(option: str, text: str) -> tuple[Quantity, str]:
    name, equals, value = text.partition("=")
    if not equals or not value:
        raise BadInput(
            f"{option} {text}: should be {GRID_SYNTAX if option == '--vary' else 'NAME=VALUE'}"
        )
    return find_quantity(name.strip()), value.strip()


def _axis(varied: Quantity, text: str) -> Axis:
    if ":" not in text:
        return Axis(varied.name, tuple(_value(varied, part) for part in text.split(",")))
    numbers, log = _parse_numbers(varied, text)
    if len(numbers) != 3 or not (numbers[2].is_integer() and 2 <= numbers[2] <= 100_000):
        raise BadInput(f"--vary {varied.name}={text}: should be {GRID_SYNTAX}")
    return Axis(varied.name, make_grid(numbers[0], numbers[1], int(numbers[2]), log), log)


def _range(varied: Quantity, text: str) -> Range:
    (low, high), log = _parse_numbers(varied, text)
    if not low < high:
        raise BadInput(f"--vary {varied.name}={text}: {low:g} must be below {high:g}")
    return Range(varied.name, low, high, log)


def _parse_numbers(varied: Quantity, text: str) -> tuple[list[float], bool]:
    log = text.endswith(f":{LOG}")
    numbers = [_number(varied, part) for part in text.removesuffix(f":{LOG}").split(":")]
    if log and not min(numbers[:2]) > 0.0:
        raise BadInput(f"--vary {varied.name}={text}: equal ratios need both ends above 0")
    return numbers, log


def _samples(ranges: Sequence[Range], n: int, method: str, seed: int) -> SweepSamples:
    # The option takes the first word: "latin hypercube" has a blank.
    known: dict[str, Method] = {name.split(maxsplit=1)[0]: name for name in METHODS}
    if method not in known:
        raise BadInput(f"--method {method}: should be {' or '.join(known)}")
    if reason := why_unbalanced(known[method], n):
        raise BadInput(f"--samples: {reason.replace('a latin', '--method latin, a latin')}")
    return SweepSamples(tuple(ranges), known[method], n, seed)


def _value(varied: Quantity, text: str) -> Value:
    if varied.choices:
        return text.strip()
    return _number(varied, text)


def _number(varied: Quantity, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise BadInput(f"{varied.name}={text}: should be a number") from None
