"""The simulator's own tools, found by their entry points so that the bench never knows it."""

import re
import tomllib
from typing import Any

from norton_bench.errors import UsageError
from norton_bench.models.network import PARAMETER_OF_FIELD, NortonNetwork
from norton_bench.models.parameters import BY_NAME
from norton_bench.rig.files import toml
from norton_bench.rig.rig import Rig
from norton_bench.units import parse_quantity
from norton_drivers import registry

SIMULATORS = "norton_bench.simulators"


def simulator(name: str) -> Any:
    """One of them. Raises WiringError where it is not installed."""
    return registry.load(SIMULATORS, name, asked_by="the simulator's part")


def true_parameters(rig: Rig, seed: int | None = None) -> dict[str, tuple[float, str]]:
    """The simulated actuator's true parameters, ``{name: (value, unit)}``, under the names the identifier uses.

    Raises WiringError, with place and mend, for true values that are wrong or missing.
    """
    found: dict[str, tuple[float, str]] = simulator("true_parameters")(
        rig.simulated,
        seed=seed,
        place=rig.place,
        command_unit=rig.command.unit,
        modulation_unit=rig.wiring.modulation_unit,
    )
    return found


TABLE = re.compile(r"^\[simulated\.actuator\][^\n]*\n(?:(?!\[)[^\n]*\n?)*", re.MULTILINE)
NAME = re.compile(r'^(name\s*=\s*)"[^"\n]*"', re.MULTILINE)
# What the simulated device is beside its mechanics: encoder, noise, how it is mounted and set up.
KEPT = ("counts_per_turn", "encoder_bandwidth", "current_noise", "mounted", "device")
TORQUE_CONSTANT, AMPLIFIER_GAIN = "torque_constant", "amplifier_gain"


def rig_with_network(rig: Rig, network: NortonNetwork, name: str) -> tuple[str, tuple[str, ...]]:
    """A simulated rig whose actuator is an identified network: the plant is what the bench found, not what was true.

    The text of ``rig``'s file with ``network`` for its simulated actuator, called ``name``; and what it lacks.

    Torque constant and amplifier gain are the rig's own, in so far as the network knows only their product. Raises
    UsageError where the two do not fit together.
    """
    before = _table_of(rig)
    if rig.command.unit != network.command_unit:
        raise UsageError(
            f"{rig.place}: its command is in {rig.command.unit}, the network's in {network.command_unit}; name the rig "
            "that it was identified on"
        )
    if network.torque_gain <= 0.0:
        raise UsageError(f"the network's torque gain is {network.torque_gain:g}: turn the actuator's direction round")
    lines = ['model = "dahl_motor"', *_written(network, before)]
    lines += [f"{key} = {toml(before[key])}" for key in KEPT if key in before]
    head = "[simulated.actuator]                # an identified network; written by `norton-bench network export`"
    text = TABLE.sub(lambda _: "\n".join([head, *lines]) + "\n\n", rig.text, count=1)
    return NAME.sub(lambda match: f'{match[1]}"{name}"', text, count=1), tuple(_left_out(network, before))


def _table_of(rig: Rig) -> dict[str, Any]:
    tables: dict[str, Any] = tomllib.loads(rig.text).get("simulated", {})
    if not isinstance(tables.get("actuator"), dict) or not TABLE.search(rig.text):
        raise UsageError(
            f"{rig.place}: has no table [simulated.actuator] to put the network into; name a simulated rig with --rig"
        )
    return dict(tables["actuator"])


def _written(network: NortonNetwork, before: dict[str, Any]) -> list[str]:
    """A line for each parameter, under the simulator's names."""
    values = {name: getattr(network, field) for field, name in PARAMETER_OF_FIELD.items() if name != "torque_gain"}
    lines = [
        _line(name, value, network) for name, value in values.items() if name not in (TORQUE_CONSTANT, AMPLIFIER_GAIN)
    ]
    if network.torque_constant is not None:
        lines.append(_line(TORQUE_CONSTANT, network.torque_constant, network))
        gain = network.torque_gain / network.torque_constant
    else:
        written = before.get(TORQUE_CONSTANT, "1 N*m/A")
        lines.append(f"{TORQUE_CONSTANT} = {toml(written)}")
        gain = network.torque_gain / parse_quantity(written, "N*m/A")
    return [*lines, _line(AMPLIFIER_GAIN, gain, network)]


def _line(name: str, value: float, network: NortonNetwork) -> str:
    return f'{name} = "{value:.12g} {BY_NAME[name].unit_for(network.command_unit)}"'


def _left_out(network: NortonNetwork, before: dict[str, Any]) -> list[str]:
    sentences = []
    if "cogging" in before:
        sentences.append("The rig's cogging is left out: the network knows no torque that goes with the position.")
    if network.torque_constant is None:
        sentences.append("The torque constant is the rig's: no current was measured, so the network knows only Km·Ka.")
    return sentences
