"""The exam of photos: 500 drawn ones under all disturbances at once, each by chance; errors by
percentiles, and nothing wrong told.
"""

import numpy as np
import pytest

from rfca_rig.vision.camera_model import CameraModel, Floats
from rfca_rig.vision.hinge_angles import HingeAngles, hinge_angles
from rfca_rig.vision.identify import IdentifiedMarks, identify
from rfca_rig.vision.leg_marks import mark_positions
from rfca_rig.vision.marks import find_marks
from tests.vision.drawing import Look, draw
from tests.vision.scenes import LENGTHS_M, PLAN, camera, pose

PHOTOS = 500
WIDTH_PX = 1200
WRONG_PX = 3.0


def disturbed(random: np.random.Generator) -> Look:
    """Everything that disturbs, each as strong as chance has it."""
    return Look(
        defocus_px=float(random.uniform(0.3, 3.0)),
        noise_counts=float(random.uniform(1.0, 5.0)),
        light_fall=float(random.uniform(0.0, 0.9)),
        exposure=float(random.uniform(0.5, 2.0)),
        glints=int(random.integers(20)),
        covers=tuple(
            (int(i), float(random.uniform(0, 6.3)), float(random.uniform(0.1, 1.0)))
            for i in random.choice(8, random.integers(3), False)
        ),
        left_out=(int(random.integers(8)),) if random.random() < 0.2 else (),
        red_discs_m=tuple(
            (float(random.uniform(-0.05, 0.25)), float(random.uniform(-0.24, 0.03)), 0.0085)
            for _ in range(random.integers(3))
        ),
        red_bars=int(random.integers(2)),
        jpeg_quality=int(random.integers(85, 98)) if random.random() < 0.5 else None,
    )


def read(
    random: np.random.Generator,
) -> tuple[CameraModel, Floats, Look, IdentifiedMarks, HingeAngles]:
    model = camera(
        WIDTH_PX,
        (
            float(random.uniform(-10, 10)),
            float(random.uniform(-10, 10)),
            float(random.uniform(-2, 2)),
        ),
    )
    angles = pose(random)
    look = disturbed(random)
    photo = draw(angles, LENGTHS_M, PLAN, model, look, random)
    expected = float(
        np.mean(model.disc_diameter_px(mark_positions(angles, LENGTHS_M, PLAN), PLAN.diameter_m))
    )
    identified = identify(find_marks(photo, expected), model, PLAN, LENGTHS_M.tolist())
    return (
        model,
        angles,
        look,
        identified,
        hinge_angles(identified, model, PLAN, LENGTHS_M.tolist()),
    )


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_five_hundred_photos(capsys: pytest.CaptureFixture[str]) -> None:
    random = np.random.default_rng(20)
    misses = []
    sigmas = []
    wrong = 0
    asked = 0
    for _ in range(PHOTOS):
        model, angles, look, identified, result = read(random)
        true_px = model.project(mark_positions(angles, LENGTHS_M, PLAN))
        for i, mark in enumerate(identified.marks):
            wrong += mark is not None and (
                i in look.left_out or float(np.linalg.norm(mark.px - true_px[i])) > WRONG_PX
            )
        for true, told, std in zip(
            np.diff(angles, prepend=0.0), result.hinge_rad, result.hinge_std_rad, strict=True
        ):
            asked += 1
            if told is not None and std is not None:
                misses.append(abs(np.degrees(told - true)))
                sigmas.append(abs(told - true) / std)
    median, most = np.percentile(misses, [50, 99])
    covered = np.mean(np.array(sigmas) < 1.96)
    with capsys.disabled():
        print(
            f"\ntold {len(misses)} of {asked}; median {median:.4f}, 99 % {most:.3f}, "
            f"largest {max(misses):.3f} degrees; "
            f"{covered:.1%} inside of 95 %; wrong marks {wrong}"
        )
    assert wrong == 0
    assert median <= 0.05
    assert most <= 0.2
    assert covered > 0.93
