"""Photos by MuJoCo's renderer: the same errors as on photos by outlines, from a program that
knows nothing of marks.
"""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from rfca_rig.vision.hinge_angles import hinge_angles
from rfca_rig.vision.identify import identify
from rfca_rig.vision.leg_marks import mark_positions
from rfca_rig.vision.marks import find_marks
from tests.vision.mujoco_photo import scene
from tests.vision.scenes import LENGTHS_M, PLAN

SEEDS = (0, 1, 2)


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the numbered photos."""
    if importlib.util.find_spec("mujoco") is None:
        pytest.skip("mujoco is not installed")
    folder = tmp_path_factory.mktemp("photos")
    command = [sys.executable, "-m", "tests.vision.mujoco_photo", str(folder), *map(str, SEEDS)]
    environment = os.environ | {"MUJOCO_GL": os.environ.get("MUJOCO_GL", "egl")}
    done = subprocess.run(
        command,
        env=environment,
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    if done.returncode:
        pytest.skip(f"MuJoCo cannot render here: {done.stderr.strip().splitlines()[-1:]}")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_hinge_angles_from_mujocos_photos(photos: Path, seed: int) -> None:
    model, angles = scene(seed)
    picture = cv2.imread(str(photos / f"{seed}.png"))
    noisy = np.clip(
        picture + np.random.default_rng(seed).normal(0, 2.5, picture.shape), 0, 255
    ).astype(np.uint8)
    places = mark_positions(angles, LENGTHS_M, PLAN)
    expected = float(np.mean(model.disc_diameter_px(places, PLAN.diameter_m)))
    identified = identify(find_marks(noisy, expected), model, PLAN, LENGTHS_M.tolist())
    result = hinge_angles(identified, model, PLAN, LENGTHS_M.tolist())
    outside = [
        i
        for i, px in enumerate(model.project(places))
        if not (12 < px[0] < 1188 and 12 < px[1] < 888)
    ]
    assert [i for i, mark in enumerate(identified.marks) if mark is None] == outside
    assert not [doubt for doubt in identified.doubts if doubt.kind not in {"extra", "missing"}]
    told = np.array([value is not None for value in result.hinge_rad])
    miss = (np.array(result.hinge_rad, float) - np.diff(angles, prepend=0.0))[told]
    assert told.sum() >= 7 - 2 * len(outside)
    assert np.abs(np.degrees(miss)).max() < 0.12
    assert (np.abs(miss) < 4.0 * np.array(result.hinge_std_rad, float)[told]).all()
