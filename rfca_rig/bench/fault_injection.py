"""Faults that can be injected into the devices of a rig file, and their injection into a twin in this process."""

from collections.abc import Callable, Sequence

import can

from rfca_rig.description.rig_file import RigFile
from rfca_rig.devices import find_motor, load_object
from rfca_rig.devices.force_sensor import NetFtSection
from rfca_rig.twin_server.faults import (
    BOX_FAULTS,
    CAN_FAULTS,
    FORCE_FAULTS,
    DriveFaults,
    Fault,
    FaultEvent,
    FaultPanel,
    FaultSchedule,
    TamperedBus,
)
from rfca_rig.twin_server.netft_ports import TamperedLink
from rfca_rig.twins.wires import DatagramLink
from rfca_rig.twins.world import MotorTwin


def faults_of(rig: RigFile) -> tuple[Fault, ...]:
    """Every fault that this rig's devices can have, except those of the sensor box's own pages."""
    # Faults of the force stream act on UDP datagrams, which only a Net F/T sends.
    force = FORCE_FAULTS if isinstance(rig.force_sensor, NetFtSection) else ()
    return (*force, *CAN_FAULTS, *drive_faults_of(rig).faults)


def faults_of_served_rig(rig: RigFile) -> tuple[Fault, ...]:
    """The same for a rig whose sensor box has pages that clients read."""
    return (*faults_of(rig), *(BOX_FAULTS if isinstance(rig.force_sensor, NetFtSection) else ()))


def drive_faults_of(rig: RigFile) -> DriveFaults:
    """The faults of the rig's drive, none where its make names none."""
    place = find_motor(rig.motor.device).faults
    faults: DriveFaults = DriveFaults() if place is None else load_object(place)
    return faults


class FaultInjection:
    """Faults of a twin in this process, switched by the rig's own clock. Without orders it changes nothing."""

    def __init__(self, rig: RigFile, orders: Sequence[FaultEvent]) -> None:
        """Raises BadInput for an order that names no fault of this rig."""
        self._rig = rig
        self._is_idle = not orders
        self._panel = FaultPanel(faults_of(rig))
        # Refuses orders of unknown faults.
        self._agenda = FaultSchedule(orders, self._panel)

    def on_bus(self, end: can.BusABC) -> can.BusABC:
        """The drive's end of the wire."""
        return end if self._is_idle else TamperedBus(end, self._panel, drive_faults_of(self._rig).dialect)

    def on_link(self, link: DatagramLink) -> DatagramLink:
        """The sensor's end of the network."""
        return link if self._is_idle else TamperedLink(link, self._panel)

    def with_faults(self, process: Callable[[float], None], motor: MotorTwin) -> Callable[[float], None]:
        """`process`, which advances the twins to a time, preceded by the faults that are due until then."""
        if self._is_idle:
            return process
        events = drive_faults_of(self._rig).events(motor)

        def process_with_faults(to_s: float) -> None:
            # Switched before the step, so that a fault acts from its time on and not one step later.
            self._agenda.pass_to(to_s)
            self._panel.run_pending(events)
            process(to_s)

        return process_with_faults
