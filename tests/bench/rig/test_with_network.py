"""A network put back into the simulated bench: the same response, the same parameters when it is identified again."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from norton_bench.cli import app
from norton_bench.errors import UsageError
from norton_bench.identification.judged_fit import fit
from norton_bench.identification.motor_values import PHYSICAL
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import Status
from norton_bench.models.terms import NetworkTerm
from norton_bench.procedures.calibrate import CalibrateProcedure
from norton_bench.procedures.imposed import ImposedProcedure
from norton_bench.procedures.options import CalibrateOptions, ImposedOptions, TareOptions
from norton_bench.procedures.tare import TareProcedure
from norton_bench.procedures.waves import multisine
from norton_bench.rig.load import load_rig, parse_rig, rig_with_network
from norton_bench.session.engine import record_script
from norton_sim.plant import Plant
from norton_sim.truth import read_truth
from tests.bench.whole_session import whole_session

RIGS = Path(__file__).parents[3] / "rigs"
NETWORK = NortonNetwork(
    torque_gain=0.81,
    amplifier_bandwidth_rad_s=480.0,
    inertia_kgm2=6.2e-5,
    viscous_damping_nms_rad=1.3e-3,
    coulomb_torque_nm=0.017,
    presliding_stiffness_nm_rad=8.1,
    presliding_damping_nms_rad=0.008,
    command_unit="N*m",
    torque_constant=0.045,
    amplifier_gain=18.0,
)
COMMAND = 0.08 * multisine(4.0, 1e-3, low_hz=0.3, high_hz=40.0, seed=5, slope=-0.3)


def written(name="sim-odrive", network=NETWORK):
    return rig_with_network(load_rig(RIGS / f"{name}.toml"), network, "found")


TERMS = {
    "plain": (),
    "stribeck": (NetworkTerm("stribeck", (0.008, 2.0)),),
    "asymmetry": (NetworkTerm("asymmetry", (0.2,)),),
    "friction_by_position": (NetworkTerm("friction_by_position", (0.2, -0.1), 6),),
    "saturation": (NetworkTerm("saturation", (20.0,)),),
    "ripple": (NetworkTerm("ripple", (0.1, 0.05), 4),),
    "drag": (NetworkTerm("drag", (2e-5,)),),
    "cogging": (NetworkTerm("cogging", (0.004, 0.002), 7.5),),
}


def free_position(network):
    text, left_out = written("sim-free-shaft", network)
    rig = parse_rig(text, place="found.toml", backend="simulated")
    plant = Plant(read_truth(rig.simulated, seed=1, place="found.toml"), seed=1)
    position = np.empty(COMMAND.size)
    for tick, value in enumerate(COMMAND):
        plant.advance(tick * 1_000_000)
        position[tick] = plant.true_position_rad("actuator")
        plant.command("actuator", float(value))
    return position, left_out


@pytest.mark.parametrize("name", TERMS)
def test_the_simulated_plant_moves_as_the_network_does(name):
    network = replace(NETWORK, terms=TERMS[name])
    position, left_out = free_position(network)
    assert not any("term" in sentence for sentence in left_out)
    expected = network.free_motion(COMMAND, 1e-3)[0]
    rms = np.sqrt(np.mean(expected**2))
    assert np.sqrt(np.mean((position - expected) ** 2)) < (5e-3 if network.terms else 1e-3) * rms
    plain = NETWORK.free_motion(COMMAND, 1e-3)[0]
    assert name == "plain" or np.sqrt(np.mean((position - plain) ** 2)) > 0.02 * rms


def test_friction_that_grows_with_the_torque_at_the_port_goes_into_the_plant():
    text, left_out = written("sim-free-shaft", replace(NETWORK, terms=(NetworkTerm("load", (0.1,)),)))
    actuator = parse_rig(text, place="found.toml", backend="simulated").simulated["actuator"]
    assert actuator["departures"] == {"load_friction": pytest.approx(0.1)}
    assert not any("term" in sentence for sentence in left_out)


@pytest.mark.parametrize(
    "terms",
    [
        (NetworkTerm("compliance", (12.0, 0.01, 1e-5)),),
        (NetworkTerm("backlash", (60.0, 0.02, 1e-5, 2e-3)), NetworkTerm("load", (0.1,))),
    ],
    ids=["spring", "play"],
)
def test_a_motor_behind_a_joint_becomes_the_plant_that_it_is(terms):
    """With play to 3 %: the plant's own steps meet the blows at other instants."""
    network = replace(NETWORK, terms=terms)
    position, left_out = free_position(network)
    assert not any("term" in sentence for sentence in left_out)
    expected = network.free_motion(COMMAND, 1e-3)[0]
    rms = np.sqrt(np.mean(expected**2))
    assert np.sqrt(np.mean((position - expected) ** 2)) < (1e-3 if len(terms) == 1 else 0.03) * rms


def test_what_a_plant_behind_a_joint_cannot_have_is_said_with_its_cost():
    terms = (NetworkTerm("compliance", (12.0, 0.01, 0.0)), NetworkTerm("drag", (2e-5,)), *TERMS["cogging"])
    text, left_out = written("sim-free-shaft", replace(NETWORK, terms=terms))
    actuator = parse_rig(text, place="found.toml", backend="simulated").simulated["actuator"]
    assert actuator["model"] == "series_elastic"
    assert actuator["output"] == {"inertia": "6.2e-08 kg*m^2"}  # no body has none: a thousandth of the motor's
    names = [sentence.split()[2] for sentence in left_out if "% of the torque's rms" in sentence]
    assert names == ["drag", "cogging"]


