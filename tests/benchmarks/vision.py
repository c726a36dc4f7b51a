"""Time from a photo of 12 megapixels to hinge angles, and where it goes.

Run: python -m tests.benchmarks.vision
"""

import time

import numpy as np

from rfca_rig.vision.hinge_angles import hinge_angles
from rfca_rig.vision.identify import identify
from rfca_rig.vision.leg_marks import mark_positions
from rfca_rig.vision.leg_photo import draw_overlay
from rfca_rig.vision.marks import find_marks
from tests.vision.drawing import Look, draw
from tests.vision.scenes import LENGTHS_M, PLAN, camera, pose

WIDTH_PX = 4000
ROUNDS = 5


def main() -> None:
    random = np.random.default_rng(1)
    model = camera(WIDTH_PX)
    angles = pose(random)
    photo = draw(
        angles,
        LENGTHS_M,
        PLAN,
        model,
        Look(defocus_px=2.0, glints=8, red_bars=1, light_fall=0.5),
        random,
    )
    expected = float(
        np.mean(model.disc_diameter_px(mark_positions(angles, LENGTHS_M, PLAN), PLAN.diameter_m))
    )
    times = []
    for _ in range(ROUNDS):
        begin = time.perf_counter()
        marks = find_marks(photo, expected)
        found = time.perf_counter()
        identified = identify(marks, model, PLAN, LENGTHS_M.tolist())
        told = time.perf_counter()
        result = hinge_angles(identified, model, PLAN, LENGTHS_M.tolist())
        solved = time.perf_counter()
        draw_overlay(photo, identified, model, PLAN, result)
        times.append(np.diff([begin, found, told, solved, time.perf_counter()]) * 1e3)
    milliseconds = np.median(times, axis=0)
    names = ("marks found", "identified", "hinge angles", "overlay drawn")
    print(f"photo of {photo.shape[1]} x {photo.shape[0]}, marks of {expected:.0f} px")
    for name, value in zip(names, milliseconds, strict=True):
        print(f"{name:16s} {value:8.1f} ms")
    print(f"photos a second  {1e3 / milliseconds[:3].sum():8.1f}, overlay not counted")
    miss = np.array(result.hinge_rad, float) - np.diff(angles, prepend=0.0)
    print(f"largest error    {np.abs(np.degrees(miss)).max():8.4f} degrees")


if __name__ == "__main__":
    main()
