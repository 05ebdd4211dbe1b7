"""A loop on the simulated backend, for tests that need the real path but not a whole session."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from norton_bench.loop.devices import Devices, guard_for, open_devices
from norton_bench.loop.loop import Loop
from norton_bench.loop.outbox import Outbox
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.sample import Alignment
from norton_drivers.registry import load_backend
from norton_sim.backend import SimulatedBackend
from norton_sim.firmware.odrive import ODriveAxis


@dataclass
class Bench:
    """``parts`` collects everything that the loop hands on."""

    rig: Rig
    backend: SimulatedBackend
    devices: Devices
    loop: Loop
    parts: list[Measured]

    def after(self, delay_s: float, fault: Callable[[], None]) -> None:
        """Let ``fault`` happen in the simulated world ``delay_s`` from now: what a schedule has no word for."""
        self.backend.world.at(self.backend.world.now_ns + round(delay_s * 1e9), lambda _now: fault())

    def cut(self, role: str) -> None:
        """Pull a device's plug."""
        self.backend.world.wires[role].cut()

    def force_torque(self, torque_nm: float) -> None:
        """Let the torque sensor read this from now on."""
        self.backend.world.devices["torque_sensor"].signal.force(torque_nm)  # type: ignore[attr-defined]

    def axis(self, role: str) -> ODriveAxis:
        device = self.backend.world.devices[role]
        assert isinstance(device, ODriveAxis)
        return device

    def armed(self) -> list[str]:
        """Roles of the drives whose firmware still closes the torque loop."""
        roles = [drive.role for drive in self.devices.drives]
        return [role for role in roles if self.backend.world.devices[role].armed]  # type: ignore[attr-defined]


@contextmanager
def opened(rig: Rig, seed: int = 1) -> Iterator[Bench]:
    """Devices and loop of ``rig``, closed again afterwards."""
    backend = load_backend("simulated")(rig.wiring, rig.simulated, seed=seed, place=rig.place)
    assert isinstance(backend, SimulatedBackend)
    devices, parts = open_devices(rig, backend), list[Measured]()
    loop = Loop(devices, guard_for(rig, devices), Outbox((parts.append,)), Alignment(), rig.tick_ns)
    loop.command_may_be_a_place = rig.command_may_be_a_place
    try:
        yield Bench(rig, backend, devices, loop, parts)
    finally:
        devices.link.close()
        backend.close()
