"""A ray tracer for photos of the leg: thin lens, two coloured lights, gloss, red clutter, Bayer
mosaic, JPEG.

It shares no projection, drawing or edge code with the reader of photos. A ray goes from every part
of a pixel, through the lens distortion (inverted by iteration) and a point of the aperture, to the
first surface. Directions: x towards the camera, y along the ground, z up, origin at the shaft axis,
in metres. The sensor samples one colour per pixel, behind a Bayer mosaic."""

from dataclasses import dataclass

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Samples per pixel; where there is only background, per block of pixels.
SAMPLES = 10
TILE_PX = 16
BLOCK_PX = 8
DISC = 0
CAPSULE = 1
SHELL = 2
NO_MARK = -1
BACKGROUND_TEXTURE = 40.0
# The normal of the wall behind the leg, in the tracer's directions.
TOWARDS_CAMERA = (1.0, 0.0, 0.0)


@dataclass(frozen=True)
class Surface:
    """One surface: `kind`, ends a and b (3,) m, radius_m, normal (3,), curvature of the normal
    towards the edge, and its material.

    Colours are red, green, blue reflectances. `gloss` is the specular share, `sharpness` the
    exponent of the highlight."""

    kind: int
    a_m: Floats
    b_m: Floats
    radius_m: float
    colour: Floats
    normal: Floats
    curvature: float = 0.0
    gloss: float = 0.0
    sharpness: float = 20.0
    mark: int = NO_MARK

    def row(self) -> Floats:
        """The surface as numbers (18,) for the compiled tracer."""
        ends = [self.kind, *self.a_m, *self.b_m, self.radius_m]
        return np.array(
            [
                *ends,
                *self.normal,
                self.curvature,
                *self.colour,
                self.gloss,
                self.sharpness,
                self.mark,
            ],
            np.float64,
        )


@dataclass(frozen=True)
class Lens:
    """A camera: position (3,) m; axes (3, 3), rows right, down, forward; focal length px, centre
    px, distortion k1 k2 p1 p2 k3.

    `aperture_m` is the radius of the lens opening, `focus_m` the distance that is in focus.
    """

    position_m: Floats
    axes: Floats
    focal_px: float
    centre_px: tuple[float, float]
    distortion: tuple[float, float, float, float, float]
    size_px: tuple[int, int]
    aperture_m: float
    focus_m: float


@dataclass(frozen=True)
class Lighting:
    """Lights: positions (n, 3) m, colours (n, 3) as red, green, blue, radii (n,) m, and the ambient
    colour (3,).

    Only the surfaces of `blockers` cast shadows on the leg.
    """

    positions_m: Floats
    colours: Floats
    radii_m: Floats
    ambient: Floats
    blockers: tuple[Surface, ...] = ()


@dataclass(frozen=True)
class Sensor:
    """What happens to the light: exposure, shot noise by the electrons at white, read noise,
    demosaicing, sharpening, JPEG quality.
    """

    exposure: float
    full_well: float = 9000.0
    read_electrons: float = 4.0
    blur_px: float = 0.5
    demosaicing: int = cv2.COLOR_BayerBG2BGR_EA
    saturation: float = 1.25
    sharpening: float = 0.0
    jpeg_quality: int | None = 92


def take_photo(
    surfaces: tuple[Surface, ...],
    lens: Lens,
    lighting: Lighting,
    sensor: Sensor,
    background: tuple[float, float],
    random: np.random.Generator,
) -> tuple[NDArray[np.uint8], Floats]:
    """Photo (height, width, 3) BGR, and for each mark the share of its picture that nothing hides.

    `background` is the distance in metres behind the plane of the leg, and the reflectance.
    """
    rows = np.array([surface.row() for surface in surfaces])
    blockers = np.array([surface.row() for surface in lighting.blockers]).reshape(-1, 18)
    marks = int(rows[:, 17].max()) + 1
    offsets, aperture, lamp = _patterns()
    light, hits = _trace(
        rows,
        blockers,
        lens.position_m,
        lens.axes,
        np.array([lens.focal_px, *lens.centre_px, *lens.distortion]),
        np.array(lens.size_px),
        np.array([lens.aperture_m, lens.focus_m]),
        lighting.positions_m,
        lighting.colours,
        lighting.radii_m,
        lighting.ambient,
        np.array(background),
        offsets,
        aperture,
        lamp,
        marks,
    )
    return _expose(light, sensor, random), hits[:, 0] / np.maximum(hits[:, 1], 1.0)


