"""A third way to make a photo of the leg: MuJoCo's own renderer, OpenGL with several samples a
pixel; no lens distortion.

In a process of its own, python -m tests.vision.mujoco_photo FOLDER SEED..., since OpenGL without a
screen may end the process.
"""

import os
import sys
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.vision.camera_model import CameraModel, Floats
from rfca_rig.vision.leg_marks import MarkPlan, mark_positions
from tests.vision.scenes import LENGTHS_M, PLAN, pose
from tests.vision.scenes import camera as distorted_camera

SHELL_HALF_M = 0.0075
IMPOSTOR_M = np.array([0.02, -0.19])


def scene(seed: int) -> tuple[CameraModel, Floats]:
    """Camera and absolute link angles of a numbered photo."""
    random = np.random.default_rng(seed)
    camera = undistorted(
        distorted_camera(1200, (float(random.uniform(-8, 8)), float(random.uniform(-8, 8)), 1.0))
    )
    return camera, pose(random)


def undistorted(camera: CameraModel) -> CameraModel:
    """The same camera with the lens and the middle of the picture that MuJoCo has."""
    width, height = camera.image_size_px
    matrix = np.array(
        [
            [camera.matrix[0, 0], 0, (width - 1) / 2],
            [0, camera.matrix[0, 0], (height - 1) / 2],
            [0, 0, 1.0],
        ]
    )
    return CameraModel(
        matrix, np.zeros(5), camera.image_size_px, camera.rotation, camera.translation_m
    )


def photo(
    angles_rad: Floats, lengths_m: Floats, plan: MarkPlan, camera: CameraModel, impostor_m: Floats
) -> NDArray[np.uint8]:
    """Photo (height, width, 3) BGR of the leg under two lamps, with a red ball behind it."""
    os.environ.setdefault("MUJOCO_GL", "egl")
    import mujoco

    width, height = camera.image_size_px
    model = mujoco.MjModel.from_xml_string(_scene(angles_rad, lengths_m, plan, camera, impostor_m))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, height, width) as renderer:
        renderer.update_scene(data, camera="photo")
        return np.ascontiguousarray(renderer.render()[..., ::-1])


def _scene(
    angles_rad: Floats, lengths_m: Floats, plan: MarkPlan, camera: CameraModel, impostor_m: Floats
) -> str:
    width, height = camera.image_size_px
    side = float(np.sign(-(camera.rotation.T @ camera.translation_m)[0]))
    place = _numbers(-camera.rotation.T @ camera.translation_m)
    axes = _numbers(np.concatenate([camera.rotation[0], -camera.rotation[1]]))
    fovy = np.degrees(2 * np.arctan(height / 2 / camera.matrix[1, 1]))
    marks = mark_positions(angles_rad, lengths_m, plan)
    discs = [_disc(mark, plan.diameter_m / 2, side) for mark in marks]
    return f"""
    <mujoco>
      <visual>
        <global offwidth="{width}" offheight="{height}"/> <quality offsamples="8"/> <map znear="0.05" zfar="50"/>
        <headlight ambient="0.5 0.5 0.5" diffuse="0.3 0.3 0.3" specular="0.3 0.3 0.3"/>
      </visual>
      <worldbody>
        <light pos="{side * 0.6} -0.3 0.4" dir="{-side} 0.6 -0.5" diffuse="0.5 0.5 0.5" specular="0.8 0.8 0.8"/>
        <camera name="photo" pos="{place}" xyaxes="{axes}" fovy="{fovy}"/>
        <geom type="sphere" size="0.012" pos="{-side * 0.03} {_numbers(impostor_m)}" rgba="0.8 0.05 0.05 1"/>
        {"".join(_shells(angles_rad, lengths_m, side))}
        {"".join(discs)}
      </worldbody>
    </mujoco>"""


def _numbers(values: Floats) -> str:
    return " ".join(f"{value:.12g}" for value in values)


def _disc(place_m: Floats, radius_m: float, side: float) -> str:
    """A disc whose front is in the plane of the marks; thin, so that its edge is not seen."""
    thin = 2e-5
    ends = f"{-2 * side * thin} {_numbers(place_m)} 0 {_numbers(place_m)}"
    return f'<geom type="cylinder" fromto="{ends}" size="{radius_m}" rgba="0.75 0.06 0.06 1"/>'


def _shells(angles_rad: Floats, lengths_m: Floats, side: float) -> list[str]:
    steps = lengths_m[:, None] * np.column_stack([np.cos(angles_rad), -np.sin(angles_rad)])
    ends = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    x = -side * (SHELL_HALF_M + 1e-4)
    shell = '<geom type="capsule" fromto="{} {} {} {}" size="{}" rgba="0.05 0.05 0.05 1"/>'
    return [shell.format(x, _numbers(a), x, _numbers(b), SHELL_HALF_M) for a, b in pairwise(ends)]


if __name__ == "__main__":
    for number in sys.argv[2:]:
        seen_by, standing = scene(int(number))
        cv2.imwrite(
            str(Path(sys.argv[1]) / f"{number}.png"),
            photo(standing, LENGTHS_M, PLAN, seen_by, IMPOSTOR_M),
        )
