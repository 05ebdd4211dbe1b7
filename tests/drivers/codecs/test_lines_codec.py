"""Lines of text: what is a number and what is not, with nothing but its form to go by; and Mantracourt's questions."""

from itertools import pairwise
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.lines import LINE_MAX, LineStream, NumberFormat, Numbers, signed_text
from norton_drivers.codecs.mantracourt import ANSWER, question, question_in

PLAIN = NumberFormat()
NUMBERS = st.floats(-99_999.9, 99_999.9)
DIGITS = st.tuples(st.integers(5, 7), st.integers(0, 6))


@given(NUMBERS, DIGITS)
def test_numbers_come_back_within_half_a_digit(number, digits):
    text = signed_text(number, *digits)
    assert len(text) == sum(digits) + 2
    for form in (PLAIN, ANSWER, NumberFormat(width=len(text))):
        assert abs(form.number_in(text) - number) <= 0.5 * 10.0 ** -digits[1] * (1 + 1e-9)


@pytest.mark.parametrize("number", [1e5, -1e5, 99_999.96, float("nan"), float("inf")])
def test_what_so_many_digits_cannot_say(number):
    with pytest.raises(CodecError):
        signed_text(number, 5, 1)


@pytest.mark.parametrize(
    ("text", "number"),
    [
        (b"1", 1.0),
        (b"+00032.100", 32.1),
        (b" -0.5 ", -0.5),
        (b"-  12.25", -12.25),
        (b".5", 0.5),
        (b"5.", 5.0),
        (b"-1.25E-02", -0.0125),
    ],
)
def test_numbers(text, number):
    assert PLAIN.number_in(text) == number


@pytest.mark.parametrize(
    "text",
    [b"", b".", b"+", b"1,5", b"1.2.3", b"1 2", b"0x10", b"nan", b"inf", b"1e999", b"--1", b"1-", b"1.0 Nm", b"\xff1"],
)
def test_what_is_no_number(text):
    assert PLAIN.number_in(text) is None


def test_unit_fields_width_and_sign():
    assert NumberFormat(unit="Nm").number_in(b"+1.5 Nm") == 1.5
    assert NumberFormat(unit="N.m").number_in(b"1.5 Nxm") is None
    assert NumberFormat(unit="Nm").number_in(b"1.5") is None
    assert NumberFormat(unit="Nm").number_in(b"1.5 mNm") is None
    assert NumberFormat(separator=";", field=2, unit="Nm").number_in(b"17;-2.5Nm;0") == -2.5
    assert NumberFormat(separator=";", field=2).number_in(b"17") is None
    assert NumberFormat(separator=" ", field=3).number_in(b"a b 3") == 3
    assert NumberFormat(width=6).number_in(b"+1.500") == 1.5
    assert NumberFormat(width=6).number_in(b"+1.50") is None
    assert ANSWER.number_in(b"00032.100") is None


CHARACTERS = st.sampled_from(b"0123456789+-. eN")
TEXTS = st.lists(CHARACTERS, min_size=1, max_size=2 * LINE_MAX).map(bytes)


@given(st.lists(st.tuples(TEXTS, st.sampled_from([b"\r", b"\n", b"\r\n"]))), st.data())
def test_any_cut_gives_the_same_lines(lines, data):
    wire = b"".join(text + end for text, end in lines) + data.draw(TEXTS)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(wire)), max_size=8)))
    whole, cut, by_byte = (LineStream(mid_line=False) for _ in range(3))
    found = [line.text for line in whole.feed(wire)]
    assert found == [text for text, _ in lines if len(text) <= LINE_MAX]
    assert [line.text for a, b in pairwise([0, *cuts, len(wire)]) for line in cut.feed(wire[a:b])] == found
    assert [line.text for byte in wire for line in by_byte.feed(bytes([byte]))] == found
    assert whole.overlong == cut.overlong == by_byte.overlong
    assert whole.overlong >= sum(len(text) > LINE_MAX for text, _ in lines)


def test_how_many_bytes_came_after_a_line():
    stream = LineStream(mid_line=False)
    assert [line.later_bytes for line in stream.feed(b"1.0\r\n2.0\r\n3.")] == [8, 3]
    assert [line.later_bytes for line in stream.feed(b"5\r")] == [0]


def test_a_stream_that_begins_within_a_line():
    stream = LineStream(mid_line=True)
    assert [line.text for line in stream.feed(b"2.100\r\n+00032.100\r\n")] == [b"+00032.100"]


def test_a_line_that_never_ends_is_counted_once_and_skipped_whole():
    stream = LineStream(mid_line=False)
    assert stream.feed(b"1" * 500) == []
    assert stream.feed(b"1" * 500) == []
    assert [line.text for line in stream.feed(b"1\r2\r")] == [b"2"]
    assert stream.overlong == 1


def test_dropping_what_has_begun():
    stream = LineStream(mid_line=False)
    stream.feed(b"+000")
    stream.drop()
    assert [line.text for line in stream.feed(b"32.1\r")] == [b"32.1"]


def test_noise_is_a_number_now_and_then_but_not_twice_in_a_row():
    stream, random, numbers = LineStream(mid_line=True), Random(3), Numbers(PLAIN)
    lines = [line.text for _ in range(1000) for line in stream.feed(random.randbytes(1000))]
    believed = [numbers.believed for line in lines if numbers.take(line) is not None]
    assert 0 < len(believed) < 20
    assert not any(believed)


@given(st.lists(st.booleans(), max_size=30))
def test_a_number_is_believed_behind_a_number(are_numbers):
    numbers = Numbers(PLAIN)
    for before, is_number in pairwise([False, *are_numbers]):
        assert numbers.take(b"1.5" if is_number else b"1,5") == (1.5 if is_number else None)
        assert numbers.believed == (before and is_number)
    assert numbers.garbled == are_numbers.count(False)


def test_the_published_question():
    assert question(1, "SOUT") == b"!001:SOUT?\r"
    assert question_in(b"!001:SOUT?") == (1, "SOUT")
    assert question_in(b"!042:sys?") == (42, "SYS")
    assert ANSWER.number_in(b"+00032.100") == 32.1


@given(st.integers(0, 999), st.text("ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789", min_size=1, max_size=4))
def test_questions_come_back(station, command):
    assert question_in(question(station, command).removesuffix(b"\r")) == (station, command)


@pytest.mark.parametrize(("station", "command"), [(1000, "SOUT"), (-1, "SOUT"), (1, ""), (1, "SOUTS"), (1, "A\r")])
def test_questions_that_cannot_be(station, command):
    with pytest.raises(CodecError):
        question(station, command)


@given(st.binary(max_size=30))
def test_any_line_is_a_question_or_a_codec_error(line):
    try:
        station, command = question_in(line)
    except CodecError:
        return
    assert question(station, command).removesuffix(b"\r") == line.upper()
