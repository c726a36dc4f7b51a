"""Plug-in API: what device files and device packages of a lab import. See docs/add-a-motor.md and docs/add-a-force-sensor.md."""

from rfca_rig.devices import MotorMake
from rfca_rig.devices.force_sensor import ForceSensorKeys
from rfca_rig.devices.motor import MotorKeys, SpeedDriveKeys
from rfca_rig.drivers.force_sensors.record_stream import Record, RecordStream
from rfca_rig.drivers.speed_drive import Report, SpeedDrive
from rfca_rig.toml import NotNegative, Positive
from rfca_rig.twins.plugins import RecordStreamTwin, SpeedDriveTwin

__all__ = [
    "ForceSensorKeys",
    "MotorKeys",
    "MotorMake",
    "NotNegative",
    "Positive",
    "Record",
    "RecordStream",
    "RecordStreamTwin",
    "Report",
    "SpeedDrive",
    "SpeedDriveKeys",
    "SpeedDriveTwin",
]
