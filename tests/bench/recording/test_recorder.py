import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import fields
from io import FileIO
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from norton_bench.errors import ExperimentError, UsageError
from norton_bench.models.parameters import Estimate, Status
from norton_bench.recording import recorder as recorder_module
from norton_bench.recording.contents import RecordedEstimates
from norton_bench.recording.disk import Syncing
from norton_bench.recording.reader import read_recording
from norton_bench.recording.recorder import Recorder
from norton_bench.recording.recover import recover
from norton_bench.records import Measured, join
from norton_drivers.real_time import LOOP_PRIORITY, permitted_priority

RIG = '[rig]\nname = "x"  # µ\n'


def record(path: Path, parts: list[Measured], live: tuple[RecordedEstimates, ...] = ()) -> None:
    with Recorder(path, rig_text=RIG, metadata={"seed": "3", "command_unit": "N*m"}, patience_s=10.0) as recorder:
        for measured in parts:
            recorder.put(measured)
        for state in live:
            recorder.put_estimate(state)


def assert_same(one: Measured, other: Measured) -> None:
    for item in fields(Measured):
        first, second = getattr(one, item.name), getattr(other, item.name)
        if isinstance(first, np.ndarray):
            assert first.dtype == second.dtype
            assert first.tobytes() == second.tobytes(), item.name
        else:
            assert first == second, item.name


def test_what_is_read_back_is_what_was_put(tmp_path, part) -> None:
    parts = [part(first) for first in range(0, 500, 100)] + [Measured(), part(500, 1)]
    live = tuple(
        RecordedEstimates(k, 10 * k, (Estimate("inertia", 5e-5 * k, float("inf"), "kg*m^2", Status.LEARNING),))
        for k in (1, 2)
    )
    record(tmp_path / "deep" / "r.mcap", parts, live)
    recording = read_recording(tmp_path / "deep" / "r.mcap")
    assert_same(recording.measured, join(parts))
    assert recording.live == live
    assert recording.rig_text == RIG
    assert recording.metadata["seed"] == "3"
    assert recording.metadata["version.numpy"] == np.__version__
    assert recording.complete


def test_raw_frames_can_be_left_out(tmp_path, part) -> None:
    record(tmp_path / "r.mcap", [part(0)])
    recording = read_recording(tmp_path / "r.mcap", raw_frames=False)
    assert_same(recording.measured, part(0).without_frames())


