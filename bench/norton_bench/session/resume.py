"""Resume: what an interrupted session has finished is read from its recording and put before the new measurements."""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from norton_bench.errors import UsageError
from norton_bench.events import PlannedStep
from norton_bench.recording.contents import Recording
from norton_bench.recording.reader import read_recording
from norton_bench.records import NO_DEVICE_TIME, STREAMS, Event, Measured, Table, has_device_clock, join
from norton_bench.rig.rig import Rig
from norton_bench.session.items import ASK

# Kinds of events in the recording, for a session that resumes it.
FINISHED, ANSWERED = "step", "answer"
# The key of the metadata that names the recording which a session resumes.
RESUMES = "resumes"
# The gap put between two recordings: too long to be taken for a missing reading.
PAUSE_NS = 2_000_000_000
# From so many readings on either side the difference of two clocks is computed.
ABOUT_THE_PAUSE = 500


@dataclass
class EarlierSession:
    """Finished procedures and given answers of the session that is resumed; they are taken in order, not done again.

    ``records`` are the measurements of the procedures, one each, with the time stamps of that session.
    """

    place: str = ""
    records: tuple[Measured, ...] = ()
    _finished: deque[tuple[str, Measured]] = field(default_factory=deque)
    _answers: deque[tuple[str, str]] = field(default_factory=deque)

    @property
    def left(self) -> bool:
        """Whether a finished procedure is left that was not taken yet."""
        return bool(self._finished)

    def check(self, plan: Sequence[PlannedStep]) -> None:
        """Raises UsageError, before anything is opened, where a session with this plan cannot have finished these
        procedures.

        An adaptive step finishes any number of procedures, all under its own name.
        """
        steps = [step for step in plan if step.name != ASK]
        places = {0}  # the steps that may come next, for every path that conditions allow
        for name, _ in self._finished:
            following = {at for place in places for at in _possible(steps, place)}
            again = {place - 1 for place in places if place}
            places = {at + 1 for at in following | again if steps[at].name == name}
            if not places and following:
                meant = " or ".join(dict.fromkeys(f"'{steps[at].name}'" for at in sorted(following)))
                raise self._another(f"there '{name}' came next, where this session has {meant}")
            if not places:
                raise self._another("has more finished steps than this session")

    def _another(self, how: str) -> UsageError:
        return UsageError(f"{self.place}: {how}; resume with the session that was recorded")

    def finished(self, name: str) -> Measured | None:
        """The measurements of the next procedure; None where none is left.

        Raises UsageError where the next one has another name.
        """
        if not self._finished:
            return None
        recorded, record = self._finished.popleft()
        if recorded != name:
            raise self._another(f"there '{recorded}' came next, where this session has '{name}'")
        return record

    def answer(self, name: str) -> str | None:
        """The answer given to prompt ``name``; None where none is left. Raises UsageError where another prompt came
        next.
        """
        if not self._answers:
            return None
        asked, answer = self._answers.popleft()
        if asked != name:
            raise self._another(f'there "{asked}" was asked, where this session asks "{name}"')
        return answer


def _possible(steps: Sequence[PlannedStep], place: int) -> Iterator[int]:
    """The steps that may come next: that at ``place``, and later ones as long as those before may be left out."""
    for at in range(place, len(steps)):
        yield at
        if steps[at].certain:
            return


def read_earlier(path: Path, rig: Rig) -> EarlierSession:
    """The finished procedures of the recording at ``path``, or of the newest in that folder, and of those it resumed.

    Raises UsageError where it cannot be read, is of another rig, or has finished nothing.
    """
    path = _newest(path) if path.is_dir() else path
    recording = read_recording(path, raw_frames=False)
    _check_rig(path, recording, rig)
    records = finished_in_all(path, recording)
    if not records:
        raise UsageError(f"{path}: no step was finished in it; run the session from its beginning")
    finished = [(name, record) for name, record in records]
    answers = [_answer(event) for event in recording.measured.events if event.kind == ANSWERED]
    return EarlierSession(str(path), tuple(record for _, record in finished), deque(finished), deque(answers))


def finished_in_all(path: Path, recording: Recording) -> list[tuple[str, Measured]]:
    """Name and measurements of every finished procedure, first those of the recordings that it resumed; on its
    clock."""
    own = _finished_in(recording.measured)
    resumed = resumed_path(path, recording)
    if resumed is None:
        return own
    earlier = finished_in_all(resumed, read_recording(resumed, raw_frames=False))
    names, records = [name for name, _ in earlier], [record for _, record in earlier]
    return [*zip(names, before(records, recording.measured), strict=True), *own]


def with_earlier(path: Path, recording: Recording) -> Measured:
    """All that was measured in a recording, after what the recordings that it resumes have finished."""
    resumed = resumed_path(path, recording)
    if resumed is None:
        return recording.measured
    earlier = [record for _, record in finished_in_all(resumed, read_recording(resumed, raw_frames=False))]
    return after(earlier, recording.measured)


def resumed_path(path: Path, recording: Recording) -> Path | None:
    """The recording that it resumes, None if it resumes none. Raises UsageError where that file is missing."""
    written = recording.metadata.get(RESUMES)
    if not written:
        return None
    for place in (Path(written), path.parent / written, path.parent / Path(written).name):
        if place.is_file() and place.resolve() != path.resolve():
            return place
    raise UsageError(f"{path}: resumes {written}, which is not there; put it beside this recording")


