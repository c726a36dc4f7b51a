"""Turns a recording into what the first format held: counts of the force with a scale, an angle and
the host's time with an offset.
"""

import h5py
import numpy as np

COUNT = 1e-6
TURN_RAD = -6.25


def turn_into_first_format(file: h5py.File, start_s: float = 100.25) -> None:
    """Changes a file that is open for writing."""
    file.attrs["format"] = "rfca-recording/1"

    def add_scale(_name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset) and "units" in item.attrs:
            item.attrs["conversion"] = 1.0
            item.attrs["offset"] = 0.0

    file.visititems(add_scale)
    for stage in (*file.get("strokes", {}).values(), *file.get("raw", {}).values()):
        for stream in stage.values():
            _turn_stream(stream, start_s)


def _turn_stream(stream: h5py.Group, start_s: float) -> None:
    for name in list(stream):
        if name.endswith(("_N", "_Nm")) and name[:2] in ("fx", "fy", "fz", "tx", "ty", "tz"):
            _turn_into_counts(stream, name)
    if "shaft_angle_rad" in stream:
        stream["shaft_angle_rad"][:] -= TURN_RAD
        stream["shaft_angle_rad"].attrs["offset"] = TURN_RAD
    if "host_s" in stream:
        stream["host_s"].attrs["offset"] = -start_s


def _turn_into_counts(stream: h5py.Group, name: str) -> None:
    counts = np.round(stream[name][:] / COUNT).astype(np.int32)
    attributes = {key: stream[name].attrs[key] for key in ("units", "long_name")}
    del stream[name]
    dataset = stream.create_dataset(name, data=counts)
    for key, value in {**attributes, "conversion": COUNT, "offset": 0.0}.items():
        dataset.attrs[key] = value
