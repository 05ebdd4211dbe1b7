"""Decoded messages of any kind to columns: "topic/field", "topic/field/part", "topic/field[joint]"."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray, IntArray

# Lists of words that name the entries of the lists beside them and below.
NAMES = ("name", "names", "joint_name", "joint_names", "interface_names")
# What an entry of such a list calls itself: foxglove.JointStates.
OWN_NAME = ("name", "joint_name", "joint")
# How libraries write an instant: whole seconds and nanoseconds.
INSTANTS = (("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"), ("seconds", "nanos"))
# The instant that a message is of, in a header or without one.
STAMPS = ("stamp", "timestamp")
HEADER = "header"
# Longer lists without names are images, points or samples, and not one machine's state.
LONGEST = 64
# Stamps further than this from the times at which they were logged are those of another clock.
SAME_CLOCK_NS = 1_000_000_000
LOG_TIME = "log_time"


@dataclass(frozen=True)
class Columns:
    """``arrays`` by name, each (n,) with the times ``times_s`` of the same name, (n,), in seconds of one clock."""

    arrays: Mapping[str, FloatArray]
    times_s: Mapping[str, FloatArray]
    remarks: tuple[str, ...] = ()


@dataclass
class _Topic:
    """What the messages of one topic said. ``stamps_ns`` is 0 where a message had none."""

    log_ns: list[int] = field(default_factory=list)
    stamps_ns: list[int] = field(default_factory=list)
    values: dict[str, list[float]] = field(default_factory=dict)
    rows: dict[str, list[int]] = field(default_factory=dict)


class Collector:
    """Messages, one after the other, to columns."""

    def __init__(self) -> None:
        self._topics: dict[str, _Topic] = {}

    @property
    def count(self) -> int:
        """How many messages were added."""
        return sum(len(topic.log_ns) for topic in self._topics.values())

    @property
    def topics(self) -> tuple[str, ...]:
        return tuple(self._topics)

    def add(self, topic: str, log_ns: int, message: object) -> None:
        """``message`` is any library's. Raises what reading its fields raises."""
        fields = dict(_fields(message))
        numbers = list(_numbers(fields, ""))
        told = self._topics.setdefault(topic, _Topic())
        row = len(told.log_ns)
        told.log_ns.append(log_ns)
        told.stamps_ns.append(_stamp_ns(fields))
        for name, value in numbers:
            told.values.setdefault(name, []).append(value)
            told.rows.setdefault(name, []).append(row)

    def columns(self) -> Columns:
        """All of them, on one clock that counts from the first message, and what is to be said of the clocks."""
        arrays: dict[str, FloatArray] = {}
        times_s: dict[str, FloatArray] = {}
        clocks, remarks = _clocks(self._topics)
        first_ns = min((int(clock.min()) for clock in clocks.values()), default=0)
        for name, topic in self._topics.items():
            clock_s = np.asarray((clocks[name] - first_ns) * 1e-9)
            if not topic.values:
                continue
            for each, values in topic.values.items():
                place = f"{name}/{each}"
                arrays[place] = np.asarray(values, dtype=np.float64)
                times_s[place] = clock_s[topic.rows[each]]
            arrays[f"{name}/{LOG_TIME}"] = np.asarray((np.asarray(topic.log_ns, dtype=np.int64) - first_ns) * 1e-9)
            times_s[f"{name}/{LOG_TIME}"] = clock_s
        return Columns(arrays, times_s, remarks)


def _clocks(topics: Mapping[str, _Topic]) -> tuple[dict[str, IntArray], tuple[str, ...]]:
    """The times of each topic's messages in ns: their own stamps where they all have one, else those of the log.

    Stamps of a clock that the log does not have are moved to it, all by the same: the median of what lies between.
    """
    clocks: dict[str, IntArray] = {}
    strange: dict[str, IntArray] = {}
    for name, topic in topics.items():
        logged, stamps = (np.asarray(each, dtype=np.int64) for each in (topic.log_ns, topic.stamps_ns))
        stamped = bool(np.all(stamps != 0))
        clocks[name] = stamps if stamped else logged
        if stamped and abs(np.median(logged - stamps)) > SAME_CLOCK_NS:
            strange[name] = logged - stamps
    if not strange or len(strange) == len(topics):
        return clocks, ()
    shift_ns = int(np.median(np.concatenate(list(strange.values()))))
    for name in strange:
        clocks[name] = clocks[name] + shift_ns
    return clocks, (
        f"the stamps of {', '.join(strange)} are of another clock; {shift_ns * 1e-9:.6g} s, the median of what lies "
        "between, is added to them.",
    )


