"""Which excitations to run next: greedy and minimax. Each pick narrows what is then the widest relative interval most
for its time on the bench; the next pick counts on it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.information import deviations

# A pick that narrows the widest interval by less than this share would change nothing that anybody could see.
LEAST_GAIN = 0.002


@dataclass(frozen=True)
class Option:
    """An excitation, as far as choosing goes: how long it takes, and its information matrix (k, k)."""

    duration_s: float
    information: FloatArray


@dataclass(frozen=True)
class Selection:
    """Indices of the options, in order, and the widths (wanted,) that are foreseen after them all."""

    picks: tuple[int, ...]
    foreseen: FloatArray


def select(
    options: Sequence[Option],
    known: FloatArray,
    widths: Callable[[FloatArray], FloatArray],
    *,
    target: float,
    time_s: float,
) -> Selection:
    """Fill ``time_s`` with ``options``, each as often as it is worth it, until all widths are within ``target``.

    ``known`` is the information there is (k, k); ``widths`` turns deviations (k,) into the widths that matter, of which
    the widest counts. Nothing is picked where no option helps.
    """
    picks: list[int] = []
    now = widths(deviations(known))
    while np.max(now) > target:
        widest = int(np.argmax(now))
        fitting = [index for index, option in enumerate(options) if option.duration_s <= time_s]
        after = {index: widths(deviations(known + options[index].information)) for index in fitting}
        gain = {index: float(np.log(now[widest] / after[index][widest])) for index in fitting}
        useful = [index for index in fitting if gain[index] > LEAST_GAIN]
        if not useful:
            break
        best = max(useful, key=lambda index: gain[index] / options[index].duration_s)
        picks.append(best)
        known, now = known + options[best].information, after[best]
        time_s -= options[best].duration_s
    return Selection(tuple(picks), now)
