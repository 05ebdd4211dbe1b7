"""A simulated twin for a rig under way: the section ``[simulated]``, so that it can be rehearsed before it is wired.

Where nobody says what is on the bench, the twin is the paper's torque motor (Hogan 2014, section IV.D) as
``rigs/sim-odrive.toml`` has it, in other units of torque and angle: torques are scaled to what this actuator gives at
most, angles to the velocity that this rig allows, times not at all. So it is the same machine to whoever controls it,
and what the standard session can do with the one it can do with the other.
"""

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from norton_bench.rig.new.options import Asker, Question, Section, quoted
from norton_bench.units import parse_quantity, same_dimension

TYPICAL, DATASHEET, NONE = "typical", "datasheet", "none"
KINDS = (TYPICAL, DATASHEET, NONE)

# Of rigs/sim-odrive.toml: the torque that its command's limit asks for, and the velocity it allows.
TORQUE_NM, VELOCITY_RAD_S = 0.5, 80.0
TORQUE_CONSTANT_NM_A = 0.05
# No amplifier gives exactly what it is told: of a torque, and of a current.
TORQUE_GAIN, CURRENT_GAIN = 0.9, 0.98
CURRENT_NOISE = 5e-3 / 10.0  # 5 mA, of the current for that torque


@dataclass(frozen=True)
class Quantity:
    """A true value: in the paper's motor ``value``, which grows with torque and angle by these powers."""

    key: str
    unit: str
    value: float
    torque: int
    angle: int
    words: str
    asked: bool = False  # of whoever has a datasheet


MOTOR = (
    Quantity("inertia", "kg*m^2", 5e-5, 1, -1, "inertia of rotor and coupling", asked=True),
    Quantity("viscous_damping", "N*m*s/rad", 1e-3, 1, -1, "torque that grows with velocity", asked=True),
    Quantity("coulomb_torque", "N*m", 0.02, 1, 0, "friction, from no-load current or breakaway torque", asked=True),
    Quantity("presliding_stiffness", "N*m/rad", 10.0, 1, -1, "of friction before it slides"),
    Quantity("presliding_damping", "N*m*s/rad", 0.01, 1, -1, "of friction before it slides"),
)
LOAD = (
    Quantity("inertia", "kg*m^2", 1.2e-4, 1, -1, "inertia of the load's rotor", asked=True),
    Quantity("viscous_damping", "N*m*s/rad", 3e-4, 1, -1, "torque that grows with velocity", asked=True),
    Quantity("coulomb_torque", "N*m", 8e-3, 1, 0, "the load's friction", asked=True),
    Quantity("presliding_stiffness", "N*m/rad", 8.0, 1, -1, "of friction before it slides"),
    Quantity("presliding_damping", "N*m*s/rad", 5e-3, 1, -1, "of friction before it slides"),
)
SENSOR = (
    Quantity("stiffness", "N*m/rad", 200.0, 1, -1, "torsional stiffness of sensor and couplings", asked=True),
    Quantity("damping", "N*m*s/rad", 0.01, 1, -1, "of sensor and couplings"),
    Quantity("noise", "N*m", 1e-3, 1, 0, "standard deviation of one reading", asked=True),
    Quantity("bias", "N*m", 3e-3, 1, 0, "what it reads at no torque"),
)


@dataclass(frozen=True)
class Bench:
    """What a twin must fit: the rig's sections as far as they are answered, read as a rig file is."""

    written: dict[str, Any]

    @property
    def command(self) -> tuple[float, str]:
        """The actuator's greatest command, and its unit."""
        command = self.written["actuator"]["command"]
        return parse_quantity(command["limit"], command["unit"]), command["unit"]

    @property
    def torque_nm(self) -> float:
        """What the actuator is asked for at most: the command where that is a torque, else half of what the port
        stands, as on the rigs that are shipped."""
        limit, unit = self.command
        if same_dimension(unit, "N*m"):
            return parse_quantity(f"{limit!r} {unit}", "N*m")
        stood = self.written["limits"].get("torque") or self.written.get("load", {}).get("torque_limit")
        return 0.5 * parse_quantity(stood, "N*m") if stood is not None else TORQUE_NM

    @property
    def velocity_rad_s(self) -> float:
        return parse_quantity(self.written["limits"]["velocity"], "rad/s")

    def option(self, role: str, key: str) -> Any:
        return self.written.get(role, {}).get(key)

    def scaled(self, quantity: Quantity) -> float:
        """A true value in this bench's units of torque and angle."""
        torques, angles = self.torque_nm / TORQUE_NM, self.velocity_rad_s / VELOCITY_RAD_S
        return quantity.value * torques**quantity.torque * angles**quantity.angle


