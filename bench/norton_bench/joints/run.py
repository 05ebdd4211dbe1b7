"""An arm from its file to its result: measured on the benches of its joints, and concluded from their recordings."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from norton_bench.errors import ExperimentError, UsageError
from norton_bench.identification.cleaning import clean
from norton_bench.joints import experiment
from norton_bench.joints.arm import JOINTS, Arm
from norton_bench.joints.bench import ARM, RUN, open_benches
from norton_bench.joints.hand import HandStiffness, hand_stiffness
from norton_bench.joints.impedance import JointImpedance, fit, spectra
from norton_bench.joints.source import SourcePath, source_path
from norton_bench.loop.stop_word import never_stop
from norton_bench.procedures.calibrate import CalibrateProcedure
from norton_bench.procedures.tare import TareProcedure
from norton_bench.recording.reader import read_recording

# A swing smaller than this share of the one asked for was made smaller on purpose.
SMALLER = 0.95
PREPARATION = (TareProcedure(), CalibrateProcedure())


@dataclass(frozen=True)
class ArmResult:
    """``source`` is None where the file asks for no reach, ``hand`` where it knows no lengths, and both where ``notes``
    say why."""

    name: str
    impedance: JointImpedance
    source: SourcePath | None = None
    hand: HandStiffness | None = None
    notes: tuple[str, ...] = ()
    recordings: tuple[Path, ...] = ()
    metadata: Mapping[str, str] = field(default_factory=dict)


def run_arm(
    arm: Arm,
    out: Path,
    *,
    seed: int | None = None,
    on_note: Callable[[str], None] = lambda _text: None,
    stop_request: Callable[[], str | None] = never_stop,
) -> ArmResult:
    """Measure the arm; recordings are in the folder ``out``.

    Raises WiringError, RigError and UsageError before anything moves; DeviceError, SafetyStopError, OperatorStopError
    and ExperimentError afterwards, with the drives idle and all that was measured in the recordings.
    """
    record_arm(arm, out, seed=seed, on_note=on_note, stop_request=stop_request)
    return conclude_arm(arm, [out / f"{rig.name}.mcap" for rig in arm.rigs])


def record_arm(
    arm: Arm,
    out: Path,
    *,
    seed: int | None = None,
    on_note: Callable[[str], None] = lambda _text: None,
    stop_request: Callable[[], str | None] = never_stop,
) -> None:
    """The experiment alone. Raises as :func:`run_arm` does."""
    for procedure in PREPARATION:
        for rig in arm.rigs:
            procedure.require(rig)
    with open_benches(arm, out, seed=seed, planned_s=planned_s(arm), stop_request=stop_request) as benches:
        for finding in benches.verify_watchdogs():
            on_note(finding)
        for procedure in PREPARATION:
            for joint, name in enumerate(JOINTS):
                on_note(f"{procedure.name}: {name}")
                benches.carry_out(joint, procedure)
        on_note("impedance: both joints are moved")
        benches.perform(experiment.IMPEDANCE, experiment.impedance(arm))
        if arm.reach is not None:
            on_note(f"reach: {arm.reach.trials} reaches without torque")
            benches.perform(experiment.REACH, experiment.reaches(arm, arm.reach))
    for recorder in benches.recorders:
        if recorder.dropped_parts:
            on_note(f"{recorder.path}: {recorder.dropped_parts} parts were not recorded: the disk was too slow")


def planned_s(arm: Arm) -> float:
    """About how long it takes [s of bench time]."""
    prepared_s = sum(procedure.duration_s(rig) for procedure in PREPARATION for rig in arm.rigs)
    return prepared_s + experiment.duration_s(arm)


def conclude_arm(arm: Arm, recordings: Sequence[Path]) -> ArmResult:
    """From the recordings of shoulder and elbow. Raises UsageError for a file, ExperimentError for what it holds."""
    read = [read_recording(path, raw_frames=False) for path in recordings]
    _check(arm, recordings, [each.metadata for each in read])
    joints = tuple(clean(each.measured).measured for each in read)
    impedance = fit(spectra(joints, arm.impedance, arm.tick_s), arm.impedance)
    result = ArmResult(arm.name, impedance, recordings=tuple(recordings), metadata=read[0].metadata)
    if max(impedance.swing_rad) < SMALLER * arm.impedance.swing_rad:
        result = _noted(result, "The swing was made smaller, to stay within 80 % of every limit of both rigs.")
    try:
        if arm.reach is not None:
            result = replace(result, source=source_path(joints, impedance, arm.tick_s))
        if arm.links is not None:
            result = replace(result, hand=hand_stiffness(impedance, arm.links))
    except ExperimentError as error:
        result = _noted(result, f"Not evaluated: {error}.")
    return result


def _noted(result: ArmResult, sentence: str) -> ArmResult:
    return replace(result, notes=(*result.notes, sentence))


def _check(arm: Arm, recordings: Sequence[Path], metadata: Sequence[Mapping[str, str]]) -> None:
    """Raises UsageError for recordings of another arm, of other options, or of two runs."""
    for path, rig, each in zip(recordings, arm.rigs, metadata, strict=True):
        if ARM not in each or each["rig"] != rig.name:
            raise UsageError(f"{path}: is no recording of the joint {rig.name}; give the folder of a run of this arm")
        if each[ARM] != arm.options:
            raise UsageError(
                f"{path}: was measured with other options than {arm.place} has now; put [impedance], [reach] and the "
                "rate back, or measure again"
            )
    if metadata[0][RUN] != metadata[1][RUN]:
        raise UsageError(f"{recordings[0]} and {recordings[1]} are of two runs; give the folder of one")


def write_source(path: Path, source: SourcePath) -> Path:
    """As CSV; returns the path. Raises OSError."""
    columns = np.column_stack([source.time_s, source.angle_rad, source.half_rad])
    head = ",".join(["time_s", *(f"{name}_{what}" for what in ("rad", "half_rad") for name in JOINTS)])
    np.savetxt(path, columns, fmt="%.9g", delimiter=",", header=head, comments="")
    return path
