"""What photos cost the control loop: python -m tests.benchmarks.photo_load [--seconds 20] [--every
1.0]

A loop of 500 Hz hands its samples, 30 records of force a tick, to the recorder process, in real
time; now and then a photo of 1920 x 1080 noise as well, which the recorder packs and forces to
disk. Shown is the time between ticks, without and with photos; half the drive's watchdog, 50 ms, is
the limit. For comparison the same photos packed in the loop's own process.
"""

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from rfca_rig.clock import WallClock
from rfca_rig.recording import run_folder
from rfca_rig.recording.backend import RecorderClient
from rfca_rig.recording.journal import Begin, End, samples_block
from rfca_rig.recording.model import Recording
from rfca_rig.recording.run_writer import write_picture
from tests.recording.growing import FORCE, FORMS, SHAFT, static_stage

TICK_S = 2e-3
PER_TICK = 30
WATCHDOG_S = 0.1
ROWS = 1080
COLUMNS = 1920
Photographed = Callable[[np.ndarray], str]


def gaps_ms(
    keeper: RecorderClient, seconds: float, every_s: float, photographed: Photographed
) -> np.ndarray:
    """Between the ticks of a loop that ends a stage, with its photo, again and again."""
    clock = WallClock()
    random = np.random.default_rng(1)
    pictures = [random.integers(0, 255, (ROWS, COLUMNS, 3), dtype=np.uint8) for _ in range(3)]
    shaft = np.zeros(1, SHAFT.dtype)
    force = np.zeros(PER_TICK, FORCE.dtype)
    due_s = clock.now_s()
    woke = []
    stages = 0
    keeper.give(Begin("photo load", 0.215, FORMS).block())
    while clock.now_s() < seconds:
        due_s = max(due_s + TICK_S, clock.now_s())
        clock.wait_until(due_s)
        woke.append(clock.now_s())
        keeper.give(samples_block((shaft, force)))
        if clock.now_s() > (stages + 1) * every_s:
            name = photographed(pictures[stages % len(pictures)])
            stages += 1
            keeper.give(End(static=replace(static_stage(4), photo=name)).block())
            keeper.give(Begin("photo load", 0.215, FORMS).block())
    return 1e3 * np.diff(woke)


def in_the_loop(folder: Path) -> Photographed:
    def photographed(picture: np.ndarray) -> str:
        write_picture(folder / "photos" / "in-the-loop.png", picture)
        return ""

    return photographed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="for each of the three")
    parser.add_argument("--every", type=float, default=1.0, help="seconds between photos")
    words = parser.parse_args()
    for name in ("no photos", "photos to the recorder", "photos by the loop itself"):
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place) / "run"
            run_folder.create(folder, Recording("benchmark", "REAL", {}, {}, (), ()))
            keeper = RecorderClient(folder, patient=False)
            photographed = {
                "no photos": lambda _: "",
                "photos to the recorder": keeper.keep_photo,
            }.get(name, in_the_loop(folder))
            found = gaps_ms(keeper, words.seconds, words.every, photographed)
            keeper.finish("done")
            kept = len(list((folder / "photos").glob("0*.png")))
            print(
                f"{name:26s}: median {np.median(found):.2f}, p99 "
                f"{np.percentile(found, 99):.2f}, worst {found.max():.1f} ms "
                f"of {1e3 * WATCHDOG_S / 2:.0f}; {keeper.acknowledged} stages "
                f"acknowledged, {kept} photos on disk",
                flush=True,
            )


if __name__ == "__main__":
    main()
