"""Evaluates the folder for runs: free space, write speed, permission."""

from dataclasses import dataclass

from rfca_rig.doctor.finding import Finding, green, red, yellow

SUBJECT = "disk for runs"
LEAST_FREE_BYTES = 200_000_000
GOOD_FREE_BYTES = 2_000_000_000
# A sensor at 15 kHz produces half of this.
LEAST_BYTES_S = 1_000_000
GOOD_BYTES_S = 10_000_000


@dataclass(frozen=True)
class DiskSeen:
    """Observed folder. `error` is why nothing could be written, None if it could."""

    folder: str
    free_bytes: int = 0
    bytes_per_s: float = 0.0
    error: str | None = None


def judge_disk(seen: DiskSeen) -> Finding:
    if seen.error is not None:
        return red(
            SUBJECT, f"{seen.folder} cannot be written: {seen.error}", "choose another folder with --runs, or make it yours:", _own(seen)
        )
    summary = f"{seen.folder}: {seen.free_bytes / 1e9:.1f} GB free, writes {seen.bytes_per_s / 1e6:.0f} MB/s"
    if seen.free_bytes < GOOD_FREE_BYTES:
        finding = red if seen.free_bytes < LEAST_FREE_BYTES else yellow
        return finding(
            SUBJECT, summary, "make room, or choose another disk with --runs; the largest folders:", f"du -sh {seen.folder}/* | sort -h"
        )
    if seen.bytes_per_s < GOOD_BYTES_S:
        finding = red if seen.bytes_per_s < LEAST_BYTES_S else yellow
        return finding(SUBJECT, summary, "choose a local disk with --runs, not a network or USB one; the disks there are:", "df -h .")
    return green(SUBJECT, summary)


def _own(seen: DiskSeen) -> str:
    return f"sudo chown -R $USER {seen.folder}"
