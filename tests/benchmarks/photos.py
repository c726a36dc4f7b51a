"""Marks and hinge angles from ray-traced photos with every disturbance.

Run: python -m tests.benchmarks.photos FOLDER [--legs 60]

Draws legs from a seed, photographs each in several stages, reads the photos as a static run does,
and prints a table. What is in FOLDER already is not done again, so that it can be interrupted;
`--reading NAME` keeps the readings of several versions of the reader apart. `--finished` only uses
the legs that have their photos.

A mark is visible where 60 % or more of it is not hidden, and it is inside the picture. An error is
silent where it is larger than three stated standard deviations.
"""

import argparse
import json
from collections import Counter
from functools import partial
from multiprocessing import Pool
from pathlib import Path

import cv2
import numpy as np

from rfca_rig.vision.hinge_angles import fit_leg, hinge_angles
from rfca_rig.vision.leg_photo import PhotoSetup, read_marks
from tests.vision.ray_scenes import (
    camera_model,
    draw_leg,
    mark_places,
    photograph,
    project,
    true_hinges_rad,
)
from tests.vision.scenes import LENGTHS_M, PLAN

WIDTH_PX = 1632
LARGE_WIDTH_PX = 4000
VISIBLE_SHARE = 0.6
WHOLE_SHARE = 0.98
# A mark that is farther from its true place than this share of its diameter is another thing.
WRONG_SHARE = 0.25
SILENT_SIGMAS = 3.0


def make_leg(number, folder, seed, stages, large_every):
    """The leg of a number, with its photos on disk and what they should show in `truth.json`."""
    place = folder / f"leg-{number:03d}"
    leg = draw_leg(
        1000 * seed + number,
        LARGE_WIDTH_PX if number % large_every == large_every - 1 else WIDTH_PX,
        stages,
    )
    truth = place / "truth.json"
    if not truth.exists():
        (place / "photos").mkdir(parents=True, exist_ok=True)
        seen = []
        for stage in range(stages):
            photo, shares = photograph(leg, stage)
            cv2.imwrite(
                str(place / "photos" / f"{stage + 1:03d}.png"),
                photo,
                [cv2.IMWRITE_PNG_COMPRESSION, 1],
            )
            px = project(leg.lens, np.column_stack([leg.offsets_m, mark_places(leg, stage)]))
            border = 0.6 * leg.lens.focal_px * PLAN.diameter_m / abs(leg.lens.position_m[0])
            inside = ((px > border) & (px < np.array(leg.lens.size_px) - border)).all(axis=1)
            hinges = true_hinges_rad(leg, stage)
            seen.append(
                {
                    "visible": np.where(inside, shares, 0.0).tolist(),
                    "px": px.tolist(),
                    "hinge_rad": hinges.tolist(),
                }
            )
        truth.write_text(
            json.dumps({"kinds": leg.kinds, "width_px": leg.lens.size_px[0], "stages": seen}),
            encoding="utf-8",
        )
    return place, leg


def read_leg(number, folder, seed, stages, large_every, reading):
    """What the reader makes of a leg's photos, kept in a file: marks per photo, hinge angles of
    each photo alone, and of all together.
    """
    place, leg = make_leg(number, folder, seed, stages, large_every)
    path = place / f"read-{reading}.json"
    if not reading or path.exists():
        return
    eye = PhotoSetup(camera_model(leg.lens), PLAN, tuple(LENGTHS_M.tolist()))
    marks = [
        read_marks(cv2.imread(str(place / "photos" / f"{stage + 1:03d}.png")), eye)
        for stage in range(stages)
    ]
    alone = [hinge_angles(one, eye.camera, PLAN, eye.link_lengths_m) for one in marks]
    fit = fit_leg(marks, eye.camera, PLAN, eye.link_lengths_m)
    found = {
        "marks": [
            {
                "px": [None if mark is None else mark.px.tolist() for mark in one.marks],
                "std_px": [None if mark is None else mark.std_px.tolist() for mark in one.marks],
                "doubts": [doubt.words for doubt in one.doubts],
            }
            for one in marks
        ],
        "alone": [
            {"hinge_rad": one.hinge_rad[1:], "hinge_std_rad": one.hinge_std_rad[1:]}
            for one in alone
        ],
        "together": [
            {"hinge_rad": one.hinge_rad[1:], "hinge_std_rad": one.hinge_std_rad[1:]}
            for one in fit.angles
        ],
        "refused": fit.refused,
    }
    path.write_text(json.dumps(found), encoding="utf-8")


def as_numbers(values):
    """Array (n,) with NaN for None."""
    return np.array([np.nan if value is None else value for value in values], float)


def labels_of(truth, share):
    """The groups that a mark of which `share` is seen belongs to."""
    kinds = truth["kinds"]
    yield "all"
    yield "12 MP" if truth["width_px"] == LARGE_WIDTH_PX else "2 MP"
    yield from (f"{key}: {kinds[key]}" for key in ("light", "surface", "blur", "plane"))
    if "at marks" in kinds["clutter"]:
        cable = "cable at marks"
    else:
        cable = "cable" if "cable" in kinds["clutter"] else "no cable"
    yield f"clutter: {cable}"
    yield "whole" if share > WHOLE_SHARE else "partly covered"


