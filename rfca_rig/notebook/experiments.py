"""A plan, and a run on the twin."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rfca_rig.cli.commands.measure.dynamic import replace_conditions
from rfca_rig.cli.run_config import RunConfig, RunOptions, make_run_config
from rfca_rig.cli.run_experiment import check_before_run, run_and_record
from rfca_rig.description.protocol_file import read_dynamic, read_plan
from rfca_rig.diagnosis.problem import Row
from rfca_rig.errors import BadInput
from rfca_rig.notebook.recordings import OpenedRecordings, html_table, make_frame, open_path
from rfca_rig.protocol.experiments import RigFacts, flapping_plan
from rfca_rig.protocol.plan import Plan

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class CheckedPlan:
    """The stages of a run in order, within the limits of the rig.

    Parameters
    ----------
    plan
        The stages, limits and rates.
    rows
        A row per stage: what it is, its longest time, and the load that the model predicts.
    """

    plan: Plan
    rows: tuple[Row, ...]

    def table(self) -> "pandas.DataFrame":
        """A row per stage."""
        return make_frame(self.rows)

    def _repr_html_(self) -> str:
        return html_table(
            (
                f"{self.plan.title}: {len(self.plan.stages)} stages, at most "
                f"{self.plan.duration_s:.0f} s"
            ),
            self.rows,
        )


def plan(
    protocol: str | Path = "flapping",
    rig: str | Path = "twin",
    *,
    height_mm: float | None = None,
    speed_rad_s: float | None = None,
    repeats: int | None = None,
) -> CheckedPlan:
    """Make a plan and compare it with the limits of the rig; nothing moves.

    Parameters
    ----------
    protocol
        A name such as "table2", or the path of a protocol file.
    rig
        The path or name of a rig file.
    height_mm, speed_rad_s, repeats
        Values in place of those of a dynamic protocol, height and speed together.

    Raises
    ------
    BadInput
        Where a stage passes a limit, or a file cannot be used.
    """
    config = _configure(
        RunOptions(str(rig), str(protocol), None, Path("runs"), is_dry=True, is_quiet=True),
        height_mm,
        speed_rad_s,
        repeats,
    )
    loads = check_before_run(config, lambda _: None)
    rows = (
        {
            "stage": stage.label,
            "at_most_s": stage.duration_s,
            "predicted_force_N": loads[stage].force_N if stage in loads else None,
            "predicted_torque_Nm": loads[stage].torque_Nm if stage in loads else None,
        }
        for stage in config.plan.stages
    )
    return CheckedPlan(config.plan, tuple(rows))


def run(
    protocol: str | Path = "flapping",
    rig: str | Path = "twin",
    *,
    height_mm: float | None = None,
    speed_rad_s: float | None = None,
    repeats: int | None = None,
    runs: str | Path = "runs",
    seed: int | None = None,
    operator: str = "",
    sample: str = "",
) -> OpenedRecordings:
    """Run a dynamic or static protocol on a twin and open its recording.

    Hardware is run from a terminal, by the commands of the same names: there, ^C reaches the
    control loop at once.

    Parameters
    ----------
    protocol, rig, height_mm, speed_rad_s, repeats
        As for `plan`.
    runs
        Folder in which the run makes a folder of its own.
    seed
        Seed of the twin's noise and scatter; the rig file's if None.
    operator, sample
        Who ran what; stored in the recording.

    Raises
    ------
    BadInput
        As for `plan`, and for a rig file of real hardware.
    Tripped
        Where a limit stopped the run; what was recorded is kept.
    """
    options = RunOptions(
        str(rig), str(protocol), None, Path(runs), seed, operator, sample, is_quiet=True
    )
    config = _configure(options, height_mm, speed_rad_s, repeats)
    if config.rig.is_real:
        command = f"rfca-rig {config.plan.experiment} run --protocol {protocol} --rig {rig}"
        raise BadInput(f"{rig}: drives hardware, which only a terminal may run: {command}")
    folder, _ = run_and_record(config, lambda *_: None)
    assert folder is not None  # only a dry run has none
    return open_path(folder)


def _configure(
    options: RunOptions, height_mm: float | None, speed_rad_s: float | None, repeats: int | None
) -> RunConfig:
    if (height_mm is None) != (speed_rad_s is None):
        raise BadInput(
            "give height_mm and speed_rad_s together; alone, each leaves the other to chance"
        )

    def make_plan(path: Path, facts: RigFacts) -> Plan:
        if height_mm is speed_rad_s is repeats is None:
            return read_plan(path, facts)
        return flapping_plan(
            replace_conditions(read_dynamic(path), height_mm, speed_rad_s, repeats).flapping(),
            facts,
        )

    return make_run_config(options, make_plan)
