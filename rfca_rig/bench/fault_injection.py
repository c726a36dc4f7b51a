"""Faults that can be injected into the devices of a rig file, and their injection into a twin in
this process.
"""

from collections.abc import Callable, Mapping, Sequence

import can

from rfca_rig.description.rig_file import RigFile
from rfca_rig.devices import find_motor, find_sensor, load_object
from rfca_rig.twin_server.faults import (
    CAN_FAULTS,
    DriveFaults,
    Fault,
    FaultEvent,
    FaultPanel,
    FaultSchedule,
    TamperedBus,
)
from rfca_rig.twin_server.sensor_mount import MOUNT_FAULTS
from rfca_rig.twins.world import MotorTwin


def faults_of(rig: RigFile) -> tuple[Fault, ...]:
    """Every fault that this rig's devices can have, except those of ports for other programs."""
    wire = find_sensor(rig.force_sensor.device).find_wire()
    faults = (*MOUNT_FAULTS, *CAN_FAULTS, *drive_faults_of(rig).faults)
    if wire is None:
        return faults
    return (*wire.faults, *faults)


def faults_of_served_rig(rig: RigFile) -> tuple[Fault, ...]:
    """The same for a rig whose devices are on ports for other programs."""
    wire = find_sensor(rig.force_sensor.device).find_wire()
    if wire is None:
        return faults_of(rig)
    return (*faults_of(rig), *wire.port_faults)


def drive_faults_of(rig: RigFile) -> DriveFaults:
    """The faults of the rig's drive, none where its make names none."""
    reference = find_motor(rig.motor.device).faults
    if reference is None:
        return DriveFaults()
    faults: DriveFaults = load_object(reference)
    return faults


class FaultInjection:
    """Faults of a twin in this process, switched by the rig's own clock. Without orders it
    changes nothing.
    """

    def __init__(self, rig: RigFile, orders: Sequence[FaultEvent]) -> None:
        """Raises BadInput for an order that names no fault of this rig."""
        self._rig = rig
        self._is_idle = not orders
        self._panel = FaultPanel(faults_of(rig))
        # Refuses orders of unknown faults.
        self._agenda = FaultSchedule(orders, self._panel)
        # A fault at 0 s is there from the beginning: settings are read before any time passes.
        self._agenda.pass_to(0.0)

    def on_bus(self, end: can.BusABC) -> can.BusABC:
        """The drive's end of the wire."""
        if self._is_idle:
            return end
        return TamperedBus(end, self._panel, drive_faults_of(self._rig).dialect)

    @property
    def panel(self) -> FaultPanel | None:
        """The switches of the sensor's faults; None where nothing is ordered."""
        if self._is_idle:
            return None
        return self._panel

    def with_faults(
        self, process: Callable[[float], None], motor: MotorTwin | None
    ) -> Callable[[float], None]:
        """`process`, which advances the twins to a time, preceded by the faults that are due
        until then. `motor` is None where there is only a sensor.
        """
        if self._is_idle:
            return process
        events: Mapping[str, Callable[[], None]] = {}
        if motor is not None:
            events = drive_faults_of(self._rig).events(motor)

        def process_with_faults(to_s: float) -> None:
            # Switched before the step, so that a fault acts from its time on and not one step
            # later.
            self._agenda.pass_to(to_s)
            self._panel.run_pending(events)
            process(to_s)

        return process_with_faults
