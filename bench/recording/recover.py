"""Rescues a recording that was cut off: everything sound goes into a new, complete file."""

from dataclasses import dataclass
from io import FileIO
from pathlib import Path

from bench.errors import ExperimentError, UsageError
from bench.recording.mcap_file import McapFile
from bench.recording.scan import Scan, scan
from bench.recording.streams import METADATA, OUTCOME


@dataclass(frozen=True)
class RecoveryReport:
    """``bytes_lost`` counts what stands after the break, ``chunks_lost`` the damaged stretches before it."""

    path: Path
    messages: int
    bytes_lost: int
    chunks_lost: int
    was_complete: bool


def recovered_name(path: Path) -> Path:
    """Where :func:`recover` writes."""
    return path.with_name(f"{path.stem}.recovered.mcap")


def recover(path: Path) -> RecoveryReport:
    """Write ``<name>.recovered.mcap`` beside ``path``, which is never touched.

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
    lost = 0 if found.finished else found.size - found.sound_bytes
    return RecoveryReport(target, messages, lost, found.damaged, found.finished and not found.damaged)


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
