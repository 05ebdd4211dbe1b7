"""``network element``, ``join``, ``gear`` and ``through``: network files made of network files."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from norton_bench.cli.arguments import Json
from norton_bench.cli.network import NetworkFile, Out, stem
from norton_bench.cli.output import Output
from norton_bench.errors import ExitCode, UsageError

if TYPE_CHECKING:
    from norton_bench.networks.family import Network

OutHere = Annotated[Path, Parameter(name="--out", help="The file to write.")]
Impedance = Annotated[
    str | None, Parameter(name="--impedance", help='Exertion for a motion x, v, a: "K*x + G*sin(x)" with --set K=3.')
]
Values = Annotated[list[str] | None, Parameter(name="--set", help="The value of a name: --set K=3. May be repeated.")]
Stiffness = Annotated[float, Parameter(name="--stiffness", help="In N m/rad.")]
Damping = Annotated[float, Parameter(name="--damping", help="In N m s/rad.")]
Inertia = Annotated[float, Parameter(name="--inertia", help="In kg m².")]
NetworkFiles = Annotated[list[Path], Parameter(name="FILE", help="Two or more network files (JSON).")]
How = Annotated[
    Literal["parallel", "series"],
    Parameter(name="--in", help="parallel: one motion, exertions add; series: one exertion, motions add."),
]
Ratio = Annotated[float, Parameter(name="--ratio", help="The motion of FILE over that of the new port.")]
Part = Annotated[Path, Parameter(name="PART", help="A network file without commands: what lies between the ports.")]
As = Annotated[
    Literal["carried", "yielding"],
    Parameter(name="--as", help="carried: moves with the port, as a load; yielding: bears its exertion, as a spring."),
]
Remove = Annotated[bool, Parameter(name="--remove", help="FILE has PART already: take it away again.")]


def element(
    *,
    out: OutHere,
    impedance: Impedance = None,
    values: Values = None,
    stiffness: Stiffness = 0.0,
    damping: Damping = 0.0,
    inertia: Inertia = 0.0,
    json: Json = False,
) -> int:
    """Write an element without a source: a spring, a damper, a mass, or an impedance of your own."""
    from norton_bench.networks import algebra  # noqa: PLC0415  (numpy and scipy are slow to import)
    from norton_bench.networks.operator import Operator  # noqa: PLC0415

    linear = (stiffness, damping, inertia)
    if (impedance is None) != any(linear) or (values and impedance is None):
        raise UsageError(
            "an element is either --impedance with its --set, or any of --stiffness, --damping and --inertia; give one"
        )
    if impedance is None:
        return _written(algebra.element(Operator.polynomial(*linear)), out, json=json)
    return _written(algebra.element(impedance, **dict(map(_value, values or ()))), out, json=json)


def _value(text: str) -> tuple[str, float]:
    name, _, number = text.partition("=")
    try:
        return name.strip(), float(number)
    except ValueError:
        raise UsageError(f'--set "{text}" is no value; write it as --set K=3') from None


def join(files: NetworkFiles, /, *, how: How, out: Out = None, json: Json = False) -> int:
    """Join networks at one port: in parallel (one motion) or in series (one exertion)."""
    from norton_bench.networks.algebra import in_parallel, in_series  # noqa: PLC0415
    from norton_bench.networks.files import load  # noqa: PLC0415

    together = in_parallel if how == "parallel" else in_series
    path = out or files[0].with_name(f"{'-'.join(stem(file) for file in files)}.{how}.json")
    names = ", ".join(file.name for file in files)
    return _written(together(*map(load, files)), path, json=json, made=f"in {how}: {names}")


def gear(file: NetworkFile, /, *, ratio: Ratio, out: Out = None, json: Json = False) -> int:
    """See a network beyond a gear or lever: its motion over the ratio, its exertion times the ratio."""
    from norton_bench.networks.algebra import geared  # noqa: PLC0415
    from norton_bench.networks.files import load  # noqa: PLC0415

    path = out or file.with_name(f"{stem(file)}.geared.json")
    return _written(geared(load(file), ratio), path, json=json, made=f"{file.name} beyond a gear of {ratio:g}")


def through(
    file: NetworkFile, part: Part, /, *, role: As, remove: Remove = False, out: Out = None, json: Json = False
) -> int:
    """See a network at an outer port, through a load or a spring; or, with --remove, at the inner port."""
    from norton_bench.networks import algebra  # noqa: PLC0415
    from norton_bench.networks.files import load  # noqa: PLC0415

    kind = algebra.Carried if role == "carried" else algebra.Yielding
    seen = algebra.inward if remove else algebra.outward
    path = out or file.with_name(f"{stem(file)}.{'inner' if remove else 'outer'}.json")
    made = f"{file.name} {'without' if remove else 'through'} {part.name} ({role})"
    return _written(seen(load(file), kind(load(part))), path, json=json, made=made)


def _written(network: "Network", path: Path, *, json: bool, made: str | None = None) -> int:
    from norton_bench.networks.family import commands_of, form_of, kind_of  # noqa: PLC0415
    from norton_bench.networks.files import save  # noqa: PLC0415

    save(network if made is None else network.with_provenance({"made": made}), path)
    data = {
        "network": path,
        "type": kind_of(network).value,
        "form": form_of(network).value,
        "commands": commands_of(network),
    }
    Output(json).result(data, str(path))
    return ExitCode.OK
