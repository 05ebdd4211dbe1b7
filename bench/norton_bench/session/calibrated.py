"""What an earlier session has calibrated, from its recording."""

from dataclasses import dataclass
from pathlib import Path

from norton_bench.control.calibration import LoadCalibration
from norton_bench.errors import UsageError
from norton_bench.procedures.calibrate import CalibrateProcedure
from norton_bench.procedures.knowledge import Knowledge, refuse_servo, require_load
from norton_bench.procedures.tare import TareProcedure
from norton_bench.recording.reader import read_recording
from norton_bench.rig.load import parse_rig
from norton_bench.rig.rig import Rig
from norton_bench.segments import RENDER
from norton_bench.session.resume import finished_in_all


@dataclass(frozen=True)
class CalibratedBench:
    """A rig as it was recorded, and the last calibration of its load drive in that recording."""

    rig: Rig
    calibration: LoadCalibration


def calibrated_bench(path: Path) -> CalibratedBench:
    """From a recording, by its steps; a rest that the operator asked for in between is none.

    Raises UsageError where it cannot be read, or has no finished calibration; RigError where its rig is none, has no
    load, or a servo for an actuator; and ExperimentError where the calibration cannot be used.
    """
    recording = read_recording(path, raw_frames=False)
    # Files that a rig names are beside it, and not beside its recordings.
    rig = parse_rig(recording.rig_text, place=recording.metadata.get("rig_file") or str(path))
    require_load(rig, RENDER, "to act the virtual body")
    refuse_servo(rig, RENDER)
    known = Knowledge(rig)
    steps = {each.name: each for each in (TareProcedure(), CalibrateProcedure())}
    for name, measured in finished_in_all(path, recording):
        if name in steps:
            known = steps[name].conclude(known, measured)
    if known.calibration is None:
        raise UsageError(f"{path}: no step 'calibrate' was finished in it; record a session that has one")
    return CalibratedBench(known.rig, known.calibration)
