import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from norton_bench.errors import UsageError
from norton_bench.recording.reader import read_recording
from norton_bench.recording.recorder import Recorder
from norton_bench.recording.recover import recover, recovered_name
from norton_bench.records import MOTION, TICK, Measured, join

KILLS = 4
KEPT_BEFORE_S = 0.15


def record(path: Path, parts: list[Measured]) -> None:
    with Recorder(path, rig_text="rig", metadata={"seed": "1"}, patience_s=10.0) as recorder:
        for measured in parts:
            recorder.put(measured)


@pytest.fixture
def recorded(tmp_path, part) -> Path:
    path = tmp_path / "r.mcap"
    record(path, [part(first) for first in range(0, 400, 100)])
    return path


def cut(path: Path, size: int) -> Path:
    path.write_bytes(path.read_bytes()[:size])
    return path


def test_wherever_it_is_cut_the_rows_are_a_true_beginning(recorded, part, tmp_path) -> None:
    whole = join([part(first) for first in range(0, 400, 100)])
    size = recorded.stat().st_size
    content = recorded.read_bytes()
    rows_before = 0
    for number, place in enumerate(np.linspace(2000, size - 1, 25).astype(int)):
        path = tmp_path / f"cut{number}.mcap"
        path.write_bytes(content[:place])
        with pytest.raises(UsageError, match=r"cut off after \d+ of \d+ bytes; .*norton-bench recover .*mcap"):
            read_recording(path)
        report = recover(path)
        assert path.read_bytes() == content[:place]
        recovered = read_recording(report.path)
        rows = len(recovered.measured.ticks)
        assert rows >= rows_before
        rows_before = rows
        assert not recovered.complete
        for name in ("ticks", "motion", "torque", "current"):
            found = getattr(recovered.measured, name)
            assert found.tobytes() == getattr(whole, name)[: len(found)].tobytes()
        assert set(recovered.measured.frames) <= set(whole.frames)
    assert rows_before == 400


def test_a_damaged_chunk_is_left_out_and_the_rest_kept(recorded) -> None:
    whole = recover(recorded).messages
    recovered_name(recorded).unlink()
    content = bytearray(recorded.read_bytes())
    middle = content.index(b"zstd", len(content) // 3) + 40
    content[middle : middle + 8] = b"\x00" * 8
    recorded.write_bytes(content)
    with pytest.raises(UsageError, match=r"damaged in 1 place; .*recover"):
        read_recording(recorded)
    report = recover(recorded)
    assert (report.chunks_lost, report.bytes_lost, report.was_complete) == (1, 0, False)
    assert not read_recording(report.path).complete
    assert 0.8 * whole < report.messages < whole
    with report.path.open("rb") as file:
        assert sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages()) == report.messages


def test_a_sound_recording_is_recovered_whole(recorded, part) -> None:
    report = recover(recorded)
    assert report.was_complete
    again = read_recording(report.path)
    assert again.complete
    assert again.measured.ticks.tobytes() == read_recording(recorded).measured.ticks.tobytes()
    assert again.rig_text == "rig"


def test_a_recovered_file_is_never_written_over(recorded) -> None:
    cut(recorded, recorded.stat().st_size - 50)
    recovered_name(recorded).write_text("mine")
    with pytest.raises(UsageError, match="is there already"):
        recover(recorded)
    assert recovered_name(recorded).read_text() == "mine"


@pytest.mark.parametrize("use", [read_recording, recover])
@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (None, "there is no recording"),
        (b"", "is empty"),
        (b"hello, this is a text", "is not an MCAP recording"),
        (b"\x89MCAP0\r\n", "cut off|nothing that norton-bench recorded"),
    ],
)
def test_what_is_no_recording_is_one_sentence(tmp_path, use, content, sentence) -> None:
    path = tmp_path / "x.mcap"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(UsageError, match=sentence) as caught:
        use(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("use", [read_recording, recover])
def test_a_folder_is_no_recording(tmp_path, use) -> None:
    with pytest.raises(UsageError, match="is a folder"):
        use(tmp_path)


def test_a_foreign_mcap_file_is_refused(tmp_path) -> None:
    from mcap.writer import Writer

    with (tmp_path / "f.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()
    with pytest.raises(UsageError, match="not recorded by norton-bench"):
        read_recording(tmp_path / "f.mcap")


def forever(path: Path) -> None:
    """What the killed experiment does: 10 ms parts in wall time, each row true by construction."""
    with Recorder(path, rig_text="", metadata={}) as recorder:
        print(recorder.writer_pid, flush=True)
        last_ns = time.monotonic_ns()
        while True:
            time.sleep(0.02)
            now_ns = time.monotonic_ns()
            stamps = np.arange(last_ns // 1_000_000 + 1, now_ns // 1_000_000 + 1) * 1_000_000
            last_ns = now_ns
            ticks, motion = np.zeros(len(stamps), TICK), np.zeros(len(stamps), MOTION)
            ticks["tick_ns"] = motion["arrival_ns"] = stamps
            ticks["torque_nm"] = motion["position_rad"] = np.sin(stamps * 1e-9)
            recorder.put(Measured(ticks=ticks, motion=motion))


@pytest.mark.wall_time
def test_killed_with_the_recording_process_it_keeps_all_but_the_last_moment(tmp_path) -> None:
    code = (
        "import importlib.util, sys; from pathlib import Path\n"
        f"spec = importlib.util.spec_from_file_location('killed', {__file__!r})\n"
        "killed = importlib.util.module_from_spec(spec); spec.loader.exec_module(killed)\n"
        "killed.forever(Path(sys.argv[1]))"
    )
    for number in range(KILLS):
        path = tmp_path / f"k{number}.mcap"
        with subprocess.Popen([sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            writer_pid = int(process.stdout.readline())
            time.sleep(0.4 + 0.13 * number)
            killed_ns = time.monotonic_ns()
            os.kill(writer_pid, signal.SIGKILL)
            process.kill()
        ticks = read_recording(recover(path).path).measured.ticks
        stamps = ticks["tick_ns"]
        assert killed_ns - stamps[-1] < KEPT_BEFORE_S * 1e9
        np.testing.assert_array_equal(np.diff(stamps), 1_000_000)
        np.testing.assert_array_equal(ticks["torque_nm"], np.sin(stamps * 1e-9))
