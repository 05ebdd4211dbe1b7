"""Several recordings of one actuator: the result of each, and the combined result."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from norton_bench.errors import ExperimentError, UsageError
from norton_bench.identification.results import FitResult
from norton_bench.identification.sessions import SessionFit, Together, together
from norton_bench.recording.contents import Recording
from norton_bench.recording.reader import read_recording
from norton_bench.report.sessions import SessionRow, SessionsData, write_sessions_report
from norton_bench.result import Result
from norton_bench.rig.rig import NO_MODEL
from norton_bench.segments import Use
from norton_bench.session.conclusion import NEEDED, check_metadata, conclude_recording
from norton_bench.session.resume import RESUMES

WITHOUT_MODEL = "holds tables without a model, which cannot be combined; fit it alone"
IN_WORDS = {"rig": "rig", "command_unit": "command unit", "tick_s": "tick [s]"}


@dataclass(frozen=True)
class OneOf:
    """One of the recordings, with its own result."""

    recording: Path
    metadata: Mapping[str, str]
    result: Result
    fit: FitResult


@dataclass(frozen=True)
class Several:
    """``network`` is None where one of its parameters is valid in no session."""

    sessions: tuple[OneOf, ...]
    together: Together
    network: Path | None
    report: Path


def conclude_several(paths: Sequence[Path], out: Path | None, say: Callable[[str], None]) -> Several:
    """Fit every recording on its own, then combine them; ``say`` is called with the one that is being fitted.

    Network and report of each are written beside it, or into a folder of its own in ``out``; the combined ones beside
    the first recording, or into ``out``. Raises UsageError for recordings that cannot be read or do not belong
    together.
    """
    metadata = _belonging_together(paths)
    sessions: list[OneOf] = []
    for number, (path, own) in enumerate(zip(paths, metadata, strict=True), 1):
        say(f"fitting {path}")
        sessions.append(_one(path, own, None if out is None else out / f"{number}-{path.stem}"))
    common = {key: metadata[0][key] for key in NEEDED}
    combined = together([SessionFit(str(one.recording), one.fit) for one in sessions], common["command_unit"])
    place = (out if out is not None else paths[0].parent) / f"{common['rig']}-{len(paths)}-sessions"
    network = None
    if combined.network is not None:
        network = place.with_name(f"{place.name}.network.json")
        provenance = {**common, "recordings": "; ".join(map(str, paths))}
        combined.network.with_provenance(provenance).save(network)
    rows = tuple(SessionRow(str(one.recording), one.metadata.get("started", ""), one.fit) for one in sessions)
    data = SessionsData(common["rig"], rows, combined)
    report = write_sessions_report(place.with_name(f"{place.name}.report.html"), data)
    return Several(tuple(sessions), combined, network, report)


def _belonging_together(paths: Sequence[Path]) -> list[Mapping[str, str]]:
    """The metadata of each. Raises UsageError, before any is fitted, where one is from another rig, holds nothing to
    combine, or is named twice."""
    metadata: list[Mapping[str, str]] = []
    measured: dict[str, Path] = {}
    for number, path in enumerate(paths):
        if path.resolve() in {before.resolve() for before in paths[:number]}:
            raise UsageError(f"{path}: is given twice; give every session once")
        recording = read_recording(path, raw_frames=False)
        metadata.append(recording.metadata)
        check_metadata(path, metadata[-1])
        for key in NEEDED:
            if metadata[-1][key] != metadata[0][key]:
                raise UsageError(
                    f"{path}: its {IN_WORDS[key]} is {metadata[-1][key]}, that of {paths[0]} is {metadata[0][key]}; "
                    "only sessions of one rig can be combined, so fit it alone"
                )
        _check_fits(path, recording)
        other = measured.setdefault(sha256(recording.measured.ticks.tobytes()).hexdigest(), path)
        if other != path:
            raise UsageError(f"{path}: holds the same measurements as {other}; name every session once")
    return metadata


def _check_fits(path: Path, recording: Recording) -> None:
    """Raises UsageError where no motor can be fitted. Recordings that a session resumed are not checked."""
    if recording.metadata.get("model") == NO_MODEL:
        raise UsageError(f"{path}: {WITHOUT_MODEL}")
    uses = {segment.use for segment in recording.measured.segments}
    if Use.IDENTIFY not in uses and not recording.metadata.get(RESUMES):
        raise UsageError(f"{path}: holds no segment made for identification; leave it out")


def _one(path: Path, metadata: Mapping[str, str], out: Path | None) -> OneOf:
    try:
        if out is not None:
            out.mkdir(parents=True, exist_ok=True)
        result = conclude_recording(path, out)
    except OSError as error:
        raise UsageError(f"{out}: the folder cannot be made ({error.strerror}); choose another") from error
    except ExperimentError as error:
        raise ExperimentError(f"{path}: {error}; leave it out") from error
    if result.fit is None:
        raise UsageError(f"{path}: {WITHOUT_MODEL}")
    return OneOf(path, metadata, result, result.fit)
