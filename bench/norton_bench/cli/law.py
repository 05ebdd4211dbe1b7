"""``law``: whether a bench can render a virtual body, by its last calibration."""

from math import isfinite, isnan
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from norton_bench.cli.arguments import Json, RecordingFile, value_in
from norton_bench.cli.output import Output, plain_table
from norton_bench.errors import ExitCode, UsageError

if TYPE_CHECKING:
    from rich.table import Table

    from norton_bench.control.renderable import Overview
    from norton_bench.control.rendering import Rendering

Mass = Annotated[str, Parameter(help='Of the virtual body: "0.5 g*m^2", or a number in kg m².')]
Damping = Annotated[str, Parameter(help='"20 mN*m*s/rad", or a number in N m s/rad.')]
Stiffness = Annotated[str, Parameter(help='"1 N*m/rad", or a number in N m/rad.')]
Wall = Annotated[str | None, Parameter(help="The spring begins at this angle (rad), and acts on that side alone.")]


def law(
    recording: RecordingFile,
    /,
    *,
    mass: Mass = "0",
    damping: Damping = "0",
    stiffness: Stiffness = "0",
    wall: Wall = None,
    json: Json = False,
) -> int:
    """Tell whether a bench can render a virtual body, and with which actuators, by the calibration in a recording.
    Without a law: the least damping for a table of masses and stiffnesses. Nothing moves.
    """
    from norton_bench.segments import LAW_UNITS, Admittance  # noqa: PLC0415  (slow to import)

    given = zip(LAW_UNITS.items(), (mass, damping, stiffness), strict=True)
    values = (value_in(f"--{name}", text, unit) for (name, unit), text in given)
    asked = Admittance.of(values, None if wall is None else value_in("--wall", wall, "rad"))
    if asked.shortcoming:
        raise UsageError(asked.shortcoming)
    from norton_bench.control.renderable import overview  # noqa: PLC0415
    from norton_bench.control.rendering import require_rendered  # noqa: PLC0415
    from norton_bench.session.calibrated import calibrated_bench  # noqa: PLC0415

    bench, output = calibrated_bench(recording), Output(json)
    if asked.has_body:
        certificate = require_rendered(bench.calibration, bench.rig.tick_s, asked)
        output.result(_certificate_data(certificate), certificate.words)
    else:
        found = overview(bench.calibration, bench.rig.tick_s)
        output.result(_overview_data(found), _overview_table(found), *EXPLANATION)
    return ExitCode.OK


EXPLANATION = (
    "The least damping [N m s/rad] with which this bench can render a virtual body, by its mass and stiffness; more",
    "damping will do as well. -: none that was tried will do. With the actuator that was calibrated: ask for a law",
    "to be told with which others. Take more than the least, for the next calibration will differ a little.",
)


def _certificate_data(found: "Rendering") -> dict[str, Any]:
    return {
        "law": dict(zip(("mass_kgm2", "damping_nms_rad", "stiffness_nm_rad"), found.law.values, strict=True)),
        "wall_rad": found.law.wall_rad,
        "lightest_actuator_kgm2": found.lightest_kgm2,
        "heaviest_actuator_kgm2": found.heaviest_kgm2 if isfinite(found.heaviest_kgm2) else None,
        "stable_when_held": not isfinite(found.heaviest_kgm2),
        "passive_actuators_from_damping_nms_rad": _known(found.needed_damping_nms_rad),
        "asked_for_at_hz": _known(found.needed_at_hz),
    }


def _overview_data(found: "Overview") -> dict[str, Any]:
    return {
        "masses_kgm2": found.masses_kgm2,
        "stiffnesses_nm_rad": found.stiffnesses_nm_rad,
        "least_damping_nms_rad": [[_known(each) for each in row] for row in found.least_nms_rad],
    }


def _known(value: float) -> float | None:
    return None if isnan(value) else value


def _overview_table(found: "Overview") -> "Table":
    table = plain_table()
    table.add_column("kg m²", justify="right")
    for stiffness in found.stiffnesses_nm_rad:
        table.add_column(f"{stiffness:g} N m/rad", justify="right")
    for mass, row in zip(found.masses_kgm2, found.least_nms_rad, strict=True):
        table.add_row(f"{mass:.2g}", *("-" if isnan(each) else f"{each:.2g}" for each in row))
    return table
