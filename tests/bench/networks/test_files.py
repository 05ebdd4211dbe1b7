"""Network files give back what was saved, the motor's own among them; what is none is told in one sentence."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from matplotlib import image

from norton_bench.errors import UsageError
from norton_bench.networks.expressions import Equations, Table
from norton_bench.networks.family import converted
from norton_bench.networks.files import load, save
from norton_bench.networks.kinds import Form, Kind
from norton_bench.networks.nonlinear import NonlinearNetwork
from norton_bench.networks.plots import plot, save_plot
from tests.bench.networks.some import MOTOR, PENDULUM, PNEUMATIC, VARIABLE, linear_networks, series_elastic

MEASURED = NonlinearNetwork(
    Kind.NORTON,
    Form.IMPEDANCE,
    Equations(("c",), {"x_N": "source(c)"}, tables={"source": Table(((0.0, 1.0, 2.0),), (0.0, 0.7, 1.0))}),
    Equations(
        ("x_N", "x"), {"f": "map(x_N, x)"}, tables={"map": Table(((0.0, 1.0), (0.0, 2.0)), ((0.0, -8.0), (4.0, -4.0)))}
    ),
    {"c": "V"},
    domain={"x": (0.0, 2.0), "c": (0.0, 2.0)},
    provenance={"recording": "x.mcap"},
)
NETWORKS = {
    "motor": MOTOR,
    "pneumatic": PNEUMATIC,
    "pendulum": PENDULUM,
    "spring": series_elastic("K*dx"),
    "measured": MEASURED,
    "variable stiffness": VARIABLE,
}


@pytest.mark.parametrize("network", NETWORKS.values(), ids=NETWORKS)
def test_a_file_gives_back_what_was_saved(network, tmp_path):
    network = network.with_provenance({"made": "here"})
    save(network, tmp_path / "n.json")
    assert load(tmp_path / "n.json") == network


@given(linear_networks())
@settings(max_examples=20)
def test_a_linear_network_comes_back_digit_by_digit(tmp_path_factory, network):
    path = tmp_path_factory.mktemp("n") / "n.json"
    save(network, path)
    assert load(path) == network


@pytest.mark.long
@pytest.mark.parametrize("network", NETWORKS.values(), ids=NETWORKS)
def test_every_network_can_be_drawn(network, tmp_path):
    save_plot(network, tmp_path / "n.png")
    pixels = image.imread(tmp_path / "n.png")
    assert len(np.unique(pixels.reshape(-1, pixels.shape[-1]), axis=0)) > 20


def test_the_drawn_source_is_the_motors_three_branches():
    line = plot(MOTOR).axes[0].lines[0]
    assert line.get_ydata() == pytest.approx(MOTOR.source_velocity(line.get_xdata()))


def test_a_table_that_ends_before_the_source_is_one_sentence(tmp_path):
    """What blocks the muscle is more than the table of its motion reaches."""
    beyond = converted(PNEUMATIC, Kind.THEVENIN, Form.ADMITTANCE)
    with pytest.raises(UsageError, match="the port answers nothing, as beyond the range of a table"):
        save_plot(beyond, tmp_path / "n.png")


def test_a_picture_in_no_known_format_is_one_sentence(tmp_path):
    with pytest.raises(UsageError, match=r"name it \.svg or"):
        save_plot(MOTOR, tmp_path / "n.doc")


def broken(change):
    content = json.loads(json.dumps(SAVED))
    change(content)
    return json.dumps(content)


SAVED = {
    "format": "equivalent-network",
    "version": 1,
    "equations": "nonlinear",
    "type": "norton",
    "form": "impedance",
    "joined": "nonlinearly",
    "commands": {"c": "V"},
    "step_s": 0.001,
    "source": {"inputs": ["c"], "outputs": {"x_N": "c"}},
    "connection": {"inputs": ["x_N", "x"], "outputs": {"f": "x_N - x"}},
}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "line 1: not valid JSON"),
        ("[" * 100_000, "not valid JSON"),
        ("[]", 'expected JSON with "format"'),
        (broken(lambda c: c.update(version=7)), "version 7 of the network file is unknown"),
        (broken(lambda c: c.update(type="mayer")), r'"type" is .mayer.; it must be "thevenin" or "norton"'),
        (broken(lambda c: c.pop("form")), '"form" is None'),
        (broken(lambda c: c.update(equations="magic")), 'it must be "linear" or "nonlinear"'),
        (broken(lambda c: c.update(equations="linear")), "source: 'A' is missing"),
        (broken(lambda c: c.pop("source")), '"source" must be an object'),
        (broken(lambda c: c["source"].pop("outputs")), "source: 'outputs' is missing"),
        (broken(lambda c: c["source"].update(outputs={"x_N": "d"})), 'source: output x_N: "d" in "d" is not known'),
        (broken(lambda c: c["source"].update(outputs=3)), "source: a value is of the wrong kind"),
        (broken(lambda c: c.update(step_s="soon")), "step_s: could not convert"),
        (broken(lambda c: c.update(step_s=-1)), "step_s = -1.0 is not a step"),
        (broken(lambda c: c.update(domain={"x": 3})), "domain of x: a value is of the wrong kind"),
        (broken(lambda c: c.update(commands=[])), '"commands" must be an object'),
        (broken(lambda c: c["source"].update(tables={"t": {"nodes": [[1, 0]], "values": [1, 2]}})), "must rise"),
    ],
)
def test_what_is_no_network_file_is_one_sentence(text, says, tmp_path):
    path = tmp_path / "n.json"
    path.write_text(text)
    with pytest.raises(UsageError, match=says) as caught:
        load(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_cannot_be_had_is_one_sentence(tmp_path):
    with pytest.raises(UsageError, match="cannot be read"):
        load(tmp_path / "none.json")
    with pytest.raises(UsageError, match="cannot write"):
        save(PNEUMATIC, tmp_path / "none" / "n.json")
    (tmp_path / "b.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UsageError, match="is not text"):
        load(tmp_path / "b.json")
