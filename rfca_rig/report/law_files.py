"""A measured residual law as CSV for other programs, and as one sentence."""

import csv
import io
from pathlib import Path

from rfca_rig.diagnosis.residual_force.law import MeasuredLaw, StatedLaw
from rfca_rig.recording.atomic import write_atomically


def write_law_table(path: Path, law: MeasuredLaw) -> None:
    """Writes knots, values and standard deviations as CSV, and the whole law where the model has a part of it already.

    Raises RigError where the file cannot be written.
    """
    unit = law.unit.replace(" ", "") or "relative"
    columns = {law.argument: law.knots, f"residual_{unit}": law.values, f"residual_std_{unit}": law.std}
    if law.whole is not None and law.whole_std is not None:
        columns |= {f"whole_{unit}": law.whole, f"whole_std_{unit}": law.whole_std}
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(columns)
    rows.writerows([f"{value:.7g}" for value in row] for row in zip(*columns.values(), strict=True))
    write_atomically(path, text.getvalue().encode("utf-8"))


def describe_law(stated: StatedLaw) -> str:
    """States which effects the model had when the law was measured, and which share of the held-out misfit the law removes."""
    law = stated.law
    beside = " and ".join(law.base) or "the model without effects"
    instead = f", in place of what {' and '.join(stated.instead_of)} states there" if stated.instead_of else ""
    return f"measured beside {beside}{instead}. On held-out conditions it removes {100.0 * law.explained:.0f}\u00a0% of what those leave"
