"""How the bus of a drive with CAN-FD is opened on adapters that python-can knows."""

from typing import Any

import can
import pytest

from rfca_rig.drivers.can_frames import CanBusSettings


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The arguments with which python-can would open the bus; no adapter is needed."""
    arguments: dict[str, Any] = {}
    monkeypatch.setattr(can, "Bus", lambda **given: arguments.update(given))
    return arguments


def test_a_peak_adapter_is_given_the_parts_of_a_bit_with_the_drives_sample_point(opened) -> None:
    """python-can hands its driver no bit rate for CAN-FD."""
    CanBusSettings("pcan", "PCAN_USBBUS1", 1_000_000, 5_000_000).open()
    timing = opened["timing"]
    assert (timing.nom_bitrate, timing.data_bitrate) == (1_000_000, 5_000_000)
    assert timing.nom_sample_point == pytest.approx(66.67, abs=0.01)
    assert timing.data_sample_point == pytest.approx(66.67, abs=0.01)


def test_other_adapters_are_given_both_bit_rates(opened) -> None:
    CanBusSettings("kvaser", "0", 1_000_000, 5_000_000).open()
    assert opened == {
        "interface": "kvaser",
        "channel": "0",
        "bitrate": 1_000_000,
        "data_bitrate": 5_000_000,
        "fd": True,
    }
