"""Receives what the engine records: passes it on as blocks, and makes strokes and static stages
of it.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rfca_rig.bench.photo_reader import PhotoReader
from rfca_rig.bench.stage_photos import read_stage_photos
from rfca_rig.clock import Clock
from rfca_rig.drivers.roles import ForceSamples, SensorScale, ShaftSamples
from rfca_rig.engine.loop_gaps import GapCounter
from rfca_rig.engine.stopping import UNKNOWN_STANDSTILL, Cycle, RecordedSamples, Standstill
from rfca_rig.progress import ProgressCount, ignore_progress
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Approach, Cycles, Flap, Hold
from rfca_rig.recording.backend import RunBackend
from rfca_rig.recording.columns import (
    DEVICE_TIME,
    HOST_TIME,
    ColumnForm,
    CommandedStart,
    Rows,
    StreamForm,
    make_stream_from_rows,
)
from rfca_rig.recording.journal import (
    Begin,
    End,
    StrokeCondition,
    event_block,
    samples_block,
    start_block,
)
from rfca_rig.recording.layout import HINGES, SHAFT, UNITS, WRENCH
from rfca_rig.recording.model import StaticStage, Stroke
from rfca_rig.recording.tables import CYCLE_FORM, cycle_row
from rfca_rig.vision.leg_photo import PhotoSetup

Floats = NDArray[np.float64]

# Run clock and wall clock are recorded together at least this often: the wall clock may be set
# while the other goes on.
CLOCK_PAIR_EVERY_S = 10.0


_CLOCKS = (ColumnForm(HOST_TIME, "<f8", "s"), ColumnForm(DEVICE_TIME, "<f8", "s"))

SHAFT_FORM = StreamForm(
    "shaft", (*(ColumnForm(name, "<f8", UNITS[name]) for name in SHAFT), *_CLOCKS)
)
_SHAFT_DTYPE = SHAFT_FORM.dtype


def force_form(scale: SensorScale) -> StreamForm:
    """Layout of the force stream: counts, with their conversion to N and N m."""
    # Channel names end with their unit, which decides the scale.
    per_unit = {"N": scale.counts_per_N, "Nm": scale.counts_per_Nm}
    wrench = (
        ColumnForm(name, "<i4", UNITS[name], 1.0 / per_unit[name.split("_")[1]]) for name in WRENCH
    )
    return StreamForm(
        "force",
        (*wrench, ColumnForm("rdt_sequence", "<i8", ""), ColumnForm("status", "<u4", ""), *_CLOCKS),
    )


_FORCE_DTYPE = force_form(SensorScale(1.0, 1.0, 1.0)).dtype
# The same bytes with the six channels as one field, which is filled at once.
_FORCE_BLOCK_DTYPE = np.dtype(
    [
        ("counts", "<i4", (len(WRENCH),)),
        ("rdt_sequence", "<i8"),
        ("status", "<u4"),
        *_SHAFT_DTYPE.descr[-2:],
    ]
)


def shaft_rows(samples: ShaftSamples) -> Rows:
    """Packed records (m,) of the shaft, laid out as `SHAFT_FORM`."""
    rows = np.empty(len(samples.host_s), _SHAFT_DTYPE)
    for name, values in zip(
        SHAFT, (samples.angle_rad, samples.speed_rad_s, samples.torque_Nm), strict=True
    ):
        rows[name] = values
    rows[HOST_TIME] = samples.host_s
    rows[DEVICE_TIME] = samples.device_s
    return rows


def force_rows(samples: ForceSamples) -> Rows:
    """Packed records (m,) of the force, laid out as `force_form`."""
    rows = np.empty(len(samples.host_s), _FORCE_BLOCK_DTYPE)
    rows["counts"] = samples.counts
    rows["rdt_sequence"] = samples.sequence
    rows["status"] = samples.status
    rows[HOST_TIME] = samples.host_s
    rows[DEVICE_TIME] = samples.device_s
    return rows.view(_FORCE_DTYPE)


def make_commanded_start(start_s: float, turns_rad: float) -> CommandedStart:
    """The start, with the offset that brings the shaft angle within one turn of the stage's own."""
    return CommandedStart(start_s, {"shaft_angle_rad": -turns_rad})


