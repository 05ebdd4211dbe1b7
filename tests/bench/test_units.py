"""Quantities as people write them. References: the SI brochure's definitions and exact conversion factors."""

from math import isclose, pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from norton_bench.units import check_unit, parse_quantity, parse_range, same_dimension

EXACT = [
    ("5 ms", "s", 0.005),
    ("1 kHz", "Hz", 1000.0),
    ("1 Mbit/s", "bit/s", 1e6),
    ("3000 rpm", "rad/s", 100 * pi),
    ("1 turn", "rad", 2 * pi),
    ("90 deg", "rad", pi / 2),
    ("30 °", "rad", pi / 6),
    ("80 °C", "degC", 80.0),
    ("0 degC", "K", 273.15),
    ("60 %", "", 0.6),
    (0.6, "", 0.6),
    ("500 g*cm^2", "kg*m^2", 5e-5),
    ("2 Nm", "N*m", 2.0),
    ("3 mNm", "N*m", 3e-3),
    ("1 N·m", "N*m", 1.0),
    ("1 in*lbf", "N*m", 0.0254 * 4.4482216152605),
    ("1 ozf*in", "N*m", 4.4482216152605 / 16 * 0.0254),
    ("18 A/(N*m)", "A/(N*m)", 18.0),
    ("20 W", "N*m/s", 20.0),
    ("2 V", "W/A", 2.0),
    ("-1e-3 N*m*s/rad", "N*m*s/rad", -1e-3),
    ("400 µs", "s", 4e-4),
    ("400 us", "s", 4e-4),
]

WRONG = [
    ("5", "s", '"5" has no unit; write it like "1 s"'),
    (5, "s", '"5" has no unit; write it like "1 s"'),
    ("20", "rad", "has no unit"),
    (True, "s", "expected a quantity"),
    (None, "s", "expected a quantity"),
    (["5 s"], "s", "expected a quantity"),
    ("", "s", "is not a quantity"),
    ("s", "s", "is not a quantity"),
    ("nan s", "s", "is not a quantity"),
    ("inf s", "s", "is not a quantity"),
    ("1e999 s", "s", "is more than any bench meets"),
    ("1,5 s", "s", 'write it like "1 s"'),
    ("5 N", "N*m", '"5 N" is not in N*m; write it like "1 N*m"'),
    ("100 Hz", "rad/s", "is not in rad/s"),  # 100 Hz is 628 rad/s, and never 100
    ("0.5 N*m", "N*m/rad", "is not in N*m/rad"),
    ("60 %", "rad", "is not in rad"),
    ("5 furlong", "m", '"furlong" in "5 furlong" is not a unit known here'),
    ("5 __import__('os')", "s", "is not a unit known here"),
    ("5 s)", "s", "is not a unit known here"),
]


@pytest.mark.parametrize(("text", "unit", "value"), EXACT)
def test_a_quantity_is_converted(text: object, unit: str, value: float) -> None:
    assert parse_quantity(text, unit) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(("text", "unit", "said"), WRONG)
def test_what_is_no_such_quantity_is_refused_in_a_sentence(text: object, unit: str, said: str) -> None:
    with pytest.raises(ValueError, match=r"write it like|such as") as refusal:
        parse_quantity(text, unit)
    assert said in str(refusal.value)
    assert "\n" not in str(refusal.value)


@given(st.floats(-(2.0**59), 2.0**59, width=32), st.sampled_from(["N*m", "rad/s", "A/(N*m)", "W"]))
def test_a_number_survives_being_written(value: float, unit: str) -> None:
    assert parse_quantity(f"{value!r} {unit}", unit) == value


@given(
    st.floats(1e-6, 1e6), st.sampled_from([("m", 1e-3), ("u", 1e-6), ("n", 1e-9), ("k", 1e3), ("M", 1e6), ("c", 1e-2)])
)
def test_prefixes_are_powers_of_ten(value: float, prefix: tuple[str, float]) -> None:
    letter, factor = prefix
    assert isclose(parse_quantity(f"{value!r} {letter}W", "W"), value * factor, rel_tol=1e-12)


@given(st.text(max_size=12))
def test_any_text_gives_a_number_or_a_sentence(text: str) -> None:
    said = ""
    try:
        parse_quantity(text, "s")
    except ValueError as refusal:
        said = str(refusal)
    assert not said or "write it like" in said


@given(st.integers(-50, 50), st.integers(1, 9), st.integers(0, 40))
def test_a_range_has_both_its_ends(first: int, step: int, count: int) -> None:
    last = first + step * count
    values = parse_range(f"{first}:{step}:{last} rad/s", "rad/s")
    assert values == pytest.approx([first + step * index for index in range(count + 1)])


def test_a_range_of_decimals_keeps_its_last_value() -> None:
    assert parse_range("0:0.1:0.3 N*m", "N*m") == pytest.approx((0.0, 0.1, 0.2, 0.3))


@pytest.mark.parametrize(
    "text", ["1:2", "1:0:5 rad/s", "5:1:1 rad/s", "0:1e-9:5 rad/s", "a:b:c", 5, "1:2:3", "1:2:3 N"]
)
def test_a_range_that_is_none_is_refused(text: object) -> None:
    with pytest.raises(ValueError, match=r"range|unit|rad/s"):
        parse_range(text, "rad/s")


def test_units_are_known_or_refused() -> None:
    assert check_unit("N*m/A") == "N*m/A"
    assert same_dimension("mNm", "N*m")
    assert not same_dimension("A", "N*m")
    with pytest.raises(ValueError, match="not a unit known here"):
        check_unit("bananas")
