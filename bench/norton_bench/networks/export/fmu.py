"""A network as an FMU for co-simulation, FMI 3.0: description, C source, and a binary where a compiler is at hand.

Names, types and signatures are those of the FMI 3.0 headers (fmi-standard.org, fmi3FunctionTypes.h). Between two
communication points the command is held, and the port goes on as its own derivatives say: x + v t + a t²/2, v + a t;
an exertion is held.
"""

import platform
import shutil
import subprocess
import zipfile
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.sax.saxutils import quoteattr

from norton_bench.errors import UsageError
from norton_bench.networks.export.c_code import UNITS, Written, header, write_network
from norton_bench.networks.export.fmu_source import SOURCE, UNSUPPORTED
from norton_bench.networks.family import Network

MACHINES = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}
SYSTEMS = {"Linux": ("linux", ".so"), "Darwin": ("darwin", ".dylib")}
# Value references: time, commands from 1, port and outputs from here.
FIRST_PORT = 100
FIRST_OUTPUT = 200


def export_fmu(network: Network, path: Path) -> bool:
    """Write the FMU; returns whether it has a binary for this machine (else the importer must compile its source).

    Raises UsageError where the network cannot be stepped, or the file not be written.
    """
    written = write_network(network, path.stem)
    texts = {
        "modelDescription.xml": model_description(written),
        "sources/buildDescription.xml": _build_description(written),
        f"sources/{written.prefix}.h": header(network, path.stem),
        "sources/fmu.c": fmu_source(written),
    }
    with TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for name, text in texts.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text, encoding="utf-8")
        binary = _compiled(written, folder)
        try:
            with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
                for name in [*texts, *([binary] if binary else [])]:
                    archive.write(folder / name, name)
        except OSError as error:
            raise UsageError(f"{path}: cannot be written ({error.strerror}); choose another place") from error
    return binary is not None


def model_description(written: Written) -> str:
    """modelDescription.xml, section 2.4 of the standard."""
    outputs = range(FIRST_OUTPUT, FIRST_OUTPUT + len(written.outputs))
    units = sorted({unit for _, _, unit, _ in _variables(written) if unit})
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<fmiModelDescription fmiVersion="3.0" modelName="{written.prefix}" instantiationToken="{_token(written)}"'
        ' generationTool="norton-bench" variableNamingConvention="flat">',
        f'  <CoSimulation modelIdentifier="{written.prefix}" canHandleVariableCommunicationStepSize="true"'
        ' canBeInstantiatedOnlyOncePerProcess="false"/>',
        "  <UnitDefinitions>",
        *(f"    <Unit name={quoteattr(unit)}/>" for unit in units),
        "  </UnitDefinitions>",
        '  <DefaultExperiment startTime="0" stepSize="0.001"/>',
        "  <ModelVariables>",
        '    <Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>',
        *(
            f'    <Float64 name={quoteattr(name)} valueReference="{reference}" causality="{causality}"'
            f' variability="continuous"{f" unit={quoteattr(unit)}" if unit else ""}'
            f"{' start=' + quoteattr('0.0') if causality == 'input' else ''}/>"
            for name, reference, unit, causality in _variables(written)
        ),
        "  </ModelVariables>",
        "  <ModelStructure>",
        *(f'    <Output valueReference="{reference}"/>' for reference in outputs),
        *(f'    <InitialUnknown valueReference="{reference}"/>' for reference in outputs),
        "  </ModelStructure>",
        "</fmiModelDescription>",
        "",
    ]
    return "\n".join(lines)


def fmu_source(written: Written) -> str:
    """fmu.c: the functions of a co-simulation FMU around the header's."""
    values = {
        "@NAME@": written.prefix,
        "@TOKEN@": _token(written),
        "@COMMANDS@": str(len(written.commands)),
        "@STATES@": str(max(len(written.start), 1)),
        "@ROOM@": str(max(len(written.commands), 1)),
        "@PORT@": str(len(written.port)),
        "@OUTPUTS@": str(len(written.outputs)),
        "@FIRST_PORT@": str(FIRST_PORT),
        "@FIRST_OUTPUT@": str(FIRST_OUTPUT),
        "@MOTION@": str(int(written.port != ("f",))),
    }
    text = SOURCE + UNSUPPORTED
    for mark, value in values.items():
        text = text.replace(mark, value)
    return text


def _variables(written: Written) -> Iterator[tuple[str, int, str, str]]:
    """Name, value reference, unit, causality."""
    for place, (name, unit) in enumerate(written.commands.items(), start=1):
        yield name, place, unit, "input"
    for place, name in enumerate(written.port, start=FIRST_PORT):
        yield name, place, UNITS[name], "input"
    for place, name in enumerate(written.outputs, start=FIRST_OUTPUT):
        yield name, place, UNITS[name], "output"


def _token(written: Written) -> str:
    """The same for the same network: an importer compares it with that of the binary."""
    return sha256(repr(written).encode()).hexdigest()[:32]


def _build_description(written: Written) -> str:
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<fmiBuildDescription fmiVersion="3.0">\n'
        f'  <BuildConfiguration modelIdentifier="{written.prefix}">\n'
        '    <SourceFileSet language="C99">\n      <SourceFile name="fmu.c"/>\n    </SourceFileSet>\n'
        '    <Library name="m"/>\n'
        "  </BuildConfiguration>\n</fmiBuildDescription>\n"
    )


def _compiled(written: Written, folder: Path) -> str | None:
    """The binary's place in the FMU, or None where this machine has no compiler or no name in the standard."""
    compiler = shutil.which("cc")
    machine, system = MACHINES.get(platform.machine().lower()), SYSTEMS.get(platform.system())
    if compiler is None or machine is None or system is None:
        return None
    place = f"binaries/{machine}-{system[0]}/{written.prefix}{system[1]}"
    (folder / place).parent.mkdir(parents=True)
    command = [compiler, "-std=c99", "-O2", "-fPIC", "-shared", "sources/fmu.c", "-o", place, "-lm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        first = next((line for line in done.stderr.splitlines() if "error" in line), "no reason given")
        raise UsageError(f"the C compiler refuses the FMU's source ({first}); is a complete compiler installed?")
    return place
