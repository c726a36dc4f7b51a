"""Whatever is heard on a bus, the looking says something about it; and whatever is said fits the
terminal.
"""

import re

import can
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rfca_rig.cli.commands.doctor import WIDTH, _colour_word, _lines
from rfca_rig.devices.checks import ReceivedFrame, red
from rfca_rig.devices.cubemars.checks import judge_mit, judge_servo, observe_mit, observe_servo
from rfca_rig.devices.cubemars.codec import mit_ranges
from rfca_rig.devices.moteus.checks import judge_moteus, observe_moteus
from rfca_rig.devices.netft.checks import judge_stream, observe_stream
from rfca_rig.devices.netft.section import NetFtSettings
from rfca_rig.devices.odrive.checks import OdriveWanted, judge_odrive, observe_odrive
from rfca_rig.devices.odrive.messages import OdriveFirmware
from tests.doctor.said import whole

IDS = st.one_of(
    st.integers(0, 0x7FF),
    st.integers(0, 0x1FFFFFFF),
    st.integers(0x2900, 0x2902),
    st.integers(0x20, 0x3F),
)
DATA = st.one_of(
    st.binary(max_size=8), st.binary(min_size=8, max_size=8), st.binary(min_size=16, max_size=16)
)


@st.composite
def heard(draw) -> ReceivedFrame:
    identifier = draw(IDS)
    data = draw(DATA)
    extended = identifier > 0x7FF or draw(st.booleans())
    message = can.Message(
        arbitration_id=identifier, data=data, is_extended_id=extended, is_fd=len(data) > 8
    )
    return ReceivedFrame(draw(st.floats(0.0, 1.0)), message)


@pytest.mark.slow
@settings(deadline=None, max_examples=300)
@given(st.lists(heard(), max_size=20).map(lambda frames: sorted(frames, key=lambda one: one.at_s)))
def test_any_frames_are_judged(frames):
    for dialect in OdriveFirmware:
        wanted = OdriveWanted(1, 2e-3, dialect)
        assert all(whole(one) for one in judge_odrive(observe_odrive(frames, wanted), wanted))
    for asked in (True, False):
        assert all(
            whole(one) for one in judge_mit(observe_mit(frames, 1, mit_ranges("AK80-9"), asked), 1)
        )
    assert all(whole(one) for one in judge_servo(observe_servo(frames, 1), 1, 2e-3))
    assert all(whole(one) for one in judge_moteus(observe_moteus(frames, 1, 0), 1))


@given(
    st.lists(st.one_of(st.binary(max_size=80), st.binary(min_size=36, max_size=36)), max_size=10)
)
def test_any_datagrams_are_judged(datagrams):
    assert all(
        whole(one)
        for one in judge_stream(observe_stream("h:1", 0.5, datagrams), NetFtSettings(), True)
    )


@given(
    st.text(st.characters(min_codepoint=32, max_codepoint=126), min_size=1, max_size=300).filter(
        str.strip
    )
)
def test_any_finding_fits_the_terminal(text):
    words = " ".join(word[:60] for word in text.split())
    finding = red("subject", text, text, words)
    first, *rest = _lines(finding)
    lines = [re.sub(r"\x1b\[[0-9;]*m", "", _colour_word(finding)) + first, *rest]
    assert max(map(len, lines)) <= WIDTH
    assert lines[0].startswith("red     subject ")
