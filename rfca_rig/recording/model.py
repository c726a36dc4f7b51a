"""The data model of a recording, the same for a twin, a real rig and a file from elsewhere."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.escaping import printable
from rfca_rig.recording.layout import LISTENING, is_inside

Floats = NDArray[np.float64]
Source = Literal["SIM", "REAL", "IMPORT"]
Direction = Literal["loading", "unloading"]


@dataclass(frozen=True)
class Column:
    """One recorded quantity: `data` (m,), numbers in `unit`, floating-point or, for counters and
    status words, whole.
    """

    data: NDArray[Any]
    unit: str

    @property
    def values(self) -> Floats:
        """The quantity in its unit as floating-point numbers, shape (m,)."""
        return self.data.astype(np.float64)


@dataclass(frozen=True)
class Stream:
    """Columns that share one time base. `t_s` (m,) comes from the device's sample counter; 0 is
    the commanded start.
    """

    t_s: Floats
    columns: Mapping[str, Column]


@dataclass(frozen=True)
class Stroke:
    """One flap at one condition. Streams are named for their device: "shaft" and "force", or
    "table" where one file held all.

    `strokes_before` is the number of strokes that the leg had made before in this campaign, None
    where it was not counted.
    """

    height_m: float
    speed_rad_s: float
    repeat: int
    streams: Mapping[str, Stream]
    strokes_before: int | None = None

    def channel(self, name: str) -> tuple[Floats, Floats] | None:
        """(t_s, values), each (m,), of a channel by its name in `channels`; None where it was
        not recorded.
        """
        for stream in self.streams.values():
            if name in stream.columns:
                return stream.t_s, stream.columns[name].values
        return None


@dataclass(frozen=True)
class StaticStage:
    """One settled stage of the static experiment: means after settling.

    `hinge_deg` (6,) is NaN where no photo gave the angle. `hinge_std_deg` (6,), one standard
    deviation of each hinge angle, is NaN where unknown. `hinge_reading_std_deg` (6,) is the part of
    it that differs from photo to photo, NaN where unknown; the rest is how the marks are glued, the
    same in all photos of a leg. `settled` is None where the recording does
    not say. `photo` and `overlay` are paths in the run's folder, `photo_doubts` what the photo did
    not show; "" for none. `strokes_before` as in `Stroke`. `held_s` is how long the shaft had stood
    in the middle of the reading, None where unknown.
    """

    height_m: float
    stage: int
    direction: Direction
    shaft_angle_rad: float
    hinge_deg: tuple[float, ...]
    fy_N: float
    fz_N: float
    tx_Nm: float
    std: Mapping[str, float] = field(default_factory=dict)
    settled: bool | None = None
    hinge_std_deg: tuple[float, ...] = ()
    photo: str = ""
    overlay: str = ""
    photo_doubts: str = ""
    strokes_before: int | None = None
    held_s: float | None = None
    hinge_reading_std_deg: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Raises ValueError for a photo that lies outside the run's folder."""
        if not (is_inside(self.photo) and is_inside(self.overlay)):
            raise ValueError(
                f"the picture {self.photo or self.overlay} of a static stage lies outside "
                "the run's folder"
            )
        for name in ("hinge_std_deg", "hinge_reading_std_deg"):
            if not getattr(self, name):
                # The dataclass is frozen; the default depends on the number of hinges, so a field
                # default cannot state it.
                object.__setattr__(self, name, (math.nan,) * len(self.hinge_deg))

    @property
    def bend_deg(self) -> float:
        """Angle between the first link and the last, without sign: the sum of the hinge angles.
        NaN where one of them is unknown.
        """
        if self.hinge_deg:
            return abs(math.fsum(self.hinge_deg))
        return math.nan


def collect_strokes_before(recorded: Iterable[Stroke | StaticStage]) -> tuple[int, ...]:
    """How many strokes the leg had made before each of these; () where one of them was not
    counted.
    """
    counts = [stage.strokes_before for stage in recorded]
    # All or none: a sequence with gaps is of no use as an order.
    known = tuple(count for count in counts if count is not None)
    if len(known) == len(counts):
        return known
    return ()


@dataclass(frozen=True)
class RawStage:
    """Samples of a stage that is no stroke: those behind the means of a static stage, or of a stage
    that was cut short.

    `cut_short` is the reason, "" for a complete stage. Times count from the commanded start, or
    from the first sample where that never came.
    """

    label: str
    height_m: float
    streams: Mapping[str, Stream]
    cut_short: str = ""


@dataclass(frozen=True)
class Recording:
    """Everything that one run or one campaign recorded. Analyses take `strokes` and `static`; `raw`
    is for a closer look.

    `nominal` holds the sections leg, ground, sensor, drive of the nominal model, `known_to` one
    standard deviation of each nominal value, both as plain data in the file's own units.
    `provenance` is text by name (versions, seed, plan ...).
    """

    title: str
    source: Source
    nominal: Mapping[str, Any]
    known_to: Mapping[str, Any]
    strokes: tuple[Stroke, ...]
    static: tuple[StaticStage, ...]
    provenance: Mapping[str, str] = field(default_factory=dict)
    raw: tuple[RawStage, ...] = ()

    def __post_init__(self) -> None:
        # Titles are printed by nearly every command; the file may come from elsewhere.
        object.__setattr__(self, "title", printable(str(self.title)))

    @property
    def is_listening(self) -> bool:
        """Whether the devices were recorded without any motion by this program."""
        return self.provenance.get("experiment") == LISTENING

    def with_order(self) -> "Recording":
        """The same with its strokes counted, where a rig or a twin recorded them: there they are
        stored in the order of time.
        """
        # Nothing says in which order imported strokes were made.
        if self.source == "IMPORT":
            return self
        return replace(
            self,
            strokes=tuple(
                replace(stroke, strokes_before=before) for before, stroke in enumerate(self.strokes)
            ),
        )


def refuse_other_nominal(recordings: Sequence[Recording], remedy: str) -> None:
    """Raise BadInput, which ends with what to do instead, for the first recording whose nominal
    model or whose [known_to] differs from those of the first one; also for one that was made
    without motion, which has neither.
    """
    for recording in recordings:
        if recording.is_listening:
            raise BadInput(
                f"{recording.title!r} was recorded without motion, so it says nothing of a model; "
                "leave it out"
            )
    first = recordings[0]
    for other in recordings[1:]:
        if other.nominal != first.nominal or other.known_to != first.known_to:
            raise BadInput(
                f"{other.title!r} states other nominal values than {first.title!r}; {remedy}"
            )


def check_header(found: Recording) -> Recording:
    """The recording from a file. Raises ValueError where its source or its nominal values are
    none.
    """
    check_source(found.source)
    if not (isinstance(found.nominal, dict) and isinstance(found.known_to, dict)):
        raise ValueError("its nominal values are not values by name")
    return found


def check_source(source: object) -> Source:
    """The source from a file. Raises ValueError where it is none."""
    if not isinstance(source, str) or source not in get_args(Source):
        raise ValueError(f"source {source!r} is none of {', '.join(get_args(Source))}")
    return cast(Source, source)


def check_texts(provenance: object) -> dict[str, str]:
    """The provenance. Raises ValueError where it is not text by name."""
    if not (
        isinstance(provenance, dict) and all(isinstance(text, str) for text in provenance.values())
    ):
        raise ValueError("its provenance is not text by name")
    return provenance
