"""The logs on their grid, what of them is trained on, and what noise of the readings does to the rows of the equation.

Noise of a position counts most where it is fast: an acceleration's grows with the square of the frequency. So rows hold
what is slower than the frequency at which the motion sinks into its noise, and what noise adds to them is taken off.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy import signal

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.identification.standstill import resolution
from norton_bench.logs.column_map import ColumnMap
from norton_bench.logs.grid import Filters, Stretch
from norton_bench.logs.motion import Motion

# Spectra are averaged over pieces so long, or over so many; a shorter one tells nothing. The window's side lobes, at
# -92 dB, hide no noise.
SPECTRUM_S = 4.0
PIECES = 4
LEAST_SPECTRUM = 64
WINDOW = "blackmanharris"
# The motion is seen where its amplitude is so many times that of its noise; below this share noise is next to nothing.
CLEARLY = 2.0
NEGLIGIBLE = 0.001
# A command that is held for a sample has lost 1.6 % of itself, 1 - sinc(0.1), at this share of the sampling rate.
HELD = 0.1
# Counting is simulated so often: nobody knows where between two counts the motion lies.
DRAWS = 4

Splits = Sequence[tuple[BoolArray, BoolArray]]


@dataclass(frozen=True)
class Readings:
    """All stretches; ``splits`` are the instants of each to train and to test on."""

    stretches: tuple[Stretch, ...]
    splits: tuple[tuple[BoolArray, BoolArray], ...]
    filters: Filters
    _noise: dict[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, column_map: ColumnMap, parts: Sequence[Stretch], splits: Splits) -> "Readings":
        """With the filters of the map; where it says nothing of rows, these hold what is seen of the acceleration."""
        wanted = column_map.filter
        filters = Filters.of(parts[0].dt_s, wanted.cutoff_hz, wanted.rate_hz)
        readings = cls(tuple(parts), tuple(splits), filters)
        if wanted.rate_hz is not None:
            return readings
        fastest_hz = readings.fastest_hz if column_map.model.inertia else float("inf")
        if "command" in parts[0].columns:
            fastest_hz = min(fastest_hz, HELD / parts[0].dt_s)
        return replace(readings, filters=Filters.of(parts[0].dt_s, wanted.cutoff_hz, None, fastest_hz), _noise={})

    @property
    def motion_name(self) -> str:
        """The column that the motion is taken from."""
        return self.stretches[0].motion_name

    @property
    def trained(self) -> list[BoolArray]:
        """The samples of each stretch that are trained on."""
        return [train for train, _ in self.splits]

    def white_noise(self, name: str) -> float:
        """The rms deviation of white noise in a column, where it is sound and trained on; each is found once."""
        if name not in self._noise:
            self._noise[name] = self._white_noise(name)
        return self._noise[name]

    def _white_noise(self, name: str) -> float:
        pairs = [(part, part.sound & train) for part, train in zip(self.stretches, self.trained, strict=True)]
        noise = [self.filters.noise(part, name, chosen) ** 2 for part, chosen in pairs if chosen.any()]
        return float(np.sqrt(np.mean(noise)))

    @cached_property
    def fastest_hz(self) -> float:
        """Up to which frequency the acceleration trained on is ``CLEARLY`` more than its noise, or all noise so far
        next to nothing beside all motion so far. Infinite where nothing is long enough to tell."""
        name, dt_s = self.motion_name, self.filters.dt_s
        pairs = zip(self.stretches, self.trained, strict=True)
        runs = [run for part, train in pairs for run in _runs(part.columns[name], part.sound & train)]
        size = min(max((run.size for run in runs), default=0) // PIECES, round(SPECTRUM_S / dt_s))
        if size < LEAST_SPECTRUM:
            return float("inf")
        runs = [run for run in runs if run.size >= size]
        # Differences, as the equation takes them, so that what is slow does not leak into what is fast.
        order = 2 if name == "position" else 1
        spectra = [signal.welch(np.diff(run, order), 1 / dt_s, WINDOW, size - order) for run in runs]
        power = np.average([spectrum for _, spectrum in spectra], axis=0, weights=[run.size for run in runs])
        hertz = spectra[0][0]
        noise = self.white_noise(name) ** 2 * 2 * dt_s * (2 * np.sin(np.pi * hertz * dt_s)) ** (2 * order)
        seen = int(np.argmax(np.cumsum(power - (1 + CLEARLY**2) * noise)))
        clean = np.flatnonzero(np.cumsum(noise) <= NEGLIGIBLE**2 * np.cumsum(power))
        return float(hertz[max(seen, int(clean[-1]) if clean.size else 0, 1)])

    @cached_property
    def acceleration_errors(self) -> FloatArray:
        """What noise makes of the acceleration, simulated at every sample of all stretches, (DRAWS, samples)."""
        random = np.random.default_rng(0)
        white = self.white_noise(self.motion_name)
        return np.concatenate([self._errors(part, white, random) for part in self.stretches], axis=1)

    def _errors(self, part: Stretch, white: float, random: np.random.Generator) -> FloatArray:
        """A motion slower than a count in a sample has errors that are slow, too: it is counted once more. What
        scatters beyond the counts is added."""
        name = self.motion_name
        # What changes in every row has no counts that show.
        count = min(resolution(part.log.columns[name]), np.sqrt(12) * white)
        beyond = np.sqrt(max(white**2 - count**2 / 12, 0.0))
        # What the low-pass of the rows leaves of the counts would be counted to the same again.
        slower_hz = min(self.fastest_hz, self.filters.cutoff_hz)
        motion = part.in_log(name, replace(self.filters, cutoff_hz=slower_hz).smooth(part.columns[name]))
        draws = []
        for shift in count * np.arange(DRAWS) / DRAWS:
            read = motion + shift + beyond * random.standard_normal(motion.size)
            error = part.on_grid(name, np.round(read / count) * count - shift - motion)
            draws.append(Motion.of_column(name, error, self.filters).acceleration)
        return np.stack(draws)


def _runs(values: FloatArray, chosen: BoolArray) -> list[FloatArray]:
    """The pieces of ``values`` (n,) that are chosen without a break."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], chosen.astype(np.int8), [0]])))
    return [values[first:end] for first, end in edges.reshape(-1, 2)]
