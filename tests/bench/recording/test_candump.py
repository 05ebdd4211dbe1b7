"""The candump log, read by python-can's reader and, where it is installed, by can-utils."""

import shutil
import subprocess
from pathlib import Path

import can
import numpy as np
import pytest
from can.io import CanutilsLogReader, CanutilsLogWriter
from hypothesis import given
from hypothesis import strategies as st

from norton_bench.errors import ExperimentError, UsageError
from norton_bench.procedures.waves import coasting
from norton_bench.recording.export import export
from norton_bench.recording.frames import log_lines, log_name
from norton_bench.recording.reader import read_recording
from norton_bench.recording.recorder import Recorder
from norton_bench.recording.recover import recover
from norton_bench.recording.wire import Frames
from norton_bench.rig.load import load_rig, parse_rig
from norton_bench.segments import Use
from norton_drivers.codecs.can_errors import CanErrorFrame, ErrorClass
from norton_drivers.readings import ERROR_FRAME, RawFrame
from tests.bench.bench_in_simulation import opened

RIG = Path(__file__).parents[3] / "rigs" / "sim-odrive.toml"

STAMPS = st.integers(0, 2**40).map(lambda microseconds: microseconds * 1000)
# Remote frame, CAN FD, and whether its data go at a bit rate of their own.
KINDS = [(False, False, False), (True, False, False), (False, True, False), (False, True, True)]
STANDARD, EXTENDED = st.integers(0, 0x7FF), st.integers(0, 0x1FFFFFFF)


@st.composite
def can_frames(draw: st.DrawFn) -> RawFrame:
    extended, (remote, fd, switched) = draw(st.booleans()), draw(st.sampled_from(KINDS))
    identifier = draw(EXTENDED if extended else STANDARD)
    data = b"" if remote else draw(st.binary(max_size=64 if fd else 8))
    return RawFrame(draw(STAMPS), draw(st.sampled_from(["can0", "bus_b"])), draw(st.booleans()), data, identifier,
                    extended, remote, fd, switched)  # fmt: skip


def read(content: bytes, path: Path) -> list[can.Message]:
    path.write_bytes(content)
    with CanutilsLogReader(path) as reader:
        return list(reader)


@given(frames=st.lists(can_frames(), max_size=5))
def test_python_can_reads_back_what_crossed_the_bus(tmp_path_factory: pytest.TempPathFactory, frames) -> None:
    serial = RawFrame(1, "/dev/ttyUSB0", False, b"abc")
    messages = read(log_lines(Frames.of((*frames, serial))), tmp_path_factory.getbasetemp() / "x.log")
    assert len(messages) == len(frames)
    for message, frame in zip(messages, frames, strict=True):
        assert message.timestamp == pytest.approx(frame.stamp_ns * 1e-9, abs=0.5e-6)
        assert (message.channel, message.is_rx) == (frame.channel, not frame.sent)
        assert (message.arbitration_id, message.is_extended_id) == (frame.arbitration_id, frame.extended)
        assert (bytes(message.data), message.is_remote_frame) == (frame.data, frame.remote)
        assert (message.is_fd, message.bitrate_switch) == (frame.fd, frame.switched)


@given(frame=can_frames())
def test_it_is_what_python_can_writes(tmp_path_factory: pytest.TempPathFactory, frame) -> None:
    path = tmp_path_factory.getbasetemp() / "theirs.log"
    with CanutilsLogWriter(path) as writer:
        writer.on_message_received(
            can.Message(
                frame.stamp_ns * 1e-9,
                frame.arbitration_id,
                frame.extended,
                frame.remote,
                channel=frame.channel,
                data=None if frame.remote else frame.data,
                is_fd=frame.fd,
                bitrate_switch=frame.switched,
                is_rx=not frame.sent,
            )
        )
    stamp, *ours = log_lines(Frames.of((frame,))).decode().split()
    their_stamp, *theirs = path.read_text().split()
    assert ours == theirs
    assert float(stamp[1:-1]) == pytest.approx(float(their_stamp[1:-1]), abs=1.1e-6)


def test_a_bus_whose_name_has_blanks_stays_one_word() -> None:
    (line,) = log_lines(Frames.of((RawFrame(2_000_001_000, "left bus", True, b"\x01", 5),))).decode().splitlines()
    assert line == "(2.000001) left_bus 005#01 T"


