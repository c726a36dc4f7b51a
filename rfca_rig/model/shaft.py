"""Motion of the shaft, prescribed or under the torque of a drive, which closes row 0 of the equations. Symbols as in `state`."""

import numpy as np

from rfca_rig.model.compiled import jit_inline
from rfca_rig.model.state import Floats, Shaft, Work


@jit_inline
def shaft_at(shaft: Shaft, t: float) -> tuple[float, float, float]:
    """(angle, speed, acceleration) of the prescribed shaft; at a break the piece that ends there counts."""
    # Before the first break and after the last one, the outer pieces go on.
    i = min(max(np.searchsorted(shaft.breaks, t) - 1, 0), shaft.coefficient.shape[0] - 1)
    c, x = shaft.coefficient[i], t - shaft.breaks[i]
    return (
        c[0] + x * (c[1] + x * (c[2] + x * c[3])),
        c[1] + x * (2.0 * c[2] + x * 3.0 * c[3]),
        2.0 * c[2] + 6.0 * c[3] * x,
    )


@jit_inline
def drive_torque(shaft: Shaft, angle: float, speed: float, at: float) -> tuple[float, float, float]:
    """Torque on a free shaft that is `angle` and `speed` behind its command, and stands `at` this angle: (T, -dT/dq, -dT/dw)."""
    bent, k_angle, k_speed = angle, shaft.k_angle, shaft.k_speed
    if shaft.gap > 0.0:
        bent = angle - shaft.gap if angle >= shaft.gap else (angle + shaft.gap if angle <= -shaft.gap else 0.0)
        side = np.sign(bent)
        # Hunt and Crossley: the damping grows with the depth, so the torque does not jump at contact; it is never negative, so no pull.
        pressed = max(1.0 + shaft.loss * side * speed, 0.0)
        k_angle *= pressed * abs(side)
        k_speed += shaft.k_angle * abs(bent) * shaft.loss * (pressed > 0.0)
        bent *= pressed
    torque = shaft.feed + shaft.k_angle * bent + shaft.k_speed * speed
    if abs(torque) > shaft.limit:
        torque, k_angle, k_speed = shaft.limit * np.sign(torque), 0.0, 0.0
    # Cogging comes from the magnets, so the limit of the current does not apply to it.
    if shaft.cogging != 0.0:
        electrical = shaft.cycles * (at - shaft.angle) + shaft.phase
        torque += shaft.cogging * np.sin(electrical)
        k_angle -= shaft.cogging * shaft.cycles * np.cos(electrical)
    return torque, k_angle, k_speed


@jit_inline
def drive_rotor(shaft: Shaft, t: float, q: Floats, w: Floats, a: Floats, g: float, derive: bool, work: Work) -> None:
    """Adds rotor and drive torque to row 0, eq. (16), of a free shaft; `q`, `w` and `a` are (c,).

    A prescribed shaft has no row, because its acceleration is known. `derive` says whether J is wanted, with the stage's g.
    """
    if not shaft.free:
        return
    angle, speed = shaft.angle, shaft.speed
    if shaft.breaks.size > 0:
        angle, speed, _ = shaft_at(shaft, t)
    torque, k_angle, k_speed = drive_torque(shaft, angle - q[0], speed - w[0], q[0])
    work.R[0] += shaft.rotor * a[0] - torque
    if derive:
        work.J[0, 0] += shaft.rotor + g * k_speed + g * g * k_angle


@jit_inline
def update_motion(shaft: Shaft, t: float, base_q: Floats, base_w: Floats, g: float, q: Floats, w: Floats, a: Floats) -> None:
    """Writes q and w of a stage from its acceleration, all (c,); a prescribed shaft follows its command exactly."""
    for i in range(q.size):
        w[i] = base_w[i] + g * a[i]
        q[i] = base_q[i] + g * w[i]
    if not shaft.free:
        q[0], w[0], a[0] = shaft_at(shaft, t)
