"""All causes that are known by name."""

from tests.runner_faults.bus_causes import BUS_CAUSES
from tests.runner_faults.cause import Cause
from tests.runner_faults.computer_causes import COMPUTER_CAUSES
from tests.runner_faults.drive_causes import DRIVE_CAUSES
from tests.runner_faults.operator_causes import OPERATOR_CAUSES
from tests.runner_faults.sensor_causes import SENSOR_CAUSES

CAUSES: dict[str, Cause] = {
    cause.name: cause
    for cause in (*SENSOR_CAUSES, *DRIVE_CAUSES, *BUS_CAUSES, *COMPUTER_CAUSES, *OPERATOR_CAUSES)
}
