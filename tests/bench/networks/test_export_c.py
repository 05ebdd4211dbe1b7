"""Exported C, compiled by the machine's own compiler with all warnings as errors, against the network itself."""

import ctypes
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from norton_bench.errors import UsageError
from norton_bench.networks.export.c_code import header, prefix_of
from norton_bench.networks.expressions import Equations, Table
from norton_bench.networks.family import commands_of, converted, exertion, form_of, motion
from norton_bench.networks.kinds import Form, Kind, Motion
from norton_bench.networks.linear import LinearNetwork
from norton_bench.networks.nonlinear import NonlinearNetwork
from norton_bench.networks.operator import Operator
from tests.bench.networks.some import (
    ALL_TERMS,
    JOINTS,
    MOTOR,
    MOTORS,
    PENDULUM,
    PNEUMATIC,
    VARIABLE,
    in_equations,
    series_elastic,
)

CC = shutil.which("cc")
pytestmark = pytest.mark.skipif(CC is None, reason="no C compiler here")
TICK_S = 1e-3
TICKS = 60
TIME_S = np.arange(TICKS) * TICK_S
PORT = Motion.of_position(0.6 + 0.3 * np.sin(25.0 * TIME_S), TICK_S)
EXERTION = 0.01 * np.sin(60.0 * TIME_S)

ARM = LinearNetwork(
    Kind.NORTON,
    Form.IMPEDANCE,
    Operator.rational([900.0], [1.0, 40.0, 900.0]),
    Operator.polynomial(3.0, 0.1, 0.01) + Operator.rational([5.0], [1.0, 30.0]),
    ("rad",),
)
SEVERAL = LinearNetwork(
    Kind.THEVENIN,
    Form.IMPEDANCE,
    Operator.of([[-10.0]], [[10.0, 5.0]], [1.0], [[0.0, 0.2]]),
    Operator.polynomial(3.0, 0.1),
    ("V", "A"),
)
# What no other example uses: two tables, both branches of a choice, and most functions.
MEASURED = NonlinearNetwork(
    Kind.NORTON,
    Form.IMPEDANCE,
    Equations(("c",), {"x_N": "source(c)"}, tables={"source": Table(((-1.0, 0.0, 2.0),), (-0.7, 0.1, 1.0))}),
    Equations(
        ("x_N", "x", "v"),
        {"f": "map(x_N, x) + (tanh(v) if x < 0.6 else -0.1*v**2*sign(v)) - min(atan2(x, 2), max(x_N, z))"},
        {"z": "exp(-abs(v)) - 3*z"},
        {"z": 0.4},
        tables={"map": Table(((0.0, 0.5, 1.0), (0.2, 2.0)), ((0.0, -8.0), (1.0, -5.0), (4.0, -4.0)))},
    ),
    {"c": "V"},
)
NETWORKS = {
    "linear": ARM,
    "linear, Thevenin, two commands": SEVERAL,
    "linear, admittance": ARM.converted(Kind.NORTON, Form.ADMITTANCE),
    "motor": MOTOR,
    "motor, admittance": converted(MOTOR, Kind.THEVENIN, Form.ADMITTANCE),
    "motor, Thevenin": converted(MOTOR, Kind.THEVENIN, Form.IMPEDANCE),
    "motor with all terms": ALL_TERMS,
    "motor with all terms, Thévenin": converted(ALL_TERMS, Kind.THEVENIN, Form.IMPEDANCE),
    "motor behind a joint, with all terms": JOINTS["compliance with all"],
    "motor behind play": JOINTS["backlash"],
    "motor with all terms, admittance": converted(ALL_TERMS, Kind.NORTON, Form.ADMITTANCE),
    "pneumatic": PNEUMATIC,
    "pendulum": PENDULUM,
    "series elastic": series_elastic("K*dx + B*dv"),
    "measured": MEASURED,
    "variable stiffness": VARIABLE,
}

MAIN = """
#include "{name}.h"
void run(int ticks, double dt_s, const double *command, const double *port, double *output)
{{
    {name}_network n;
    double out[{name_upper}_OUTPUTS];
    {name}_start(&n);
    for (int k = 0; k < ticks; ++k) {{
        {name}_step(&n, dt_s, command + k * {name_upper}_COMMANDS, port + k * {name_upper}_PORT, out);
        output[k] = out[0];
    }}
}}
"""


def run_in_c(network, commands, port, folder):
    (folder / "net.h").write_text(header(network, "net"))
    (folder / "main.c").write_text(MAIN.format(name="net", name_upper="NET"))
    strict = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O1", "-fPIC", "-shared"]
    subprocess.run([CC, *strict, "main.c", "-o", "net.so", "-lm"], cwd=folder, check=True)
    output = np.zeros(len(commands))
    given = [np.ascontiguousarray(each) for each in (commands, port)]
    pointers = [each.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for each in (*given, output)]
    ctypes.CDLL(str(folder / "net.so")).run(len(commands), ctypes.c_double(TICK_S), *pointers)
    return output


@pytest.mark.long
@pytest.mark.parametrize("network", NETWORKS.values(), ids=NETWORKS)
def test_the_exported_c_answers_as_the_network_does(network, tmp_path):
    commands = np.column_stack(
        [0.5 + 0.4 * np.sin((30.0 + 9.0 * i) * TIME_S) for i in range(len(commands_of(network)))]
    )
    if form_of(network) is Form.IMPEDANCE:
        port = PORT.derivatives().T
        # The motor's own steps take the angle alone, once a tick; its equations take what the C takes.
        expected = exertion(in_equations(network), commands, PORT, TICK_S)
    else:
        port = EXERTION[:, None]
        expected = motion(network, commands, EXERTION, TICK_S)
    found = run_in_c(network, commands, port, tmp_path)
    assert np.ptp(expected) > 0.0
    assert found == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize(
    "motor", [MOTOR, *MOTORS.values(), ALL_TERMS, *JOINTS.values()], ids=["plain", *MOTORS, "all", *JOINTS]
)
def test_the_exported_motor_moves_freely_as_the_compiled_steps_do(motor, tmp_path):
    command = 0.06 * np.sin(2 * np.pi * 20 * TIME_S)
    network = converted(motor, Kind.THEVENIN, Form.ADMITTANCE)
    found = run_in_c(network, command[:, None], np.zeros((TICKS, 1)), tmp_path)
    expected = motor.free_motion(command, TICK_S, longest_step_s=2e-6)[0]
    # Of a motor behind a joint the compiled steps are those that the joint needs, which are no finer.
    share = 1e-5 if not motor.terms else (1e-4 if motor.joint is None else 2e-3)
    assert found == pytest.approx(expected, abs=share * np.abs(expected).max())


def test_names_that_c_cannot_have():
    assert [prefix_of(name) for name in ("my-motor.2", "3rd", "π")] == ["my_motor_2", "n_3rd", "network"]


def test_a_unit_cannot_break_out_of_its_comment(tmp_path):
    network = replace(PNEUMATIC, command_units={"c": "*/ int x; /* \\\n#error ??/"})
    found = run_in_c(network, np.full((TICKS, 1), 0.5), PORT.derivatives().T, tmp_path)
    assert found == pytest.approx(exertion(network, np.full(TICKS, 0.5), PORT, TICK_S))


def test_what_cannot_be_stepped_is_one_sentence():
    improper = LinearNetwork(Kind.NORTON, Form.IMPEDANCE, Operator.gains(1.0), Operator.polynomial(1.0, 0.1), ("rad",))
    with pytest.raises(UsageError, match="answers to the command's derivative"):
        header(improper, "n")
