"""Campaigns whose metadata or columns are wrong."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.exam.simulator.world import World

Floats = NDArray[np.float64]

# Wrong metadata, with the catalogue effects that describe the same thing and count as right.
MISLABELLED: Mapping[str, tuple[str, ...]] = {
    "links longer than written": (),
    "masses written a fifth too low": (),
    "heights written 8 mm too high": ("height_offset",),
    "fy and fz swapped": (),
    "sign of fy": (),
    "tx in N cm": (),
    "speeds of two conditions swapped": (),
    "start angle written 4 degrees too small": (),
}

# The recorded shaft angle reveals these: a diagnosis that uses it has nothing to explain, so "nothing missing" is right.
REVEALED_BY_ENCODER = ("speeds of two conditions swapped", "start angle written 4 degrees too small")


def true_world(world: World, mislabelled: str | None) -> World:
    """The true world behind a campaign whose file describes another one."""
    links = world.links
    if mislabelled == "links longer than written":
        return replace(world, links=replace(links, length_m=tuple(1.05 * each for each in links.length_m)))
    if mislabelled == "masses written a fifth too low":
        return replace(world, links=replace(links, mass_kg=tuple(1.25 * each for each in links.mass_kg)))
    if mislabelled == "heights written 8 mm too high":
        return replace(world, mount=replace(world.mount, height_m=world.mount.height_m - 8e-3))
    if mislabelled == "start angle written 4 degrees too small":
        return replace(world, drive=replace(world.drive, start_angle_rad=world.drive.start_angle_rad + float(np.radians(4.0))))
    return world


def columns_as_written(columns: dict[str, Floats], mislabelled: str | None) -> dict[str, Floats]:
    """The columns, (m,) each, under the names and in the units that the faulty logger gave them."""
    if mislabelled == "fy and fz swapped":
        return {**columns, "fy_N": columns["fz_N"], "fz_N": columns["fy_N"]}
    if mislabelled == "sign of fy":
        return {**columns, "fy_N": -columns["fy_N"]}
    if mislabelled == "tx in N cm":
        return {**columns, "tx_Nm": 100.0 * columns["tx_Nm"]}
    return columns


def speed_as_written(speed: float, speeds: tuple[float, ...], mislabelled: str | None) -> float:
    """The speed as the campaign's file states it: lowest and highest change places where they were swapped."""
    if mislabelled != "speeds of two conditions swapped":
        return speed
    low, high = min(speeds), max(speeds)
    return {low: high, high: low}.get(speed, speed)