def _patterns() -> tuple[Floats, Floats, Floats]:
    """Places of the samples in the pixel, and on the discs of the aperture and the lamps, (SAMPLES,
    2) each.

    Every sample has an opposite one, in the pixel and in the aperture: a lopsided blur would move
    the edges."""
    half = SAMPLES // 2
    # The R2 sequence: even coverage of a square, with any number of samples.
    square = (
        0.5 + np.arange(3 * half)[:, None] * np.array([0.7548776662466927, 0.5698402909980532])
    ) % 1.0
    pixel = square[:half] - 0.5
    discs = []
    for part in (square[half : 2 * half], square[2 * half :]):
        turn = np.pi * part[:, 0]
        radius = np.sqrt(part[:, 1])
        disc = np.column_stack([radius * np.cos(turn), radius * np.sin(turn)])
        discs.append(np.vstack([disc, -disc]))
    return np.vstack([pixel, -pixel]), discs[0], discs[1]


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "arcp"})
def _ideal(u, v, camera):
    """Undistorted x, y at depth 1 of a pixel, by iteration."""
    xd = (u - camera[1]) / camera[0]
    yd = (v - camera[2]) / camera[0]
    x = xd
    y = yd
    for _ in range(6):
        square = x * x + y * y
        radial = 1.0 + square * (camera[3] + square * (camera[4] + square * camera[7]))
        x, y = (
            (xd - 2.0 * camera[5] * x * y - camera[6] * (square + 2.0 * x * x)) / radial,
            (yd - camera[5] * (square + 2.0 * y * y) - 2.0 * camera[6] * x * y) / radial,
        )
    return x, y


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "arcp"})
def _hit(rows, at, origin, way, normal):
    """Distance along a ray to a surface, or infinity; the normal (3,) there is written."""
    kind = int(rows[at, 0])
    if kind == CAPSULE:
        return _hit_capsule(rows, at, origin, way, normal)
    across = way[0] * rows[at, 8] + way[1] * rows[at, 9] + way[2] * rows[at, 10]
    distance = (
        (rows[at, 1] - origin[0]) * rows[at, 8]
        + (rows[at, 2] - origin[1]) * rows[at, 9]
        + (rows[at, 3] - origin[2]) * rows[at, 10]
    ) / across
    if not distance > 1e-6:
        return np.inf
    dx = origin[0] + distance * way[0] - rows[at, 1]
    dy = origin[1] + distance * way[1] - rows[at, 2]
    dz = origin[2] + distance * way[2] - rows[at, 3]
    if kind == SHELL:
        ey = rows[at, 5] - rows[at, 2]
        ez = rows[at, 6] - rows[at, 3]
        share = min(1.0, max(0.0, (dy * ey + dz * ez) / max(1e-12, ey * ey + ez * ez)))
        dx = 0.0
        dy = dy - share * ey
        dz = dz - share * ez
    if dx * dx + dy * dy + dz * dz > rows[at, 7] * rows[at, 7]:
        return np.inf
    bend = rows[at, 11] / rows[at, 7]
    nx = rows[at, 8] + bend * dx
    ny = rows[at, 9] + bend * dy
    nz = rows[at, 10] + bend * dz
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    normal[0] = nx / length
    normal[1] = ny / length
    normal[2] = nz / length
    return distance


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "arcp"})
def _hit_capsule(rows, at, origin, way, normal):
    """As `_hit`, for a rod with round ends."""
    ax = rows[at, 4] - rows[at, 1]
    ay = rows[at, 5] - rows[at, 2]
    az = rows[at, 6] - rows[at, 3]
    ox = origin[0] - rows[at, 1]
    oy = origin[1] - rows[at, 2]
    oz = origin[2] - rows[at, 3]
    axis = ax * ax + ay * ay + az * az
    along_way = ax * way[0] + ay * way[1] + az * way[2]
    along_start = ax * ox + ay * oy + az * oz
    dot = way[0] * ox + way[1] * oy + way[2] * oz
    start = ox * ox + oy * oy + oz * oz
    ways = way[0] ** 2 + way[1] ** 2 + way[2] ** 2
    distance = np.inf
    share = 0.0
    if axis > 1e-12:
        a = axis * ways - along_way * along_way
        b = axis * dot - along_start * along_way
        c = axis * start - along_start * along_start - rows[at, 7] * rows[at, 7] * axis
        root = b * b - a * c
        if root >= 0.0:
            there = (-b - np.sqrt(root)) / a
            place = (along_start + there * along_way) / axis
            if there > 1e-6 and 0.0 < place < 1.0:
                distance = there
                share = place
    if distance == np.inf:
        for end in range(2):
            px = ox - end * ax
            py = oy - end * ay
            pz = oz - end * az
            b = way[0] * px + way[1] * py + way[2] * pz
            root = b * b - ways * (px * px + py * py + pz * pz - rows[at, 7] * rows[at, 7])
            if root >= 0.0:
                there = (-b - np.sqrt(root)) / ways
                if 1e-6 < there < distance:
                    distance = there
                    share = float(end)
    if distance < np.inf:
        normal[0] = (ox + distance * way[0] - share * ax) / rows[at, 7]
        normal[1] = (oy + distance * way[1] - share * ay) / rows[at, 7]
        normal[2] = (oz + distance * way[2] - share * az) / rows[at, 7]
    return distance


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "arcp"})
def _gap(rows, at, origin, way):
    """Distance between the axis of a rod and the straight line from `origin` to `origin + way`."""
    ax = rows[at, 4] - rows[at, 1]
    ay = rows[at, 5] - rows[at, 2]
    az = rows[at, 6] - rows[at, 3]
    rx = rows[at, 1] - origin[0]
    ry = rows[at, 2] - origin[1]
    rz = rows[at, 3] - origin[2]
    a = max(1e-18, ax * ax + ay * ay + az * az)
    e = way[0] ** 2 + way[1] ** 2 + way[2] ** 2
    b = ax * way[0] + ay * way[1] + az * way[2]
    c = ax * rx + ay * ry + az * rz
    f = way[0] * rx + way[1] * ry + way[2] * rz
    steep = a * e - b * b
    if steep > 1e-18:
        s = min(1.0, max(0.0, (b * f - c * e) / steep))
    else:
        s = 0.0
    t = min(1.0, max(0.0, (b * s + f) / e))
    s = min(1.0, max(0.0, (b * t - c) / a))
    dx = rx + s * ax - t * way[0]
    dy = ry + s * ay - t * way[1]
    dz = rz + s * az - t * way[2]
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "arcp"})
def _point_at_spot(lights, radii, number, spots, spot, place, towards):
    """Write the way (3,) from a place to a spot of a lamp."""
    towards[0] = lights[number, 0] - place[0]
    towards[1] = lights[number, 1] + radii[number] * spots[spot, 0] - place[1]
    towards[2] = lights[number, 2] + radii[number] * spots[spot, 1] - place[2]


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "arcp"})
def _is_hidden(blockers, place, to_spot, unused):
    """Whether a blocker stands between a place and a spot of a lamp."""
    for blocker in range(len(blockers)):
        there = _hit(blockers, blocker, place, to_spot, unused)
        if 1e-4 < there < 1.0:
            return True
    return False


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "arcp"})
def _share_of_lamp(lights, radii, number, spots, blockers, place, towards, to_spot, unused):
    """Share of a lamp's spots that nothing hides from a place."""
    is_near = False
    for blocker in range(len(blockers)):
        # Most places are far from every shadow: one test for the whole lamp.
        if _gap(blockers, blocker, place, towards) < blockers[blocker, 7] + 1.5 * radii[number]:
            is_near = True
    if not is_near:
        return 1.0
    share = 0.0
    for spot in range(len(spots)):
        _point_at_spot(lights, radii, number, spots, spot, place, to_spot)
        if not _is_hidden(blockers, place, to_spot, unused):
            share += 1.0 / len(spots)
    return share


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "arcp"})
def _shade(
    rows,
    at,
    place,
    normal,
    way,
    lights,
    colours,
    radii,
    ambient,
    blockers,
    spots,
    sample,
    unused,
    towards,
    to_spot,
    colour,
):
    """Write the light (3,) that a surface sends back along a ray.

    The share of a lamp that is seen from there is taken over all its spots. One spot per ray would
    pair each spot with a point of the aperture: in a penumbra only a lopsided part of the aperture
    would see light, and blur would shift the edges."""
    for channel in range(3):
        colour[channel] = rows[at, 12 + channel] * ambient[channel]
    length = np.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2)
    for number in range(len(lights)):
        _point_at_spot(lights, radii, number, spots, sample, place, towards)
        square = towards[0] ** 2 + towards[1] ** 2 + towards[2] ** 2
        away = np.sqrt(square)
        facing = (normal[0] * towards[0] + normal[1] * towards[1] + normal[2] * towards[2]) / away
        if facing <= 0.0:
            continue
        seen = _share_of_lamp(
            lights, radii, number, spots, blockers, place, towards, to_spot, unused
        )
        if seen == 0.0:
            continue
        hx = towards[0] / away - way[0] / length
        hy = towards[1] / away - way[1] / length
        hz = towards[2] / away - way[2] / length
        half = np.sqrt(hx * hx + hy * hy + hz * hz)
        shine = 0.0
        if rows[at, 15] > 0.0:
            shine = (
                rows[at, 15]
                * max(0.0, (normal[0] * hx + normal[1] * hy + normal[2] * hz) / half)
                ** rows[at, 16]
            )
        for channel in range(3):
            colour[channel] += (
                seen * colours[number, channel] / square * (rows[at, 12 + channel] * facing + shine)
            )


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "arcp"})
def _project_ends(rows, position, axes, camera, aperture):
    """Both ends of each surface in the picture, and its reach around them, (surfaces, 5) px."""
    ends = np.empty((len(rows), 5))
    for number in range(len(rows)):
        for end in range(2):
            p = rows[number, 1 + 3 * end : 4 + 3 * end] - position
            depth = axes[2, 0] * p[0] + axes[2, 1] * p[1] + axes[2, 2] * p[2]
            x = (axes[0, 0] * p[0] + axes[0, 1] * p[1] + axes[0, 2] * p[2]) / depth
            y = (axes[1, 0] * p[0] + axes[1, 1] * p[1] + axes[1, 2] * p[2]) / depth
            square = x * x + y * y
            radial = 1.0 + square * (camera[3] + square * camera[4])
            ends[number, 2 * end] = camera[0] * x * radial + camera[1]
            ends[number, 2 * end + 1] = camera[0] * y * radial + camera[2]
            blur = aperture[0] * abs(depth / aperture[1] - 1.0)
            ends[number, 4] = camera[0] * (rows[number, 7] + blur) / depth + 4.0
    return ends


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "arcp"})
def _list_near(ends, top, left, near):
    """Write the surfaces that a tile may show, and return how many."""
    count = 0
    mu = left + 0.5 * TILE_PX
    mv = top + 0.5 * TILE_PX
    for number in range(len(ends)):
        eu = ends[number, 2] - ends[number, 0]
        ev = ends[number, 3] - ends[number, 1]
        share = ((mu - ends[number, 0]) * eu + (mv - ends[number, 1]) * ev) / max(
            1e-9, eu * eu + ev * ev
        )
        share = min(1.0, max(0.0, share))
        off = np.hypot(mu - ends[number, 0] - share * eu, mv - ends[number, 1] - share * ev)
        if off < ends[number, 4] + 0.75 * TILE_PX:
            near[count] = number
            count += 1
    return count


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "arcp"})
def _aim(position, axes, aperture, disc, x, y, origin, way):
    """Write where a ray starts on the aperture (3,), and its way (3,), through x, y at depth 1."""
    right = aperture[0] * disc[0]
    down = aperture[0] * disc[1]
    for i in range(3):
        shift = right * axes[0, i] + down * axes[1, i]
        origin[i] = position[i] + shift
        way[i] = x * axes[0, i] + y * axes[1, i] + axes[2, i] - shift / aperture[1]


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "arcp"})
def _meet_first(rows, near, count, wall_m, origin, way, place, normal, unused, hits):
    """The surface that a ray meets first, or -1 for the wall behind the leg; place (3,) and normal
    (3,) there are written, and the marks that the ray meets are counted.
    """
    best = np.inf
    first = -1
    for k in range(count):
        there = _hit(rows, near[k], origin, way, unused)
        mark = int(rows[near[k], 17])
        if there < np.inf and mark >= 0:
            hits[mark, 1] += 1.0
        if there < best:
            best = there
            first = near[k]
            for i in range(3):
                normal[i] = unused[i]
    behind = (-wall_m - origin[0]) / way[0]
    if first < 0 or behind < best:
        best = behind
        first = -1
        for i in range(3):
            normal[i] = TOWARDS_CAMERA[i]
    for i in range(3):
        place[i] = origin[i] + best * way[i]
    if first >= 0 and rows[first, 17] >= 0.0:
        hits[int(rows[first, 17]), 0] += 1.0
    return first


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "arcp"})
def _colour_wall(reflectance, place, wall):
    """Write the colour of the wall, of a single row, at a place."""
    folds = np.sin(BACKGROUND_TEXTURE * place[1] + 3.0 * np.sin(17.0 * place[2])) + np.sin(
        61.0 * place[2]
    )
    for i in range(3):
        wall[0, 12 + i] = reflectance * (1.0 + 0.2 * folds)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "arcp"})