def ask_twin(sections: list[Section], ask: Asker) -> list[Section]:
    """The sections of the twin that was asked for; none where nobody wants one."""
    text = "a simulated twin, to rehearse with: typical values, those of the datasheet, or none"
    kind = ask.ask(Question("simulated.twin", text, TYPICAL, choices=KINDS))
    if kind == NONE:
        return []
    bench = Bench(tomllib.loads("\n\n".join(section.text() for section in sections)))
    twin = _Twin(bench, ask, datasheet=kind == DATASHEET)
    return [*twin.sections()]


@dataclass(frozen=True)
class _Twin:
    bench: Bench
    ask: Asker
    datasheet: bool

    def sections(self) -> list[Section]:
        top = Section("simulated", "read by the simulated backend alone: true values of a twin, to rehearse with")
        top.add("seed", "1", "of the noise")
        result = [top, self._actuator()]
        if "load" in self.bench.written:
            result.append(self._load())
        if "load" in self.bench.written or "torque_sensor" in self.bench.written:
            result.append(self._sensor())
        result.append(_transport())
        return result

    def _actuator(self) -> Section:
        section = Section("simulated.actuator", "the paper's torque motor, scaled to this bench where nothing is known")
        section.add("model", quoted("dahl_motor"))
        limit, unit = self.bench.command
        constant = self._torque_constant(limit, unit)
        gain_a = CURRENT_GAIN if unit == "A" else TORQUE_GAIN * self.bench.torque_nm / (limit * constant)
        per_command = "A" if unit == "1" else f"A/{unit}" if unit.isalpha() else f"A/({unit})"
        section.add("amplifier_gain", _quantity(gain_a, per_command), "current for one unit of the command")
        section.add("amplifier_bandwidth", quoted("600 rad/s"), "of the drive's current loop")
        section.add("torque_constant", _quantity(constant, "N*m/A"))
        self._values(section, MOTOR)
        self._mounting(section, "actuator")
        noise_a = CURRENT_NOISE * self.bench.torque_nm / constant
        section.add("current_noise", _quantity(noise_a, "A"), "standard deviation of one reading")
        return section

    def _torque_constant(self, limit: float, unit: str) -> float:
        given = self.bench.option("actuator", "torque_constant")
        if given is not None:
            typical = parse_quantity(given, "N*m/A")
        else:
            typical = self.bench.torque_nm / limit if unit == "A" else TORQUE_CONSTANT_NM_A
        words = "the motor's torque constant"
        return self._value("simulated.actuator.torque_constant", "N*m/A", typical, words, asked=given is None)

    def _load(self) -> Section:
        section = Section("simulated.load")
        section.add("torque_gain", quoted("0.95"), "shaft torque for one newton metre commanded")
        section.add("amplifier_bandwidth", quoted("1000 rad/s"))
        given = self.bench.option("load", "torque_constant")
        if given is not None:
            section.add("torque_constant", quoted(given))
        self._values(section, LOAD)
        self._mounting(section, "load")
        return section

    def _sensor(self) -> Section:
        """The spring between the two, which is there without anybody who reads its torque, too."""
        section = Section("simulated.torque_sensor")
        read = "torque_sensor" in self.bench.written
        self._values(
            section, SENSOR if read else tuple(each for each in SENSOR if each.key in ("stiffness", "damping"))
        )
        if read:
            section.add("mounted", str(self.bench.option("torque_sensor", "direction") or 1), "the truth of direction")
        return section

    def _mounting(self, section: Section, role: str) -> None:
        section.add("mounted", str(self.bench.option(role, "direction") or 1), "the truth of `direction`")
        if self.bench.option(role, "counts_per_turn"):
            section.add("counts_per_turn", str(self.bench.option(role, "counts_per_turn")))

    def _values(self, section: Section, quantities: tuple[Quantity, ...]) -> None:
        for each in quantities:
            key, typical = f"{section.name}.{each.key}", self.bench.scaled(each)
            section.add(
                each.key, _quantity(self._value(key, each.unit, typical, each.words, asked=each.asked), each.unit)
            )

    def _value(self, key: str, unit: str, typical: float, words: str, *, asked: bool) -> float:
        """Typical, unless somebody knows better."""
        if not (self.ask.offers(key) or (self.datasheet and asked)):
            return typical
        return float(self.ask.ask(Question(key, words, f"{typical:.3g} {unit}", check=_positive(unit))))


def _transport() -> Section:
    """As on the rigs that are shipped."""
    section = Section("simulated.transport", "from device to host and back")
    for key, value in (("can_delay", "250 us"), ("can_jitter", "50 us"), ("serial_delay", "400 us")):
        section.add(key, quoted(value))
    section.add("serial_jitter", quoted("100 us"))
    return section


def _positive(unit: str) -> Callable[[str], str]:
    def check(text: str) -> str:
        value = parse_quantity(text, unit)
        if value <= 0:
            raise ValueError(f'"{text}" must be greater than 0')
        return repr(value)

    return check


def _quantity(value: float, unit: str) -> str:
    return quoted(f"{value:.4g} {unit}")
