"""The end of a segment as it was measured: mean command, velocity and torque."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from norton_bench.errors import ExperimentError
from norton_bench.identification.tables.means import velocity_of
from norton_bench.records import Measured, SegmentInfo


@dataclass(frozen=True)
class Look:
    """``label`` is the segment's name, in words; torque as it was read, with whatever the sensor's zero adds."""

    label: tuple[str, ...]
    command: float
    velocity_rad_s: float
    torque_nm: float


def looks(measured: Measured, procedure: str, look_s: float) -> Iterator[Look]:
    """At the last ``look_s`` of every segment of ``procedure``. Raises ExperimentError where readings are missing."""
    for segment in measured.segments:
        if segment.procedure == procedure:
            yield _look(measured, segment, look_s)


def pairs(found: Iterable[Look]) -> Iterator[tuple[Look, Look]]:
    """An experiment and its mirror image, which comes next."""
    all_of_them = list(found)
    yield from zip(all_of_them[::2], all_of_them[1::2], strict=True)


def _look(measured: Measured, segment: SegmentInfo, look_s: float) -> Look:
    end = measured.between(max(segment.start_ns, segment.end_ns - round(look_s * 1e9)), segment.end_ns)
    if len(end.motion) < 3 or not len(end.torque) or not len(end.ticks):
        raise ExperimentError(f'the end of "{segment.procedure}: {segment.name}" was hardly recorded; run it again')
    return Look(
        label=tuple(segment.name.split()),
        command=float(np.mean(end.ticks["command"])),
        velocity_rad_s=velocity_of(end.motion),
        torque_nm=float(np.mean(end.torque["torque_nm"][end.torque["valid"]])),
    )
