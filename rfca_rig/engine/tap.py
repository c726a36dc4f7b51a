"""Collects what the devices report while a stage is recorded."""

import numpy as np

from rfca_rig.drivers.blocks import join
from rfca_rig.drivers.roles import ForceSamples, ShaftSamples


class Tap:
    """Open while a stage runs; holds every block as it came."""

    def __init__(self) -> None:
        self._shaft: list[ShaftSamples] = []
        self._force: list[ForceSamples] = []

    def take(self, shaft: ShaftSamples, force: ForceSamples) -> None:
        self._shaft.append(shaft)
        self._force.append(force)

    def shaft(self) -> ShaftSamples:
        return join(self._shaft)

    def force(self) -> ForceSamples:
        return join(self._force)


def host_offset_s(host_s: np.ndarray, device_s: np.ndarray) -> float:
    """What to add to a device's own time to get the host's: the least delay seen is nearest to none.

    Bias: late by the shortest way from device to host, which is well below a millisecond on CAN and on a local network.
    """
    return float(np.min(host_s - device_s))
