"""A segment as it is recorded."""

from norton_bench.records import SegmentInfo
from norton_bench.segments import Segment


def segment_info(segment: Segment, index: int, start_ns: int, end_ns: int) -> SegmentInfo:
    """The ``index``-th that was run, which took until ``end_ns``, or has so far."""
    mode = segment.mode.value
    return SegmentInfo(index, segment.procedure, segment.name, segment.use, mode, start_ns, end_ns, segment.preview)
