"""A rig file to a :class:`Rig`: every mistake in it is told at once, in a sentence each, before anything is opened."""

import re
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from math import atan2, hypot, prod
from pathlib import Path
from typing import Any

import numpy as np

from norton_bench.errors import RigError, UsageError
from norton_bench.models.network import PARAMETER_OF_FIELD, NortonNetwork
from norton_bench.models.parameters import BY_NAME
from norton_bench.models.sliding import command_shown
from norton_bench.models.terms import LIGHTEST_OUTPUT, Factor, NetworkTerm, waves_of
from norton_bench.networks.left_out import cost_percent, standard_motion, term_sentences
from norton_bench.rig.draft import Draft, check, read_draft
from norton_bench.rig.driver_options import amplifier_options
from norton_bench.rig.files import Mistakes, check_kind, parse_toml, read_text, toml
from norton_bench.rig.rig import Command, Limits, Rig, Supervision
from norton_bench.rig.schema import ActuatorSection, CommandSection, DeviceSection, LimitsSection, RigSection
from norton_bench.units import parse_quantity
from norton_drivers import registry
from norton_drivers.wiring import DeviceSettings, Wiring


def load_rig(path: str | Path, *, backend: str | None = None) -> Rig:
    """The bench that the rig file describes; ``backend`` overrides the file's.

    Raises RigError: one line for each mistake, each with its place and the remedy.
    """
    path = Path(path)
    return parse_rig(read_text(path, "rig file", RigError), place=str(path), backend=backend)


def parse_rig(text: str, *, place: str, backend: str | None = None) -> Rig:
    """As :func:`load_rig`, from the file's content (a recording keeps it); ``place`` is where it came from."""
    mistakes = Mistakes(place)
    written = parse_toml(text, place, RigError)
    check_kind(written, "rig file", place, RigError)
    draft = read_draft(written, Path(place).parent, mistakes)
    chosen = backend or (draft.rig.backend if draft.rig else None)
    check(draft, chosen, mistakes)
    mistakes.raise_as(RigError)
    return _assemble(draft, chosen, text)


def _assemble(draft: Draft, backend: str | None, text: str) -> Rig:
    rig, actuator, limits = draft.rig, draft.actuator, draft.limits
    guard, recording = draft.guard, draft.recording
    # Whatever of these is missing or wrong has been told, and raised, by now.
    assert rig is not None
    assert actuator is not None
    assert limits is not None
    assert guard is not None
    assert recording is not None
    assert backend is not None
    return Rig(
        name=rig.name,
        backend=backend,
        wiring=_wiring(draft, rig, actuator),
        command=_command(actuator.command),
        modulation=_command(draft.modulator.command) if draft.modulator else None,
        model=actuator.model,
        limits=_limits(limits, draft.load.torque_limit_nm if draft.load else None),
        supervision=Supervision(tuple(guard.leave_out), guard.verify_watchdogs),
        candump=recording.candump and bool(draft.buses),
        simulated=draft.written.get("simulated", {}),
        place=draft.place,
        text=text,
    )


def _command(section: CommandSection) -> Command:
    return Command(section.unit, section.limit, section.lowest, section.sent_as)


def _wiring(draft: Draft, rig: RigSection, actuator: ActuatorSection) -> Wiring:
    return Wiring(
        name=rig.name,
        tick_ns=round(1e9 / rig.rate_hz),
        buses=tuple(bus.settings(name) for name, bus in draft.buses.items() if bus is not None),
        actuator=_drive("actuator", actuator, draft.options["actuator"]),
        torque_sensor=_device("torque_sensor", draft.torque_sensor, draft.options["torque_sensor"])
        if draft.torque_sensor
        else None,
        load=_drive("load", draft.load, draft.options["load"]) if draft.load else None,
        shaft=rig.shaft,
        command_unit=actuator.command.unit,
        modulator=_drive("modulator", draft.modulator, draft.options["modulator"]) if draft.modulator else None,
        modulation_unit=draft.modulator.command.unit if draft.modulator else "",
        sensors=tuple(_device(role, sensor, draft.options[role]) for role, sensor in draft.sensors.items() if sensor),
    )


