"""A SimpleFOC sketch with one motor, as its Commander shows it.

Source: simplefoc/Arduino-FOC 2.3.4: src/communication/Commander.cpp, src/BLDCMotor.cpp (``move``: torque control by
voltage or current, limited; ``enable``, ``disable``). Lines are looked for once in the sketch's loop, numbers are
float32, and the terminal sees what the verbosity lets it see: all words at first. There is no error to be told of: what
goes wrong disables the motor, as a driver's fault input does. Where the rig has a timeout, it is the sketch's own, fed
by targets alone.
"""

from collections.abc import Callable
from struct import pack, unpack
from typing import cast

from norton_drivers.codecs.simplefoc import COMMAND_MAX, CONTROLLERS, MotorState, state_text
from norton_drivers.simplefoc.options import SimpleFocOptions
from norton_drivers.wiring import parse_options
from norton_sim.firmware.context import DeviceContext, DriveFault, Heating
from norton_sim.firmware.text_lines import LineServer
from norton_sim.plant import Machine

LOOP_PERIOD_NS = 100_000
LOOK_PERIOD_NS = 10_000_000
PRINTING_NS = 80_000
NOTHING, BARE, WORDS = 0, 1, 2  # of VerboseMode
DECIMALS, LIMIT_A, LIMIT_V = 3, 0.2, 12.0  # as the library begins
AMPLITUDE_PER_TORQUE_CURRENT = 2.0 / 3.0  # flux linkage times pole pairs, for each newton metre per ampere


