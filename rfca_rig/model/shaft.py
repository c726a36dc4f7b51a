"""What turns the shaft, and the row of the equations it closes. Symbols as in `state`."""

import numpy as np

from rfca_rig.model.compiled import inlined
from rfca_rig.model.state import Floats, Shaft, Work


@inlined
def shaft_at(shaft: Shaft, t: float) -> tuple[float, float, float]:
    """(angle, speed, acceleration) of the prescribed shaft; at a break the piece that ends there counts."""
    i = min(max(np.searchsorted(shaft.breaks, t) - 1, 0), shaft.coefficient.shape[0] - 1)
    c, x = shaft.coefficient[i], t - shaft.breaks[i]
    return (
        c[0] + x * (c[1] + x * (c[2] + x * c[3])),
        c[1] + x * (2.0 * c[2] + x * 3.0 * c[3]),
        2.0 * c[2] + 6.0 * c[3] * x,
    )


@inlined
def drive_torque(shaft: Shaft, angle: float, speed: float, at: float) -> tuple[float, float, float]:
    """The torque on a free shaft that is `angle` and `speed` behind and stands `at` this angle, and by how much it falls with angle and
    speed.
    """
    bent, k_angle, k_speed = angle, shaft.k_angle, shaft.k_speed
    if shaft.gap > 0.0:
        bent = angle - shaft.gap if angle >= shaft.gap else (angle + shaft.gap if angle <= -shaft.gap else 0.0)
        side = np.sign(bent)
        pressed = max(1.0 + shaft.loss * side * speed, 0.0)  # Hunt and Crossley: nothing jumps where it engages, and nothing sticks
        k_angle *= pressed * abs(side)
        k_speed += shaft.k_angle * abs(bent) * shaft.loss * (pressed > 0.0)
        bent *= pressed
    torque = shaft.feed + shaft.k_angle * bent + shaft.k_speed * speed
    if abs(torque) > shaft.limit:
        torque, k_angle, k_speed = shaft.limit * np.sign(torque), 0.0, 0.0
    if shaft.cogging != 0.0:  # of the magnets: no limit of the current holds for it
        turned = shaft.cycles * (at - shaft.angle) + shaft.phase
        torque += shaft.cogging * np.sin(turned)
        k_angle -= shaft.cogging * shaft.cycles * np.cos(turned)
    return torque, k_angle, k_speed


@inlined
def drive_rotor(shaft: Shaft, t: float, q: Floats, w: Floats, a: Floats, g: float, derive: bool, work: Work) -> None:
    """Row 0, eq. (16), of a shaft that is free: a torque drives the rotor. A prescribed one has no row, its acceleration is known."""
    if not shaft.free:
        return
    angle, speed = shaft.angle, shaft.speed
    if shaft.breaks.size > 0:
        angle, speed, _ = shaft_at(shaft, t)
    torque, k_angle, k_speed = drive_torque(shaft, angle - q[0], speed - w[0], q[0])
    work.R[0] += shaft.rotor * a[0] - torque
    if derive:
        work.J[0, 0] += shaft.rotor + g * k_speed + g * g * k_angle


@inlined
def place(shaft: Shaft, t: float, base_q: Floats, base_w: Floats, g: float, q: Floats, w: Floats, a: Floats) -> None:
    """q and w of a stage from its acceleration; a prescribed shaft is where it is told to be."""
    for i in range(q.size):
        w[i] = base_w[i] + g * a[i]
        q[i] = base_q[i] + g * w[i]
    if not shaft.free:
        q[0], w[0], a[0] = shaft_at(shaft, t)
