"""Plug-in API: what device files of a lab import. See docs/add-a-motor.md and docs/add-a-force-sensor.md."""

from rfca_rig.description.device_sections import ForceSensorKeys, MotorKeys
from rfca_rig.description.sections import NotNegative, Positive
from rfca_rig.drivers.force_sensors.record_stream import Record, RecordStream
from rfca_rig.drivers.motors.speed_drive import Report, SpeedDrive
from rfca_rig.twins.plugins import RecordStreamTwin, SpeedDriveTwin

__all__ = [
    "ForceSensorKeys",
    "MotorKeys",
    "NotNegative",
    "Positive",
    "Record",
    "RecordStream",
    "RecordStreamTwin",
    "Report",
    "SpeedDrive",
    "SpeedDriveTwin",
]
