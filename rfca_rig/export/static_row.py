"""The means of a static stage as a row of a table."""

from typing import Any

from rfca_rig.recording.model import StaticStage
from rfca_rig.recording.strokes import height_mm


def static_row(held: StaticStage) -> dict[str, Any]:
    """By the names that campaign files have for them."""
    hinges = {f"hinge{i}_deg": angle for i, angle in enumerate(held.hinge_deg, start=2)}
    about = {"height_mm": height_mm(held.height_m), "stage": held.stage, "direction": held.direction}
    return {**about, "shaft_angle_rad": held.shaft_angle_rad, **hinges, **{name: getattr(held, name) for name in ("fy_N", "fz_N", "tx_Nm")}}
