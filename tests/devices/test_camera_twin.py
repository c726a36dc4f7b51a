"""The twin's camera: its pictures against the pinhole worked out by hand, and every disturbance
doing what it says.
"""

from dataclasses import dataclass, fields, replace

import cv2
import numpy as np
import pytest

from rfca_rig.bench.sensors import TwinCamera
from rfca_rig.clock import TwinClock
from rfca_rig.errors import BadInput
from rfca_rig.twins.camera import CameraTwin, ImageDisturbance, render_leg
from rfca_rig.twins.image_noise import compute_coverage, render_sensor_image
from rfca_rig.vision.camera_model import CameraModel
from rfca_rig.vision.leg_marks import MarkPlan, PlannedMark

LENGTHS_M = np.array([0.054, *[0.03933] * 6])
ANGLES = np.radians([20.0, 14.0, 6.0, -3.0, -10.0, -20.0, -28.0])
PLAN = MarkPlan.at_hinges(LENGTHS_M.tolist())
FOCAL = 2000.0
SIZE = (1024, 768)
ALL = ImageDisturbance(
    defocus_px=2.0,
    noise_counts=4.0,
    uneven_light=0.5,
    glints=10,
    hidden_mark=4,
    hidden_share=0.5,
    red_things=3,
    reflection=0.3,
    jpeg_quality=85,
)


def straight_on(side: int = -1, distortion=(0.0,) * 5) -> CameraModel:
    """Looks along the plane's normal from 0.8 m: from +x with +y to the right, from -x with +y
    to the left.
    """
    rows = np.array([[0.0, -side, 0.0], [0.0, 0.0, -1.0], [side, 0.0, 0.0]], dtype=np.float64)
    matrix = np.array([[FOCAL, 0.0, 500.0], [0.0, FOCAL, 380.0], [0.0, 0.0, 1.0]])
    return CameraModel(
        matrix, np.array(distortion), SIZE, rows, np.array([side * 0.15, -0.05, 0.8])
    )


def rendered(disturbance=None, seed=1, angles=ANGLES, plan=PLAN, camera=None, ground=None):
    camera = camera or straight_on()
    return render_leg(
        angles,
        LENGTHS_M,
        plan,
        camera,
        disturbance or ImageDisturbance(),
        np.random.default_rng(seed),
        ground,
    )


def red_light(image):
    """Linear light of red beyond grey."""
    share = image.astype(np.float64) / 255.0
    light = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.clip(light[..., 2] - light[..., 1] - 0.01, 0.0, None)


def centre_near(image, px, reach=22):
    """Middle of the red light around `px`, and how much there is."""
    column, row = np.round(px).astype(int)
    light = red_light(image)[row - reach : row + reach + 1, column - reach : column + reach + 1]
    rows, columns = np.mgrid[row - reach : row + reach + 1, column - reach : column + reach + 1]
    return np.array([(light * columns).sum(), (light * rows).sum()]) / light.sum(), light.sum()


def by_hand(plan=PLAN, side=-1):
    """Pixels of the marks before the straight camera."""
    hinges = np.vstack(
        [
            [0.0, 0.0],
            np.cumsum(
                LENGTHS_M[:, None] * np.column_stack([np.cos(ANGLES), np.sin(ANGLES)]), axis=0
            ),
        ]
    )
    px = []
    for mark in plan.marks:
        angle = ANGLES[mark.link - 1]
        y, z = hinges[mark.link - 1] + mark.along_m * np.array([np.cos(angle), np.sin(angle)])
        y, z = np.array([y, z]) + mark.across_m * np.array([-np.sin(angle), np.cos(angle)])
        px.append(
            [500.0 + FOCAL * (-side * y + side * 0.15) / 0.8, 380.0 + FOCAL * (z - 0.05) / 0.8]
        )
    return np.array(px)


@pytest.mark.parametrize("side", [-1, 1])
def test_marks_are_where_a_pinhole_puts_them(side):
    plan = MarkPlan(
        (
            PlannedMark(1, 0.0),
            PlannedMark(2, 0.01, 0.004),
            PlannedMark(4, 0.02, -0.003),
            PlannedMark(7, 0.03933),
        )
    )
    camera = straight_on(side)
    image = rendered(plan=plan, camera=camera)
    assert image.shape == (768, 1024, 3)
    assert image.dtype == np.uint8
    area = np.pi * (0.5 * plan.diameter_m * FOCAL / 0.8) ** 2
    for px in by_hand(plan, side):
        middle, light = centre_near(image, px)
        assert middle == pytest.approx(px, abs=0.02)
        assert light == pytest.approx(area * (0.5 - 0.03 - 0.01), rel=0.02)


