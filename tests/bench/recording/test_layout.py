"""Our bulk encoding against the protobuf library, which knows nothing of it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from norton_bench.recording import frames
from norton_bench.recording.layout import HEADER, Layout, fields_of, table_from, varint
from norton_bench.recording.schemas import RAW_MESSAGE, layout_in, message_class, raw_fields, raw_names, schema_bytes
from norton_bench.recording.wire import Frames
from norton_bench.records import MOTION, TABLES, TICK, has_device_clock
from norton_drivers.readings import RawFrame

INTEGERS = st.integers(-(2**63), 2**63 - 1)


@pytest.mark.parametrize("kind", [table.kind for table in TABLES], ids=[table.name for table in TABLES])
@given(data=st.data())
def test_rows_are_what_protobuf_reads(kind, data) -> None:
    row = np.zeros(1, kind.columns)
    for name in kind.columns.names:
        info = {"i8": INTEGERS, "i4": st.integers(-(2**31), 2**31 - 1), "u4": st.integers(0, 2**32 - 1)}
        code = kind.columns[name].str.lstrip("<|")
        choice = info.get(code, st.booleans() if code == "b1" else st.floats(width=64))
        row[name] = data.draw(choice) if name != kind.stamp else abs(data.draw(INTEGERS) // 2)
    records = Layout(fields_of(kind.columns)).encode(row, channel=3, first_sequence=9, stamp=kind.stamp)
    message = message_class(kind.message).FromString(records.tobytes()[HEADER.itemsize :])
    for name in kind.columns.names:
        np.testing.assert_equal(getattr(message, name), row[name][0].item())
    assert (records["chan"][0], records["seq"][0], records["log"][0]) == (3, 9, row[kind.stamp][0])


@pytest.mark.parametrize("kind", [table.kind for table in TABLES], ids=[table.name for table in TABLES])
def test_a_layout_is_read_back_from_its_own_schema(kind) -> None:
    described = layout_in(schema_bytes(kind.message), f"norton_bench.{kind.message}")
    assert described == Layout(fields_of(kind.columns))


@given(length=st.integers(0, 20_000), content=st.data())
def test_raw_frames_of_any_length(length: int, content) -> None:
    data = bytes(content.draw(st.integers(0, 255)) for _ in range(min(length, 3))).ljust(length, b"\xa5")
    frame = RawFrame(12345, "can0", True, data, 0x1FFFFFFF, True, False, True, False)
    (rows,) = frames.encode(Frames.of((frame,)), lambda name: 7, 41)
    message = message_class(RAW_MESSAGE).FromString(rows.tobytes()[HEADER.itemsize :])
    assert (message.stamp_ns, message.data, message.arbitration_id) == (12345, data, 0x1FFFFFFF)
    assert (message.sent, message.extended, message.remote) == (True, True, False)
    assert (message.fd, message.switched) == (True, False)
    assert frames.length_of(rows.dtype.itemsize) == length
    again = frames.raw_layout(length).decode(rows.tobytes())
    assert frames.decode([("can0", again)]) == (frame,)


OLDER = frozenset({"stamp_ns", "arbitration_id", "sent", "extended", "remote", "data"})


@pytest.mark.parametrize("length", [0, 8, 200])
def test_raw_frames_of_a_file_from_before_can_fd(length: int) -> None:
    layout = frames.raw_layout(length, OLDER)
    row = layout.blank(1, 7)
    row["stamp_ns"], row["arbitration_id"], row["extended"], row["data"] = 5, 0x29, True, 0x5A
    assert frames.length_of(layout.record.itemsize, OLDER) == length
    message = message_class(RAW_MESSAGE).FromString(row.tobytes()[HEADER.itemsize :])  # ours reads theirs, too
    assert (message.data, message.fd) == (b"\x5a" * length, False)
    (frame,) = frames.decode([("can0", layout.decode(row.tobytes()))])
    assert frame == RawFrame(5, "can0", False, b"\x5a" * length, 0x29, True)
    assert raw_names(schema_bytes(RAW_MESSAGE)) == OLDER | {"fd", "switched"}


@given(st.integers(0, 2**40))
def test_varint_holds_the_value_in_sevens(value: int) -> None:
    encoded = varint(value)
    assert sum((byte & 0x7F) << 7 * place for place, byte in enumerate(encoded)) == value
    assert [bool(byte & 0x80) for byte in encoded] == [True] * (len(encoded) - 1) + [False]


def test_no_frame_size_is_taken_for_another() -> None:
    sizes = [Layout(raw_fields(length)).record.itemsize for length in range(400)]
    assert [frames.length_of(size) for size in sizes] == list(range(400))
    with pytest.raises(ValueError, match="length"):
        frames.length_of(sizes[127] + 1)  # 128 bytes need a longer length: this size cannot be


def test_messages_of_another_layout_are_refused() -> None:
    layout = Layout(fields_of(TICK))
    record = bytearray(layout.encode(np.zeros(1, TICK), channel=1, first_sequence=0, stamp="tick_ns").tobytes())
    with pytest.raises(ValueError, match="length"):
        layout.decode(bytes(record[:-1]))
    record[HEADER.itemsize] ^= 0xFF
    with pytest.raises(ValueError, match="fields"):
        layout.decode(bytes(record))


def test_a_column_that_an_older_file_lacks_is_unknown() -> None:
    older = np.array([(5, 1.5)], [("tick_ns", "i8"), ("command", "f8")])
    table = table_from(older, TICK)
    assert (table["tick_ns"][0], table["command"][0], table["segment"][0]) == (5, 1.5, 0)
    assert np.isnan(table["torque_nm"][0])


def test_readings_of_an_older_file_without_the_column_bear_no_device_time() -> None:
    layout = Layout(fields_of(np.dtype([(name, MOTION[name]) for name in MOTION.names if name != "device_ns"])))
    motion = np.zeros(2, MOTION)
    motion["position_rad"] = 1.5, 2.5
    older = layout.encode(motion, channel=1, first_sequence=0, stamp="arrival_ns").tobytes()
    table = table_from(layout.decode(older), MOTION)
    assert list(table["position_rad"]) == [1.5, 2.5]
    assert not has_device_clock(table)
