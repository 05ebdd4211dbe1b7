"""Exported FMUs: judged by FMPy's validation and the standard's own headers, and run by FMPy against the network."""

import shutil
import subprocess
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

from norton_bench.errors import UsageError
from norton_bench.networks.export.fmu import export_fmu
from norton_bench.networks.family import commands_of, converted, exertion, form_of, motion
from norton_bench.networks.kinds import Form, Kind, Motion
from tests.bench.networks.some import ALL_TERMS, MOTOR, PENDULUM, PNEUMATIC, in_equations, series_elastic
from tests.bench.networks.test_export_c import ARM, MEASURED, SEVERAL

CC = shutil.which("cc")
pytestmark = pytest.mark.skipif(CC is None, reason="no C compiler here")
TICK_S = 1e-3
TICKS = 40
TIME_S = np.arange(TICKS) * TICK_S
PHASE = 25.0 * TIME_S
PORT = Motion(0.6 + 0.3 * np.sin(PHASE), 7.5 * np.cos(PHASE), -187.5 * np.sin(PHASE))
EXERTION = 0.01 * np.sin(60.0 * TIME_S)
ROTOR = converted(MOTOR, Kind.THEVENIN, Form.ADMITTANCE)
NETWORKS = {
    "linear": ARM,
    "two-commands": SEVERAL,
    "admittance": ARM.converted(Kind.NORTON, Form.ADMITTANCE),
    "motor": MOTOR,
    "terms": ALL_TERMS,
    "rotor": ROTOR,
    "pneumatic": PNEUMATIC,
    "pendulum": PENDULUM,
    "elastic": series_elastic("K*dx + B*dv"),
    "measured": MEASURED,
}


def commands_for(network, moving):
    names = commands_of(network)
    return moving * np.column_stack([0.4 * np.sin((30.0 + 9.0 * i) * TIME_S) for i in range(len(names))]) + 0.5


def port_of(network):
    """What goes in at the port by name, and what comes out."""
    if form_of(network) is Form.ADMITTANCE:
        return {"f": EXERTION}, "x"
    return dict(zip(("x", "v", "a"), PORT.derivatives(), strict=True)), "f"


def response(network, moving):
    """What the network itself answers."""
    commands = commands_for(network, moving)
    if form_of(network) is Form.ADMITTANCE:
        return motion(network, commands, EXERTION, TICK_S)
    return exertion(in_equations(network), commands, PORT, TICK_S)


def signals(network, moving):
    port, _ = port_of(network)
    columns = {"time": TIME_S, **dict(zip(commands_of(network), commands_for(network, moving).T, strict=True)), **port}
    table = np.zeros(TICKS, dtype=[(name, float) for name in columns])
    for name, column in columns.items():
        table[name] = column
    return table


@pytest.mark.long
@pytest.mark.parametrize(("name", "network"), NETWORKS.items(), ids=NETWORKS)
def test_fmpy_runs_it_as_the_network_answers(name, network, tmp_path):
    """Told the inputs of a tick, to 0.2 %. FMPy's own loop records before it sets them: steady commands, to 3 %."""
    path = tmp_path / f"{name}.fmu"
    assert export_fmu(network, path)
    assert validate_fmu(str(path)) == []
    (_, out), expected = port_of(network), response(network, moving=False)
    run = fmpy.simulate_fmu(
        str(path), stop_time=TIME_S[-1], output_interval=TICK_S, input=signals(network, moving=False), output=[out]
    )
    assert run["time"] == pytest.approx(TIME_S)
    assert run[out][1:] == pytest.approx(expected[1:], abs=0.03 * np.ptp(expected))
    moving = response(network, moving=True)
    assert at_the_ticks(network, path, tmp_path) == pytest.approx(moving, abs=2e-3 * np.ptp(moving))


def opened(path, folder):
    description = fmpy.read_model_description(str(path))
    unzipped = fmpy.extract(str(path), unzipdir=str(folder / f"{path.stem}-unzipped"))
    fmu = FMU3Slave(
        guid=description.guid,
        unzipDirectory=unzipped,
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="one",
    )
    fmu.instantiate()
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    return fmu, {variable.name: variable.valueReference for variable in description.modelVariables}


def at_the_ticks(network, path, folder):
    fmu, places = opened(path, folder)
    table, (_, out) = signals(network, moving=True), port_of(network)
    names = table.dtype.names[1:]
    found = []
    for k, row in enumerate(table):
        fmu.setFloat64([places[name] for name in names], [row[name] for name in names])
        found.append(fmu.getFloat64([places[out]])[0])
        fmu.doStep(k * TICK_S, TICK_S)
    fmu.terminate()
    fmu.freeInstance()
    return np.array(found)


def test_a_state_that_was_kept_gives_the_same_future(tmp_path):
    export_fmu(ROTOR, tmp_path / "rotor.fmu")
    fmu, places = opened(tmp_path / "rotor.fmu", tmp_path)

    def future():
        for k in range(5):
            fmu.doStep(k * TICK_S, TICK_S)
        return fmu.getFloat64([places["x"], places["v"]])

    fmu.setFloat64([places["c"]], [0.06])
    future()
    kept = fmu.getFMUState()
    as_bytes = fmu.serializeFMUState(kept)
    first = future()
    fmu.setFMUState(kept)
    assert future() == first
    fmu.setFMUState(fmu.deserializeFMUState(as_bytes))
    assert future() == first
    fmu.reset()
    assert fmu.getFloat64([places["x"], places["c"]]) == [0.0, 0.0]
    assert first[0] > 0.0
    fmu.freeFMUState(kept)
    fmu.freeInstance()


def test_every_function_has_the_standards_own_signature(tmp_path):
    """Compiled behind the official header, a declaration that differs is an error."""
    export_fmu(ROTOR, tmp_path / "rotor.fmu")
    with zipfile.ZipFile(tmp_path / "rotor.fmu") as archive:
        archive.extractall(tmp_path)
        assert {"modelDescription.xml", "sources/buildDescription.xml", "sources/fmu.c"} < set(archive.namelist())
    source = (tmp_path / "sources" / "fmu.c").read_text()
    own = source[source.index("typedef void *fmi3Instance;") : source.index("/* All that a state")]
    checked = source.replace(own, '#include "fmi3Functions.h"\n')
    (tmp_path / "sources" / "checked.c").write_text(checked)
    headers = Path(fmpy.__file__).parent / "c-code"
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", f"-I{headers}", "-fsyntax-only"]
    subprocess.run([CC, *strict, "checked.c"], cwd=tmp_path / "sources", check=True)
    alone = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-fsyntax-only"]
    subprocess.run([CC, *alone, "fmu.c"], cwd=tmp_path / "sources", check=True)


def test_without_a_compiler_the_source_goes_alone(tmp_path, monkeypatch):
    monkeypatch.setattr("norton_bench.networks.export.fmu.shutil.which", lambda _: None)
    assert not export_fmu(PENDULUM, tmp_path / "p.fmu")
    assert not any(name.startswith("binaries") for name in zipfile.ZipFile(tmp_path / "p.fmu").namelist())


def test_a_place_that_cannot_be_written_is_one_sentence(tmp_path):
    with pytest.raises(UsageError, match="cannot be written"):
        export_fmu(PENDULUM, tmp_path / "none" / "p.fmu")
