"""From what the engine records to what is kept: blocks as the devices give them, then strokes and static stages."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rfca_rig.bench.sample_rows import SHAFT_FORM, commanded_start, force_form, force_rows, shaft_rows
from rfca_rig.bench.stage_photos import read_stage_photos
from rfca_rig.channels import HINGES, WRENCH
from rfca_rig.clock import Clock
from rfca_rig.drivers.roles import ForceSamples, SensorScale, ShaftSamples
from rfca_rig.engine.sink import Recorded
from rfca_rig.protocol.plan import Flap, Hold
from rfca_rig.recording.blocks import Begin, Condition, End, event_block, samples_block, start_block
from rfca_rig.recording.form import StaticStage, Stroke
from rfca_rig.recording.keeper import Keeper
from rfca_rig.recording.photo_store import PhotoStore
from rfca_rig.recording.rows import stream_of
from rfca_rig.vision.leg_photo import Eye

Floats = NDArray[np.float64]

CLOCK_PAIR_EVERY_S = 10.0


class Recorder:
    """The engine's sink: hands every tick's samples over, so that a crash costs none that were taken.

    A stage is safe when the keeper has acknowledged it, which may be a moment after it is done. `strokes` and `stages` are those
    that were done, for the closing lines.
    """

    def __init__(self, keeper: Keeper, scale: SensorScale, clock: Clock, photos: PhotoStore | None = None) -> None:
        """`photos` takes the photos of static stages, where any are taken."""
        self._keeper = keeper
        self._scale = scale
        self._clock = clock
        self._photos = photos
        self._forms = (SHAFT_FORM, force_form(scale))
        self._paired_s = clock.now_s()
        self.samples = 0
        self.worst_gap_s = 0.0
        self.strokes: list[Stroke] = []
        self.stages: list[StaticStage] = []

    def begin(self, stage: Flap | Hold) -> None:
        self.note("stage begins", stage=stage.label)
        self._keeper.give(Begin(stage.label, stage.height_m, self._forms).block())

    def start(self, start_s: float, turns_rad: float) -> None:
        self._keeper.give(start_block(commanded_start(start_s, turns_rad)))

    def take(self, shaft: ShaftSamples, force: ForceSamples) -> None:
        self.samples += len(shaft.host_s) + len(force.host_s)
        self._keeper.give(samples_block((shaft_rows(shaft), force_rows(force))))
        if self._clock.now_s() - self._paired_s > CLOCK_PAIR_EVERY_S:
            self.note("clocks")

    def flap(self, stage: Flap, recorded: Recorded) -> None:
        self._keeper.give(End(stroke=Condition(stage.speed_rad_s, stage.repeat)).block())
        self.strokes.append(stroke_of(stage, recorded, self._scale))

    def hold(self, stage: Hold, recorded: Recorded) -> None:
        static_stage = replace(static_stage_of(stage, recorded, self._scale), photo=self._kept(recorded))
        self._keeper.give(End(static=static_stage).block())
        self.stages.append(static_stage)

    def off(self, worst_gap_s: float) -> None:
        self.worst_gap_s = worst_gap_s

    def note(self, event: str, **about: str | float) -> None:
        """One line for the run's events, with both clocks."""
        self._paired_s = self._clock.now_s()
        self._keeper.give(event_block({"event": event, **self._clocks(), **about}))

    def _clocks(self) -> Mapping[str, str | float]:
        return {"t_s": round(self._paired_s, 6), "utc": self._clock.wall_time().isoformat()}

    def read_photos(self, run_folder: Path, eye: Eye) -> None:
        """Waits until every photo is on disk, and puts what they show into `stages`. For when nothing moves any more."""
        if self._photos is not None:
            lost = self._photos.finish()
            self.stages = list(read_stage_photos(self.stages, run_folder, eye, lost))

    def _kept(self, recorded: Recorded) -> str:
        if recorded.photo is None or self._photos is None:
            return ""
        return self._photos.keep(recorded.photo.image)


def stroke_of(stage: Flap, recorded: Recorded, scale: SensorScale) -> Stroke:
    """The stroke with raw counts, scale and both clocks of each device."""
    start = commanded_start(recorded.start_s, recorded.turns_rad)
    streams = {
        "shaft": stream_of(SHAFT_FORM, shaft_rows(recorded.shaft), start),
        "force": stream_of(force_form(scale), force_rows(recorded.force), start),
    }
    return Stroke(stage.height_m, stage.speed_rad_s, stage.repeat, streams)


def static_stage_of(stage: Hold, recorded: Recorded, scale: SensorScale) -> StaticStage:
    """Means over the averaging time, with the standard deviation of a single sample; hinge angles wait for the photo to be read."""
    counts = recorded.force.counts.astype(np.float64)
    wrench = dict(zip(WRENCH, (counts / _counts_per_unit(scale)).T, strict=True))
    angle_rad = recorded.shaft.angle_rad - recorded.turns_rad
    channels = {"shaft_angle_rad": angle_rad, "fy_N": wrench["fy_N"], "fz_N": wrench["fz_N"], "tx_Nm": wrench["tx_Nm"]}
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
    )


def _counts_per_unit(scale: SensorScale) -> Floats:
    return np.repeat([scale.counts_per_N, scale.counts_per_Nm], 3)
