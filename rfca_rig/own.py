"""Plug-in API: what device files and device packages of a lab import. See docs/add-a-motor.md
and docs/add-a-force-sensor.md.
"""

from rfca_rig.devices import MotorMake, SensorMake
from rfca_rig.devices.sections import ForceSensorKeys, MotorKeys, SerialSensorKeys, SpeedDriveKeys
from rfca_rig.drivers.record_stream import Record, RecordStream
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
    "SensorMake",
    "SerialSensorKeys",
    "SpeedDrive",
    "SpeedDriveKeys",
    "SpeedDriveTwin",
]
