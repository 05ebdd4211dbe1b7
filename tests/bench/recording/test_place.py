"""What may go wrong with the place that is recorded to: found out before anything moves, or told once, nothing lost."""

import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import mkdtemp

import pytest

from norton_bench.errors import BenchError, ExperimentError, UsageError
from norton_bench.procedures.options import CalibrateOptions, TareOptions
from norton_bench.recording import disk
from norton_bench.recording import recorder as recorder_module
from norton_bench.recording.disk import Need
from norton_bench.recording.reader import read_recording
from norton_bench.recording.recorder import Recorder
from norton_bench.records import Measured, join
from norton_bench.rig.load import load_rig
from norton_bench.session import engine
from norton_bench.session.schema import Session, Step

RIG = load_rig(Path(__file__).parents[3] / "rigs" / "sim-odrive.toml")
SESSION = Session(
    (Step("tare", TareOptions(duration_s=0.5)), Step("calibrate", CalibrateOptions(duration_s=4.0))), place="test"
)
SMALL = "12m"  # the reserve, and two or three seconds of recording


@contextmanager
def mounted(options: str) -> Iterator[Path]:
    """A file system of its own; not among pytest's folders, which another run of it may be tidying up."""
    folder = Path(mkdtemp(prefix="norton-bench-"))
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", folder], check=False, capture_output=True)
    try:
        if done.returncode:
            pytest.skip("mounting is not permitted here")
        yield folder
    finally:
        if not done.returncode:
            subprocess.run(["umount", "--lazy", folder], check=True)
        folder.rmdir()


@pytest.fixture
def small() -> Iterator[Path]:
    """A disk that is soon full."""
    with mounted(f"size={SMALL}") as folder:
        yield folder


@pytest.fixture
def read_only() -> Iterator[Path]:
    with mounted("ro") as folder:
        yield folder


def put_until_told(recorder: Recorder, part: Callable[[int], Measured]) -> tuple[str, list[Measured]]:
    """What was told, and everything that was put until then."""
    parts: list[Measured] = []
    for first in range(0, 100_000, 100):
        parts.append(part(first))
        try:
            recorder.put(parts[-1])
        except ExperimentError as error:
            return str(error), parts
        time.sleep(0.005)
    raise AssertionError


def assert_nothing_is_lost(path: Path, parts: list[Measured]) -> None:
    recording = read_recording(path)  # without having to be recovered
    assert not recording.complete
    assert recording.measured.ticks.tobytes() == join(parts).ticks.tobytes()
    assert recording.measured.frames == join(parts).frames


def test_a_disk_that_fills_up_ends_the_recording_in_good_order(small: Path, part) -> None:
    recorder = Recorder(small / "r.mcap", rig_text="", metadata={}, patience_s=10.0, candump=True)
    said, parts = put_until_told(recorder, part)
    assert said.startswith(f"recording to {small / 'r.mcap'} has to end: the disk is full; ")
    # What is measured while the drives come to rest is recorded too, and not complained of again.
    parts.append(part(len(parts) * 100))
    recorder.put(parts[-1])
    recorder.close()
    assert_nothing_is_lost(small / "r.mcap", parts)


@pytest.mark.long
def test_a_session_whose_disk_fills_up_is_stopped_with_the_drives_idle(small: Path, monkeypatch) -> None:
    monkeypatch.setattr(disk, "BYTES_A_TICK", 1.0)  # or it would be refused
    with pytest.raises(ExperimentError, match="the disk is full; what was measured until then is whole"):
        engine.run_session(RIG, SESSION, out=small, seed=1, live=False)
    measured = read_recording(small / "sim-odrive.mcap").measured
    assert len(measured.ticks) > 1000
    assert "the disk is full" in next(event.text for event in measured.events if event.kind == "stop")


