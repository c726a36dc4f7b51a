"""Lists CAN adapters that python-can finds, other than those of the kernel."""

import can

FINDABLE = ("canalystii", "cantact", "gs_usb", "ixxat", "kvaser", "neovi", "nican", "nixnet", "pcan", "systec", "usb2can", "vector")


def look_for_adapters() -> tuple[tuple[str, str], ...]:
    """All adapters as (interface, channel). Interfaces without an installed driver find none."""
    found = can.detect_available_configs(FINDABLE)
    return tuple(sorted((str(one["interface"]), str(one["channel"])) for one in found))
