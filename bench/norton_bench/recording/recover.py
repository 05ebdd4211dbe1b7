"""Rescues a recording that was cut off: everything undamaged goes into a new, complete file."""

from dataclasses import dataclass
from io import FileIO
from pathlib import Path

from norton_bench.errors import ExperimentError, UsageError
from norton_bench.recording.frames import log_lines, log_name
from norton_bench.recording.mcap_file import McapFile
from norton_bench.recording.reader import frames_in
from norton_bench.recording.scan import Scan, scan
from norton_bench.recording.schemas import METADATA, OUTCOME
from norton_bench.recording.wire import Frames


@dataclass(frozen=True)
class RecoveryReport:
    """``bytes_lost`` counts what stands after the break, ``chunks_lost`` the damaged stretches before it.

    ``log`` is the candump log written anew, where there was one beside the recording.
    """

    path: Path
    messages: int
    bytes_lost: int
    chunks_lost: int
    was_complete: bool
    log: Path | None = None


def recovered_name(path: Path) -> Path:
    """Where :func:`recover` writes."""
    return path.with_name(f"{path.stem}.recovered.mcap")


def recover(path: Path) -> RecoveryReport:
    """Write ``<name>.recovered.mcap`` beside ``path``, which is never touched; and the candump log, where there is one.

    Raises UsageError where ``path`` is no recording of ours or the new file is there already, ExperimentError where
    it cannot be written to the end.
    """
    found = scan(path)
    if not found.entries(METADATA):
        raise UsageError(f"{path} holds nothing that norton-bench recorded; there is nothing to recover")
    target = recovered_name(path)
    try:
        target.touch(exist_ok=False)
        with FileIO(target, "r+b") as file:
            messages = _rewrite(found, file)
    except FileExistsError as error:
        raise UsageError(f"{target} is there already; move it away and recover again") from error
    except OSError as error:
        target.unlink(missing_ok=True)
        raise ExperimentError(f"cannot write {target}: {error.strerror}; make room and recover again") from error
    log = _log_anew(found, target) if log_name(path).exists() else None
    lost = 0 if found.finished else found.size - found.sound_bytes
    return RecoveryReport(target, messages, lost, found.damaged, found.finished and not found.damaged, log)


def _log_anew(found: Scan, recovered: Path) -> Path:
    """From the recording's own frames, which have checksums: the last line of a log that was cut off may be half one.

    Raises ExperimentError where it cannot be written.
    """
    path = log_name(recovered)
    try:
        path.write_bytes(log_lines(Frames.of(frames_in(found))))
    except OSError as error:
        raise ExperimentError(f"cannot write {path}: {error.strerror}; the recording itself is {recovered}") from error
    return path


def _rewrite(found: Scan, file: FileIO) -> int:
    """Returns how many messages were rescued."""
    rescued = McapFile(file)
    for record in found.metadata:
        if record.name != OUTCOME:
            rescued.add_metadata(record.name, record.metadata)
    for attachment in found.attachments:
        rescued.add_attachment(attachment)
    for schema in found.schemas.values():
        rescued.add_schema(schema)
    for channel in found.channels.values():
        rescued.add_channel(channel)
    for block in found.blocks:
        rescued.add(block)
    rescued.add_metadata(OUTCOME, _outcome(found))
    rescued.finish()
    return rescued.messages


def _outcome(found: Scan) -> dict[str, str]:
    """How the original ended; a recovered file of a sound original says the same as it did."""
    if found.finished and not found.damaged:
        return found.entries(OUTCOME)
    return {
        "ended": "cut off, then recovered",
        "dropped_parts": "unknown",
        "chunks_lost": str(found.damaged),
        "bytes_lost": str(found.size - found.sound_bytes),
    }
