"""What a recording holds: its topics, and which column of which table goes where."""

from dataclasses import dataclass

import numpy as np

from norton_bench.recording.layout import Field
from norton_bench.records import CURRENT, MOTION, TICK, TORQUE

FORMAT = "1"
PACKAGE = "norton_bench"
PROFILE = "norton-bench"
METADATA = "norton_bench"  # what was known at the start
OUTCOME = "norton_bench.outcome"  # what was known at the end
RIG_FILE = "rig.toml"


@dataclass(frozen=True)
class Stream:
    """One table of :class:`norton_bench.records.Measured`, written a message a row."""

    table: str  # the attribute's name
    topic: str
    message: str
    dtype: np.dtype[np.void]
    stamp: str  # the column that is the message's log time


STREAMS = (
    Stream("ticks", "/ticks", "Tick", TICK, "tick_ns"),
    Stream("motion", "/actuator/motion", "Motion", MOTION, "arrival_ns"),
    Stream("load_motion", "/load/motion", "Motion", MOTION, "arrival_ns"),
    Stream("torque", "/torque", "Torque", TORQUE, "arrival_ns"),
    Stream("current", "/actuator/current", "Current", CURRENT, "arrival_ns"),
    Stream("load_current", "/load/current", "Current", CURRENT, "arrival_ns"),
    Stream("modulator_motion", "/modulator/motion", "Motion", MOTION, "arrival_ns"),
    Stream("modulator_current", "/modulator/current", "Current", CURRENT, "arrival_ns"),
)

EVENTS = "/events"
SEGMENTS = "/segments"
ESTIMATES = "/estimates"

RAW_PREFIX = "/raw/"
RAW_MESSAGE = "RawFrame"
RAW_CHANNEL_KEY = "channel"  # in the MCAP channel's metadata: the name as the rig knows it


def raw_topic(channel: str) -> str:
    """The topic of a bus's or serial port's frames."""
    return RAW_PREFIX + channel.strip("/")


def raw_fields(length: int) -> tuple[Field, ...]:
    """The fields of a raw frame that carries ``length`` bytes."""
    return (
        Field("stamp_ns", 1, "i8"),
        Field("arbitration_id", 2, "i4"),
        Field("sent", 3, "b1"),
        Field("extended", 4, "b1"),
        Field("remote", 5, "b1"),
        Field("data", 6, None, length),
    )
