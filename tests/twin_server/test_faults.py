"""Every fault that can be switched is noticed as what it is, or known to leave no trace on the
wire.
"""

import re

import pytest

from rfca_rig.errors import BadInput
from rfca_rig.twin_server.faults import FaultEvent, FaultPanel, FaultSchedule, parse_fault_events
from tests.twin_server.fault_table import CATALOGUE, NOTHING, noticed, table, told

EXPECTED = {
    "force-lost": r"^\d+ lost$",
    "force-twice": r"^\d+ twice$",
    "force-swapped": r"^\d+ out of order$",
    "force-short": r"malformed.*1431 bytes",
    "force-long": r"malformed.*1441 bytes",
    "force-silent": r"^no record for 1\.0",
    "force-stuck": rf"^{NOTHING}$",  # the engine's watch on frozen values stops that
    "force-frozen": r"^the sensor's own sample counter stood still",
    "force-saturated": r"transducer saturation",
    "force-scale": r"^at the next start: .*2e\+06",
    "box-turned": (
        r"^at the next start: .* tool transformation .* is shift 0, 0, 0 mm, turn 0, 0, 90 degrees"
    ),
    "box-filter": r"low-pass filter is on, code 8, about 5 Hz .*about 32 ms late",
    "box-pounds": r"^at the next start: .*224808.* \(1e\+06 per lbf\)",
    "box-axia": r"^at the next start: .*is an Ethernet Axia, .* set model = \"axia\"",
    "bias-stops-stream": r"^no record for 1\.0",
    "box-restart": r"^no record for 1\.0",
    "stream-stolen": r"^no record for 1\.0",
    "http-busy": r"^at the next start: .*503",
    "can-silent": r"^motor: no heartbeat for 1\.",
    "bus-off": r"^motor: no heartbeat for 1\.",
    "can-short": r"^raises: .* has 7 bytes, expected 8",
    "own-frame-echo": rf"^{NOTHING}$",  # and nothing is the right answer to it
    "can-twice": r"^motor: its reports come \d+ times a second where 1000 are set",
    "heartbeat-silent": r"^motor: no heartbeat for 1\.",
    "encoder-jump": r"^motor: position leapt by 6\.28 rad.*; angle jumps by 6\.28 rad$",
    "watchdog-trip": r"^motor: .*WATCHDOG_TIMER_EXPIRED",
    "over-temperature": r"^motor: .*MOTOR_OVER_TEMP",
    "idle-unasked": r"^motor: left closed loop",
    "drive-restart": r"^motor: position leapt by -\d\.\d\d rad",
    "drive-hot": rf"^{NOTHING}$",  # the engine's limit on the temperature stops that
    "temperature-stuck": rf"^{NOTHING}$",
    "encoder-frozen": rf"^{NOTHING}$",  # the engine's limit on the following error stops that
}


def test_the_list_is_whole():
    assert [fault.name for fault in CATALOGUE] == list(EXPECTED)


@pytest.mark.parametrize("name", EXPECTED)
def test_a_fault_is_noticed_as_what_it_is(name):
    assert re.search(EXPECTED[name], told(name)), told(name)


def test_the_stream_itself_does_not_say_its_scale():
    assert noticed("force-scale") == NOTHING


def test_the_table_names_every_fault(monkeypatch):
    monkeypatch.setattr("tests.twin_server.fault_table.told", lambda name: f"said {name}")
    assert len(table().splitlines()) == 2 + len(EXPECTED)


def test_orders_for_faults_are_read_and_carried_out_in_time():
    orders = parse_fault_events(["force-lost@2-4", "can-silent@3"])
    assert orders == (
        FaultEvent(2.0, "force-lost", True),
        FaultEvent(3.0, "can-silent", True),
        FaultEvent(4.0, "force-lost", False),
    )
    panel = FaultPanel(CATALOGUE)
    agenda = FaultSchedule(orders, panel)
    assert agenda.pass_to(1.9) == []
    assert agenda.pass_to(3.0) == list(orders[:2])
    assert panel.is_on("force-lost") and panel.is_on("can-silent")
    agenda.pass_to(10.0)
    assert not panel.is_on("force-lost") and panel.is_on("can-silent")


@pytest.mark.parametrize(
    "order",
    [
        "force-lost",
        "force-lost@",
        "@2",
        "force-lost@x",
        "force-lost@4-2",
        "force-lost@nan",
        "force-lost@-1",
        "",
    ],
)
def test_an_order_that_cannot_be_read_is_refused(order):
    with pytest.raises(BadInput, match="NAME@SECONDS"):
        parse_fault_events([order])


def test_a_fault_nobody_knows_is_refused_before_anything_runs():
    with pytest.raises(BadInput, match="no fault is called 'flood'; there are force-lost"):
        FaultSchedule(parse_fault_events(["flood@2"]), FaultPanel(CATALOGUE))


def test_a_fault_that_happens_once_is_over_when_taken():
    panel = FaultPanel(CATALOGUE)
    panel.switch_on("box-restart")
    assert panel.take("box-restart") and not panel.take("box-restart")