def test_what_the_plant_cannot_have_of_the_terms_is_said_with_its_cost():
    terms = (
        NetworkTerm("stribeck", (-0.004, 2.0)),
        NetworkTerm("asymmetry", (0.1,)),
        *(NetworkTerm("cogging", (size, 0.0), periods) for size, periods in ((0.001, 3), (0.004, 8))),
    )
    text, left_out = written("sim-free-shaft", replace(NETWORK, terms=terms))
    actuator = parse_rig(text, place="found.toml", backend="simulated").simulated["actuator"]
    assert actuator["cogging"]["periods_per_turn"] == 8
    assert actuator["departures"] == {"asymmetry": 0.1}
    costs = [sentence for sentence in left_out if "% of the torque's rms" in sentence]
    assert len(costs) == 2
    assert costs[0].startswith("The term stribeck is left out")
    assert "only the strongest wave, 8 a turn" in costs[1]


def test_departures_of_the_rig_itself_do_not_stay():
    before = load_rig(RIGS / "sim-free-shaft.toml")
    own = '[simulated.actuator.departures]\nasymmetry = "30 %"\n\n'
    rig = replace(before, text=before.text.replace("[simulated.transport]", own + "[simulated.transport]"))
    assert "asymmetry" in rig.text
    text, left_out = rig_with_network(rig, NETWORK, "found")
    assert "asymmetry" not in text
    assert any("own departures are left out" in sentence for sentence in left_out)


def test_what_is_not_the_network_s_stays_as_it_was():
    text, left_out = written()
    before, rig = load_rig(RIGS / "sim-odrive.toml"), parse_rig(text, place="found.toml")
    assert rig.name == "found"
    assert (rig.wiring.load, rig.limits) == (before.wiring.load, before.limits)
    actuator = rig.simulated["actuator"]
    assert actuator["counts_per_turn"] == before.simulated["actuator"]["counts_per_turn"]
    assert "cogging" not in actuator
    assert any("cogging" in sentence for sentence in left_out)
    assert {key: rig.simulated[key] for key in ("load", "torque_sensor", "transport")} == {
        key: before.simulated[key] for key in ("load", "torque_sensor", "transport")
    }


def test_where_only_the_product_is_known_the_rig_s_torque_constant_stands():
    text, left_out = written(network=replace(NETWORK, torque_constant=None, amplifier_gain=None))
    actuator = parse_rig(text, place="found.toml").simulated["actuator"]
    assert actuator["torque_constant"] == "0.05 N*m/A"
    assert actuator["amplifier_gain"] == "16.2 A/(N*m)"
    assert any("only Km·Ka" in sentence for sentence in left_out)


def session(_so_far):
    yield TareProcedure(TareOptions(duration_s=0.5))
    yield CalibrateProcedure(CalibrateOptions(duration_s=4.0))
    yield ImposedProcedure(ImposedOptions(amplitude=0.3, commands=1, duration_s=5.0))


def fitted(rig, out, seed):
    measured = record_script(rig, session, out=out, seed=seed, live=False).measured
    return fit(measured, command_unit=rig.command.unit, tick_s=rig.tick_s)


@pytest.mark.long
def test_identified_exported_and_identified_again_it_is_the_same(tmp_path_factory, tmp_path, capsys):
    first = whole_session(tmp_path_factory).result.fit
    path, network = tmp_path / "again.toml", tmp_path / "first.network.json"
    first.network.save(network)
    arguments = ["network", "export", str(network), "--to", "rig", "--rig", str(RIGS / "sim-odrive.toml")]
    assert app.main([*arguments, "--out", str(path)]) == 0
    assert str(path) in capsys.readouterr().out
    path.write_text(path.read_text().replace('"1 kHz"', '"500 Hz"'))
    again = fitted(load_rig(path), tmp_path, seed=12)
    for name in PHYSICAL:
        known, found = first.estimate(name), again.estimate(name)
        assert found.status is Status.VALID
        # Seven parameters at once: 99 % of such trips stay within three deviations.
        assert abs(found.value - known.value) < 3 * found.std, name


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"command_unit": "A"}, "its command is in N\\*m, the network's in A"),
        ({"torque_gain": -0.9}, "turn the actuator"),
    ],
)
def test_what_does_not_fit_together_is_refused(change, sentence):
    with pytest.raises(UsageError, match=sentence):
        written(network=replace(NETWORK, **change))


def test_a_rig_without_a_simulated_actuator_takes_none(tmp_path):
    rig = load_rig(RIGS / "sim-odrive.toml")
    bare = replace(rig, text=rig.text[: rig.text.index("[simulated]")], place="bare.toml")
    with pytest.raises(UsageError, match=r"bare.toml: has no table \[simulated.actuator\]"):
        rig_with_network(bare, NETWORK, "found")


@pytest.mark.parametrize(
    ("network", "arguments", "sentence"),
    [
        (NETWORK, [], "does not name the rig that it comes from"),
        (NETWORK.with_provenance({"scale": "ratios"}), [], "holds only ratios"),
    ],
)
def test_the_command_says_what_it_lacks(network, arguments, sentence, tmp_path, capsys):
    network.save(tmp_path / "n.json")
    assert app.main(["network", "export", str(tmp_path / "n.json"), "--to", "rig", *arguments]) == 2
    assert sentence in capsys.readouterr().err


def test_a_rig_is_named_for_a_rig_alone(tmp_path, capsys):
    NETWORK.save(tmp_path / "n.json")
    assert app.main(["network", "export", str(tmp_path / "n.json"), "--to", "c", "--rig", "x.toml"]) == 2
    assert "--rig is for --to rig" in capsys.readouterr().err
