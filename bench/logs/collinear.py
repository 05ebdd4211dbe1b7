"""What a log cannot tell: directions of the unknowns along which its prediction hardly changes, in words."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

# Columns scaled to one: a direction with less than this share of the strongest is next to silent.
SILENT = 0.03
# A parameter belongs to such a direction with at least this share of it.
SHARE = 0.25


def silent_directions(columns: FloatArray, names: Sequence[str]) -> tuple[str, ...]:
    """A sentence for each direction in which ``columns`` (parameters, rows) nearly cancel."""
    norms = np.linalg.norm(columns, axis=1)
    heard = [index for index, norm in enumerate(norms) if norm > 0]
    if len(heard) < 2:
        return ()
    scaled = columns[heard] / norms[heard][:, None]
    power, axes = np.linalg.eigh(scaled @ scaled.T)
    silent = np.sqrt(np.maximum(power, 0.0)) < SILENT * np.sqrt(power[-1])
    sentences = []
    for axis in axes.T[silent]:
        together = [names[heard[index]].replace("_", " ") for index in np.flatnonzero(np.abs(axis) >= SHARE)]
        if len(together) > 1:
            said = ", ".join(together[:-1]) + f" and {together[-1]}"
            sentences.append(
                f"The data hardly tell {said} apart, only a combination of them: excite more than one of them alone."
            )
    return tuple(sentences)