def _device(role: str, section: DeviceSection, options: Mapping[str, Any]) -> DeviceSettings:
    return DeviceSettings(role, section.driver, section.bus, section.port, section.direction, options)


def _drive(role: str, section: DeviceSection, options: Mapping[str, Any]) -> DeviceSettings:
    declared = amplifier_options(section.driver, options)
    settings = _device(role, section, options)
    if declared is None:
        return settings
    return replace(
        settings,
        released_at_zero=declared.released_at_zero,
        answers_commands=declared.answers_commands,
        dead_band=declared.dead_band,
        servo=declared.servo,
    )


def _limits(section: LimitsSection, load_torque_nm: float | None) -> Limits:
    values = section.model_dump(exclude={"stale_after_s", "stall_after_s"})
    if load_torque_nm is not None:
        values["load_torque_nm"] = load_torque_nm
    return Limits(
        **values,
        stale_after_ns=round(section.stale_after_s * 1e9),
        stall_after_ns=round(section.stall_after_s * 1e9),
    )


SIMULATORS = "norton_bench.simulators"


# The simulator's own tools, found by their entry points so that the bench never knows it.
def simulator(name: str) -> Any:
    """One of them. Raises WiringError where it is not installed."""
    return registry.load(SIMULATORS, name, asked_by="the simulator's part")


def true_parameters(rig: Rig, seed: int | None = None) -> dict[str, tuple[float, str]]:
    """The simulated actuator's true parameters, ``{name: (value, unit)}``, under the names the identifier uses.

    Raises WiringError, with place and mend, for true values that are wrong or missing.
    """
    result: dict[str, tuple[float, str]] = simulator("true_parameters")(
        rig.simulated,
        seed=seed,
        place=rig.place,
        command_unit=rig.command.unit,
        modulation_unit=rig.wiring.modulation_unit,
    )
    return result


TABLE = re.compile(r"^\[simulated\.actuator\][^\n]*\n(?:(?!\[)[^\n]*\n?)*", re.MULTILINE)
INNER_TABLES = re.compile(r"^\[simulated\.actuator\.[^\n]*\n(?:(?!\[)[^\n]*\n?)*", re.MULTILINE)
NAME = re.compile(r'^(name\s*=\s*)"[^"\n]*"', re.MULTILINE)
# What the simulated device is beside its mechanics: encoder, noise, how it is mounted and set up.
KEPT = ("counts_per_turn", "encoder_bandwidth", "current_noise", "mounted", "device")
TORQUE_CONSTANT, AMPLIFIER_GAIN = "torque_constant", "amplifier_gain"
DERIVED = ("torque_gain", "torque_limit")
# What the simulator calls terms that it calls otherwise.
DEPARTURE = {"load": "load_friction", "drag": "quadratic_drag"}


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
    held, strongest = _terms_held(network), _strongest_wave(network)
    written = _written(network, before, held)
    lines = [*_plant(network, written), *(f"{key} = {toml(before[key])}" for key in KEPT if key in before)]
    if network.joint is None:
        lines += [f"cogging = {toml(_cogging(strongest))}"] if strongest else []
        lines += [f"departures = {toml(held)}"] if held else []
    else:
        lines += [f"{key} = {toml(value)}" for key, value in held.items()]
    head = "[simulated.actuator]                # an identified network; written by `norton-bench network export`"
    text = TABLE.sub(lambda _: "\n".join([head, *lines]) + "\n\n", INNER_TABLES.sub("", rig.text), count=1)
    return NAME.sub(lambda match: f'{match[1]}"{name}"', text, count=1), tuple(_left_out(network, before, held))


