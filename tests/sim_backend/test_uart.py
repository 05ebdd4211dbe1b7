"""A line sampled at another rate: right within a few per cent, garbage beyond, and as a UART makes it."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from norton_sim.hookup import heard_at


@given(st.binary(max_size=80), st.floats(0.96, 1.04))
def test_a_few_per_cent_are_no_matter(data, ratio):
    """A character's last sample lies 9.5 bits after its start: it must not slip by half a bit."""
    assert heard_at(data, 115_200, 115_200 * ratio) == data


@given(st.binary(max_size=60), st.integers(300, 3_000_000), st.integers(300, 3_000_000))
def test_any_two_rates_give_bytes(data, sent, heard):
    got = heard_at(data, sent, heard)
    # A receiver cannot find more characters than there are start bits, nor fewer than none.
    assert len(got) <= 5 * len(data)
    assert got == heard_at(data, 2 * sent, 2 * heard)


@pytest.mark.parametrize(
    ("sent", "ratio", "heard"),
    [
        # 0 10101010 1: sampled twice a bit, 0 01100110 and a missing stop bit; then from the next fall, 0 01100111.
        (b"\x55", 2.0, b"\x66\xe6"),
        # Nine low bits are four and a half of the slower ones: the start bit and three of the data's.
        (b"\x00", 0.5, b"\xf8"),
        (b"\xff", 0.6, b"\xff"),
        # The start bit is over when the slower one looks whether it is one.
        (b"\xff", 0.4, b""),
        (b"\xff\xff", 1.0, b"\xff\xff"),
    ],
)
def test_by_hand(sent, ratio, heard):
    assert heard_at(sent, 100_000, 100_000 * ratio) == heard


def test_nothing_stays_nothing():
    assert heard_at(b"", 9600, 115_200) == b""