def test_any_mcap_reader_understands_it(tmp_path, part) -> None:
    """The MCAP library's own reader, by index and with checksums, and protobuf's decoding."""
    measured = join([part(0), part(100)])
    record(tmp_path / "r.mcap", [part(0), part(100)])
    with (tmp_path / "r.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        decoded: dict[str, list] = {}
        for item in reader.iter_decoded_messages():
            decoded.setdefault(item.channel.topic, []).append((item.message.log_time, item.decoded_message))
        (attachment,) = reader.iter_attachments()
        backwards = [message.log_time for _, _, message in reader.iter_messages(topics=["/torque"], reverse=True)]
    assert attachment.data.decode() == RIG
    assert summary.statistics.message_count == sum(map(len, decoded.values()))
    assert backwards == measured.torque["arrival_ns"].tolist()[::-1]
    for topic, table in (
        ("/ticks", measured.ticks),
        ("/actuator/motion", measured.motion),
        ("/load/motion", measured.load_motion),
        ("/torque", measured.torque),
        ("/actuator/current", measured.current),
        ("/load/current", measured.load_current),
        ("/temperature", measured.temperature),
    ):
        stamp = table.dtype.names[0]
        assert [log_time for log_time, _ in decoded[topic]] == table[stamp].tolist()
        for name in table.dtype.names:
            np.testing.assert_array_equal([getattr(message, name) for _, message in decoded[topic]], table[name])
    assert sorted(message.data for _, message in decoded["/raw/dev/ttyUSB0"]) == sorted(
        frame.data for frame in measured.frames if frame.channel == "/dev/ttyUSB0"
    )
    assert [message.text for _, message in decoded["/events"]] == [event.text for event in measured.events]


def test_a_name_that_is_taken_is_refused_and_left_alone(tmp_path) -> None:
    path = tmp_path / "r.mcap"
    path.write_text("mine")
    with pytest.raises(UsageError, match=r"r\.mcap is there already"):
        Recorder(path, rig_text="", metadata={})
    assert path.read_text() == "mine"


def test_a_folder_that_cannot_be_is_refused(tmp_path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="cannot record to"):
        Recorder(tmp_path / "file" / "r.mcap", rig_text="", metadata={})


def test_a_full_disk_is_found_out_before_anything_moves(tmp_path, monkeypatch) -> None:
    path = tmp_path / "r.mcap"
    path.symlink_to("/dev/full")
    monkeypatch.setattr(recorder_module, "_create", lambda paths, need: paths)
    with pytest.raises(ExperimentError, match=r"cannot record to .*: No space left"):
        Recorder(path, rig_text="", metadata={})
    assert not path.is_symlink()


def put_until_told(recorder: Recorder, part: Callable[[int], Measured]) -> None:
    for first in range(0, 50_000, 100):
        recorder.put(part(first))
        time.sleep(0.01)


def test_a_disk_that_fills_up_is_told_and_costs_nothing_written(tmp_path, part) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, before[1]))
    try:
        recorder = Recorder(tmp_path / "r.mcap", rig_text="", metadata={}, reserve_bytes=0)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    with pytest.raises(ExperimentError, match="broke down: File too large; rescue"):
        put_until_told(recorder, part)
    with pytest.raises(ExperimentError, match="File too large"):
        recorder.close()
    rescued = read_recording(recover(tmp_path / "r.mcap").path).measured
    assert len(rescued.ticks) >= 100
    assert rescued.ticks[:100].tobytes() == part(0).ticks.tobytes()


@pytest.mark.parametrize("kill", [signal.SIGKILL, signal.SIGTERM])
def test_the_death_of_the_writer_is_told_at_the_next_part(tmp_path, part, kill) -> None:
    recorder = Recorder(tmp_path / "r.mcap", rig_text="", metadata={})
    recorder.put(part(0))
    os.kill(recorder.writer_pid, kill)
    with pytest.raises(ExperimentError, match=r"broke down: the recording process has died; .*norton-bench recover"):
        put_until_told(recorder, part)
    with pytest.raises(ExperimentError, match="broke down"):
        recorder.close()
    with pytest.raises(ExperimentError):
        recorder.put(part(200))


def test_the_death_of_the_writer_is_told_before_anything_moves(tmp_path) -> None:
    recorder = Recorder(tmp_path / "r.mcap", rig_text="", metadata={})
    recorder.check()
    os.kill(recorder.writer_pid, signal.SIGKILL)
    os.waitid(os.P_PID, recorder.writer_pid, os.WEXITED | os.WNOWAIT)
    with pytest.raises(ExperimentError, match="broke down: the recording process has died"):
        recorder.check()
    with pytest.raises(ExperimentError):
        recorder.close()


def test_a_writer_that_hangs_costs_parts_but_never_the_caller(tmp_path, part, monkeypatch) -> None:
    monkeypatch.setattr(recorder_module, "QUEUE_PARTS", 4)
    monkeypatch.setattr(recorder_module, "STOP_TIMEOUT_S", 0.3)
    recorder = Recorder(tmp_path / "r.mcap", rig_text="", metadata={}, patience_s=0.0)
    os.kill(recorder.writer_pid, signal.SIGSTOP)
    measured = part(0)
    begin_s = time.perf_counter()
    for _ in range(50):
        recorder.put(measured)
    assert recorder.dropped_parts > 0
    assert time.perf_counter() - begin_s < 5.0
    with pytest.raises(ExperimentError, match=r"did not finish within|has died"):
        recorder.close()


