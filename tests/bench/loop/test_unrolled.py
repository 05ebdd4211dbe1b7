"""An array unrolled as it is asked for has the array's values."""

import numpy as np
import pytest

from norton_bench.loop.unrolled import BACK, CHUNK, Unrolled

VALUES = np.random.default_rng(1).normal(size=3 * CHUNK + 7)


@pytest.mark.parametrize("ahead", [0, 5, BACK - 1, CHUNK])
def test_every_value_is_that_of_the_array(ahead: int) -> None:
    unrolled = Unrolled(VALUES)
    for index in range(len(VALUES)):
        assert unrolled[index] == VALUES[index]
        later = min(index + ahead, len(VALUES) - 1)
        assert unrolled[later] == VALUES[later]
    assert len(unrolled) == len(VALUES)
    assert type(unrolled[0]) is float


def test_who_looks_a_little_ahead_makes_each_chunk_be_unrolled_once(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, unroll = list[int](), Unrolled._unroll
    monkeypatch.setattr(Unrolled, "_unroll", lambda self, index: (begun.append(index), unroll(self, index))[1])
    unrolled = Unrolled(VALUES)
    for index in range(len(VALUES) - 5):
        assert unrolled[index + 5] == VALUES[index + 5]
        assert unrolled[index] == VALUES[index]
    assert len(begun) == len(set(begun)) == 4


def test_what_is_beyond_the_end_is_an_error() -> None:
    with pytest.raises(IndexError):
        Unrolled(VALUES)[len(VALUES)]
