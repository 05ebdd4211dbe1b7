"""What CubeMars' actuators send in servo mode, against a package that drives them, and by hand."""

import math
from contextlib import suppress
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from TMotorCANControl.servo_can import CAN_Manager_servo, Servo_Params

from norton_drivers.codecs import cubemars, mit
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.cubemars import Upload

I16, BYTES = st.integers(-32768, 32767), st.integers(0, 255)


@given(I16, I16, I16, st.integers(-20, 127), st.integers(0, 6))
def test_an_upload_as_a_third_party_unpacks_it(position, tens_of_erpm, hundredths_a, temperature, error):
    data = Upload(position, 10.0 * tens_of_erpm, hundredths_a / 100, temperature, error).encode()
    # It makes int16 of a number that is none: numpy says so, and wraps, as C does.
    numbers = [int.from_bytes(data[at : at + 2], "big", signed=True) for at in (0, 2, 4)]
    assert numbers == [position, tens_of_erpm, pytest.approx(hundredths_a, abs=1)]
    if min(numbers) >= 0:
        theirs = CAN_Manager_servo.parse_servo_message(SimpleNamespace(debug=False), data)
        assert theirs.position == pytest.approx(position * 0.1)
        assert theirs.velocity == 10.0 * tens_of_erpm
        assert theirs.current == pytest.approx(hundredths_a * 0.01, abs=0.011)
        assert (theirs.error, int(theirs.temperature) & 0xFF) == (error, temperature & 0xFF)
    told = Upload.decode(data)
    assert (told.position, told.erpm, told.temperature_c, told.error) == (
        position,
        10.0 * tens_of_erpm,
        temperature,
        error,
    )


def test_an_upload_by_hand():
    """Manual V1.0.8, section 5.2.1: position, speed, current of 16 bits, high byte first, then temperature, error."""
    told = Upload.decode(bytes.fromhex("FC18 0064 FF38 1E 04"))
    assert told == (-1000, 1000.0, -2.0, 30, 4)
    assert math.isclose(told.position * cubemars.POSITION_STEP_DEG, -100.0)


def test_the_errors_are_those_that_a_third_party_names():
    theirs = Servo_Params["ERROR_CODES"]
    assert len(theirs) == mit.ERRORS_MAX + 1
    for code, word in {
        1: "temperature",
        2: "current",
        3: "voltage",
        4: "voltage",
        5: "encoder",
        6: "unbalance",
    }.items():
        assert word in theirs[code].lower()
    words = {1: "hot", 2: "current", 3: "voltage too high", 4: "voltage too low", 5: "encoder", 6: "unbalanced"}
    assert all(word in mit.describe_error(code) for code, word in words.items())


def test_a_position_beyond_16_bits_wraps():
    assert Upload.decode(Upload(32768, 0.0, 0.0, 25, 0).encode()).position == -32768
    assert Upload.decode(Upload(0, 1e7, -1e4, 25, 0).encode())[1:3] == (327670.0, -327.68)


@given(st.binary(max_size=12))
def test_no_data_raise_anything_but_a_codec_error(data):
    """Any other error would come out of ``suppress``."""
    with suppress(CodecError):
        Upload.decode(data)
