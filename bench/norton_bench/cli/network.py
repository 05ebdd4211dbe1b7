"""``network show``, ``convert``, ``plot`` and ``export``: commands for network files."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from norton_bench.cli.arguments import Json
from norton_bench.cli.output import Output
from norton_bench.errors import ExitCode, UsageError

if TYPE_CHECKING:
    from norton_bench.networks.family import Network
    from norton_bench.networks.findings import Finding
    from norton_bench.networks.left_out import ExportedModel
    from norton_drivers.servo import Servo

NetworkFile = Annotated[Path, Parameter(name="FILE", help="A network file (JSON).")]
Type = Annotated[Literal["thevenin", "norton"] | None, Parameter(name="--type", help="Type of the source.")]
FormName = Annotated[Literal["impedance", "admittance"] | None, Parameter(name="--form", help="Operational form.")]
Out = Annotated[Path | None, Parameter(name="--out", help="The file to write; default: beside FILE.")]
Settle = Annotated[str, Parameter(help="Time allowed for a network with states to come to rest.")]
Span = Annotated[float | None, Parameter(help="Greatest command shown, in the command's unit.")]

Target = Annotated[
    Literal["mujoco", "mujoco-dcmotor", "urdf", "isaaclab", "ranges", "c", "fmu", "rig"],
    Parameter(name="--to", help="The kind of file to write."),
]
IntoRig = Annotated[
    Path | None,
    Parameter(name="--rig", help="With --to rig: the simulated rig that gets the network; default: its own."),
]

ENDINGS = {
    "mujoco": ".mjcf.xml",
    "mujoco-dcmotor": ".dcmotor.mjcf.xml",
    "urdf": ".urdf",
    "isaaclab": ".isaaclab.py",
    "ranges": ".ranges.json",
    "c": ".h",
    "fmu": ".fmu",
    "rig": "-network.toml",
}


def show(file: NetworkFile, /, *, settle: Settle = "1 s", json: Json = False) -> int:
    """Show a network: its equations, whether measurements at its port determine it, and its equivalents."""
    from norton_bench.networks.checks import check  # noqa: PLC0415  (numpy and scipy are slow to import)
    from norton_bench.networks.family import commands_of, form_of, kind_of  # noqa: PLC0415
    from norton_bench.networks.files import load  # noqa: PLC0415

    network = load(file)
    findings = check(network, settle_s=_seconds(settle))
    data: dict[str, Any] = {
        "file": file,
        "type": kind_of(network).value,
        "form": form_of(network).value,
        "equations": _equations(network),
        "commands": commands_of(network),
        "conditions": [
            {"condition": each.condition, "holds": each.holds, "why": each.why, "interval_rad": each.interval_rad}
            for each in findings
        ],
        "equivalents": _equivalents(network),
        "terms": _terms(network),
        "provenance": dict(network.provenance),
    }
    Output(json).result(data, "\n".join(_lines(data, findings)))
    return ExitCode.OK


def convert(
    file: NetworkFile, /, *, kind: Type = None, form: FormName = None, out: Out = None, json: Json = False
) -> int:
    """Convert a network to its equivalent of another type, form, or both: exact, or by tables that tell their error."""
    from norton_bench.networks.family import converted, form_of, kind_of  # noqa: PLC0415
    from norton_bench.networks.files import load, save  # noqa: PLC0415
    from norton_bench.networks.kinds import Form, Kind, NoConversionError  # noqa: PLC0415

    network = load(file)
    wanted = (Kind(kind) if kind else kind_of(network), Form(form) if form else form_of(network))
    try:
        equivalent = converted(network, *wanted)
    except NoConversionError as error:
        raise NoConversionError(f"{file}: {error}") from error
    path = out or file.with_name(f"{stem(file)}.{wanted[0].value}-{wanted[1].value}.json")
    save(equivalent.with_provenance({"converted_from": file.name}), path)
    Output(json).result({"network": path, "type": wanted[0].value, "form": wanted[1].value}, str(path))
    return ExitCode.OK


def plot(
    file: NetworkFile, /, *, out: Out = None, span: Span = None, settle: Settle = "1 s", json: Json = False
) -> int:
    """Draw source and impedance into an SVG, PNG or PDF file."""
    from norton_bench.networks.files import load  # noqa: PLC0415
    from norton_bench.networks.plots import save_plot  # noqa: PLC0415

    path = out or file.with_name(f"{stem(file)}.svg")
    if span is not None and not span > 0.0:
        raise UsageError(f"--span {span:g} shows nothing; give a command greater than zero")
    save_plot(load(file), path, span=span, settle_s=_seconds(settle))
    Output(json).result({"plot": path}, str(path))
    return ExitCode.OK


def export(file: NetworkFile, /, *, to: Target, rig_file: IntoRig = None, out: Out = None, json: Json = False) -> int:
    """Write the network for other programs: MuJoCo, URDF, Isaac Lab, C, an FMU for co-simulation (FMI 3.0); as ranges
    to draw parameters from; or as a rig file with the network as its simulated actuator."""
    from norton_bench.networks.files import load  # noqa: PLC0415

    output = Output(json)
    path = out or file.with_name(f"{stem(file)}{ENDINGS[to]}")
    if rig_file is not None and to != "rig":
        raise UsageError(f"--rig is for --to rig; leave it out with --to {to}")
    try:
        network = load(file)
        left_out = _into_rig(network, rig_file, file, path) if to == "rig" else _exported(network, to, path)
    except OSError as error:
        raise UsageError(f"{path}: cannot be written ({error.strerror}); choose another place") from error
    for sentence in left_out:
        output.say(sentence)
    output.result({"file": path, "to": to, "left_out": left_out}, str(path))
    return ExitCode.OK


def _into_rig(network: "Network", rig_file: Path | None, file: Path, path: Path) -> list[str]:
    """Write a rig file with the network as its simulated actuator; default: the rig that the network comes from."""
    from norton_bench.models.network import NortonNetwork  # noqa: PLC0415
    from norton_bench.rig.load import (  # noqa: PLC0415
        load_rig,
        parse_rig,
        rig_with_network,
    )

    if not isinstance(network, NortonNetwork):
        raise UsageError(f"{file}: is not an identified motor; the simulator knows no other network yet")
    if "scale" in network.provenance:
        raise UsageError(
            f"{file}: holds only ratios of its parameters, which do not define a machine; measure torque, too"
        )
    known = network.provenance.get("rig_file")
    if rig_file is None and known is None:
        raise UsageError(f"{file}: does not name the rig that it comes from; name a simulated rig with --rig")
    text, left_out = rig_with_network(load_rig(rig_file or Path(str(known)), backend="simulated"), network, path.stem)
    parse_rig(text, place=str(path), backend="simulated")
    path.write_text(text, encoding="utf-8")
    return list(left_out)


def _exported(network: "Network", to: str, path: Path) -> list[str]:
    """Write the file; returns sentences about what is missing in it."""
    name = path.name.removesuffix(ENDINGS[to]).split(".")[0]
    if to in ("mujoco", "mujoco-dcmotor"):
        from norton_bench.networks.export.mjcf import export_mjcf  # noqa: PLC0415

        return _written(export_mjcf(network, name, dcmotor=to == "mujoco-dcmotor"), path)
    if to in ("urdf", "isaaclab", "ranges"):
        from norton_bench.networks.export import robots  # noqa: PLC0415

        makers = {"urdf": robots.export_urdf, "isaaclab": robots.export_isaac_lab, "ranges": robots.export_ranges}
        return _written(makers[to](network, name), path)
    if to == "c":
        from norton_bench.networks.export.c_code import header  # noqa: PLC0415

        path.write_text(header(network, name), encoding="utf-8")
        return []
    from norton_bench.networks.export.fmu import export_fmu  # noqa: PLC0415

    compiled = export_fmu(network, path)
    return (
        []
        if compiled
        else ["No C compiler was found, so the FMU contains only source code; the importing program must compile it."]
    )


def _written(model: "ExportedModel", path: Path) -> list[str]:
    path.write_text(model.text, encoding="utf-8")
    return list(model.left_out)


def _seconds(text: str) -> float:
    from norton_bench.units import parse_quantity  # noqa: PLC0415  (pydantic is slow to import)

    try:
        value = parse_quantity(text, "s")
    except ValueError as error:
        raise UsageError(f"--settle: {error}") from error
    if not value > 0.0:
        raise UsageError(f'--settle "{text}" must be greater than zero, such as "1 s"')
    return value


def stem(file: Path) -> str:
    """The name of a network file without what network files end with."""
    return file.name.removesuffix(".json").removesuffix(".network")


def _equations(network: "Network") -> str:
    from norton_bench.models.network import NortonNetwork  # noqa: PLC0415
    from norton_bench.networks.linear import LinearNetwork  # noqa: PLC0415

    if isinstance(network, NortonNetwork):
        loop = "" if network.servo is None else f" behind a loop of {_held(network.servo)}"
        return f"dahl motor{loop}, with terms" if network.terms else f"dahl motor{loop}"
    return "linear" if isinstance(network, LinearNetwork) else "nonlinear"


def _held(servo: "Servo") -> str:
    return "position" if servo.holds_position else "velocity"


def _terms(network: "Network") -> list[dict[str, Any]]:
    """What an identified motor has beside the paper's: equation, values, and half of each one's 95 % interval."""
    from norton_bench.models.network import NortonNetwork  # noqa: PLC0415
    from norton_bench.models.parameters import HALF_INTERVAL  # noqa: PLC0415

    if not isinstance(network, NortonNetwork):
        return []
    places = {name: place for place, name in enumerate(network.covariance_names)}
    return [
        {
            "name": each.name,
            "equation": each.term.equation,
            "meaning": each.term.meaning,
            "periods_per_turn": each.periods_per_turn or None,
            "parameters": [
                {
                    "name": parameter.name,
                    "symbol": parameter.symbol,
                    "value": value,
                    "unit": parameter.unit_for(network.command_unit),
                    "half_interval": HALF_INTERVAL * network.covariance[place][place] ** 0.5
                    if (place := places.get(parameter.name)) is not None
                    else None,
                }
                for parameter, value in zip(each.term.parameters, each.values, strict=True)
            ],
        }
        for each in network.terms
    ]


def _term_line(term: dict[str, Any]) -> str:
    """Name, equation, and the values with their intervals."""
    values = [
        f"{each['symbol']} = {each['value']:.4g}"
        + ("" if each["half_interval"] is None else f" ± {each['half_interval']:.2g}")
        + ("" if each["unit"] == "1" else f" {each['unit']}")
        for each in term["parameters"]
    ]
    periods = [f"p = {term['periods_per_turn']:g} a turn"] if term["periods_per_turn"] else []
    return f"term {term['name']}: {term['equation']}: {', '.join([*values, *periods])}: {term['meaning']}"


def _equivalents(network: "Network") -> list[dict[str, Any]]:
    """The four types and forms: whether the network has this equivalent, what its tables are good for, or why not."""
    from norton_bench.networks.family import converted  # noqa: PLC0415
    from norton_bench.networks.forms import TABLE  # noqa: PLC0415
    from norton_bench.networks.kinds import Form, Kind, NoConversionError  # noqa: PLC0415

    equivalents = []
    for kind in Kind:
        for form in Form:
            tables, why = [], None
            try:
                made = converted(network, kind, form).provenance
                tables = [
                    text for name, text in made.items() if name.startswith(TABLE) and name not in network.provenance
                ]
            except NoConversionError as error:
                why = str(error)
            equivalents.append(
                {"type": kind.value, "form": form.value, "exists": why is None, "tables": tables, "why": why}
            )
    return equivalents


def _lines(data: dict[str, Any], findings: "tuple[Finding, ...]") -> Iterator[str]:
    from norton_bench.networks.findings import VERDICTS  # noqa: PLC0415

    commands = ", ".join(f"{name} [{unit or '-'}]" for name, unit in data["commands"].items())
    yield f"{data['type']} network in {data['form']} form, {data['equations']}; commands: {commands or 'none'}"
    for term in data["terms"]:
        yield _term_line(term)
    for each in findings:
        yield f"{each.condition}: {VERDICTS[each.holds]}: {each.why}"
    for each in data["equivalents"]:
        yield f"{each['type']}, {each['form']}: {each['why'] or '; '.join(each['tables']) or 'exact'}"
    for name, text in data["provenance"].items():
        yield f"{name}: {text}"
