"""SimpleFOC's Commander: lines as its source prints and reads them."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from norton_drivers.codecs import simplefoc as protocol
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.simplefoc import MotorState


def test_what_is_said():
    """SimpleFOC documentation, "Commander", "Motor commands": M2.34 sets the target, MMG7 gets all, ME0 disables."""
    assert protocol.said("M", protocol.target_text(2.34, 2)) == b"M2.34\n"
    assert protocol.said("M", "MG7") == b"MMG7\n"
    assert protocol.said("A", "E0") == b"AE0\n"
    with pytest.raises(CodecError):
        protocol.said("M", "LC123456789.1234567")
    for value in (float("nan"), float("inf"), 1e6):
        with pytest.raises(CodecError):
            protocol.target_text(value, 5)


def test_a_state():
    told = protocol.state_in("0.50000;1.20000;0.00000;0.49800;-0.00100;12.30000;-3.14159")
    assert told == MotorState(0.5, 1.2, 0.0, 0.498, -0.001, 12.3, -3.14159)
    assert told is not None
    assert protocol.state_text(told, 5) == "0.50000;1.20000;0.00000;0.49800;-0.00100;12.30000;-3.14159"
    assert len(protocol.state_text(told, 5)) + 2 <= protocol.longest_state(5)


@pytest.mark.parametrize(
    "text", ["0.5", "1;2;3;4;5;6;7", "0.1;0.1;0.1;0.1;0.1;0.1", "nan;" + "0.1;" * 5 + "0.1", "err"]
)
def test_what_is_no_state(text):
    assert protocol.state_in(text) is None


def test_flags_letters_and_targets_are_told_apart():
    assert [protocol.flag_in(text) for text in ("1", "0", "1.00000", "", "10")] == [True, False, None, None, None]
    assert [protocol.letter_in(text) for text in ("M:motor", "?A:", "on!", ":", "MM:x")] == ["M", "A", None, None, None]


@settings(max_examples=50)
@given(st.lists(st.floats(-999, 999), min_size=7, max_size=7), st.integers(3, 6))
def test_a_state_both_ways(values, decimals):
    text = protocol.state_text(MotorState(*values), decimals)
    assert len(text) + 2 <= protocol.longest_state(decimals)
    assert protocol.state_in(text) == pytest.approx(values, abs=0.6 * 10.0**-decimals)


@settings(max_examples=50)
@given(st.text(max_size=80))
def test_nothing_makes_it_raise(text):
    protocol.state_in(text)
    protocol.flag_in(text)
    protocol.letter_in(text)