class Recorder:
    """The engine's sink: hands every tick's samples over, so that a crash costs none that were
    taken.

    A stage is safe when the keeper has acknowledged it, possibly a moment after it is done.
    `stages` are the completed static stages; `strokes` has only the last stroke, because an hour of
    them is gigabytes. `where` says in or after which stage the run is, `refused` how many of the
    `samples` the keeper did not take, `ended` how many stages were handed over to their end.
    """

    def __init__(
        self,
        keeper: RunBackend,
        scale: SensorScale,
        clock: Clock,
        reader: PhotoReader | None = None,
    ) -> None:
        """`reader` reads the photos while the run goes on; without it they are read afterwards."""
        self._keeper = keeper
        self._reader = reader
        self._scale = scale
        self._clock = clock
        self._forms = (SHAFT_FORM, force_form(scale))
        self._paired_s = clock.now_s()
        self.samples = self.refused = self.ended = 0
        self.where = "before the first stage"
        self.cycles_done = 0
        self.gaps = GapCounter()
        self.standstill = UNKNOWN_STANDSTILL
        self.bad_samples = "none"
        self.tares: list[Floats] = []
        self.strokes: deque[Stroke] = deque(maxlen=1)
        self.stages: list[StaticStage] = []

    @property
    def worst_gap_s(self) -> float:
        """The longest time without a command to the drive; 0 before the motor is off."""
        return self.gaps.longest_s

    def begin(self, stage: Flap | Hold | Cycles) -> None:
        self.note("stage begins", stage=stage.label)
        self.where = stage.label
        forms = (CYCLE_FORM,) if isinstance(stage, Cycles) else self._forms
        self._keeper.give(Begin(stage.label, stage.height_m, forms).block())

    def start(self, start_s: float, turns_rad: float) -> None:
        self._keeper.give(start_block(make_commanded_start(start_s, turns_rad)))

    def take(self, shaft: ShaftSamples, force: ForceSamples) -> None:
        count = len(shaft.host_s) + len(force.host_s)
        # Counted as refused first: if `give` raises, they stay so.
        self.samples = self.samples + count
        self.refused = self.refused + count
        self._keeper.give(samples_block((shaft_rows(shaft), force_rows(force))))
        self.refused -= count
        self._note_clocks()

    def flap(self, stage: Flap, recorded: RecordedSamples) -> None:
        self._end(End(stroke=StrokeCondition(stage.speed_rad_s, stage.repeat)))
        self.strokes.append(stroke_of(stage, recorded, self._scale))
        self.where = f"after {stage.label}"

    def hold(self, stage: Hold, recorded: RecordedSamples) -> None:
        # The photo before the end of its stage, which names it.
        if recorded.photo:
            photo = self._keeper.keep_photo(recorded.photo.image)
        else:
            photo = ""
        if photo and self._reader is not None:
            self._reader.expect(photo)
        static_stage = replace(static_stage_of(stage, recorded, self._scale), photo=photo)
        self._end(End(static=static_stage))
        self.stages.append(static_stage)
        self.where = f"after {stage.label}"

    def cycle(self, cycle: Cycle) -> None:
        self.samples += 1
        self.cycles_done = cycle.number
        values = cycle.peak_force_N, cycle.peak_moment_Nm, cycle.min_fz_N, cycle.mean_speed_rad_s
        self._keeper.give(
            samples_block((cycle_row(cycle.number, values, cycle.host_s, cycle.device_s),))
        )
        self._note_clocks()

    def cycles(self, stage: Cycles) -> None:
        self._end(End())
        self.note("cycles counted", stage=stage.label, last=self.cycles_done)
        self.where = f"after {stage.label}"

    def _end(self, end: End) -> None:
        self._keeper.give(end.block())
        self.ended += 1

    def begin_listening(self, label: str, forms: Sequence[StreamForm]) -> None:
        """The devices are recorded without motion from now on, in these streams."""
        self.note("stage begins", stage=label)
        self.where = label
        self._keeper.give(Begin(label, 0.0, tuple(forms)).block())
        self._keeper.give(start_block(make_commanded_start(self._clock.now_s(), 0.0)))

    def take_rows(self, rows: Sequence[Rows]) -> None:
        """What was received in one period: packed records (m,) of every stream, in the order of
        their forms.
        """
        count = sum(len(records) for records in rows)
        self.samples += count
        self.refused += count
        self._keeper.give(samples_block(rows))
        self.refused -= count
        self._note_clocks()

    def end_listening(self, label: str) -> None:
        self._end(End())
        self.where = f"after {label}"

    def _note_clocks(self) -> None:
        if self._clock.now_s() - self._paired_s > CLOCK_PAIR_EVERY_S:
            self.note("clocks")

    def take_tare(self, wrench: Floats) -> None:
        """Records the sensor's zero: `wrench` (6,) in N and N m of a leg that hangs still. Its
        drift shows over a run.
        """
        self.tares.append(wrench)
        self.note(
            "tare",
            **{name: round(float(value), 5) for name, value in zip(WRENCH, wrench, strict=True)},
        )

    def tare_drift(self) -> str:
        """Change of the sensor's zero from the first rest to the last, in words."""
        if not self.tares:
            return "unknown: the leg was never seen at rest in the air"
        drift = self.tares[-1] - self.tares[0]
        return (
            f"{np.linalg.norm(drift[:3]):.3f} N, {np.linalg.norm(drift[3:]):.4f} N m from the "
            "first rest in the air to the last"
        )

    def take_first_stroke(self, stage: Approach, peak: Load) -> None:
        self.note(
            "first stroke",
            stage=stage.label,
            force_N=round(peak.force_N, 3),
            torque_Nm=round(peak.torque_Nm, 4),
        )

    def begin_pause(self) -> None:
        self.note("paused")

    def end_pause(self, waited_s: float) -> None:
        self.note("pause ends", waited_s=round(waited_s, 3))

    def off(self, gaps: GapCounter, standstill: Standstill, bad_samples: str) -> None:
        self.gaps = gaps
        self.standstill = standstill
        self.bad_samples = bad_samples

    def note(self, event: str, **about: str | float) -> None:
        """Adds one line to the run's events, with both clocks."""
        self._paired_s = self._clock.now_s()
        self._keeper.give(event_block({"event": event, **self._clocks(), **about}))

    def _clocks(self) -> Mapping[str, str | float]:
        return {"t_s": round(self._paired_s, 6), "utc": self._clock.wall_time().isoformat()}

    def read_photos(
        self, run_folder: Path, eye: PhotoSetup, report_progress: ProgressCount = ignore_progress
    ) -> None:
        """Adds the angles from the photos to `stages`. To be called when nothing moves and the
        keeper has finished.
        """
        known = self._reader.collect() if self._reader is not None else {}
        self.stages = list(read_stage_photos(self.stages, run_folder, eye, report_progress, known))