class SimpleFocMotor:
    """The rig's actuator or its load."""

    def __init__(self, context: DeviceContext) -> None:
        self.enabled = True  # after initFOC
        self.heating = Heating()
        self._options = options = parse_options(SimpleFocOptions, context.settings)
        self._world = context.world
        self._plant = context.world.plant
        self._machine = cast(Machine, context.settings.role)
        self._volt_s_rad = AMPLITUDE_PER_TORQUE_CURRENT * context.truth.driven(self._machine).torque_constant_nm_a
        self._target = 0.0
        self._controller, self._torque = CONTROLLERS["voltage"][0], False  # a sketch that begins with another motion
        self._limits = {"C": LIMIT_A, "U": LIMIT_V}
        self._verbosity, self._decimals = WORDS, DECIMALS
        self._commanded_ns = context.world.now_ns
        self._frozen: tuple[float, float] | None = None
        self._connector = context.serial_connector()
        lines = LineServer(context, self._run, least_ns=PRINTING_NS, jitter_ns=LOOP_PERIOD_NS, longest=COMMAND_MAX)
        self._connector.on_bytes(lines.receive)
        context.cyclic(LOOK_PERIOD_NS, self._look)
        if options.mode == "voltage":
            context.cyclic(LOOP_PERIOD_NS, lambda _stamp_ns: self._drive())

    @property
    def armed(self) -> bool:
        return self.enabled and self._torque

    def break_down(self, fault: DriveFault) -> None:
        """The driver's fault input, whatever it is that it minds."""
        self._enable(False)

    def freeze(self) -> None:
        """From now on report the position and velocity of this instant."""
        self._frozen = self._motion()

    # ---- lines ----

    def _run(self, line: bytes) -> None:
        text = line.decode("latin-1")
        word, rest = text[:1], text[1:]
        if word == "?":
            self._print(f"{self._options.letter}:motor")
        elif word == "@":
            self._verbosity = int(_number(rest, self._verbosity))
            self._print("on!", "Verb:")
        elif word == "#":
            self._decimals = int(_number(rest, self._decimals))
            self._print(str(self._decimals), "Decimal:")
        elif word == self._options.letter:
            self._motor(rest)

    def _print(self, text: str, words: str = "") -> None:
        if self._verbosity != NOTHING:
            self._connector.send(f"{words if self._verbosity == WORDS else ''}{text}\r\n".encode())

    def _float(self, value: float) -> str:
        return f"{_f32(value):.{self._decimals}f}"

    # ---- Commander::motor ----

    def _motor(self, text: str) -> None:
        if text[:1].isdigit() or text[:1] in ("-", "+"):
            self._set_target(_number(text, 0.0))
            return
        commands: dict[str, Callable[[str], None]] = {
            "C": self._choose_motion,
            "E": self._switch,
            "L": self._limit,
            "M": self._tell,
            "T": self._choose_torque,
        }
        command = commands.get(text[:1])
        if command is None:
            self._print("err", "unknown cmd ")
        else:
            command(text[1:])

    def _set_target(self, value: float) -> None:
        self._target = _f32(value)
        self._commanded_ns = self._world.now_ns
        self._print(self._float(self._target), "Target: ")
        self._drive()

    def _choose_motion(self, text: str) -> None:
        if text:
            self._torque = int(_number(text, 0)) == 0
        self._print("torque" if self._torque else "vel", "Motion:")
        self._drive()

    def _choose_torque(self, text: str) -> None:
        if text:
            self._controller = int(_number(text, self._controller))
        names = dict(CONTROLLERS.values())
        self._print(names.get(self._controller, "err"), "Torque: ")
        self._drive()

    def _switch(self, text: str) -> None:
        if text:
            self._enable(bool(_number(text, 0.0)))
        self._print(str(int(self.enabled)), "Status: ")

    def _limit(self, text: str) -> None:
        which = text[:1]
        if which not in self._limits:
            self._print("err", "Limits| ")
            return
        if text[1:]:
            self._limits[which] = _f32(_number(text[1:], 0.0))
        self._print(self._float(self._limits[which]), "Limits| ")
        self._drive()

    def _tell(self, text: str) -> None:
        if text != "G7":
            self._print("err", "Monitor | ")
            return
        position_rad, velocity_rad_s = self._motion()
        current_a = self._plant.current_a(self._machine) if self.enabled else 0.0
        state = MotorState(self._target, 0.0, 0.0, current_a, 0.0, velocity_rad_s, position_rad)
        self._print(state_text(MotorState(*map(_f32, state)), self._decimals), "Monitor | all: ")

    def _motion(self) -> tuple[float, float]:
        """Angle [rad] and velocity [rad/s]."""
        if self._frozen is not None:
            return self._frozen
        plant, machine = self._plant, self._machine
        return plant.encoder_position_rad(machine), plant.encoder_velocity_rad_s(machine)

    # ---- what it drives ----

    def _drive(self) -> None:
        if not self.armed:
            return
        if self._controller != CONTROLLERS[self._options.controller][0]:
            self._plant.release(self._machine)  # the plant's amplifier knows one kind of command
            return
        most = self._limits["U" if self._options.mode == "voltage" else "C"]
        value = min(max(self._target, -most), most)
        if self._options.mode == "voltage":
            value -= self._volt_s_rad * self._plant.encoder_velocity_rad_s(self._machine)
        self._plant.command(self._machine, value * self._options.per_target)

    def _enable(self, on: bool) -> None:
        self.enabled = on
        if on:
            self._drive()
        else:
            self._plant.release(self._machine)

    def _look(self, stamp_ns: int) -> None:
        self.heating.carry(self._plant.true_current_a(self._machine), LOOK_PERIOD_NS * 1e-9)
        timeout_ns = round(self._options.watchdog_s * 1e9)
        if self.heating.too_hot or (timeout_ns and stamp_ns - self._commanded_ns > timeout_ns):
            self._enable(False)


def _f32(value: float) -> float:
    return float(unpack("<f", pack("<f", value))[0])


def _number(text: str, otherwise: float) -> float:
    """As atof reads it: what is no number is 0, and nothing is ``otherwise``."""
    if not text:
        return otherwise
    try:
        return float(text)
    except ValueError:
        return 0.0
