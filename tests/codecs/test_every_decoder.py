"""What `tests.benchmarks.decoders` does a million times, some thousand times."""

import pytest

from rfca_rig.codecs import classic_can, fdcanusb
from rfca_rig.errors import MalformedFrame
from tests.benchmarks.decoders import DECODERS, Decoder, tried


@pytest.mark.parametrize("decoder", DECODERS, ids=lambda decoder: decoder.name)
def test_no_random_frame_breaks_it_or_is_taken_wrongly(decoder):
    taken, refused, _ = tried(decoder, 4000, 7)
    assert taken > 0
    assert refused > 0 or "stream" in decoder.name


def test_a_decoder_that_takes_what_it_should_not_is_caught():
    careless = Decoder(
        "careless", lambda data: data, (b"\x01\x02",), lambda data: len(data) == 2, 8
    )
    with pytest.raises(AssertionError, match="careless took"):
        tried(careless, 100, 1)


def test_only_spaces_part_words():
    """Python takes more characters for white space than any protocol does."""
    assert classic_can.split_socketcand(b"< send 1\x1c0 >") == ([["send", "1\x1c0"]], b"")
    with pytest.raises(MalformedFrame):
        fdcanusb.decode_received("rcv\x85123 00")