@pytest.mark.skipif(not permitted_priority(LOOP_PRIORITY), reason="real time is not permitted here")
@pytest.mark.parametrize("wall_time", [True, False])
def test_in_wall_time_the_writer_goes_before_what_is_not_real_time(tmp_path, part, wall_time) -> None:
    with Recorder(tmp_path / "r.mcap", rig_text="", metadata={}, wall_time=wall_time) as recorder:
        recorder.put(part(0))
        policy, priority = (ask(recorder.writer_pid) for ask in (os.sched_getscheduler, os.sched_getparam))
    assert (policy == os.SCHED_FIFO) is wall_time
    assert priority.sched_priority < LOOP_PRIORITY


def test_a_disk_that_reports_errors_later_is_told(tmp_path) -> None:
    """Only when it is brought onto the disk does it show."""
    read_end, write_end = os.pipe()  # which cannot be brought anywhere
    with FileIO(read_end), FileIO(write_end, "w") as pipe, Syncing([pipe], interval_s=0.01) as syncing:
        deadline_s = time.monotonic() + 10
        while syncing.trouble is None:
            assert time.monotonic() < deadline_s
            time.sleep(0.01)
    assert syncing.trouble == "the disk reports: Invalid argument; run again, with --out on another disk"


def test_a_recording_that_dropped_parts_says_so(tmp_path, part) -> None:
    recorder = Recorder(tmp_path / "r.mcap", rig_text="", metadata={})
    recorder.put(part(0))
    recorder.dropped_parts = 2
    assert recorder.close().dropped_parts == 2
    assert not read_recording(tmp_path / "r.mcap").complete


def test_an_error_within_is_not_hidden_by_the_recorder(tmp_path, part) -> None:
    recorder = Recorder(tmp_path / "r.mcap", rig_text="", metadata={})
    os.kill(recorder.writer_pid, signal.SIGKILL)
    with pytest.raises(ZeroDivisionError) as caught, recorder:
        raise ZeroDivisionError
    assert "norton-bench recover" in caught.value.__notes__[0]


def test_closing_twice_is_harmless_and_putting_afterwards_is_told(tmp_path, part) -> None:
    recorder = Recorder(tmp_path / "r.mcap", rig_text="", metadata={})
    recorder.put(part(0))
    first = recorder.close()
    assert recorder.close() == first
    assert first.size_bytes == (tmp_path / "r.mcap").stat().st_size
    with pytest.raises(ExperimentError, match="closed already"):
        recorder.put(part(100))


def test_the_death_of_the_experiment_still_ends_the_file(tmp_path) -> None:
    """Only the experiment dies: the recording process sees it go and finishes what it was sent."""
    script = (
        "import os, sys; from pathlib import Path; from norton_bench.records import *; import numpy as np\n"
        "from norton_bench.recording.recorder import Recorder\n"
        "recorder = Recorder(Path(sys.argv[1]), rig_text='', metadata={})\n"
        "recorder.put(Measured(ticks=np.zeros(50, TICK)))\n"
        "while recorder._queue.qsize(): pass\n"
        "import time; time.sleep(0.3); os.kill(os.getpid(), 9)\n"
    )
    path = tmp_path / "r.mcap"
    process = subprocess.run([sys.executable, "-c", script, str(path)], check=False, timeout=60)
    assert process.returncode == -signal.SIGKILL
    deadline_s = time.monotonic() + 20
    while True:
        try:
            recording = read_recording(path)
            break
        except UsageError:
            assert time.monotonic() < deadline_s
            time.sleep(0.05)
    assert len(recording.measured.ticks) == 50
    assert not recording.complete


def test_the_writer_imports_nothing_slow() -> None:
    code = "import sys, norton_bench.recording.writer; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"numba", "scipy", "matplotlib", "pyarrow", "pint", "pydantic", "can", "textual"} & set(loaded)
