"""Error frames: Linux' layout both ways, and words for what happened."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from norton_drivers.codecs.can_errors import CanErrorFrame, ControllerError, ErrorClass, ProtocolError

FRAMES = st.builds(
    CanErrorFrame,
    st.integers(0, 0x3FF).map(ErrorClass),
    st.integers(0, 0x7F).map(ControllerError),
    st.integers(0, 0xFF).map(ProtocolError),
    *[st.integers(0, 255)] * 3,
)


@given(FRAMES)
def test_both_directions(frame):
    assert CanErrorFrame.decode(*frame.encode()) == frame


@given(st.integers(0, 0x1FFFFFFF), st.binary(max_size=64))
def test_anything_decodes_and_is_told_in_words(arbitration_id, data):
    words = CanErrorFrame.decode(arbitration_id, data).words()
    assert words
    assert len(set(words)) == len(words)


# Identifier and data as `candump -e` shows them of an ERRORFRAME.
@pytest.mark.parametrize(
    ("arbitration_id", "data", "words"),
    [
        (0x040, "0000000000000000", ("bus-off",)),
        (0x020, "", ("no acknowledgement",)),
        (0x004, "0010000000000000", ("error-passive",)),
        (0x204, "0008000000006000", ("error warning level reached",)),
        (0x004, "0001000000000000", ("receive overrun",)),
        (0x088, "0000040000000000", ("bit stuffing error",)),
        (0x088, "0000820000000000", ("frame format error",)),
        (0x002, "0500000000000000", ("arbitration lost",)),
        (0x008, "0000200000000000", ("bus overload",)),
        (0x0A8, "0000801900000000", ("no acknowledgement",)),
        (0x080, "", ("bus error",)),
        (0x000, "", ("bus error",)),
        (0x010, "0000000004000000", ("transceiver fault",)),
        (0x100, "", ("controller restarted",)),
    ],
)
def test_words(arbitration_id, data, words):
    frame = CanErrorFrame.decode(arbitration_id, bytes.fromhex(data))
    assert frame.words() == words
    assert (frame.bus_off, frame.restarted) == (words == ("bus-off",), words == ("controller restarted",))