def _table_of(rig: Rig) -> dict[str, Any]:
    tables: dict[str, Any] = tomllib.loads(rig.text).get("simulated", {})
    if not isinstance(tables.get("actuator"), dict) or not TABLE.search(rig.text):
        raise UsageError(
            f"{rig.place}: has no table [simulated.actuator] to put the network into; name a simulated rig with --rig"
        )
    return dict(tables["actuator"])


def _plant(network: NortonNetwork, written: dict[str, str]) -> list[str]:
    """Lines of the plant and its mechanics: a motor, or one behind a joint."""
    if network.joint is None:
        return ['model = "dahl_motor"', *(f"{name} = {toml(value)}" for name, value in written.items())]
    stiffness, damper, output_inertia, half = network.joint
    amplifier = {name: value for name, value in written.items() if name.startswith("amplifier_")}
    joint = {"stiffness": f"{stiffness:.12g} N*m/rad", "damping": f"{max(damper, 0.0):.12g} N*m*s/rad"}
    lighter = max(output_inertia, LIGHTEST_OUTPUT * network.inertia_kgm2)
    tables: dict[str, Any] = {
        **amplifier,
        "motor": {name: value for name, value in written.items() if name not in amplifier},
        "output": {"inertia": f"{lighter:.12g} kg*m^2"},
        **({"backlash": {"width": f"{2 * half:.12g} rad", **joint}} if half else {"spring": joint}),
    }
    model = "gear_train" if half else "series_elastic"
    return [f'model = "{model}"', *(f"{name} = {toml(value)}" for name, value in tables.items())]


def _written(network: NortonNetwork, before: dict[str, Any], held: dict[str, Any]) -> dict[str, str]:
    """Each parameter's text, under the simulator's names, which has its Coulomb torque at rest."""
    values = {name: getattr(network, field) for field, name in PARAMETER_OF_FIELD.items() if name not in DERIVED}
    if "stribeck" in held:
        values["coulomb_torque"] /= 1.0 - held["stribeck"]["drop"]
    texts = {
        name: _text(name, value, network)
        for name, value in values.items()
        if name not in (TORQUE_CONSTANT, AMPLIFIER_GAIN)
    }
    if network.torque_constant is not None:
        texts[TORQUE_CONSTANT] = _text(TORQUE_CONSTANT, network.torque_constant, network)
        gain = network.torque_gain / network.torque_constant
    else:
        constant = before.get(TORQUE_CONSTANT) or before.get("motor", {}).get(TORQUE_CONSTANT, "1 N*m/A")
        texts[TORQUE_CONSTANT] = constant
        gain = network.torque_gain / parse_quantity(constant, "N*m/A")
    if "saturation" in held:  # until here with the command at which the share is less
        held["saturation"]["current"] = f"{gain * held['saturation']['current']:.12g} A"
    if network.torque_limit_nm is not None:
        texts["current_limit"] = f"{network.torque_limit_nm * gain / network.torque_gain:.12g} A"
    return {**texts, AMPLIFIER_GAIN: _text(AMPLIFIER_GAIN, gain, network)}


def _terms_held(network: NortonNetwork) -> dict[str, Any]:
    """The terms that the simulated motor has words for, under its names (docs/plants.md): fewer behind a joint."""
    told = [term for term in network.relative_terms if term.term.factor is not Factor.JOINT]
    if network.joint is not None:
        told = [term for term in told if term.name == "load" and network.joint[3]]
    written = {term.name: _departure(network, term) for term in told}
    return {key: value for name, value in written.items() if value is not None for key in (DEPARTURE.get(name, name),)}


