"""A recording as it is read back."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from norton_bench.models.parameters import Estimate
from norton_bench.records import STREAMS, Measured


class EstimatesLike(Protocol):
    """The part of the identifier's live state that is recorded."""

    @property
    def stamp_ns(self) -> int: ...
    @property
    def samples(self) -> int: ...
    @property
    def estimates(self) -> tuple[Estimate, ...]: ...


@dataclass(frozen=True)
class RecordedEstimates:
    """The live estimates as they stood at ``stamp_ns``, from ``samples`` samples."""

    stamp_ns: int
    samples: int
    estimates: tuple[Estimate, ...]


@dataclass(frozen=True)
class Recording:
    """One experiment. ``complete`` says that it was ended in good order and nothing was dropped on the way.

    ``metadata`` holds what the recorder was given, and the versions of everything it ran with. ``part_ends_ns`` says
    where the session had handed over its parts: each ends before the tick of that time.
    """

    measured: Measured
    rig_text: str
    metadata: Mapping[str, str]
    complete: bool
    live: tuple[RecordedEstimates, ...] = ()
    part_ends_ns: tuple[int, ...] = ()


def parts_of(recording: Recording) -> Iterator[Measured]:
    """A recording taken apart again into the parts in which the session handed it on.

    Part by part, without frames: the ticks until each of ``part_ends_ns``, and what had arrived by the last of
    them.

    Every part that a segment reaches into names it with its last end.
    """
    ticks = recording.measured.ticks
    begun_ns = ticks["tick_ns"] + ticks["lateness_ns"]
    first, seen_ns = 0, 0
    for end_ns in recording.part_ends_ns:
        last = int(np.searchsorted(ticks["tick_ns"], end_ns))
        if last > first:
            until_ns = int(begun_ns[last - 1]) + 1
            yield _part(recording.measured, slice(first, last), seen_ns, until_ns)
            first, seen_ns = last, until_ns


def _part(measured: Measured, ticks: slice, start_ns: int, end_ns: int) -> Measured:
    """These ticks, and the readings that arrived from ``start_ns`` until before ``end_ns``."""
    rows = measured.ticks[ticks]
    tables = {}
    for stream in STREAMS:
        table = getattr(measured, stream.name)
        first, last = np.searchsorted(table[stream.kind.stamp], [start_ns, end_ns])
        tables[stream.name] = table[first:last]
    first_ns, last_ns = (int(rows["tick_ns"][end]) for end in (0, -1))
    return Measured(
        ticks=rows,
        **tables,
        segments=tuple(each for each in measured.segments if each.start_ns <= last_ns and each.end_ns > first_ns),
        events=tuple(each for each in measured.events if start_ns <= each.stamp_ns < end_ns),
        chain=measured.chain,
    )
