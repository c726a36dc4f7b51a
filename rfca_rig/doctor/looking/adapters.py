"""Asks python-can for the adapters that its interfaces find, other than the kernel's."""

import can

FINDABLE = ("canalystii", "cantact", "gs_usb", "ixxat", "kvaser", "neovi", "nican", "nixnet", "pcan", "systec", "usb2can", "vector")


def look_for_adapters() -> tuple[tuple[str, str], ...]:
    """(interface, channel); an interface whose own driver is not installed finds none."""
    found = can.detect_available_configs(FINDABLE)
    return tuple(sorted((str(one["interface"]), str(one["channel"])) for one in found))
