"""Evaluates the UDP receive buffer that the system grants for the force stream."""

from rfca_rig.doctor.finding import Finding, green, yellow

SUBJECT = "receive buffer"
# What Linux charges for a datagram of one record: 256 of them fill the default of 212992 bytes.
KERNEL_BYTES_PER_DATAGRAM = 832


def judge_receive_buffer(granted_bytes: int, asked_bytes: int, rate_Hz: float) -> Finding:
    """Finding on the receive buffer. `rate_Hz` is the record rate; in the worst case each record has its own datagram."""
    if granted_bytes >= asked_bytes:
        return green(SUBJECT, f"{granted_bytes >> 10} KiB granted, {asked_bytes >> 10} asked for")
    holds_ms = 1e3 * granted_bytes / KERNEL_BYTES_PER_DATAGRAM / rate_Hz
    summary = f"{granted_bytes >> 10} KiB granted of {asked_bytes >> 10} asked for: {holds_ms:.0f} ms of single records at {rate_Hz:g} Hz"
    fix = "allow more; a file in /etc/sysctl.d makes it last over a restart:"
    return yellow(SUBJECT, summary, fix, f"sudo sysctl -w net.core.rmem_max={asked_bytes}")
