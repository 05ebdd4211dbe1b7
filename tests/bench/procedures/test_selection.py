"""The choice of excitations: what narrows the widest interval most per second, and nothing that does not help."""

from itertools import combinations_with_replacement

import numpy as np
import pytest

from norton_bench.procedures.refinement import Option, select

KNOWN = np.diag([100.0, 100.0, 100.0])  # deviations of 0.1


def telling(index: int, amount: float, duration_s: float = 1.0) -> Option:
    matrix = np.zeros((3, 3))
    matrix[index, index] = amount
    return Option(duration_s, matrix)


def as_they_are(deviations: np.ndarray) -> np.ndarray:
    return deviations


def test_the_widest_comes_first() -> None:
    options = [telling(0, 1000.0), telling(1, 300.0), telling(2, 1000.0)]
    known = np.diag([100.0, 20.0, 100.0])
    assert select(options, known, as_they_are, target=0.01, time_s=1.0).picks == (1,)


def test_what_is_widest_is_for_the_weights_to_say() -> None:
    options = [telling(0, 1000.0), telling(1, 1000.0), telling(2, 1000.0)]
    weighted = select(options, KNOWN, lambda each: each * [1.0, 1.0, 2.0], target=0.01, time_s=1.0)
    assert weighted.picks == (2,)


def test_bench_time_counts() -> None:
    long, short = telling(0, 1000.0, duration_s=10.0), telling(0, 500.0)
    picks = select([long, short], np.diag([1.0, 1e9, 1e9]), as_they_are, target=1e-3, time_s=10.0).picks
    assert picks[0] == 1


def test_it_ends_when_all_is_narrow_and_foresees_how_narrow() -> None:
    options = [telling(index, 100.0) for index in range(3)]
    chosen = select(options, KNOWN, as_they_are, target=0.071, time_s=100.0)
    assert sorted(chosen.picks) == [0, 1, 2]
    assert chosen.predicted == pytest.approx(np.full(3, 200**-0.5))


def test_time_is_kept_to() -> None:
    options = [telling(0, 100.0, duration_s=2.0), telling(1, 100.0, duration_s=2.0), telling(2, 100.0, duration_s=2.0)]
    assert len(select(options, KNOWN, as_they_are, target=0.001, time_s=5.0).picks) == 2


def test_nothing_is_picked_where_nothing_helps() -> None:
    chosen = select([telling(0, 1e6), telling(1, 1e6)], KNOWN, as_they_are, target=0.01, time_s=100.0)
    assert 2 not in chosen.picks
    assert chosen.predicted[2] == pytest.approx(0.1)
    assert select([], KNOWN, as_they_are, target=0.01, time_s=100.0).picks == ()


def test_greedy_is_close_to_the_best_of_all_choices() -> None:
    random = np.random.default_rng(1)
    options = []
    for _ in range(6):
        columns = random.standard_normal((3, 2)) * random.uniform(1, 20, (3, 1))
        options.append(Option(1.0, columns @ columns.T))
    known = np.diag([1.0, 1.0, 1.0])

    def widest(picks: tuple[int, ...]) -> float:
        total = known + sum((options[pick].information for pick in picks), np.zeros((3, 3)))
        return float(np.max(np.sqrt(np.diag(np.linalg.inv(total)))))

    best = min(widest(picks) for picks in combinations_with_replacement(range(6), 4))
    chosen = select(options, known, as_they_are, target=1e-6, time_s=4.0)
    assert widest(chosen.picks) < 1.3 * best
