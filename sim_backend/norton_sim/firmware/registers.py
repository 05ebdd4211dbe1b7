"""What emulated servos on a half-duplex line have in common: registers, and whose turn it is to answer."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Literal, cast

from norton_drivers.half_duplex.options import BusServoOptions
from norton_sim.firmware.context import DeviceContext, Heating
from norton_sim.plant import Machine

LOOK_PERIOD_NS = 10_000_000
PATIENCE_NS = 5_000_000  # with those who answer before


class Registers:
    """Bytes at addresses; numbers of several bytes in one order."""

    def __init__(self, size: int, order: Literal["little", "big"] = "little") -> None:
        self._bytes = bytearray(size)
        self._order = order

    def get(self, address: int, size: int = 1, *, signed: bool = False) -> int:
        return int.from_bytes(self._bytes[address : address + size], self._order, signed=signed)

    def put(self, address: int, value: int, size: int = 1) -> None:
        """Negative values as a complement of two."""
        self.write(address, (value & ((1 << 8 * size) - 1)).to_bytes(size, self._order))

    def read(self, address: int, length: int) -> bytes:
        """Zeros where there is nothing."""
        return bytes(self._bytes[address : address + length]).ljust(length, b"\0")

    def write(self, address: int, data: bytes) -> None:
        """What lies beyond the end is lost."""
        end = min(address + len(data), len(self._bytes))
        self._bytes[address:end] = data[: max(end - address, 0)]


class BusServo:
    """One servo: it does not answer before its turn, nor to a question that another has followed."""

    return_delay_ns = 0

    def __init__(self, context: DeviceContext, options: BusServoOptions, registers: Registers) -> None:
        self.heating = Heating()
        self.registers = registers
        self.node = options.node
        self._world = context.world
        self._plant = context.world.plant
        self._machine = cast(Machine, context.settings.role)
        self._frozen: tuple[float, float] | None = None
        self._question = 0  # how many questions there were
        self._before: list[int] = []  # whose answers come before its own
        self._answer: Callable[[], bytes] | None = None  # when they have come
        self._connector = context.half_duplex_connector(options.baud)
        self._connector.on_bytes(self._receive)
        context.cyclic(LOOK_PERIOD_NS, self._look)

    def freeze(self) -> None:
        """From now on report the position and velocity of this instant."""
        self._frozen = self._motion()

    def _motion(self) -> tuple[float, float]:
        """Position [rad] and velocity [rad/s]."""
        if self._frozen is not None:
            return self._frozen
        plant, machine = self._plant, self._machine
        return plant.encoder_position_rad(machine), plant.encoder_velocity_rad_s(machine)

    def _receive(self, data: bytes) -> None:
        raise NotImplementedError

    def _look(self, stamp_ns: int) -> None:
        self.heating.carry(self._plant.true_current_a(self._machine), LOOK_PERIOD_NS * 1e-9)

    # ---- whose turn it is ----

    def _asked_anew(self) -> None:
        """A packet of the host's: nothing before it is answered any more."""
        self._question += 1
        self._before, self._answer = [], None

    def _answer_later(self, answer: Callable[[], bytes], delay_ns: int = 0) -> None:
        """Say it after the return delay, and ``delay_ns`` more."""
        at_ns = self._world.now_ns + self.return_delay_ns + delay_ns
        self._world.at(at_ns, partial(self._say, self._question, answer))

    def _answer_behind(self, nodes: Sequence[int], answer: Callable[[], bytes]) -> None:
        """Say it when these have answered."""
        self._before, self._answer = list(nodes), answer
        self._world.at(self._world.now_ns + PATIENCE_NS, partial(self._give_up, self._question))
        self._answered(-1)

    def _give_up(self, question: int, _stamp_ns: int) -> None:
        """One before it has not answered."""
        if question == self._question:
            self._before, self._answer = [], None

    def _answered(self, node: int) -> None:
        """Another servo has answered."""
        if node in self._before:
            self._before.remove(node)
        if self._answer is not None and not self._before:
            self._answer_later(self._answer)
            self._answer = None

    def _say(self, question: int, answer: Callable[[], bytes], _stamp_ns: int) -> None:
        if question == self._question:
            self._connector.send(answer())
