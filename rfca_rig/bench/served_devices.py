"""Which openings the devices of a rig file have when they are served."""

from contextlib import ExitStack
from pathlib import Path

import numpy as np

from rfca_rig.bench.force_sensors import make_netft_twins, make_own_twin, make_serial_twin
from rfca_rig.bench.openings import Openings, Reached
from rfca_rig.description.force_sensor_sections import AtiSerialSection, ForceSensorKeys, NetFtSection
from rfca_rig.description.rig_file import RigFile, TwinSection
from rfca_rig.errors import BadInput
from rfca_rig.twin_server.command_port import CommandPort
from rfca_rig.twin_server.faults import FaultPanel
from rfca_rig.twin_server.http_port import HttpPort
from rfca_rig.twin_server.pseudo_terminal import PseudoTerminal
from rfca_rig.twin_server.tampered_link import TamperedLink
from rfca_rig.twin_server.udp_link import UdpLink
from rfca_rig.twins.sensor import SensorTwin


class ServedSensor:
    """Opens the force sensor's ports when it is made, so that a port that is taken is known before anything is computed."""

    def __init__(self, rig: RigFile, openings: Openings, panel: FaultPanel, reached: Reached, stack: ExitStack) -> None:
        """Raises BadInput for a sensor without a wire of its own, and for ports that cannot be had."""
        self._openings, self._panel, self._reached, self._stack = openings, panel, reached, stack
        sensor = rig.force_sensor
        if isinstance(sensor, NetFtSection):
            self._link = UdpLink(openings.host, openings.rdt_port)
            stack.callback(self._link.close)
            reached.note(self._link.address(), host=openings.host, rdt_port=self._link.port)
        elif isinstance(sensor, AtiSerialSection | ForceSensorKeys):
            self._line = PseudoTerminal()
            stack.callback(self._line.close)
            name = "F/T controller" if isinstance(sensor, AtiSerialSection) else Path(sensor.file).name
            reached.note(f"{name} on serial line {self._line.path}", host=openings.host, serial=self._line.path)
        else:
            raise BadInput(f"{rig.rig.title}: a {sensor.device} has no wire that others could read; it works in this process only")

    def twin(self, rig: RigFile, twin: TwinSection, random: np.random.Generator) -> SensorTwin:
        """The sensor's twin on those ports."""
        sensor = rig.force_sensor
        if isinstance(sensor, AtiSerialSection):
            return make_serial_twin(sensor, twin, random, self._line)
        if isinstance(sensor, ForceSensorKeys):
            return make_own_twin(sensor, twin, random, self._line)
        if not isinstance(sensor, NetFtSection):
            raise BadInput(f"{rig.rig.title}: a {sensor.device} cannot be served")
        streaming, box = make_netft_twins(sensor, twin, random, TamperedLink(self._link, self._panel))
        pages = HttpPort(box, self._panel, self._openings.host, self._openings.http_port)
        self._stack.callback(pages.close)
        self._reached.add(pages, http_port=pages.port)
        commands = CommandPort(box, self._openings.host, self._openings.command_port)
        self._stack.callback(commands.close)
        self._reached.add(commands, command_port=commands.port)
        return streaming
