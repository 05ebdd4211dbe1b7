"""Positions that begin anew are followed over any number of turns."""

from hypothesis import given
from hypothesis import strategies as st

from norton_drivers.readings import Unwrapped


@given(st.integers(2, 1 << 32), st.integers(-(10**6), 10**6), st.lists(st.integers(-(10**9), 10**9), max_size=30))
def test_any_path_is_followed_where_the_change_is_expected(span, start, changes):
    position, followed = start, Unwrapped(span)
    offset = followed.follow(position % span) - position
    for change in changes:
        position += change
        assert followed.follow(position % span, expected_change=change) == position + offset


@given(st.integers(4, 1 << 20), st.lists(st.floats(-0.49, 0.49), max_size=30))
def test_changes_of_less_than_half_a_turn_need_no_expectation(span, shares):
    position, followed = 0, Unwrapped(span)
    followed.follow(0)
    for share in shares:
        position += int(share * span)
        assert followed.follow(position % span) == position


@given(st.integers(100, 1 << 20), st.floats(-5, 5), st.floats(-0.45, 0.45))
def test_the_expectation_may_err_by_less_than_half_a_turn(span, turns, error):
    change, followed = int(turns * span), Unwrapped(span)
    followed.follow(0)
    assert followed.follow(change % span, expected_change=change + error * span) == change