def after(records: Sequence[Measured], later: Measured) -> Measured:
    """``records``, moved in time to before ``later``, and then ``later``."""
    return join([*before(records, later), later]) if records else later


def before(records: Sequence[Measured], later: Measured) -> list[Measured]:
    """``records``, moved in time so that they end before ``later`` begins.

    Time stamps and the numbers of readings and segments continue from one to the other. Positions stay as they were
    read: most encoders are absolute, or kept their count. A sensor's own clock may have been restarted; it is moved.
    """
    if not records or not len(later.ticks):
        return list(records)
    end_ns = max(int(record.ticks["tick_ns"][-1]) for record in records)
    segments = 1 + max(segment.index for record in records for segment in record.segments)
    time_ns = int(later.ticks["tick_ns"][0]) - PAUSE_NS - end_ns
    shift = _Shift(
        time_ns=time_ns,
        device_ns={each.name: _on_device(later, records, each.name, time_ns) for each in STREAMS},
        # One more: -1 means no segment.
        segments=min((segment.index for segment in later.segments), default=0) - segments - 1,
        counted={each.name: _count(later, records, each.name) for each in STREAMS},
    )
    return [shift.applied(record) for record in records]


@dataclass(frozen=True)
class _Shift:
    """What is added to time stamps, segment numbers and numbers of readings; by stream what is added to a device's own
    stamps, None where it sends none.
    """

    time_ns: int
    device_ns: dict[str, int | None]
    segments: int
    counted: dict[str, int]

    def applied(self, record: Measured) -> Measured:
        return replace(
            record,
            ticks=self._ticks(record.ticks),
            **cast(
                dict[str, Any], {each.name: self._readings(getattr(record, each.name), each.name) for each in STREAMS}
            ),
            segments=tuple(
                replace(
                    each,
                    index=each.index + self.segments,
                    start_ns=each.start_ns + self.time_ns,
                    end_ns=each.end_ns + self.time_ns,
                )
                for each in record.segments
            ),
            events=tuple(replace(event, stamp_ns=event.stamp_ns + self.time_ns) for event in record.events),
            frames=(),
        )

    def _ticks(self, table: Table) -> Table:
        table = table.copy()
        table["tick_ns"] += self.time_ns
        table["segment"] += self.segments
        return table

    def _readings(self, table: Table, stream: str) -> Table:
        table = table.copy()
        table["arrival_ns"] += self.time_ns
        table["sequence"] += self.counted[stream]
        if "device_ns" in (table.dtype.names or ()):
            moved_ns = self.device_ns[stream]
            table["device_ns"] = NO_DEVICE_TIME if moved_ns is None else table["device_ns"] + moved_ns
        return table


def _on_device(later: Measured, records: Sequence[Measured], stream: str, time_ns: int) -> int | None:
    """What to add to a device's own stamps, once the host's are moved by ``time_ns``; None where it sends none.

    From the readings on either side of the pause: on average they were delayed equally on their way.
    """
    tables = (getattr(record, stream) for record in reversed(records))
    older: Table | None = next((table for table in tables if len(table)), None)
    if older is None:
        return None
    older, newer = older[-ABOUT_THE_PAUSE:], getattr(later, stream)[:ABOUT_THE_PAUSE]
    if not (has_device_clock(older) and has_device_clock(newer)):
        return None
    then = np.median(older["device_ns"] - (older["arrival_ns"] + time_ns))
    return round(float(np.median(newer["device_ns"] - newer["arrival_ns"]) - then))


def _count(later: Measured, records: Sequence[Measured], stream: str) -> int:
    """What to add so that one number is left out between the two: it shows that readings are missing there."""
    after, earlier = getattr(later, stream), [getattr(record, stream) for record in records]
    last = max((int(table["sequence"][-1]) for table in earlier if len(table)), default=0)
    return (int(after["sequence"][0]) if len(after) else 0) - last - 2


def _finished_in(measured: Measured) -> list[tuple[str, Measured]]:
    finished, since_ns = [], -(2**62)
    for event in measured.events:
        if event.kind == FINISHED:
            record = _record(measured, event, since_ns)
            if record is not None:
                finished.append((event.text, record))
            since_ns = event.stamp_ns
    return finished


def _record(measured: Measured, finished: Event, since_ns: int) -> Measured | None:
    """What the procedure that finished then has measured; it began after ``since_ns``."""
    begun = [
        segment.start_ns
        for segment in measured.segments
        if segment.procedure == finished.text and since_ns <= segment.start_ns < finished.stamp_ns
    ]
    return replace(measured.between(min(begun), finished.stamp_ns), events=()) if begun else None


def _answer(event: Event) -> tuple[str, str]:
    name, _, answer = event.text.partition(": ")
    return name, answer


def _newest(folder: Path) -> Path:
    recordings = sorted(folder.glob("*.mcap"), key=lambda path: path.stat().st_mtime)
    if not recordings:
        raise UsageError(f"{folder}: holds no recording (.mcap); name the one to resume")
    return recordings[-1]


def _check_rig(path: Path, recording: Recording, rig: Rig) -> None:
    own = {"rig": rig.name, "command_unit": rig.command.unit, "tick_s": repr(rig.tick_s)}
    for key, value in own.items():
        recorded = recording.metadata.get(key, "?")
        if recorded != value:
            raise UsageError(
                f"{path}: was recorded with {key} = {recorded}, this rig has {value}; resume on the same rig"
            )
