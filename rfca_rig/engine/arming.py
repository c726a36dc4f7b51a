"""Proof, before a plan moves anything, that the drive stops by itself when this computer sends no more commands."""

from rfca_rig.engine.bench import Bench

# The longest that a drive may keep its torque without a command. Its heartbeat, which reports the stop, adds up to
# 0.1 s.
SILENCE_S = 1.0


def prove_stop(bench: Bench) -> float:
    """Energises the motor where the shaft stands, stops commanding, and returns the seconds until the drive removed its torque.

    Raises DeviceError where the drive refuses to be enabled or keeps its torque. In every case the motor is without torque afterwards.
    """
    try:
        bench.motor.enable()
        return bench.motor.prove_watchdog(SILENCE_S)
    finally:
        # Also after a failed proof: a drive whose watchdog did not act must not stay energised.
        bench.motor.disable()