def _fill_block(picture, v, u, step, light):
    """Write the light (3,) to all pixels of a block."""
    height, width, _ = picture.shape
    for channel in range(3):
        for down_px in range(min(step, height - v)):
            for right_px in range(min(step, width - u)):
                picture[v + down_px, u + right_px, channel] = light[channel]


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "arcp"})
def _trace(
    rows,
    blockers,
    position,
    axes,
    camera,
    size,
    aperture,
    lights,
    colours,
    radii,
    ambient,
    background,
    offsets,
    discs,
    lamp,
    marks,
):
    """Linear light (height, width, 3), and hits (marks, 2): rays that meet a mark first, and all
    that meet it.
    """
    width = size[0]
    height = size[1]
    picture = np.zeros((height, width, 3), np.float32)
    hits = np.zeros((marks, 2))
    ends = _project_ends(rows, position, axes, camera, aperture)
    near = np.empty(len(rows), np.int64)
    colour = np.empty(3)
    normal = np.empty(3)
    origin = np.empty(3)
    way = np.empty(3)
    place = np.empty(3)
    unused = np.empty(3)
    towards = np.empty(3)
    to_spot = np.empty(3)
    total = np.empty(3)
    wall = np.zeros((1, 18))
    for top in range(0, height, TILE_PX):
        for left in range(0, width, TILE_PX):
            count = _list_near(ends, top, left, near)
            # Nothing but the smooth background: one set of samples for a block of pixels.
            step = 1 if count else BLOCK_PX
            for v in range(top, min(height, top + TILE_PX), step):
                for u in range(left, min(width, left + TILE_PX), step):
                    total[:] = 0.0
                    middle_x, middle_y = _ideal(u, v, camera)
                    for sample in range(len(offsets)):
                        # Within a pixel the lens is linear.
                        x = middle_x + offsets[sample, 0] / camera[0]
                        y = middle_y + offsets[sample, 1] / camera[0]
                        _aim(position, axes, aperture, discs[sample], x, y, origin, way)
                        first = _meet_first(
                            rows,
                            near,
                            count,
                            background[0],
                            origin,
                            way,
                            place,
                            normal,
                            unused,
                            hits,
                        )
                        surfaces = rows
                        at = first
                        if first < 0:
                            _colour_wall(background[1], place, wall)
                            surfaces = wall
                            at = 0
                        _shade(
                            surfaces,
                            at,
                            place,
                            normal,
                            way,
                            lights,
                            colours,
                            radii,
                            ambient,
                            blockers,
                            lamp,
                            sample,
                            unused,
                            towards,
                            to_spot,
                            colour,
                        )
                        for channel in range(3):
                            total[channel] += colour[channel]
                    _fill_block(picture, v, u, step, total / len(offsets))
    return picture, hits


