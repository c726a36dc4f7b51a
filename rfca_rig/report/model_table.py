"""The values of a model as a table."""

from rfca_rig.model.parameters import RigModel
from rfca_rig.report.quantities import quantities_of
from rfca_rig.report.table import Column, Row, Table

COLUMNS = (Column("part", role="group"), Column("parameter", "Parameter"), Column("value", "Value"), Column("unit", "Unit"))


def model_table(rig: RigModel) -> Table:
    """Part by part, in a lab's units."""
    rows = [{"part": q.section, "parameter": q.name, "value": q.value, "unit": q.unit} for q in quantities_of(rig)]
    return Table("model", "", COLUMNS, tuple(Row(row) for row in rows))
