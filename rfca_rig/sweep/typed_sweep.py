"""A sweep without a file, from the options --vary, --set and --samples."""

from collections.abc import Sequence

from rfca_rig.errors import BadInput
from rfca_rig.model.parameters import RigModel
from rfca_rig.sweep.outputs import DEFAULT_OUTPUTS, parse_outputs
from rfca_rig.sweep.plan import Axis, SweepPlan, check_plan, make_grid
from rfca_rig.sweep.quantities import Quantity, Value, find_quantity
from rfca_rig.sweep.samples import METHODS, Method, Range, SweepSamples, why_unbalanced

LOG = "log"
GRID_SYNTAX = "NAME=FROM:TO:STEPS, NAME=FROM:TO:STEPS:log, or NAME=A,B,C"
RANGE_SYNTAX = "NAME=FROM:TO or NAME=FROM:TO:log"


def plan_from_options(
    rig: RigModel, vary: Sequence[str], fixed: Sequence[str], outputs: str, samples: int | None, method: str, seed: int
) -> SweepPlan:
    """The plan of the command line's options. Raises BadInput, naming the option."""
    parts = [_split_option("--vary", each) for each in vary]
    # One colon makes FROM:TO, a range to sample; two make FROM:TO:STEPS, a grid.
    ranges = [(varied, text) for varied, text in parts if text.removesuffix(f":{LOG}").count(":") == 1]
    if bool(ranges) != (samples is not None):
        raise BadInput(
            f"--vary {ranges[0][0].name}={ranges[0][1]}: a range is for --samples N; for a grid say how many steps, {GRID_SYNTAX}"
            if ranges
            else f"--samples {samples}: name the ranges to draw from, --vary {RANGE_SYNTAX}"
        )
    axes = tuple(_axis(varied, text) for varied, text in parts if (varied, text) not in ranges)
    drawn = None if samples is None else _samples([_range(varied, text) for varied, text in ranges], samples, method, seed)
    names = parse_outputs(outputs.split(",") if outputs else DEFAULT_OUTPUTS)
    set_ = tuple((varied.name, _value(varied, text)) for varied, text in (_split_option("--set", each) for each in fixed))
    return check_plan(SweepPlan(f"Sweep over {', '.join(varied.name for varied, _ in parts)}", rig, set_, axes, drawn, names))


def _split_option(option: str, text: str) -> tuple[Quantity, str]:
    name, equals, value = text.partition("=")
    if not equals or not value:
        raise BadInput(f"{option} {text}: should be {GRID_SYNTAX if option == '--vary' else 'NAME=VALUE'}")
    return find_quantity(name.strip()), value.strip()


def _axis(varied: Quantity, text: str) -> Axis:
    if ":" not in text:
        return Axis(varied.name, tuple(_value(varied, each) for each in text.split(",")))
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
    numbers = [_number(varied, each) for each in text.removesuffix(f":{LOG}").split(":")]
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
    return text.strip() if varied.choices else _number(varied, text)


def _number(varied: Quantity, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise BadInput(f"{varied.name}={text}: should be a number") from None
