"""The receive buffer that the system grants for the force stream."""

from rfca_rig.doctor.finding import Finding, green, yellow

SUBJECT = "receive buffer"
HOLDS_BYTES = 832  # what Linux counts for a datagram of one record: 256 of them in the usual 212992 bytes


def judge_receive_buffer(granted_bytes: int, asked_bytes: int, rate_Hz: float) -> Finding:
    """`rate_Hz` is that of the records, each in a datagram of its own at worst."""
    if granted_bytes >= asked_bytes:
        return green(SUBJECT, f"{granted_bytes >> 10} KiB granted, {asked_bytes >> 10} asked for")
    holds_ms = 1e3 * granted_bytes / HOLDS_BYTES / rate_Hz
    said = f"{granted_bytes >> 10} KiB granted of {asked_bytes >> 10} asked for: {holds_ms:.0f} ms of single records at {rate_Hz:g} Hz"
    fix = "allow more; a file in /etc/sysctl.d makes it last over a restart:"
    return yellow(SUBJECT, said, fix, f"sudo sysctl -w net.core.rmem_max={asked_bytes}")