def count_marks(truth, stage, marks, counts, sigmas):
    """Count the marks of a photo that are used, visible, and wrong."""
    for index, (px, std) in enumerate(zip(marks["px"], marks["std_px"], strict=True)):
        miss = None if px is None else np.array(px) - np.array(stage["px"][index])
        # About the diameter of a mark in the picture.
        counts["wrong"] += (
            miss is not None and float(np.hypot(*miss)) > WRONG_SHARE * 0.017 * truth["width_px"]
        )
        if stage["visible"][index] >= VISIBLE_SHARE:
            for label in labels_of(truth, stage["visible"][index]):
                counts[label, "visible"] += 1
                counts[label, "used"] += miss is not None
        if miss is not None and truth["kinds"]["plane"] == "one plane":
            sigmas.append(miss / np.array(std))


def describe_angles(rows):
    """One line about errors and stated deviations (n, 2) in degrees, NaN where no angle is
    stated.
    """
    error, std = np.abs(np.array(rows, float)).T
    stated = np.isfinite(error)
    if not stated.any():
        return f"none of {len(rows)} stated"
    error = error[stated]
    std = std[stated]
    silent = error[error > SILENT_SIGMAS * std].max(initial=0.0)
    return (
        f"stated {stated.mean():5.1%} of {len(rows)}, error median "
        f"{np.median(error):.3f}, 95 % {np.percentile(error, 95):.3f}, "
        f"largest {error.max():.2f} deg; stated deviation median {np.median(std):.3f} "
        f"deg; rms {np.sqrt(np.mean((error / std) ** 2)):.2f} "
        f"deviations, above 4: {(error > 4 * std).mean():.2%}; worst silent {silent:.2f} deg"
    )


def print_table(folder, legs, reading):
    """The table over all legs that are read."""
    counts = Counter()
    sigmas = []
    angles = {"alone": [], "together": []}
    for place in (folder / f"leg-{number:03d}" for number in range(legs)):
        if not (place / f"read-{reading}.json").exists():
            continue
        truth = json.loads((place / "truth.json").read_text(encoding="utf-8"))
        read = json.loads((place / f"read-{reading}.json").read_text(encoding="utf-8"))
        counts["refused"] += bool(read["refused"])
        groups = {
            "all",
            "12 MP" if truth["width_px"] == LARGE_WIDTH_PX else "2 MP",
            truth["kinds"]["plane"],
        }
        for number, stage in enumerate(truth["stages"]):
            counts["photos"] += 1
            count_marks(truth, stage, read["marks"][number], counts, sigmas)
            for how, rows in angles.items():
                told, std = (
                    as_numbers(read[how][number][key]) for key in ("hinge_rad", "hinge_std_rad")
                )
                pairs = np.degrees(np.column_stack([told - np.array(stage["hinge_rad"]), std]))
                rows += [(groups, pair) for pair in pairs]
    print(
        f"{reading}: {counts['photos']} photos, {counts['wrong']} marks taken for what "
        f"they are not, {counts['refused']} legs refused"
    )
    for label in sorted(key[0] for key in counts if key[1:] == ("visible",)):
        used = counts[label, "used"]
        visible = counts[label, "visible"]
        print(
            f"  marks used of visible, {label:22s} {used:5d} of {visible:5d}, {used / visible:6.1%}"
        )
    off = np.abs(np.array(sigmas)) if sigmas else np.zeros(1)
    print(
        f"  marks in one plane: rms error {np.sqrt(np.mean(off**2)):.2f} stated "
        f"deviations, above 4: {(off > 4).mean():.2%}"
    )
    for how, rows in angles.items():
        for group in ("2 MP", "12 MP", "one plane", "up to 1 mm", "up to 3 mm", "all"):
            if chosen := [pair for groups, pair in rows if group in groups]:
                print(f"  angles {how:8s} {group:10s}: {describe_angles(chosen)}")


def main():
    """Draws, photographs, reads and counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--legs", type=int, default=60)
    parser.add_argument("--stages", type=int, default=6)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--large-every",
        type=int,
        default=15,
        help="every so many legs before a camera of 12 megapixels",
    )
    parser.add_argument(
        "--reading", default="now", help='name of the reading; "" only makes the photos'
    )
    parser.add_argument(
        "--finished", action="store_true", help="read only the legs whose photos are all there"
    )
    parser.add_argument("--processes", type=int, default=2)
    asked = parser.parse_args()
    work = partial(
        read_leg,
        folder=asked.folder,
        seed=asked.seed,
        stages=asked.stages,
        large_every=asked.large_every,
        reading=asked.reading,
    )
    with Pool(asked.processes) as pool:
        legs = [
            k
            for k in range(asked.legs)
            if not asked.finished or (asked.folder / f"leg-{k:03d}" / "truth.json").exists()
        ]
        for _ in pool.imap_unordered(work, legs, chunksize=1):
            pass
    if asked.reading:
        print_table(asked.folder, asked.legs, asked.reading)


if __name__ == "__main__":
    main()
