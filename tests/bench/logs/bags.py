"""Bags that the libraries of ROS, MCAP and protobuf write: two joints of a robot, whose motion scipy integrates."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf.struct_pb2 import Struct
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.writer import Writer as McapWriter
from mcap_protobuf.writer import Writer as ProtobufWriter
from mcap_ros2.writer import Writer as RosWriter
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.integrate import solve_ivp

from norton_bench.arrays import FloatArray

EPOCH_NS = 1_772_000_000_000_000_000
JOINTS = ("shoulder", "elbow")


@dataclass(frozen=True)
class Joint:
    """``effort = I a + B v + τc sgn v``, driven through the port by a motor of another."""

    inertia: float
    damping: float
    coulomb: float
    phase: float

    def force(self, time_s: FloatArray) -> FloatArray:
        waves = ((0.9, 0.31), (0.7, 0.83), (0.5, 1.9))
        return np.asarray(
            sum(a * np.sin(2 * np.pi * f * time_s + self.phase * (k + 1)) for k, (a, f) in enumerate(waves))
        )

    def motion(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Position and velocity under that torque."""

        def slope(t: float, state: FloatArray) -> list[float]:
            friction = self.damping * state[1] + self.coulomb * np.tanh(state[1] / 0.002)
            return [state[1], float((self.force(np.array(t)) - friction) / self.inertia)]

        found = solve_ivp(slope, (0, time_s[-1]), [0.0, 0.0], method="LSODA", t_eval=time_s, rtol=1e-8, max_step=0.01)
        return found.y[0], found.y[1]


TRUE: Mapping[str, Joint] = {"shoulder": Joint(0.05, 0.3, 0.2, 0.3), "elbow": Joint(0.02, 0.15, 0.1, 1.3)}


@cache
def moved(joint: str, duration_s: float = 12.0, rate_hz: float = 200.0) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time, position and velocity of a joint."""
    time_s = np.arange(int(duration_s * rate_hz)) / rate_hz
    return time_s, *TRUE[joint].motion(time_s)


STORE = get_typestore(Stores.ROS2_HUMBLE)
STORE.register(get_types_from_msg("float64 amperes\nfloat64[2] pair\nstring word", "lab_msgs/msg/Flat"))


def header(stamp_ns: int) -> Any:
    time = STORE.types["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
    return STORE.types["std_msgs/msg/Header"](time, "base")


def joint_state(stamp_ns: int, names: tuple[str, ...], row: int) -> Any:
    """A message of all joints; the effort is in another topic."""
    motions = [moved(joint) for joint in JOINTS]
    columns = [np.array([motion[k][row] for motion in motions]) for k in (1, 2)]
    return STORE.types["sensor_msgs/msg/JointState"](header(stamp_ns), list(names), *columns, np.zeros(0))


def wrench(stamp_ns: int, torque: float) -> Any:
    vector, both = STORE.types["geometry_msgs/msg/Vector3"], STORE.types["geometry_msgs/msg/Wrench"]
    return STORE.types["geometry_msgs/msg/WrenchStamped"](
        header(stamp_ns), both(vector(0.0, 0.0, 0.0), vector(0.0, 0.0, torque))
    )


Message = tuple[str, str, int, Any]


def robot(names: tuple[str, ...] = JOINTS, late_ns: int = 3_000_000, wrench_hz: float = 1000.0) -> list[Message]:
    """Topic, kind, log time and message: joint states at 200 Hz that are logged late, and a wrench at the elbow.

    The wrench is at the port, so that it opposes what the motor drives: the elbow is moved from there alone.
    """
    time_s = moved("elbow")[0]
    result: list[Message] = []
    for row, each in enumerate(time_s):
        stamp_ns = EPOCH_NS + round(each * 1e9)
        state = joint_state(stamp_ns, names, row)
        result.append(("/joint_states", "sensor_msgs/msg/JointState", stamp_ns + late_ns, state))
    for each in np.arange(int(time_s[-1] * wrench_hz)) / wrench_hz:
        stamp_ns = EPOCH_NS + round(each * 1e9)
        torque = -float(TRUE["elbow"].force(np.array(each)))
        result.append(("/wrench", "geometry_msgs/msg/WrenchStamped", stamp_ns + late_ns, wrench(stamp_ns, torque)))
    return sorted(result, key=lambda message: message[2])


def write_bag(folder: Path, messages: list[Message], storage: StoragePlugin = StoragePlugin.SQLITE3) -> Path:
    """A ROS 2 bag by rosbags."""
    with Writer(folder, version=9, storage_plugin=storage) as writer:
        connections = {
            topic: writer.add_connection(topic, kind, typestore=STORE)
            for topic, kind in {topic: kind for topic, kind, _, _ in messages}.items()
        }
        for topic, kind, log_ns, message in messages:
            writer.write(connections[topic], log_ns, STORE.serialize_cdr(message, kind))
    return folder


def lists(message: Any) -> Any:
    """The same with lists in the place of arrays, which MCAP's library wants."""
    arrays = {name: each.tolist() for name, each in vars(message).items() if isinstance(each, np.ndarray)}
    return replace(message, **arrays)


def write_ros_mcap(path: Path, messages: list[Message]) -> Path:
    """An MCAP file with ROS 2 messages by MCAP's own library."""
    with path.open("wb") as file, RosWriter(file, chunk_size=1 << 16) as writer:
        schemas = {
            kind: writer.register_msgdef(kind, STORE.generate_msgdef(kind, ros_version=2)[0])
            for kind in {kind for _, kind, _, _ in messages}
        }
        for topic, kind, log_ns, message in messages:
            writer.write_message(topic, schemas[kind], lists(message), log_ns, log_ns)
    return path


def write_json_mcap(path: Path) -> Path:
    """An MCAP file with JSON messages, as Foxglove reads them: the elbow, and the torque at its port."""
    time_s, position, _ = moved("elbow")
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema("state", "jsonschema", json.dumps({"type": "object"}).encode())
        channel = writer.register_channel("/state", "json", schema)
        for each, angle in zip(time_s, position, strict=True):
            stamp_ns = EPOCH_NS + round(each * 1e9)
            content = {
                "timestamp": {"sec": stamp_ns // 10**9, "nsec": stamp_ns % 10**9},
                "elbow": {"angle": angle, "torque": -float(TRUE["elbow"].force(np.array(each)))},
                "note": "none",
                "missing": None,
            }
            writer.add_message(channel, stamp_ns + 5_000_000, json.dumps(content).encode(), stamp_ns)
        writer.finish()
    return path


def write_protobuf_mcap(path: Path) -> Path:
    """An MCAP file with protobuf messages: a message that may contain itself, and one that is a time."""
    with path.open("wb") as file, ProtobufWriter(file) as writer:
        for row in range(80):
            stamp_ns = EPOCH_NS + row * 10_000_000
            state = Struct()
            state.update({"angle": 0.1 * row, "on": True, "words": "none"})
            writer.write_message("/state", state, log_time=stamp_ns, publish_time=stamp_ns)
            clock = Timestamp(seconds=row, nanos=5)
            writer.write_message("/clock", clock, log_time=stamp_ns, publish_time=stamp_ns)
    return path