def test_the_lens_bends_the_picture_as_it_should():
    """k1 moves a point at the radius r (in focal lengths) outwards by k1 r**3, seen where the
    disc is small beside the bend.
    """
    image = rendered(camera=straight_on(distortion=(0.6, 0.0, 0.0, 0.0, 0.0)))
    for px in by_hand():
        offset = px - [500.0, 380.0]
        bent = [500.0, 380.0] + offset * (1.0 + 0.6 * (offset @ offset) / FOCAL**2)
        assert centre_near(image, bent)[0] == pytest.approx(bent, abs=0.05)


def test_the_same_chance_gives_the_same_picture():
    first = rendered(ALL, ground=0.12)
    assert np.array_equal(first, rendered(ALL, ground=0.12))
    assert not np.array_equal(first, rendered(ALL, seed=2, ground=0.12))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [field.name for field in fields(ImageDisturbance) if field.name != "hidden_share"]
)
def test_every_disturbance_changes_the_picture(name):
    turned = cv2.Rodrigues(np.array([0.3, 0.0, 0.0]))[0] @ straight_on().rotation
    from_above = replace(
        straight_on(),
        rotation=turned,
        translation_m=np.array([0.0, 0.0, 0.8]) - turned @ [0.0, 0.15, -0.05],
    )
    assert (-turned.T @ from_above.translation_m)[2] > 0.1
    near_the_ground = ANGLES + np.radians(12.0)
    absent = replace(
        ALL,
        **{
            name: type(getattr(ALL, name))()
            if name not in ("hidden_mark", "jpeg_quality")
            else None
        },
    )
    with_it, without = (
        rendered(each, angles=near_the_ground, camera=from_above, ground=0.085)
        for each in (ALL, absent)
    )
    assert np.abs(with_it.astype(int) - without).max() > 5


def test_out_of_focus_keeps_the_light_and_the_place():
    sharp = rendered()
    soft = rendered(ImageDisturbance(defocus_px=5.0))
    for px in by_hand():
        here, light = centre_near(sharp, px)
        there, same = centre_near(soft, px)
        assert there == pytest.approx(here, abs=0.05)
        assert same == pytest.approx(light, rel=0.06)
    assert (
        np.abs(np.diff(soft[..., 2].astype(int), axis=1)).max()
        < 0.5 * np.abs(np.diff(sharp[..., 2].astype(int), axis=1)).max()
    )


def test_light_is_encoded_by_the_curve_of_srgb_and_rounded():
    """Formula of IEC 61966-2-1, here in double precision: the nearest numbers beside a step may
    fall on either side of it.
    """
    light = np.linspace(-0.1, 1.1, 3 * 500_001).astype(np.float32).reshape(-1, 3, 3)
    exact = np.clip(light.astype(float), 0.0, 1.0)
    counts = 255.0 * np.where(exact <= 0.0031308, 12.92 * exact, 1.055 * exact ** (1 / 2.4) - 0.055)
    image = render_sensor_image(light, ImageDisturbance(), np.random.default_rng(1))
    assert np.abs(image - counts).max() < 0.5 + 1e-3
    assert (image != np.round(counts)).mean() < 1e-4


def test_noise_is_as_strong_as_it_says_at_mid_grey_and_grows_with_the_light():
    random = np.random.default_rng(3)
    grey, bright = (np.full((200, 200, 3), light, np.float32) for light in (0.2, 0.6))
    spread = [
        render_sensor_image(light, ImageDisturbance(noise_counts=5.0), random).std()
        for light in (grey, bright)
    ]
    assert spread[0] == pytest.approx(5.0, rel=0.05)
    slope = (0.6 / 0.2) ** (1 / 2.4 - 1.0)  # of sRGB's curve, that much flatter there
    assert spread[1] == pytest.approx(5.0 * slope * np.sqrt(0.62 / 0.22), rel=0.05)


@pytest.mark.parametrize("share", [0.3, 0.5, 0.7])
def test_the_frame_hides_the_share_it_says(share):
    """Of a disc's diameter; the area left is a segment's."""
    hidden = rendered(ImageDisturbance(hidden_mark=2, hidden_share=share))
    px = by_hand()[2]
    depth = 1.0 - 2.0 * share
    left = (np.pi - np.arccos(depth) + depth * np.sqrt(1.0 - depth**2)) / np.pi
    assert centre_near(hidden, px)[1] / centre_near(rendered(), px)[1] == pytest.approx(
        left, abs=0.02
    )


