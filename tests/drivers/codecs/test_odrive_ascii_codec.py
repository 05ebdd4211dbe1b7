"""ODrive's ASCII protocol against its manual's vectors, however the stream is cut."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from norton_drivers.codecs import odrive_ascii as protocol
from norton_drivers.codecs.common import CodecError

FINITE = st.floats(-1e5, 1e5)
TEXTS = st.text(
    st.characters(min_codepoint=0x20, max_codepoint=0x7E, exclude_characters="*;!"), min_size=1, max_size=60
)


def test_the_manuals_checksum():
    """ODrive manual, "ASCII Protocol", "Command Format": ``r vbus_voltage *93``, the blank before it counted."""
    assert protocol.line("r vbus_voltage ") == b"r vbus_voltage *93\n"
    assert protocol.text_in(b"r vbus_voltage *93") == "r vbus_voltage "


@pytest.mark.parametrize("data", [b"f 0", b"f 0*117", b"f 0*", b"f 0*1180", b"", b"f 1*118", b"\xff*255"])
def test_without_its_checksum_a_line_is_none(data):
    with pytest.raises(CodecError):
        protocol.text_in(data)


def test_what_is_said():
    assert protocol.line(protocol.torque_text(0, -0.25)) == b"c 0 -0.250000*103\n"
    assert protocol.feedback_in("1.250000 -0.500000") == (1.25, -0.5)
    assert protocol.feedback_text(1.25, -0.5) == "1.250000 -0.500000"
    assert protocol.number_in("24.123456") == 24.123456
    assert protocol.number_in("8") == 8.0
    assert len(protocol.line(protocol.torque_text(0, -0.123456))) <= protocol.LONGEST_TORQUE
    for value in (float("nan"), float("inf"), 1e7):
        with pytest.raises(CodecError):
            protocol.torque_text(0, value)


@pytest.mark.parametrize("text", ["invalid property", "1.0 2.0", "nan", "", "1e5", "0x10", "- 1"])
def test_what_is_no_value(text):
    assert protocol.number_in(text) is None


@settings(max_examples=50)
@given(FINITE, FINITE)
def test_feedback_both_ways(position_rev, velocity_rev_s):
    told = protocol.feedback_in(protocol.feedback_text(position_rev, velocity_rev_s))
    assert told == pytest.approx((position_rev, velocity_rev_s), abs=0.6e-6)


@settings(max_examples=50)
@given(st.lists(TEXTS, min_size=1, max_size=4), st.data())
def test_a_stream_is_read_alike_however_it_is_cut(texts, data):
    wire = b"junk\r\n" + b"".join(protocol.line(text, b"\r\n") for text in texts)
    stream, found = protocol.TextStream(), []
    while wire:
        count = data.draw(st.integers(1, len(wire)))
        found += [told.text for told in stream.feed(wire[:count])]
        wire = wire[count:]
    assert found == texts
    assert stream.garbled == 1


@settings(max_examples=50)
@given(st.binary(max_size=300))
def test_nothing_makes_it_raise(data):
    for told in protocol.TextStream().feed(data + b"\n"):
        protocol.feedback_in(told.text)
        protocol.number_in(told.text)
