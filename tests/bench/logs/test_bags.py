"""Bags of ROS and MCAP files of others: what their own libraries wrote comes out as columns with their own times."""

import json
import sqlite3
import sys
from pathlib import Path

import numpy as np
import pytest
from google.protobuf import descriptor_pool, message_factory
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.writer import Writer as McapWriter
from mcap_protobuf.writer import Writer as ProtobufWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from norton_bench.errors import UsageError
from norton_bench.logs.bags import is_bag, is_of_others
from norton_bench.logs.column_map import LogSection
from norton_bench.logs.files import Content, read_file
from norton_bench.logs.fit import Request, fit_logs
from norton_bench.logs.log import read_log
from norton_bench.logs.messages import Collector
from tests.bench.logs.bags import (
    EPOCH_NS,
    JOINTS,
    STORE,
    TRUE,
    Message,
    joint_state,
    moved,
    robot,
    write_bag,
    write_json_mcap,
    write_protobuf_mcap,
    write_ros_mcap,
)
from tests.bench.logs.machines import column_map, estimate

SECTION = LogSection(motion="rotation")
ELBOW = """
[log]
motion = "rotation"
[columns]
position = { name = "/joint_states/position[elbow]", unit = "rad" }
exertion = { name = "/wrench/wrench/torque/z", unit = "N*m" }
[model]
candidates = ["coulomb-viscous"]
delays = false
"""


def read(path: Path) -> Content:
    return read_file(path, SECTION)


def flat(amperes: float) -> object:
    return STORE.types["lab_msgs/msg/Flat"](amperes, np.array([amperes, 2.0]), "word")


def number(value: float) -> object:
    return STORE.types["std_msgs/msg/Float64"](value)


@pytest.fixture(scope="module")
def messages() -> list[Message]:
    return robot(wrench_hz=400.0)


def check_robot(content: Content) -> None:
    """Every number that was written, at the time of its own stamp."""
    time_s, position, velocity = moved("elbow")
    np.testing.assert_array_equal(content.array("/joint_states/position[elbow]", "here"), position)
    np.testing.assert_array_equal(content.array("/joint_states/velocity[elbow]", "here"), velocity)
    np.testing.assert_array_equal(content.array("/joint_states/position[shoulder]", "here"), moved("shoulder")[1])
    np.testing.assert_allclose(content.times_s["/joint_states/position[elbow]"], time_s, atol=1e-9)
    np.testing.assert_allclose(content.array("/joint_states/log_time", "here"), time_s + 0.003, atol=1e-9)
    assert len(content.array("/wrench/wrench/torque/z", "here")) == int(time_s[-1] * 400)
    assert not content.remarks


@pytest.mark.long
def test_a_folder_with_a_database(tmp_path: Path, messages: list[Message]) -> None:
    folder = write_bag(tmp_path / "bag", messages)
    assert is_bag(folder)
    check_robot(read(folder))
    check_robot(read(folder / "bag.db3"))
    # What a recorder that was killed leaves.
    (folder / "metadata.yaml").unlink()
    check_robot(read(folder))


def test_a_folder_with_an_mcap_file_and_that_file_alone(tmp_path: Path, messages: list[Message]) -> None:
    folder = write_bag(tmp_path / "bag", messages, StoragePlugin.MCAP)
    check_robot(read(folder))
    check_robot(read(folder / "bag.mcap"))
    assert is_of_others(folder / "bag.mcap")


def test_what_mcaps_own_library_writes(tmp_path: Path, messages: list[Message]) -> None:
    check_robot(read(write_ros_mcap(tmp_path / "robot.mcap", messages)))


@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
def test_a_compressed_folder(tmp_path: Path, mode: CompressionMode) -> None:
    writer = Writer(tmp_path / "bag", version=9)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/current", "std_msgs/msg/Float64", typestore=STORE)
        for row in range(60):
            writer.write(connection, EPOCH_NS + row, STORE.serialize_cdr(number(row), "std_msgs/msg/Float64"))
    np.testing.assert_array_equal(read(tmp_path / "bag").array("/current/data", "here"), np.arange(60))