def test_error_frames_are_recorded_and_marked(tmp_path: Path) -> None:
    with opened(load_rig(RIG)) as bench:
        bench.devices.link.set_tap(bench.loop.outbox.put_frame)
        told = int(ErrorClass.BUS_ERROR | ErrorClass.NO_ACKNOWLEDGEMENT)
        arbitration_id, data = CanErrorFrame(ErrorClass(told)).encode()
        message = can.Message(arbitration_id=arbitration_id, data=data, is_error_frame=True, is_extended_id=False)
        wire = bench.backend._can_wires["can0"]
        bench.after(0.1, lambda: [inbox.append((bench.backend.world.now_ns, message)) for inbox in wire._inboxes])
        with bench.loop.running():
            bench.loop.run(coasting("test", "rest", Use.PREPARE, np.zeros(200)))
        frames = [frame for part in bench.parts for frame in part.frames]
    (error,) = [frame for frame in frames if frame.arbitration_id > 0 and frame.arbitration_id & ERROR_FRAME]
    assert error.arbitration_id == ERROR_FRAME | arbitration_id
    (read_back,) = [message for message in read(log_lines(Frames.of(tuple(frames))), tmp_path / "x.log")
                    if message.is_error_frame]  # fmt: skip
    assert read_back.timestamp == pytest.approx(error.stamp_ns * 1e-9, abs=1e-6)


@pytest.mark.skipif(shutil.which("log2asc") is None, reason="can-utils is not installed")
def test_can_utils_read_it(tmp_path: Path) -> None:
    frames = (
        RawFrame(1_000_000, "can0", False, bytes(range(8)), 0x29),
        RawFrame(2_000_000, "can0", True, b"", 0x1ABCDEFF, True, True),
    )
    (tmp_path / "x.log").write_bytes(log_lines(Frames.of(frames)))
    told = subprocess.run(
        ["log2asc", "-I", tmp_path / "x.log", "can0"], capture_output=True, text=True, check=True
    ).stdout
    assert "29              Rx   d 8 00 01 02 03 04 05 06 07" in told
    assert "1ABCDEFFx" in told


@pytest.fixture
def recorded(tmp_path, part) -> Path:
    with Recorder(tmp_path / "r.mcap", rig_text="", metadata={}, patience_s=10.0, candump=True) as recorder:
        for first in (0, 100):
            recorder.put(part(first))
    return tmp_path / "r.mcap"


def can_frames_of(path: Path) -> tuple[RawFrame, ...]:
    return tuple(frame for frame in read_recording(path).measured.frames if frame.arbitration_id >= 0)


def test_it_stands_beside_the_recording_and_says_the_same(recorded: Path) -> None:
    assert log_name(recorded).name == "r.candump.log"
    frames = can_frames_of(recorded)
    assert len(frames) == 400
    assert log_name(recorded).read_bytes() == log_lines(Frames.of(frames))


def test_it_can_be_made_from_a_recording_later(recorded: Path, tmp_path: Path) -> None:
    assert export(recorded, "candump", tmp_path / "later") == [tmp_path / "later" / "r.candump.log"]
    assert (tmp_path / "later" / "r.candump.log").read_bytes() == log_name(recorded).read_bytes()
    with pytest.raises(ExperimentError, match="File exists"):
        export(recorded, "candump", tmp_path)


def test_recovering_writes_it_anew_without_the_half_line_that_a_kill_may_leave(recorded: Path) -> None:
    whole = log_name(recorded).read_bytes()
    log_name(recorded).write_bytes(whole[:-7])
    recorded.write_bytes(recorded.read_bytes()[:-2000])
    done = recover(recorded)
    assert done.log == recorded.with_name("r.recovered.candump.log")
    rescued = done.log.read_bytes()
    assert whole.startswith(rescued)
    assert rescued == log_lines(Frames.of(can_frames_of(done.path)))


def test_a_log_that_is_there_already_is_left_alone(tmp_path: Path) -> None:
    log_name(tmp_path / "r.mcap").write_text("mine")
    with pytest.raises(UsageError, match=r"r\.candump\.log is there already"):
        Recorder(tmp_path / "r.mcap", rig_text="", metadata={}, candump=True)
    assert [path.name for path in tmp_path.iterdir()] == ["r.candump.log"]


def test_a_rig_may_leave_it_out() -> None:
    text = RIG.read_text()
    assert load_rig(RIG).candump
    assert not parse_rig(text + "\n[recording]\ncandump = false\n", place="x").candump
