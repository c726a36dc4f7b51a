"""Collects what the devices report while a stage is recorded."""

from collections.abc import Callable

from rfca_rig.drivers.blocks import join
from rfca_rig.drivers.roles import ForceSamples, ShaftSamples

Listener = Callable[[ShaftSamples, ForceSamples], None]


class SampleCollector:
    """Open while a stage runs; holds every block as it came, and hands it on."""

    def __init__(self, listener: Listener) -> None:
        self._listener = listener
        self._shaft: list[ShaftSamples] = []
        self._force: list[ForceSamples] = []

    def take(self, shaft: ShaftSamples, force: ForceSamples) -> None:
        self._shaft.append(shaft)
        self._force.append(force)
        self._listener(shaft, force)

    def shaft(self) -> ShaftSamples:
        return join(self._shaft)

    def force(self) -> ForceSamples:
        return join(self._force)