def test_a_session_for_which_there_is_no_room_does_not_begin(small: Path) -> None:
    with pytest.raises(ExperimentError, match=r"the 15 s planned take about \d+ MB, .* has \d+ MB left; make room"):
        engine.run_session(RIG, SESSION, out=small, seed=1, live=False)
    assert list(small.iterdir()) == []


def test_a_disk_that_is_full_already_is_found_out(small: Path) -> None:
    with (small / "filler").open("wb") as filler, pytest.raises(OSError, match="No space"):  # noqa: PT012
        while True:
            filler.write(bytes(65536))
            filler.flush()
    with pytest.raises(ExperimentError, match=r"cannot record to .*r\.mcap: No space left"):
        Recorder(small / "r.mcap", rig_text="", metadata={})
    assert [path.name for path in small.iterdir()] == ["filler"]


def test_a_disk_that_is_too_slow_is_found_out(tmp_path: Path) -> None:
    with pytest.raises(ExperimentError, match=r"the disk takes .* MB/s, and recording needs 1e\+06 MB/s; record to a"):
        Recorder(tmp_path / "r.mcap", rig_text="", metadata={}, candump=True, need=Need(1e12, 0.0))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("folder", ["", "deeper"])
def test_a_folder_that_cannot_be_written_is_refused(read_only: Path, folder: str) -> None:
    with pytest.raises(UsageError, match="Read-only file system; choose another"):
        Recorder(read_only / folder / "r.mcap", rig_text="", metadata={})


def test_somebody_else_may_be_quicker(tmp_path: Path, monkeypatch) -> None:
    """The name was free when it was asked for."""
    (tmp_path / "r.mcap").write_text("theirs")
    monkeypatch.setattr(Path, "exists", lambda path: False)
    with pytest.raises(UsageError, match="File exists"):
        Recorder(tmp_path / "r.mcap", rig_text="", metadata={})
    assert (tmp_path / "r.mcap").read_text() == "theirs"


def test_a_folder_that_is_deleted_meanwhile_is_there_again_at_the_end(tmp_path: Path, part) -> None:
    recorder = Recorder(tmp_path / "runs" / "r.mcap", rig_text="", metadata={}, patience_s=10.0)
    first = part(0)
    recorder.put(first)
    time.sleep(0.3)
    shutil.rmtree(tmp_path / "runs")
    said, parts = put_until_told(recorder, lambda place: part(place + 100))
    assert "the file was deleted while it was being written; it is written there anew" in said
    recorder.close()
    assert_nothing_is_lost(tmp_path / "runs" / "r.mcap", [first, *parts])


def test_a_file_that_is_moved_meanwhile_is_whole_in_its_new_place(tmp_path: Path, part) -> None:
    recorder = Recorder(tmp_path / "r.mcap", rig_text="", metadata={}, patience_s=10.0)
    (tmp_path / "r.mcap").rename(tmp_path / "elsewhere.mcap")
    said, parts = put_until_told(recorder, part)
    assert said.endswith(f"the file was moved while it was being written; it is whole in {tmp_path}/elsewhere.mcap")
    recorder.close()
    assert_nothing_is_lost(tmp_path / "elsewhere.mcap", parts)
    assert not (tmp_path / "r.mcap").exists()


@pytest.mark.parametrize("kind", [UsageError, ExperimentError])
def test_what_is_told_is_one_sentence(kind: type[BenchError], tmp_path: Path) -> None:
    (tmp_path / "r.mcap").write_text("")
    need = Need() if kind is UsageError else Need(1.0, 1e18)
    name = "r.mcap" if kind is UsageError else "other.mcap"
    with pytest.raises(kind) as caught:
        Recorder(tmp_path / name, rig_text="", metadata={}, need=need)
    assert "\n" not in str(caught.value)
    assert ". " not in str(caught.value)


def test_the_queue_bridges_a_disk_that_stands_still_for_half_a_minute() -> None:
    shortest_part_s = 0.04
    assert recorder_module.QUEUE_PARTS * shortest_part_s > 25