def _stamp_ns(fields: Mapping[str, object]) -> int:
    """The instant that a message says it is of, 0 for none."""
    header = fields.get(HEADER)
    inside = dict(_fields(header)) if header is not None and not isinstance(header, (str, int, float)) else {}
    for place in (inside, fields):
        for name in STAMPS:
            parts = _instant(place.get(name))
            if parts is not None:
                return parts[0] * 1_000_000_000 + parts[1]
    return 0


def _instant(value: object) -> tuple[int, int] | None:
    """Seconds and nanoseconds, where ``value`` is an instant."""
    if value is None or isinstance(value, (str, bytes, bool, int, float, list, np.ndarray)):
        return None
    fields = dict(_fields(value))
    for seconds, nanoseconds in INSTANTS:
        if set(fields) == {seconds, nanoseconds}:
            return int(fields[seconds]), int(fields[nanoseconds])
    return None


def _fields(message: Any) -> Iterator[tuple[str, Any]]:
    """The fields of a message of ROS, of protobuf, or of JSON. Raises TypeError for anything else."""
    if isinstance(message, Mapping):
        yield from ((str(name), value) for name, value in message.items())
    elif hasattr(message, "DESCRIPTOR"):
        # What is not set is left out: messages may contain each other without end.
        values = ((each, getattr(message, each.name)) for each in message.DESCRIPTOR.fields)
        yield from (
            (each.name, value)
            for each, value in values
            if each.message_type is None or isinstance(value, (Sequence, Mapping)) or message.HasField(each.name)
        )
    elif hasattr(message, "__dataclass_fields__"):
        yield from (
            (name, getattr(message, name)) for name in message.__dataclass_fields__ if not name.startswith("__")
        )
    else:
        raise TypeError(f"a {type(message).__name__} is no message")


def _numbers(fields: Mapping[str, object], prefix: str, names: Sequence[str] = ()) -> Iterator[tuple[str, float]]:
    """Every number of a message with its name. ``names`` are those that a message around it gives to entries."""
    names = next((found for key in NAMES if (found := _words(fields.get(key)))), names)
    for name, value in fields.items():
        if name == HEADER or (not prefix and name in STAMPS):
            continue
        yield from _of_value(f"{prefix}{name}", value, names)


def _words(value: object) -> list[str]:
    if value is None or isinstance(value, (str, bytes)) or not isinstance(value, Sequence):
        return []
    return list(value) if all(isinstance(each, str) for each in value) else []


def _own_names(entries: Sequence[Any] | npt.NDArray[Any]) -> list[str]:
    """What the entries of a list call themselves, where each has a name of its own."""
    if not all(isinstance(each, Mapping) or hasattr(each, "DESCRIPTOR") for each in entries):
        return []
    names = [
        next((name for key in OWN_NAME if isinstance(name := dict(_fields(each)).get(key), str)), "")
        for each in entries
    ]
    return names if all(names) and len(set(names)) == len(names) else []


def _of_value(place: str, value: Any, names: Sequence[str]) -> Iterator[tuple[str, float]]:
    if isinstance(value, (bool, int, float, np.number, np.bool_)):
        yield place, float(value)
    elif value is None or isinstance(value, (str, bytes, memoryview)):
        return
    elif isinstance(value, (Sequence, np.ndarray)):
        names = _own_names(value) or names
        named = len(names) == len(value)
        if named or len(value) <= LONGEST:
            for index, each in enumerate(value):
                yield from _of_value(f"{place}[{names[index] if named else index}]", each, names)
    elif (instant := _instant(value)) is not None:
        yield place, instant[0] + 1e-9 * instant[1]
    else:
        yield from _numbers(dict(_fields(value)), f"{place}/", names)