def _departure(network: NortonNetwork, term: NetworkTerm) -> Any:
    """One of them as the simulator takes it; None where it takes no such value. ``term`` has relative values."""
    first, *others = term.values
    taken: Any = None
    match term.name:
        case "stribeck" if first >= 0.0:
            taken = {"drop": first / (1.0 + first), "velocity": f"{abs(others[0]):.12g} rad/s"}
        case "asymmetry" if abs(first) < 1.0:
            taken = first
        case "load" if 0.0 <= first * network.coulomb_torque_nm < 1.0:
            taken = first * network.coulomb_torque_nm
        case "drag" if first >= 0.0:
            taken = f"{first * network.viscous_damping_nms_rad:.12g} N*m*s^2/rad^2"
        case "saturation" if first >= 0.0:
            command = command_shown(network)
            lost = first * command**2
            taken = {"share": lost / (1.0 + lost), "current": command}
        case "ripple" | "friction_by_position" if hypot(*term.values) < 1.0:
            # a·cos + b·sin = √(a² + b²)·cos(pθ + φ)
            wave = {"share": hypot(*term.values), "periods_per_turn": round(term.periods_per_turn)}
            taken = {**wave, "phase": f"{-atan2(others[0], first):.12g} rad"}
    return taken


def _strongest_wave(network: NortonNetwork) -> tuple[float, ...]:
    """Periods a turn, and the torques [N m] that go with cosine and sine; empty without cogging."""
    waves = waves_of(network.terms)
    return tuple(waves[np.argmax(np.hypot(waves[:, 1], waves[:, 2]))].tolist()) if len(waves) else ()


def _cogging(wave: tuple[float, ...]) -> dict[str, Any]:
    """The simulator's −A·sin(pθ + φ) for a·cos(pθ) + b·sin(pθ)."""
    periods, cosine, sine = wave
    whole = round(periods) if periods == round(periods) else periods
    phase = f"{atan2(-cosine, -sine):.12g} rad"
    return {"amplitude": f"{hypot(cosine, sine):.12g} N*m", "periods_per_turn": whole, "phase": phase}


def _text(name: str, value: float, network: NortonNetwork) -> str:
    return f"{value:.12g} {BY_NAME[name].unit_for(network.command_unit)}"


def _left_out(network: NortonNetwork, before: dict[str, Any], held: dict[str, Any]) -> list[str]:
    told = [term for term in network.relative_terms if term.term.factor is not Factor.JOINT]
    names = [term.name for term in told if DEPARTURE.get(term.name, term.name) not in held]
    names += ["cogging"] if network.joint is not None else []
    sentences = list(term_sentences(network, names))
    waves = waves_of(network.terms)
    if "cogging" in before and not len(waves):
        sentences.append("The rig's cogging is left out: the network knows no torque that goes with the position.")
    if len(waves) > 1 and network.joint is None:
        sentences.append(_weaker_waves(network))
    if "departures" in before:
        sentences.append("The rig's own departures are left out: the network has what was identified of them.")
    shares = [hypot(*term.values[:1]) for term in network.relative_terms if term.name in ("stribeck", "asymmetry")]
    shares += [hypot(*term.values) for term in network.relative_terms if term.name == "friction_by_position"]
    if len(shares) > 1:
        off = 100.0 * (prod(1.0 + share for share in shares) - 1.0 - sum(shares))
        sentences.append(
            "The simulated motor multiplies the factors of its friction where the network adds them: up to "
            f"{off:.2g} % of the Coulomb torque more."
        )
    if network.torque_constant is None:
        sentences.append("The torque constant is the rig's: no current was measured, so the network knows only Km·Ka.")
    return sentences


def _weaker_waves(network: NortonNetwork) -> str:
    """The simulated motor has one wave of cogging."""
    strongest, motion = _strongest_wave(network), standard_motion(network)
    kept = [
        term
        for term in network.terms
        if term.term.factor is not Factor.TORQUE or (term.periods_per_turn, *term.values) == strongest
    ]
    cost = cost_percent(network, replace(network, terms=tuple(kept)), motion)
    return (
        f"Of the cogging, only the strongest wave, {strongest[0]:g} a turn, is kept: the simulated motor has one. That "
        f"costs {cost:.2g} % of the torque's rms, over {motion.words}."
    )
