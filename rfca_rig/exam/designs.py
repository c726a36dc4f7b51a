"""Designs of the exam's campaigns: their strokes and static stages."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ExamDesign:
    """Conditions (height in mm, speed in rad/s), each repeated, and the heights of the static table; none where there is no table."""

    conditions: tuple[tuple[float, float], ...]
    repeats: int
    static_heights_mm: tuple[float, ...]


THREE_BY_THREE = ExamDesign(
    conditions=tuple((height, speed) for height in (195.0, 215.0, 235.0) for speed in (2.0, 2.6, 3.3)),
    repeats=3,
    static_heights_mm=(195.0, 215.0, 235.0),
)
PAPER_CONDITIONS = ExamDesign(
    conditions=((215.0, 2.433), (215.0, 3.249), (235.0, 2.478), (235.0, 3.276)),
    repeats=5,
    static_heights_mm=(215.0, 235.0),
)
ONE_STROKE = ExamDesign(conditions=((215.0, 2.433),), repeats=1, static_heights_mm=())