def _expose(
    light: NDArray[np.float32], sensor: Sensor, random: np.random.Generator
) -> NDArray[np.uint8]:
    """Photo (height, width, 3) BGR from linear light: blur of the lens, mosaic, noise,
    demosaicing, colours, sRGB, sharpening, JPEG.
    """
    seen = cv2.GaussianBlur(light, (0, 0), sensor.blur_px) * sensor.exposure
    # OpenCV's BayerBG has red at even rows and columns, and blue at odd ones.
    raw = seen[..., 1].copy()
    raw[0::2, 0::2] = seen[0::2, 0::2, 0]
    raw[1::2, 1::2] = seen[1::2, 1::2, 2]
    # Shot noise of many electrons is normal; its variance is their number.
    spread = np.sqrt(np.clip(raw, 0.0, 1.2) * sensor.full_well + sensor.read_electrons**2)
    electrons = np.minimum(raw, 1.2) * sensor.full_well + spread * random.standard_normal(
        raw.shape, np.float32
    )
    # A pedestal of 256 keeps the noise of black pixels; 12 bits, stored in 16.
    counts = np.clip(np.rint(electrons / sensor.full_well * 3800.0), -256.0, 3839.0) + 256.0
    colours = (
        cv2.cvtColor((counts * 16.0).astype(np.uint16), sensor.demosaicing).astype(np.float32)
        / 16.0
        - 256.0
    )
    linear = colours / 3800.0
    grey = linear.mean(axis=2, keepdims=True)
    linear = np.clip(grey + sensor.saturation * (linear - grey), 0.0, 1.0)
    # The sRGB curve as a table of 4096 steps, finer than any count of the photo.
    steps = np.arange(4096) / 4095.0
    table = (
        np.where(steps < 0.0031308, 12.92 * steps, 1.055 * steps ** (1 / 2.4) - 0.055).astype(
            np.float32
        )
        * 255.0
    )
    coded = table[np.rint(linear * 4095.0).astype(np.int32)]
    if sensor.sharpening:
        coded = coded + sensor.sharpening * (coded - cv2.GaussianBlur(coded, (0, 0), 1.2))
    image = np.clip(np.rint(coded), 0, 255).astype(np.uint8)
    if sensor.jpeg_quality is None:
        return image
    _, packed = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, sensor.jpeg_quality])
    return np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)
