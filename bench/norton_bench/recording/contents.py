"""What a recording says when it is read back."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from norton_bench.models.parameters import Estimate
from norton_bench.records import Measured


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
