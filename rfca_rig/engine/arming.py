"""Before a plan moves anything: proof that the drive stops by itself when this computer falls silent."""

from rfca_rig.engine.bench import Bench

SILENCE_S = 1.0  # the longest that a drive may hold on without a word; its heartbeat takes up to 0.1 s of it to tell


def prove_stop(bench: Bench) -> float:
    """Energises the motor where the shaft stands, falls silent, and returns how many seconds the drive took to let go.

    Raises DeviceError where the drive refuses or goes on. However it ends, the motor is without torque then.
    """
    try:
        bench.motor.enable()
        return bench.motor.prove_watchdog(SILENCE_S)
    finally:
        bench.motor.disable()
