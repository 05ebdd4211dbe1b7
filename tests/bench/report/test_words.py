from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from norton_bench.report.words import between, in_prefixed_unit, interval, number, percent, pretty_unit, to_its_digits

_DIGITS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹−", "-0123456789-")


def read_back(text: str) -> float:
    """The number that a reader takes from the text."""
    mantissa, _, exponent = text.translate(_DIGITS).partition("·10")
    return float(mantissa) * 10.0 ** int(exponent or 0)


@given(st.floats(1e-12, 1e12), st.booleans(), st.integers(2, 6))
def test_a_number_is_read_back_to_its_digits(size: float, negative: bool, digits: int) -> None:
    value = -size if negative else size
    assert read_back(number(value, digits)) == pytest.approx(value, rel=0.51 * 10 ** (1 - digits))


@given(st.floats(1e-9, 1e6), st.floats(1e-5, 0.5))
def test_a_value_is_read_back_to_its_deviation(value: float, share: float) -> None:
    assert read_back(to_its_digits(value, value * share)) == pytest.approx(value, abs=0.06 * value * share)


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (5.002e-5, 1.3e-7, "5.002·10⁻⁵"),
        (600.0, 2.4, "600.0"),
        (-0.9, 0.0036, "−0.9000"),
        (123.0, 400.0, "123"),
        (0.02, inf, "0.02000"),
        (nan, 1.0, "–"),
        (0.0, 0.1, "0.00"),
        (9.99996e-4, 4.5e-7, "1.00000·10⁻³"),
    ],
)
def test_how_values_are_written(value: float, std: float, text: str) -> None:
    assert to_its_digits(value, std) == text


@pytest.mark.parametrize(
    ("value", "digits", "text"), [(9.99996e-4, 5, "0.0010000"), (9.9994e-4, 5, "9.9994·10⁻⁴"), (99.96, 3, "100")]
)
def test_a_number_that_rounds_up_to_a_power_of_ten_is_written_as_one(value: float, digits: int, text: str) -> None:
    assert number(value, digits) == text


def test_the_interval_is_the_normal_one() -> None:
    assert interval(10.0, 1.0) == "8.0 … 12.0"
    assert interval(5e-5, 1e-6) == "(4.80 … 5.20)·10⁻⁵"
    assert interval(1.0, nan) == "–"


def test_a_value_and_its_interval_share_their_digits() -> None:
    assert between(0.0199936, (0.0199788, 0.0200084)) == ("0.0199936", "0.0199788 … 0.0200084")
    assert between(4.9978e-5, (4.9866e-5, 5.009e-5)) == ("4.9978·10⁻⁵", "(4.9866 … 5.0090)·10⁻⁵")
    assert between(50.0, (40.0, float("inf"))) == ("50.00", "above 40.0")


@pytest.mark.parametrize(
    ("unit", "pretty"),
    [
        ("N*m*s/rad", "N·m·s/rad"),
        ("kg*m^2", "kg·m²"),
        ("N*m/(N*m)", ""),
        ("A/(A)", ""),
        ("A/A", ""),
        ("rad/s/(rad/s)", ""),
        ("N*m/(V)", "N·m/(V)"),
        ("rad/s", "rad/s"),
        ("rad/s/(A)", "rad/s/(A)"),
        ("A", "A"),
    ],
)
def test_units_with_their_proper_signs(unit: str, pretty: str) -> None:
    assert pretty_unit(unit) == pretty


def test_small_values_get_a_prefix() -> None:
    assert in_prefixed_unit(0.003, "N*m") == (1e3, "mN·m")
    assert in_prefixed_unit(3.0, "N*m") == (1.0, "N·m")
    assert in_prefixed_unit(0.0, "rad/s") == (1.0, "rad/s")


def test_percent_of_the_unknown_is_a_dash() -> None:
    assert (percent(0.0134), percent(nan)) == ("1.3 %", "–")
