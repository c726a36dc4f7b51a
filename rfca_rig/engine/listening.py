"""Listening to the devices of a rig without any motion: the motor is neither enabled nor commanded,
and not disabled at the end either, because it may be another program's.
"""

from collections.abc import Callable

from rfca_rig.drivers.roles import AskedMotor, ForceSamples, ShaftSamples
from rfca_rig.engine.interfaces import Bench, StopRequest
from rfca_rig.subprocesses import HelperWatch

# As in a stroke: a drive that answers requests reports as often as when it is commanded.
PERIOD_S = 0.002

Take = Callable[[ShaftSamples, ForceSamples], None]


def listen(
    bench: Bench,
    duration_s: float,
    begin: Callable[[], None],
    take: Take,
    stop_request: StopRequest | None = None,
    helpers: HelperWatch | None = None,
) -> None:
    """Reads all devices for `duration_s`, or until a stop of any urgency is requested.

    Parameters
    ----------
    bench
        The devices. The sensor streams meanwhile, and is stopped afterwards in every case.
    duration_s
        Time in s.
    begin
        Called when the sensor streams, before anything is read.
    take
        Receives what the devices reported in each period; what it raises ends the listening.
    stop_request
        Written by whatever hears the operator.
    helpers
        Processes that must not end.

    Raises
    ------
    DeviceError
        A device failed, or reports what cannot be true. What it had sent before was handed over.
    """
    stop_request = stop_request or StopRequest()
    helpers = helpers or HelperWatch()
    clock = bench.clock
    motor = bench.motor
    bench.sensor.start()
    try:
        begin()
        now_s = clock.now_s()
        until_s = now_s + duration_s
        while now_s < until_s and not stop_request.level:
            if isinstance(motor, AskedMotor):
                motor.ask()
            # A late period is not made up for by shorter ones, which would send bursts of requests.
            now_s = max(min(now_s + PERIOD_S, until_s), clock.now_s())
            clock.wait_until(now_s)
            take(motor.read(), bench.sensor.read())
            helpers.check()
    finally:
        bench.sensor.stop()