def test_a_bag_of_ros_1(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    kinds = store.types
    with Ros1Writer(tmp_path / "old.bag") as writer:
        connection = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        for row in range(60):
            stamp = kinds["builtin_interfaces/msg/Time"](1000 + row, 0)
            header = kinds["std_msgs/msg/Header"](row, stamp, "base")
            state = kinds["sensor_msgs/msg/JointState"](header, ["a"], np.array([0.5 * row]), np.zeros(1), np.zeros(1))
            data = store.serialize_ros1(state, "sensor_msgs/msg/JointState")
            writer.write(connection, (1000 + row) * 10**9 + 5, data)
    content = read(tmp_path / "old.bag")
    np.testing.assert_array_equal(content.array("/joint_states/position[a]", "here"), 0.5 * np.arange(60))
    np.testing.assert_allclose(content.times_s["/joint_states/position[a]"], np.arange(60))


def test_flat_messages_of_ones_own_and_numbers_alone(tmp_path: Path) -> None:
    rows: list[Message] = [("/drive", "lab_msgs/msg/Flat", EPOCH_NS + k * 10**6, flat(0.1 * k)) for k in range(60)]
    rows += [("/angle", "std_msgs/msg/Float64", EPOCH_NS + k * 10**6, number(k)) for k in range(60)]
    content = read(write_bag(tmp_path / "bag", rows))
    np.testing.assert_allclose(content.array("/drive/amperes", "here"), 0.1 * np.arange(60))
    np.testing.assert_allclose(content.array("/drive/pair[1]", "here"), 2.0)
    # Without a header, the time is that of the log.
    np.testing.assert_allclose(content.times_s["/angle/data"], 1e-3 * np.arange(60), atol=1e-9)


def test_json(tmp_path: Path) -> None:
    content = read(write_json_mcap(tmp_path / "state.mcap"))
    time_s, position, _ = moved("elbow")
    np.testing.assert_array_equal(content.array("/state/elbow/angle", "here"), position)
    np.testing.assert_allclose(content.times_s["/state/elbow/angle"], time_s, atol=1e-9)
    assert "/state/note" not in content.arrays


def test_entries_that_have_names_of_their_own_are_called_by_them(tmp_path: Path) -> None:
    """As in foxglove.JointStates, whatever the order of a message."""
    columns = Collector()
    for k in range(6):
        joints = [{"name": name, "position": float(k), "effort": 1.0} for name in ("wrist", "elbow")]
        columns.add("/state", EPOCH_NS + k, {"joints": joints[:: 1 if k % 2 else -1]})
    arrays = columns.columns().arrays
    assert {"/state/joints[elbow]/position", "/state/joints[wrist]/effort"} <= set(arrays)
    np.testing.assert_array_equal(arrays["/state/joints[elbow]/position"], np.arange(6.0))
    twice = Collector()
    twice.add("/state", EPOCH_NS, {"joints": [{"name": "elbow", "position": 1.0}] * 2})
    assert "/state/joints[1]/position" in twice.columns().arrays


def test_protobuf_also_where_messages_contain_each_other(tmp_path: Path) -> None:
    content = read(write_protobuf_mcap(tmp_path / "state.mcap"))
    np.testing.assert_array_equal(content.array("/state/on", "here"), 1.0)
    np.testing.assert_allclose(content.array("/state/angle", "here"), 0.1 * np.arange(80))


def test_protobuf_with_a_stamp_and_parts(tmp_path: Path) -> None:
    file = FileDescriptorProto(name="lab.proto", package="lab", syntax="proto3")
    file.dependency.append("google/protobuf/timestamp.proto")
    kinds = FieldDescriptorProto
    message = file.message_type.add(name="State")
    message.field.add(
        name="timestamp", number=1, type=kinds.TYPE_MESSAGE, type_name=".google.protobuf.Timestamp", label=1
    )
    message.field.add(name="angle_rad", number=2, type=kinds.TYPE_DOUBLE, label=1)
    message.field.add(name="currents", number=3, type=kinds.TYPE_FLOAT, label=3)
    descriptor_pool.Default().Add(file)
    state = message_factory.GetMessageClass(descriptor_pool.Default().FindMessageTypeByName("lab.State"))
    with (tmp_path / "lab.mcap").open("wb") as stream, ProtobufWriter(stream) as writer:
        for row in range(60):
            stamp = Timestamp(seconds=EPOCH_NS // 10**9, nanos=row * 1_000_000)
            one = state(timestamp=stamp, angle_rad=0.0, currents=[row, 2.0])
            writer.write_message("/lab", one, log_time=EPOCH_NS + 10**7, publish_time=EPOCH_NS)
    content = read(tmp_path / "lab.mcap")
    # A zero is a value, though protobuf writes none.
    np.testing.assert_array_equal(content.array("/lab/angle_rad", "here"), 0.0)
    np.testing.assert_array_equal(content.array("/lab/currents[0]", "here"), np.arange(60))
    np.testing.assert_allclose(content.times_s["/lab/angle_rad"], 1e-3 * np.arange(60), atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("wrench_hz", [1000.0, 200.0, 70.0])
def test_a_joint_is_fitted_with_a_sensor_of_another_rate(tmp_path: Path, wrench_hz: float) -> None:
    folder = write_bag(tmp_path / "bag", robot(wrench_hz=wrench_hz))
    fit = fit_logs(Request((folder,), column_map(ELBOW)))
    elbow = TRUE["elbow"]
    assert estimate(fit, "inertia").value == pytest.approx(elbow.inertia, rel=0.03)
    assert estimate(fit, "viscous_damping").value == pytest.approx(elbow.damping, rel=0.02)
    assert estimate(fit, "coulomb_torque").value == pytest.approx(elbow.coulomb, rel=0.05)
    assert any("has other times than position" in said for said in fit.verdict)


def test_the_time_may_be_that_of_the_log(tmp_path: Path, messages: list[Message]) -> None:
    folder = write_bag(tmp_path / "bag", messages)
    text = ELBOW.replace("[columns]", '[columns]\ntime = { name = "/joint_states/log_time", unit = "s" }')
    np.testing.assert_allclose(read_log(folder, column_map(text)).time_s, moved("elbow")[0], atol=1e-9)
    with pytest.raises(UsageError, match=r'the time "/wrench/log_time" is not of the messages of position'):
        read_log(folder, column_map(text.replace("/joint_states/log", "/wrench/log")))


def test_stamps_of_another_clock_are_moved_to_that_of_the_log(tmp_path: Path) -> None:
    rows: list[Message] = []
    for row in range(200):
        log_ns = EPOCH_NS + row * 5_000_000
        # A simulator's clock begins at zero.
        rows.append(
            ("/joint_states", "sensor_msgs/msg/JointState", log_ns, joint_state(10**9 + row * 5_000_000, JOINTS, row))
        )
        rows.append(("/current", "std_msgs/msg/Float64", log_ns, number(row)))
    content = read(write_bag(tmp_path / "bag", rows))
    for name in ("/joint_states/position[elbow]", "/current/data"):
        np.testing.assert_allclose(content.times_s[name], 5e-3 * np.arange(200), atol=1e-6)
    assert any("are of another clock; 1.772e+09 s" in said for said in content.remarks)


def test_stamps_that_nobody_set_are_none(tmp_path: Path) -> None:
    rows: list[Message] = [
        ("/joint_states", "sensor_msgs/msg/JointState", EPOCH_NS + row * 5_000_000, joint_state(0, JOINTS, row))
        for row in range(60)
    ]
    content = read(write_bag(tmp_path / "bag", rows))
    np.testing.assert_allclose(content.times_s["/joint_states/position[elbow]"], 5e-3 * np.arange(60), atol=1e-9)


# What is wrong with a bag: one sentence, with place and mend.
@pytest.mark.parametrize("share", [0.3, 0.7, 0.98])
def test_an_mcap_file_that_is_cut_off_is_read_so_far(tmp_path: Path, messages: list[Message], share: float) -> None:
    path = write_ros_mcap(tmp_path / "robot.mcap", messages)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    (said,) = read(path).remarks
    assert said.startswith(f"{path}: is damaged or ends in the middle (")
    assert "messages before that are used" in said


@pytest.mark.parametrize("share", [0.02, 0.5, 0.9])
def test_a_database_that_is_cut_off(tmp_path: Path, messages: list[Message], share: float) -> None:
    folder = write_bag(tmp_path / "bag", messages)
    data = (folder / "bag.db3").read_bytes()
    (folder / "bag.db3").write_bytes(data[: int(share * len(data))])
    try:
        said = " ".join(read(folder).remarks)
    except UsageError as wrong:
        said = str(wrong)
    assert said.startswith(f"{folder}: is damaged")
    assert "\n" not in said


def test_a_folder_with_spoilt_metadata_names_what_mends_it(tmp_path: Path, messages: list[Message]) -> None:
    folder = write_bag(tmp_path / "bag", messages[:100])
    (folder / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  version: 5\n  sto")
    with pytest.raises(UsageError, match=r"bag: is damaged from its beginning \(.*\); copy it again, or .* reindex"):
        read(folder)


def test_a_library_that_is_not_installed_is_named(
    tmp_path: Path, messages: list[Message], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write_bag(tmp_path / "bag", messages[:100])
    path = write_json_mcap(tmp_path / "state.mcap")
    for name in [name for name in sys.modules if name.partition(".")[0] == "rosbags"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(UsageError, match=r"reading bags of ROS needs rosbags, .*pip install 'norton-bench\[bags\]'"):
        read(folder)
    # JSON needs none.
    assert "/state/elbow/angle" in read(path).arrays


def garbage(path: Path) -> None:
    path.write_bytes(b"\x00garbage" * 100)


def no_messages(path: Path) -> None:
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        writer.finish()


def unknown_kind(path: Path) -> None:
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        channel = writer.register_channel("/state", "flatbuffer", 0)
        for row in range(60):
            writer.add_message(channel, row, b"\x01\x02", row)
        writer.finish()


def wrong_schema(path: Path) -> None:
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        for encoding, schema in (("cdr", "ros2msg"), ("protobuf", "protobuf"), ("cdr", "ros2idl")):
            kind = writer.register_schema(f"lab/{schema}", schema, b"\xff no schema ]]")
            channel = writer.register_channel(f"/{schema}", encoding, kind)
            writer.add_message(channel, 5, b"\x01\x02", 5)
        writer.finish()


def words_only(path: Path) -> None:
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        channel = writer.register_channel("/rosout", "json", 0)
        writer.add_message(channel, 5, json.dumps({"text": "hello", "images": [0] * 5000}).encode(), 5)
        writer.finish()


@pytest.mark.parametrize(
    ("write", "said"),
    [
        (garbage, "is damaged from its beginning"),
        (no_messages, "holds no message; check what was recorded"),
        (unknown_kind, "no message can be decoded, for the kinds of /state (flatbuffer) are not known here; record"),
        (wrong_schema, "/ros2msg (lab/ros2msg), /protobuf (lab/protobuf), /ros2idl (lab/ros2idl) are not known here"),
        (words_only, "none of its topics (/rosout) holds numbers; record joint states"),
    ],
)
def test_what_a_file_lacks_is_said(tmp_path: Path, write: object, said: str) -> None:
    assert callable(write)
    write(tmp_path / "log.mcap")
    with pytest.raises(UsageError) as raised:
        read(tmp_path / "log.mcap")
    assert str(raised.value).startswith(f"{tmp_path / 'log.mcap'}: ")
    assert said in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_database_of_something_else(tmp_path: Path) -> None:
    with sqlite3.connect(tmp_path / "log.db3") as database:
        database.execute("CREATE TABLE numbers (a REAL)")
    database.close()
    with pytest.raises(UsageError, match=r"log\.db3: is damaged from its beginning"):
        read(tmp_path / "log.db3")


def test_a_folder_that_is_no_bag(tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    with pytest.raises(UsageError, match="its kind is not known by its name"):
        read(tmp_path / "bag")


def test_a_topic_that_cannot_be_decoded_is_set_aside(tmp_path: Path) -> None:
    with (tmp_path / "log.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        good, odd = (writer.register_channel(topic, kind, 0) for topic, kind in (("/a", "json"), ("/b", "cbor")))
        for row in range(60):
            writer.add_message(good, row, b'{"x": 1}' if row != 3 else b"{", row)
            writer.add_message(odd, row, b"\x00", row)
        writer.finish()
    content = read(tmp_path / "log.mcap")
    assert len(content.array("/a/x", "here")) == 59
    assert [said.split(": ", 1)[1] for said in content.remarks] == [
        "messages of /b (cbor) cannot be decoded: 60 set aside.",
        "messages of /a (json) cannot be decoded: 1 set aside.",
    ]


def test_names_with_odd_characters_are_columns_as_they_are(tmp_path: Path) -> None:
    names = ("left/elbow [2]", "Gelenk ä·π")
    rows: list[Message] = [
        ("/joint_states", "sensor_msgs/msg/JointState", EPOCH_NS + 10**6 * row, joint_state(0, names, row))
        for row in range(60)
    ]
    content = read(write_bag(tmp_path / "bag", rows))
    np.testing.assert_array_equal(
        content.array("/joint_states/position[left/elbow [2]]", "here"), moved("shoulder")[1][:60]
    )
    np.testing.assert_array_equal(content.array("/joint_states/position[Gelenk ä·π]", "here"), moved("elbow")[1][:60])


def test_a_joint_that_is_not_there_is_named_with_the_nearest(tmp_path: Path, messages: list[Message]) -> None:
    folder = write_bag(tmp_path / "bag", messages)
    with pytest.raises(UsageError, match=r'holds no "/joint_states/position\[elbo\]".*mean "/joint_states/position'):
        read_log(folder, column_map(ELBOW.replace("[elbow]", "[elbo]")))
    # What stands behind a name in a bag is a joint, and no unit.
    with pytest.raises(UsageError, match="gives no unit, and none stands behind its name"):
        read_log(folder, column_map(ELBOW.replace(', unit = "rad"', "")))