def test_light_falls_off_by_the_share_it_says():
    even, uneven = (
        rendered(ImageDisturbance(uneven_light=share), plan=PLAN)[..., 1].astype(float)
        for share in (0.0, 0.6)
    )
    linear = [
        np.where(image <= 10.0, image / 255 / 12.92, ((image / 255 + 0.055) / 1.055) ** 2.4)
        for image in (even, uneven)
    ]
    ratio = linear[1][even > 20] / linear[0][even > 20]
    assert ratio.max() < 1.05
    assert 0.3 < ratio.min() < 0.6


def test_red_things_stand_behind_the_leg():
    things = rendered(ImageDisturbance(red_things=60))
    clean = rendered()
    for px in by_hand():
        column, row = np.round(px).astype(int)
        assert np.array_equal(
            things[row - 3 : row + 4, column - 3 : column + 4],
            clean[row - 3 : row + 4, column - 3 : column + 4],
        )
    assert red_light(things).sum() > 1.5 * red_light(clean).sum()


def test_glints_leave_the_marks_as_they_are():
    shining = rendered(ImageDisturbance(glints=80))
    clean = rendered()
    assert (shining.min(axis=2) > 200).sum() > 200
    for px in by_hand():
        column, row = np.round(px).astype(int)
        assert np.array_equal(
            shining[row - 6 : row + 7, column - 6 : column + 7],
            clean[row - 6 : row + 7, column - 6 : column + 7],
        )


@pytest.mark.parametrize("middle", [(20.0, 20.0), (20.3, 19.6), (20.5, 20.5), (0.0, 11.0)])
def test_covered_shares_have_the_area_and_the_middle_of_the_shape(middle):
    turn = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    rows, columns, share = compute_coverage(
        (60, 60), np.array(middle) + 7.0 * np.column_stack([np.cos(turn), np.sin(turn)])
    )
    if middle[0] > 10.0:
        where = np.mgrid[rows, columns]
        assert [
            (share * where[1]).sum() / share.sum(),
            (share * where[0]).sum() / share.sum(),
        ] == pytest.approx(middle, abs=0.01)
        assert share.sum() == pytest.approx(np.pi * 49.0, rel=0.03)
    else:
        assert share.sum() == pytest.approx(
            np.pi * 49.0 / 2 + 7.0, rel=0.03
        )  # half of it, and half a pixel


def test_a_shape_outside_covers_nothing():
    assert compute_coverage((60, 60), np.array([[-9.0, -9.0], [-5.0, -9.0], [-5.0, -5.0]])) is None


@dataclass
class Leg:
    angles: np.ndarray

    def link_angles_rad(self):
        return self.angles

    def link_lengths_m(self):
        return LENGTHS_M

    def ground_depth_m(self):
        return 0.2


def test_the_twin_shows_the_leg_as_it_stands_at_the_time():
    leg = Leg(ANGLES)
    clock = TwinClock()
    camera = TwinCamera(
        CameraTwin(leg, PLAN, straight_on(), ImageDisturbance(), np.random.default_rng(1)), clock
    )
    first = camera.photo()
    leg.angles = ANGLES + 0.2
    clock.wait_until(2.5)
    second = camera.photo()
    assert (first.host_s, first.name, second.host_s, second.name) == (
        0.0,
        "photo-001",
        2.5,
        "photo-002",
    )
    assert np.array_equal(first.image, rendered(ground=0.2))
    px = [
        500.0 + FOCAL * (0.054 * np.cos(ANGLES[0] + 0.2) - 0.15) / 0.8,
        380.0 + FOCAL * (0.054 * np.sin(ANGLES[0] + 0.2) - 0.05) / 0.8,
    ]
    assert centre_near(second.image, px)[0] == pytest.approx(px, abs=0.02)


@pytest.mark.parametrize(
    "asked",
    [{"plan": MarkPlan((PlannedMark(8, 0.0),))}, {"disturbance": ImageDisturbance(hidden_mark=8)}],
)
def test_marks_that_are_not_there_are_refused(asked):
    with pytest.raises(
        BadInput,
        match=r"marks: one is to be on link 8, the leg has 7|hidden_mark 8: should be 0 to 7",
    ):
        rendered(**asked)
