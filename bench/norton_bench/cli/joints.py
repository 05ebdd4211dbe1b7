"""``joints``: the impedance and the motion source of an arm of two joints."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from norton_bench.cli.arguments import Backend, Json, Out, Quiet, Seed, run_folder
from norton_bench.cli.output import Output, to_json
from norton_bench.errors import ExitCode, UsageError

if TYPE_CHECKING:
    from norton_bench.joints.arm import Arm
    from norton_bench.joints.run import ArmResult

ArmFile = Annotated[Path, Parameter(name="ARM", help="The file of an arm, which names the rigs of its joints.")]
Again = Annotated[Path | None, Parameter(help="Evaluate the recordings in this folder once more; nothing moves.")]


def joints(
    arm_file: ArmFile,
    /,
    *,
    again: Again = None,
    backend: Backend = None,
    seed: Seed = None,
    out: Out = None,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Measure an arm of two joints, each on a bench of its own: inertia, damping and stiffness as matrices, and how the
    arm moves when no torque acts.
    """
    from norton_bench.cli.tables import facts_table  # noqa: PLC0415
    from norton_bench.joints.arm import load_arm  # noqa: PLC0415  (slow to import)
    from norton_bench.joints.page import arm_data, impedance_facts, sentences, write_arm  # noqa: PLC0415
    from norton_bench.joints.run import write_source  # noqa: PLC0415

    arm, output = load_arm(arm_file, backend=backend), Output(json, quiet)
    if again is None:
        folder = run_folder(out, arm.name)
        result = _measured(arm, folder, seed, output)
    else:
        result = _again(arm, again)
        folder = again if out is None else run_folder(out, arm.name)
    files = {"report": write_arm(folder / f"{arm.name}.html", result, f"norton-bench joints {arm_file}")}
    if result.source is not None:
        files["source"] = write_source(folder / f"{arm.name}.source.csv", result.source)
    files["result"] = folder / f"{arm.name}.joints.json"
    data = {**arm_data(result), "files": files}
    files["result"].write_text(to_json(data), encoding="utf-8")
    table = facts_table(impedance_facts(result.impedance))
    output.result(data, table, "", *sentences(result), "", *map(str, files.values()))
    return ExitCode.OK if result.impedance.adequate else ExitCode.EXPERIMENT_FAILED


def _measured(arm: "Arm", folder: Path, seed: int | None, output: Output) -> "ArmResult":
    from norton_bench.joints.run import run_arm  # noqa: PLC0415
    from norton_bench.loop.stop_word import operator_stop  # noqa: PLC0415

    with operator_stop() as stop_word:
        return run_arm(arm, folder, seed=seed, on_note=output.say, stop_request=stop_word.heard)


def _again(arm: "Arm", folder: Path) -> "ArmResult":
    from norton_bench.joints.run import conclude_arm  # noqa: PLC0415

    recordings = [folder / f"{rig.name}.mcap" for rig in arm.rigs]
    for path in recordings:
        if not path.is_file():
            raise UsageError(f"{path}: no such recording; give the folder of a run of this arm")
    return conclude_arm(arm, recordings)