def stroke_of(stage: Flap, recorded: RecordedSamples, scale: SensorScale) -> Stroke:
    """The stroke with both clocks of each device."""
    start = make_commanded_start(recorded.start_s, recorded.turns_rad)
    streams = {
        "shaft": make_stream_from_rows(SHAFT_FORM, shaft_rows(recorded.shaft), start),
        "force": make_stream_from_rows(force_form(scale), force_rows(recorded.force), start),
    }
    return Stroke(stage.height_m, stage.speed_rad_s, stage.repeat, streams)


def static_stage_of(stage: Hold, recorded: RecordedSamples, scale: SensorScale) -> StaticStage:
    """Means over the averaging time, with the standard deviation of a single sample. Hinge
    angles follow from the photo later.
    """
    counts = recorded.force.counts.astype(np.float64)
    wrench = dict(zip(WRENCH, (counts / _counts_per_unit(scale)).T, strict=True))
    angle_rad = recorded.shaft.angle_rad - recorded.turns_rad
    channels = {
        "shaft_angle_rad": angle_rad,
        "fy_N": wrench["fy_N"],
        "fz_N": wrench["fz_N"],
        "tx_Nm": wrench["tx_Nm"],
    }
    return StaticStage(
        height_m=stage.height_m,
        stage=stage.number,
        direction=stage.direction,
        shaft_angle_rad=float(angle_rad.mean()),
        hinge_deg=(np.nan,) * len(HINGES),
        fy_N=float(channels["fy_N"].mean()),
        fz_N=float(channels["fz_N"].mean()),
        tx_Nm=float(channels["tx_Nm"].mean()),
        std={name: float(values.std(ddof=1)) for name, values in channels.items()},
        settled=recorded.settled,
        photo_doubts=recorded.photo_fault,
        # From the stop of the shaft to the middle of the averaging time.
        held_s=recorded.stood_s + 0.5 * stage.timing.average_s,
    )


def _counts_per_unit(scale: SensorScale) -> Floats:
    return np.repeat([scale.counts_per_N, scale.counts_per_Nm], 3)
