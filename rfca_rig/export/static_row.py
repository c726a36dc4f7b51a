"""Means of a static stage as one row of a table, for CSV and MCAP."""

from typing import Any

from rfca_rig.recording.model import StaticStage
from rfca_rig.recording.strokes import height_mm


def static_row(held: StaticStage) -> dict[str, Any]:
    """Means of a static stage under the column names of campaign files."""
    # Hinge 1 is the shaft: photos give hinges 2 to 7.
    hinges = {f"hinge{i}_deg": angle for i, angle in enumerate(held.hinge_deg, start=2)}
    about = {"height_mm": height_mm(held.height_m), "stage": held.stage, "direction": held.direction}
    return {**about, "shaft_angle_rad": held.shaft_angle_rad, **hinges, **{name: getattr(held, name) for name in ("fy_N", "fz_N", "tx_Nm")}}
