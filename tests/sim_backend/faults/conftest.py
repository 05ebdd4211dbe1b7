"""A host that only listens, and one that drives."""

from collections.abc import Callable
from dataclasses import dataclass, field

import can
import pytest

from norton_drivers.bota import BotaSensor, open_torque_sensor
from norton_drivers.link import Link
from norton_drivers.odrive import ODrive, open_amplifier
from norton_drivers.ports import CanPort
from norton_drivers.wiring import Wiring
from norton_sim.backend import SimulatedBackend
from norton_sim.faults.schema import Fault

MS = 1_000_000


@dataclass
class Host:
    """The rig's real drivers, and every frame that came."""

    backend: SimulatedBackend
    link: Link
    actuator: ODrive
    load: ODrive
    sensor: BotaSensor
    frames: list[tuple[int, int, bytes]] = field(default_factory=list)  # arrival, identifier, data

    @property
    def port(self) -> CanPort:
        return self.link.can_ports["can0"]

    def hear(self, message: can.Message, arrival_ns: int) -> None:
        self.frames.append((arrival_ns, message.arbitration_id, bytes(message.data)))

    def listen(self, duration_ms: int) -> None:
        for _ in range(duration_ms):
            self.link.wait(MS)

    def drive(self, torques_nm: tuple[float, float], duration_ms: int) -> None:
        for _ in range(duration_ms):
            self.actuator.command(torques_nm[0])
            self.load.command(torques_nm[1])
            self.link.wait(MS)

    def enable(self) -> None:
        """Both drives, with the first one's watchdog fed meanwhile."""
        self.actuator.enable()
        self.link.keep_alive = lambda: self.actuator.command(0.0)
        self.load.enable()
        self.link.keep_alive = None

    def of(self, node: int, command: int) -> list[bytes]:
        """The data of that message, in the order of arrival."""
        return [data for _, arbitration_id, data in self.frames if arbitration_id == node << 5 | command]


@pytest.fixture
def make_host(wiring: Wiring, open_bench: Callable[..., SimulatedBackend]) -> Callable[..., Host]:
    """``make_host(*faults, seed=1)``: the faults are there from the start."""

    def make(*faults: Fault, seed: int = 1) -> Host:
        # Without jitter, frames come when they came in the same world without the fault.
        backend = open_bench(wiring, seed, transport={})
        backend.inject(*faults)
        link = Link(backend, wiring.buses)
        assert wiring.load is not None
        assert wiring.torque_sensor is not None
        drives = open_amplifier(wiring.actuator, link), open_amplifier(wiring.load, link)
        host = Host(backend, link, *drives, open_torque_sensor(wiring.torque_sensor, link))
        host.port.subscribe(host.hear)
        return host

    return make
