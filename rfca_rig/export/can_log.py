"""Export of the CAN frames of a recording as a log that tools of a bus read, by python-can's
writers: .asc and .blf of Vector, .log of candump, .trc of PEAK.
"""

from datetime import datetime
from pathlib import Path

import can
import numpy as np

from rfca_rig.campaign.stored import StoredStream, open_stored
from rfca_rig.errors import BadInput
from rfca_rig.progress import ProgressCount, iterate_with_progress
from rfca_rig.recording.atomic import refuse_devices, remove, translate_os_errors
from rfca_rig.recording.can_frames import CAN, can_form, messages_in
from rfca_rig.recording.columns import HOST_TIME, Rows

ENDINGS = (".asc", ".blf", ".log", ".trc")


def export_can_log(run: Path, out: Path, report_progress: ProgressCount) -> int:
    """Writes the frames to `out`, completely or not at all; an existing file is replaced. Returns
    their number. Memory does not grow with the recording.

    Times are those of the host, in UTC.

    Parameters
    ----------
    run
        A run's folder, or its run.h5.
    out
        The file to write; its ending selects the form.
    report_progress
        Progress callback: number of stages done, number of stages.

    Raises
    ------
    BadInput
        Where the ending is unknown, or no frames were recorded.
    RigError
        Where the file cannot be written.
    """
    if out.suffix not in ENDINGS:
        raise BadInput(f"{out}: should end with one of {', '.join(ENDINGS)}")
    refuse_devices(out)
    stored = open_stored(run)
    started = stored.provenance.get("started_at", "1970-01-01T00:00:00+00:00")
    zero_s = datetime.fromisoformat(started).timestamp()
    # The ending must stay: python-can selects its writer by it.
    partial = out.with_name(f"{out.stem}.writing{out.suffix}")
    count = 0
    with translate_os_errors(out, "cannot be written"):
        try:
            with can.Logger(partial) as log:
                for stage in iterate_with_progress(stored.raw, report_progress):
                    with stage.samples.open_streams() as streams:
                        for stream in streams:
                            if stream.name == CAN:
                                count += _write(stream, zero_s, log)
            if count:
                partial.replace(out)
        finally:
            remove(partial)
    if not count:
        raise BadInput(f"{run}: holds no CAN frames; rfca-rig record records them")
    return count


def _write(stream: StoredStream, zero_s: float, log: can.Listener) -> int:
    count = 0
    for block in stream.blocks():
        rows = _rows_of(stream, block)
        for message in messages_in(rows, zero_s + rows[HOST_TIME]):
            log.on_message_received(message)
        count += len(rows)
    return count


def _rows_of(stream: StoredStream, block: slice) -> Rows:
    """Records (m,) of the stream as they were received, times by the clock of the run."""
    form = can_form(is_fd="data2" in stream.columns)
    columns = {name: column.data[block] for name, column in stream.columns.items()}
    rows = np.empty(len(columns["identifier"]), form.dtype)
    for name in form.dtype.names or ():
        rows[name] = columns[name]
    return rows
