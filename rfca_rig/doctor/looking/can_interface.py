"""Reads the state of the CAN interfaces of the Linux kernel."""

import json
import subprocess
from pathlib import Path
from typing import Any

from rfca_rig.doctor.judging.can_interface import CanInterfaceObservation

NETWORK = Path("/sys/class/net")
# From linux/if_arp.h, linux/if.h and linux/can.h.
ARPHRD_CAN = "280"
IFF_UP = 1
CANFD_MTU = 72
IP_WITHIN_S = 2.0


def look_at_can_interface(channel: str, network: Path = NETWORK) -> CanInterfaceObservation:
    """Observes one interface. The bit rate is known only if the command `ip` is installed."""
    names = can_interfaces(network)
    others = tuple(name for name in names if name != channel)
    if not channel or "/" in channel or not (network / channel).exists():
        return CanInterfaceObservation(channel, False, others)
    details = _query_ip(channel) if network == NETWORK else {}
    info = details.get("linkinfo", {})
    data = info.get("info_data", {})
    return CanInterfaceObservation(
        channel=channel,
        exists=True,
        others=others,
        is_can=channel in names,
        is_virtual=info.get("info_kind", "") in {"vcan", "vxcan"},
        is_up=bool(int(_text(network / channel / "flags") or "0", 16) & IFF_UP),
        state=data.get("state"),
        bitrate=data.get("bittiming", {}).get("bitrate"),
        data_bitrate=data.get("data_bittiming", {}).get("bitrate"),
        is_fd=_text(network / channel / "mtu") == str(CANFD_MTU),
    )


def can_interfaces(network: Path = NETWORK) -> tuple[str, ...]:
    """Names of all CAN interfaces of the kernel."""
    if not network.is_dir():
        return ()
    return tuple(sorted(entry.name for entry in network.iterdir() if _text(entry / "type") == ARPHRD_CAN))


def _text(file: Path) -> str:
    """Content of a file, empty if it does not exist: interfaces come and go."""
    try:
        return file.read_text().strip()
    except OSError:
        return ""


def _query_ip(channel: str) -> dict[str, Any]:
    """Output of `ip` on the interface; empty if it is not installed, or too old for JSON."""
    command = ["ip", "-details", "-json", "link", "show", "dev", channel]
    try:
        output = subprocess.run(command, capture_output=True, timeout=IP_WITHIN_S, check=True).stdout
        links = json.loads(output)
    except (OSError, subprocess.SubprocessError, ValueError):
        return {}
    return links[0] if links and isinstance(links[0], dict) else {}
