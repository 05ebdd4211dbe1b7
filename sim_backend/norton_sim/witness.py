"""Records the true state of the simulated bench, to judge how the bench handled a fault."""

from dataclasses import dataclass, field
from pathlib import Path

from norton_drivers.ports import TrueState
from norton_sim.plant import Machine
from norton_sim.world import World

# Less does nobody harm: it is what a busy bus delays a frame by.
WORTH_TELLING_NS = 5_000_000


@dataclass
class Standstills:
    """How long the served devices stood still where real ones would not have: tells whether they or the loop were late.

    Told each time the world goes on; ``count`` is how often it had stood still for longer than is worth telling.
    """

    longest_ns: int = field(default=0, init=False)
    count: int = field(default=0, init=False)
    _last_ns: int | None = field(default=None, init=False)

    def goes_on(self, now_ns: int) -> None:
        """At ``now_ns`` of the wall's clock."""
        if self._last_ns is not None:
            still_ns = now_ns - self._last_ns
            self.longest_ns = max(self.longest_ns, still_ns)
            self.count += still_ns > WORTH_TELLING_NS
        self._last_ns = now_ns

    def __str__(self) -> str:
        longest = f"the simulated devices stood still for {self.longest_ns / 1e6:.1f} ms at most"
        if not self.count:
            return longest
        times = "once" if self.count == 1 else f"{self.count} times"
        return f"{longest}, and for more than {WORTH_TELLING_NS / 1e6:g} ms {times}: real ones would have gone on"


PERIOD_NS = 250_000
# In a file, which others read while it grows: a line a millisecond.
FILE_PERIOD_NS = 1_000_000
LINES_AT_A_TIME = 10

MACHINES: tuple[Machine, ...] = ("actuator", "load", "modulator")


def true_state(world: World) -> TrueState:
    """The bench as it stands."""
    plant = world.plant
    return TrueState(
        world.now_ns,
        plant.true_port_torque_nm(),
        plant.true_velocity_rad_s("actuator"),
        plant.true_velocity_rad_s("load"),
        tuple([machine for machine in MACHINES if plant.has(machine) and plant.drives(machine)]),
        tuple([machine for machine in MACHINES if getattr(world.devices.get(machine), "armed", False)]),
    )


def watch(world: World) -> list[TrueState]:
    """What is true from now on; the list grows as time passes."""
    states: list[TrueState] = []
    world.every(PERIOD_NS, lambda _stamp_ns: states.append(true_state(world)), first_ns=world.now_ns)
    return states


class WitnessFile:
    """The same as lines of a CSV file: its first line names the columns.

    ``epoch_ns`` is what the machine's monotonic clock showed when the world began. Raises OSError.
    """

    def __init__(self, path: Path, world: World, epoch_ns: int) -> None:
        self._file = path.open("w", encoding="ascii")
        self._world = world
        self._epoch_ns = epoch_ns
        self._lines = ["monotonic_ns,torque_nm,velocity_rad_s,load_velocity_rad_s,driving,armed\n"]
        world.every(FILE_PERIOD_NS, self._note, first_ns=world.now_ns)

    def close(self) -> None:
        self._write()
        self._file.close()

    def _note(self, _stamp_ns: int) -> None:
        state = true_state(self._world)
        numbers = f"{state.torque_nm:.6g},{state.velocity_rad_s:.6g},{state.load_velocity_rad_s:.6g}"
        roles = f"{'+'.join(state.driving)},{'+'.join(state.armed)}"
        self._lines.append(f"{state.stamp_ns + self._epoch_ns},{numbers},{roles}\n")
        if len(self._lines) >= LINES_AT_A_TIME:
            self._write()

    def _write(self) -> None:
        self._file.writelines(self._lines)
        self._file.flush()
        self._lines.clear()
