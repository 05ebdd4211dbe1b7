"""What is known of a parameter, conditions on it, and the sentences that say whether it is what was expected."""

from math import inf, isnan

import pytest

from norton_bench.errors import UsageError
from norton_bench.models.parameter_result import ParameterResult, parameter_result
from norton_bench.models.parameters import Estimate, Status
from norton_bench.session.items import Condition, compared, share

FOUND = ParameterResult("coulomb_torque", "N*m", 0.0204, 0.0204 / 196, Status.VALID)  # ± 1 %
NOTHING = parameter_result((), "coulomb_torque", "N*m")


def test_the_interval_is_half_of_95_percent_over_the_value() -> None:
    assert FOUND.interval == pytest.approx(0.01)
    assert NOTHING.interval == inf
    assert isnan(NOTHING.value)
    assert ParameterResult("inertia", "kg*m^2", 1.0, 0.1, Status.DOUBTFUL).interval == inf


def test_an_estimate_is_found_by_its_name() -> None:
    estimate = Estimate("torque_gain", 0.9, 0.1, "N*m/(A)", Status.AT_BOUND)
    assert parameter_result((estimate,), "torque_gain", "A") == ParameterResult(
        "torque_gain", "N*m/(A)", 0.9, 0.1, Status.AT_BOUND
    )
    assert parameter_result((), "torque_gain", "A").unit == "N*m/(A)"
    with pytest.raises(UsageError, match=r'"torque_gian" is no parameter; did you mean "torque_gain"\?'):
        parameter_result((estimate,), "torque_gian", "A")


@pytest.mark.parametrize(
    ("tolerance", "reference", "met"),
    [
        ("2.1 %", "0.02 N*m", True),
        ("1.9 %", "0.02 N*m", False),
        ("0.5 mN*m", "20 mN*m", True),
        ("0.1 mN*m", "20 mN*m", False),
    ],
)
def test_a_value_is_near_its_reference_or_not(tolerance: str, reference: str, met: bool) -> None:
    judged = FOUND.is_within(tolerance, reference)
    assert judged.met is met
    verb = "is" if met else "is not"
    off = "" if met else ", but 2 % off"
    assert (
        judged.sentence
        == f"coulomb_torque = 0.0204 ± 0.0002 N*m (valid): {verb} within {tolerance} of {reference}{off}"
    )


def test_what_is_not_valid_is_near_nothing() -> None:
    learning = ParameterResult("coulomb_torque", "N*m", 0.02, 0.0, Status.LEARNING)
    assert not learning.is_within("50 %", "0.02 N*m").met
    assert not learning.is_known_within("50 %").met
    assert NOTHING.is_within("50 %", "0.02 N*m").sentence.startswith(
        "coulomb_torque is not known (unexcited): is not within"
    )


@pytest.mark.parametrize(("tolerance", "reference"), [("2 rad", "0.02 N*m"), ("2 %", "0.02 rad"), ("2", "0.02")])
def test_quantities_of_another_kind_are_refused(tolerance: str, reference: str) -> None:
    with pytest.raises(ValueError, match="write it like"):
        FOUND.is_within(tolerance, reference)


@pytest.mark.parametrize(
    ("condition", "holds", "of_nothing"),
    [
        (Condition("coulomb_torque", interval=share("1.01 %")), True, False),
        (Condition("coulomb_torque", interval=share("0.99 %")), False, False),
        (Condition("coulomb_torque", interval=share("> 0.5 %")), True, True),
        (Condition("coulomb_torque", value=compared("> 20 mN*m")), True, False),
        (Condition("coulomb_torque", value=compared("<= 20 mN*m")), False, False),
        (Condition("coulomb_torque", status="valid"), True, False),
        (Condition("coulomb_torque", status="not valid"), False, True),
        (Condition("coulomb_torque", value=compared("> 20 mN*m"), status="at bound"), False, False),
    ],
    ids=str,
)
def test_conditions_hold_or_not(condition: Condition, holds: bool, of_nothing: bool) -> None:
    assert condition.holds_of(FOUND) is holds
    assert condition.holds_of(NOTHING) is of_nothing
