"""Where the guardian itself fails, the process that it guards does what the guardian was for."""

import can

from rfca_rig.clock import Clock
from rfca_rig.drivers.can_bus import CanBusSettings
from rfca_rig.drivers.guard import LastWord
from rfca_rig.guardian.torque_off import EVERY_S, LEAST_TIMES


def taken_over(settings: CanBusSettings, last_word: LastWord, clock: Clock) -> can.BusABC:
    """The bus, opened here, after the last word was spoken on it a few times. Raises can.CanError where that cannot be done."""
    try:
        bus = settings.open()
    except Exception as error:  # python-can's interfaces raise all sorts
        raise can.CanInitializationError(f"the bus cannot be opened here: {error or type(error).__name__}") from error
    try:
        for _ in range(LEAST_TIMES):
            for message in last_word.frames():
                bus.send(message, timeout=0.0)
            clock.wait_until(clock.now_s() + EVERY_S)
    except Exception as error:
        bus.shutdown()
        raise can.CanOperationError(f"the drive cannot be told from here: {error or type(error).__name__}") from error
    return bus
