"""The questions in their order, each following from the answers before it."""

import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from math import inf, isfinite

from pydantic import ValidationError

from norton_bench.rig.driver_options import LOAD_UNIT, Declared, declared_by, same_unit
from norton_bench.rig.files import BARE_KEY, keys_of, toml
from norton_bench.rig.new.options import (
    Asker,
    Question,
    Section,
    ask_options,
    bitrate_for,
    data_bitrate_for,
    options_of,
    quoted,
    rig_text,
)
from norton_bench.rig.new.twin import ask_twin
from norton_bench.rig.rig import NO_MODEL
from norton_bench.units import QUANTITY, check_unit, parse_quantity
from norton_drivers import registry
from norton_drivers.adapters.table import ADAPTERS, INTERFACES, UNKNOWN, mistakes
from norton_drivers.discovery import FoundPort
from norton_drivers.wiring import CanBusSettings, written_as

NONE = "none"
IN_SITU = ": the actuator is then identified in situ alone"
MOTOR = "dahl_motor"
NO_LEAST = "unlimited"
# An ordinary desktop or laptop stands still for tens of milliseconds now and then (docs/rig-file.md): these allow for
# that, as the rigs that are shipped do, and the drives' watchdogs must outlast them.
STALE, STALL, WATCHDOG = "100 ms", "100 ms", "300 ms"
STALL_S = 0.1
READABLE = 0.8  # of what a drive's readings can tell: a reading must not end where the guard still looks
# The standard session turns the shaft by its way in some part of a second at this speed: imposed motion in 0.24 s,
# as a dry run tells; free, whatever the actuator's friction and inertia leave. This is twice the former.
WAY_S = 0.5
COMMANDS = {"N*m": "0.5 N*m", "A": "5 A", "1": "0.5"}  # examples
EXAMPLE = re.compile(r'"([^"]+)"')
SECTIONS = {
    "actuator": "the device under test",
    "load": "the machine that imposes torque or motion",
    "torque_sensor": "between actuator and load",
    "modulator": "the actuator's second drive, which sets its impedance",
}


