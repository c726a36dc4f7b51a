"""Sensitivities of a sweep: first-order Sobol index of each output for each sampled quantity, for the page and sweep.json."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rfca_rig.report.sweep_text import name_and_unit, with_unit
from rfca_rig.report.sweep_views import sample_groups
from rfca_rig.report.table import Table, TableColumn, TableRow
from rfca_rig.sweep.quantities import Value
from rfca_rig.sweep.result import SweepResult
from rfca_rig.sweep.samples import FirstOrder, first_order, shares

# Combinations of the grid's values for which sensitivities are computed.
MOST_GROUPS = 6


@dataclass(frozen=True)
class OutputSensitivity:
    """Sensitivity of one output to one quantity, for one combination of the grid's values; `found` is None where it is undetermined."""

    at: tuple[tuple[str, Value], ...]
    output: str
    name: str
    found: FirstOrder | None


def compute_sensitivities(result: SweepResult) -> list[OutputSensitivity]:
    """All sensitivities, by combination, output and quantity. The seed of the bootstrap is that of the samples."""
    return list(_compute_sensitivities(result))


def _compute_sensitivities(result: SweepResult) -> Iterator[OutputSensitivity]:
    samples = result.plan.samples
    if samples is None:
        return
    share = shares(samples)
    for group in list(sample_groups(result.plan))[:MOST_GROUPS]:
        for asked in result.plan.outputs:
            values = result.output(asked.header)[group.cases]
            for place, name in enumerate(samples.names):
                # A generator of its own for each quantity, so that the order of computation does not matter.
                rng = np.random.default_rng((samples.seed, place))
                yield OutputSensitivity(group.at, asked.header, name, first_order(share[:, place], values, rng))


def sensitivities_table(found: list[OutputSensitivity]) -> Table:
    """A row for each output, a column for each quantity, and the sum of its indices; what it lacks of 1 is due to interactions."""
    names = list(dict.fromkeys(each.name for each in found))
    columns = [TableColumn("at", role="group"), TableColumn("output")]
    for name in names:
        columns += [TableColumn(name, name_and_unit(name)[0], half=f"{name} std"), TableColumn(f"{name} std", role="kept")]
    columns.append(TableColumn("sum", "together", digits=2))
    rows = []
    for at, output in dict.fromkeys((each.at, each.output) for each in found):
        values: dict[str, str | float | None] = {"at": ", ".join(with_unit(*each) for each in at), "output": name_and_unit(output)[0]}
        of_row = [each for each in found if (each.at, each.output) == (at, output)]
        for each in of_row:
            values[each.name] = each.found.index if each.found else None
            values[f"{each.name} std"] = each.found.std if each.found else None
        values["sum"] = sum(each.found.index for each in of_row if each.found) if all(each.found for each in of_row) else None
        rows.append(TableRow(values))
    return Table(
        "sensitivities",
        "Share of an output's variance that one quantity explains alone (first-order Sobol index ± one standard error); what is missing "
        "from 1 together is due to interactions.",
        tuple(columns),
        tuple(rows),
    )