@dataclass
class Interview:
    """``name`` is proposed for the bench, ``ports`` are what is plugged in."""

    ask: Asker
    name: str
    ports: Sequence[FoundPort] = ()
    _buses: dict[str, list[tuple[str, str]]] = field(default_factory=dict, init=False)  # who is on each: role, driver
    # What the drives' readings can tell.
    _greatest_rad: float = field(default=inf, init=False)
    _greatest_rad_s: float = field(default=inf, init=False)

    def rig(self) -> str:
        """The text of a rig file. Raises UsageError where a question has no answer."""
        bench = self._bench()
        actuator = self._device("actuator", optional=False)
        assert actuator is not None
        load = self._device("load", default=NONE)
        # With a load and none, the actuator can be identified in situ alone: that is not taken for granted.
        sensor = self._device(
            "torque_sensor", default=NONE if load is None else None, without=IN_SITU if load is not None else ""
        )
        if load is None:
            shaft = Question("rig.shaft", "the shaft: free, or clamped so that it cannot turn", "free")
            bench.add("shaft", quoted(self._choice(shaft, ("free", "clamped"))), "nothing is coupled to the shaft")
        devices = [device for device in (actuator, self._modulator(actuator), load, sensor) if device is not None]
        buses = [self._new_bus(name, on_it, bench) for name, on_it in self._buses.items()]
        sections = [bench, *buses, *devices, self._limits(with_sensor=sensor is not None)]
        modulated = any(section.name == "modulator" for section in devices)
        return rig_text([*sections, *(() if modulated else ask_twin(sections, self.ask))])

    def _bench(self) -> Section:
        section = Section("rig")
        name = Question("rig.name", "a name for the bench: letters, digits, . _ -", self.name)
        section.add("name", quoted(self.ask.ask(name)), "files are named after it")
        section.add(
            "rate",
            self._quantity("rig.rate", "how often the loop runs (servos on a shared line: 400 Hz)", "Hz", "1 kHz"),
            "of the loop",
        )
        section.add("backend", quoted("hardware"), "or by --backend on the command line: hardware, simulated")
        return section

    # ---- Devices -------------------------------------------------------------------------------------------------

    def _modulator(self, actuator: Section) -> Section | None:
        """A motor has none, unless somebody says so."""
        motor = any((line.key, line.value) == ("model", quoted(MOTOR)) for line in actuator.lines)
        return None if motor and not self.ask.offers("modulator.driver") else self._device("modulator", default=NONE)

    def _device(
        self, role: str, *, optional: bool = True, default: str | None = None, without: str = ""
    ) -> Section | None:
        """``without`` is what comes of there being none."""
        group = registry.group_of(role)
        drivers = tuple(registry.installed(group))
        known = (NONE, *drivers) if optional else drivers
        text = f"{SECTIONS[role]}: its driver" + (f' ("{NONE}" where there is none{without})' if optional else "")
        driver = self._choice(Question(f"{role}.driver", text, default, drivers[0]), known)
        if driver == NONE:
            return None
        section = Section(role, SECTIONS[role])
        section.add("driver", quoted(driver))
        declared = declared_by(group, driver)
        self._connect(section, driver, declared.connection)
        ask_options(section, declared, self.ask, self._preset(role, declared))
        self._sign(section)
        takes = self._understood(section, declared)
        if role == "actuator":
            self._identified(section, takes)
        if role == "modulator":
            section.add("command", self._command(role, takes, stands_for_something=True), "what it adds at most")
        if role == "load":
            section.add("torque_limit", self._load_limit(), "of what it is told to give")
        return section

    def _understood(self, section: Section, declared: Declared) -> str | None:
        """The unit that a drive takes with the options it has got, where its driver says so."""
        if declared.model is None:
            return None
        with suppress(ValidationError):
            options = declared.model.model_validate(options_of(section, declared))
            self._greatest_rad = min(self._greatest_rad, options.greatest_position_rad)
            self._greatest_rad_s = min(self._greatest_rad_s, options.greatest_velocity_rad_s)
            return options.command_unit
        return None

    def _preset(self, role: str, declared: Declared) -> dict[str, str]:
        """A load is commanded in newton metres; a watchdog must outlast the host's own stalls."""
        if declared.model is None:
            return {}
        chosen = declared.model.command_units.get(LOAD_UNIT, {}) if role == "load" else {}
        preset = {written_as(declared.model, name): toml(value) for name, value in chosen.items()}
        watchdog = keys_of(declared.model).get("watchdog")
        if watchdog is not None and isinstance(watchdog.default, float) and 0 < watchdog.default <= STALL_S:
            preset["watchdog"] = quoted(WATCHDOG)
        return preset

    def _connect(self, section: Section, driver: str, connection: str | None) -> None:
        kinds = ("can", "serial")
        kind = connection or self._choice(
            Question(f"{section.name}.connection", "how it is connected: can or serial", "can"), kinds
        )
        if kind == "serial":
            section.add("port", quoted(self._serial_port(section.name)))
        else:
            section.add("bus", quoted(self._bus(section.name, driver)))

    def _sign(self, section: Section) -> None:
        text, default = "-1 where its positive sense is not the bench's", "1"
        if section.name == "load":
            text = "-1 where it is mounted face to face with the actuator, 1 where its shaft turns the same way"
            default = "-1"
        question = Question(f"{section.name}.direction", text, default)
        if section.name == "load" or self.ask.offers(question.key):
            default = self._choice(question, ("1", "-1"))
        elif section.name == "actuator":
            return
        section.add("direction", default, "`rig check --move` tells whether it is right")

    def _identified(self, section: Section, takes: str | None) -> None:
        """What the actuator is identified as, and what it is told."""
        text = 'a motor with friction, or "none": source and exertion as tables, whatever it is'
        model = self._choice(Question("actuator.model", text, MOTOR), (MOTOR, NO_MODEL))
        section.add("model", quoted(model), "what it is identified as")
        comment = "the greatest one; its unit is what the drive takes, unless sent_as says another"
        section.add("command", self._command("actuator", takes, stands_for_something=model == NO_MODEL), comment)

    def _command(self, role: str, takes: str | None, *, stands_for_something: bool) -> str:
        """``{ unit, limit }``; where the drive's input may stand for a position or a pressure, what else it needs.

        ``takes`` is the unit that the drive takes, where its driver says so.
        """
        sent_as = f"{role}.command.sent_as"
        free = takes is None or stands_for_something or self.ask.offers(sent_as)
        share = ", a share of the supply" if takes == "1" else ""
        text = "the greatest command, with its unit" if free else f"the greatest command, in {takes}{share}"
        like = COMMANDS.get(takes or LOAD_UNIT, f"1 {takes}")
        table = self.ask.ask(
            Question(f"{role}.command", text, example=like, check=_command_in(None if free else takes))
        )
        unit = tomllib.loads(f"x = {table}")["x"]["unit"]
        for key, question in _more_of_command(role, unit, takes or unit).items():
            if stands_for_something or self.ask.offers(question.key):
                given = self.ask.ask(question)
                if given not in (quoted(NO_LEAST), quoted(unit)):
                    table = f"{table.removesuffix(' }')}, {key} = {given} }}"
        return table

    def _load_limit(self) -> str:
        return self._quantity(
            "load.torque_limit", "the greatest torque that the load may be told", "N*m", None, "1 N*m"
        )

    # ---- Where they are connected --------------------------------------------------------------------------------

    def _serial_port(self, role: str) -> str:
        result = [port for port in self.ports if port.kind == "serial" and not port.interface]
        self._tell_ports("serial ports plugged in", result)
        default = result[0].channel if result else None
        return self.ask.ask(Question(f"{role}.port", "its serial port", default, "/dev/ttyUSB0"))

    def _bus(self, role: str, driver: str) -> str:
        default = next(iter(self._buses), "can0")
        text = "the name of its CAN bus, a new one or one named before"
        name = self.ask.ask(Question(f"{role}.bus", text, default, check=_bus_name))
        self._buses.setdefault(name, []).append((role, driver))
        return name

    def _new_bus(self, name: str, on_it: Sequence[tuple[str, str]], bench: Section) -> Section:
        result = [(port.interface or port.kind, port) for port in self.ports if port.interface or port.kind != "serial"]
        self._tell_ports("CAN adapters plugged in", [port for _, port in result])
        likely = result[0][0] if result else "socketcan"
        text = f"its interface in python-can: {', '.join(ADAPTERS)}, ..."
        data_bitrate = data_bitrate_for(on_it)
        known = sorted(each for each in INTERFACES if data_bitrate is None or ADAPTERS.get(each, UNKNOWN).fd)
        interface = self._choice(Question(f"bus.{name}.interface", text, likely, listed=False), known)
        adapter = ADAPTERS.get(interface, UNKNOWN)
        channel = next((port.channel for kind, port in result if kind == interface), None)
        section = Section(f"bus.{name}")
        section.add("interface", quoted(interface), adapter.install and f"needs {adapter.install}")
        section.add("channel", quoted(self._channel(name, interface, adapter.channel, channel)))
        rate_hz = parse_quantity(tomllib.loads(bench.text())["rig"]["rate"], "Hz")
        bitrate, why = bitrate_for(on_it, rate_hz)
        question = " ".join(filter(None, ("its bitrate", why and f"({why})")))
        section.add(
            "bitrate", self._quantity(f"bus.{name}.bitrate", question, "bit/s", bitrate), "as set in every device on it"
        )
        if data_bitrate is not None:
            section.add("fd", "true", "it carries CAN FD frames")
            text = "the bitrate of the data in CAN FD frames"
            section.add("data_bitrate", self._quantity(f"bus.{name}.data_bitrate", text, "bit/s", data_bitrate), text)
        self._more_options(section, name, interface)
        return section

    def _channel(self, name: str, interface: str, text: str, default: str | None) -> str:
        def check(channel: str) -> str:
            for key, fault in mistakes(CanBusSettings(name, interface, channel, 500_000)):
                if key == "channel":
                    raise ValueError(fault)
            return channel

        # The text has an example of its own, for whoever reads it; one that fits is wanted for the command line, too.
        example = EXAMPLE.search(text)
        question = Question(f"bus.{name}.channel", text, default, example[1] if example else "", check=check)
        return self.ask.ask(question)

    def _more_options(self, section: Section, name: str, interface: str) -> None:
        """What else the interface cannot do without."""
        channel = section.lines[1].value.strip('"')
        for key, fault in mistakes(CanBusSettings(name, interface, channel, 500_000)):
            if key == "options":
                example = '{ host = "192.168.1.5", port = 29536 }'
                question = Question(
                    f"bus.{name}.options", fault, example=example, check=_options_table(name, interface)
                )
                section.add("options", self.ask.ask(question))
                return

    def _tell_ports(self, heading: str, result: Sequence[FoundPort]) -> None:
        if result:
            self.ask.tell(heading + ":")
        for port in result:
            kind = port.interface or port.kind
            self.ask.tell(f"  {kind} {port.channel}  {port.description}" + (f" ({port.mend})" if port.mend else ""))

    # ---- Limits --------------------------------------------------------------------------------------------------

    def _limits(self, *, with_sensor: bool) -> Section:
        section = Section("limits", "the guard stops everything beyond these")
        if with_sensor:
            torque = self._quantity("limits.torque", "the greatest torque at the port", "N*m", None, "1 N*m")
            section.add("torque", torque, "at the port")
        text, like = "the greatest velocity of the shaft", "60 rad/s"
        if isfinite(self._greatest_rad_s):
            text += f", well below the {self._greatest_rad_s:g} rad/s that the drives can tell"
            like = f"{READABLE * self._greatest_rad_s:.3g} rad/s"
        if isfinite(self._greatest_rad):
            greatest_rad_s = min(READABLE * self._greatest_rad / WAY_S, READABLE * self._greatest_rad_s)
            like = f"{greatest_rad_s:.3g} rad/s"
            text += f"; with a window of {READABLE * self._greatest_rad:.3g} rad about {like}, for the session to fit"
        velocity = self._quantity("limits.velocity", text, "rad/s", None, like)
        section.add("velocity", velocity, "the procedures take their amplitudes from it")
        text, default = "how far the shaft may turn from where it stands", "unlimited"
        if isfinite(self._greatest_rad):
            text += f", within the {self._greatest_rad:g} rad about its zero that the drives can tell"
            default = f"{READABLE * self._greatest_rad:.3g} rad"
        position = self._limit("limits.position", text, "rad", default)
        section.add("position", position, "half-width of a window about where the shaft stood")
        temperature = self._limit("limits.temperature", "the greatest temperature of the drives", "degC", "80 degC")
        section.add("temperature", temperature, "of the drives' transistors and motors")
        if with_sensor:
            self._shown(section, "power", "W", "20 W", "mechanical, at the port")
        comment = "a reading older than this stops the experiment; 20 ms will do on a quiet computer"
        self._shown(section, "stale_after", "s", STALE, comment, active=True)
        comment = "the loop itself standing still; below the watchdogs; 50 ms will do on a quiet computer"
        self._shown(section, "stall_after", "s", STALL, comment, active=True)
        return section

    def _shown(
        self, section: Section, key: str, unit: str, default: str, comment: str, *, active: bool = False
    ) -> None:
        """A limit that few need to set: not asked for; where it is not ``active`` a comment, unless somebody set it."""
        question = Question(f"{section.name}.{key}", comment, default, check=_quantity(unit, unlimited=unit == "W"))
        offered = self.ask.offers(question.key)
        section.add(key, self.ask.ask(question) if offered else quoted(default), comment, active=active or offered)

    # ---- Kinds of answer -----------------------------------------------------------------------------------------

    def _choice(self, question: Question, choices: Sequence[str]) -> str:
        return self.ask.ask(replace(question, choices=tuple(choices)))

    def _quantity(self, key: str, text: str, unit: str, default: str | None, example: str = "") -> str:
        return self.ask.ask(Question(key, text, default, example or default or "", check=_quantity(unit)))

    def _limit(self, key: str, text: str, unit: str, default: str) -> str:
        return self.ask.ask(Question(key, text, default, check=_quantity(unit, unlimited=True)))


def _quantity(unit: str, *, unlimited: bool = False) -> Callable[[str], str]:
    def check(text: str) -> str:
        if not (unlimited and text == "unlimited") and not 0 < parse_quantity(text, unit) < inf:
            raise ValueError(f'"{text}" must be greater than 0')
        return quoted(text)

    return check


def _command_in(takes: str | None) -> Callable[[str], str]:
    """``{ unit, limit }`` of a quantity in the unit that the drive takes, or in any."""

    def check(text: str) -> str:
        match = QUANTITY.fullmatch(text)
        like = COMMANDS.get(takes or LOAD_UNIT, "0.5 N*m")
        if match is None or not float(match[1]) > 0:
            raise ValueError(f'"{text}" is not a quantity greater than 0; write it like {like}')
        unit = check_unit(match[2] or "1")
        if takes is not None and not same_unit(unit, takes):
            raise ValueError(f'the drive takes commands in "{takes}" as it is set here; write it like {like}')
        if unit == "1":
            return f'{{ unit = "1", limit = {quoted(match[1])} }}'
        return f"{{ unit = {quoted(unit)}, limit = {quoted(text)} }}"

    return check


def _more_of_command(role: str, unit: str, takes: str) -> dict[str, Question]:
    lowest, sent_as = (f"{role}.command.{key}" for key in ("lowest", "sent_as"))
    return {
        "lowest": Question(lowest, "the least that it makes sense to tell", NO_LEAST, "0 N*m", check=_lowest(unit)),
        "sent_as": Question(sent_as, "the unit in which the drive takes the same number", takes, check=_unit),
    }


def _bus_name(text: str) -> str:
    if not BARE_KEY.fullmatch(text):
        raise ValueError(f'"{text}" is no name of a bus; write letters, digits, - and _, such as can0')
    return text


def _lowest(unit: str) -> Callable[[str], str]:
    def check(text: str) -> str:
        if text != NO_LEAST:
            parse_quantity(text, unit)
        return quoted(text)

    return check


def _unit(text: str) -> str:
    return quoted(check_unit(text))


def _options_table(name: str, interface: str) -> Callable[[str], str]:
    def check(text: str) -> str:
        try:
            options: Mapping[str, object] = tomllib.loads(f"x = {text}")["x"]
        except tomllib.TOMLDecodeError:
            raise ValueError("write a table { key = value, ... }") from None
        for key, fault in mistakes(CanBusSettings(name, interface, "can0", 500_000, options)):
            if key == "options":
                raise ValueError(fault)
        return text

    return check
