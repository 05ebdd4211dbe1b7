"""The port of a servo maker's own library, on a simulated serial line: its packets drive the emulated devices."""

from norton_sim.backend import SimulatedBackend
from norton_sim.buses import SimulatedLine

STEP_NS = 100_000
PATIENCE_NS = 30_000_000


class SdkPort:
    """As much of their ``PortHandler`` as their packet handlers use; time passes while they read."""

    is_using = False

    def __init__(self, backend: SimulatedBackend, port: str, baud: int) -> None:
        line = backend.open_serial(port, baud).line
        assert isinstance(line, SimulatedLine)
        self.line = line
        self.world = backend.world
        self._begun_ns, self._baud = 0, baud

    def getBaudRate(self) -> int:
        return self._baud

    def clearPort(self) -> None:
        self.wait(1.0)
        while self.line.read(1000):
            pass

    def writePort(self, packet: list[int]) -> int:
        return self.line.write(bytes(packet))

    def readPort(self, length: int) -> bytes:
        self.world.advance(self.world.now_ns + STEP_NS)
        return self.line.read(length)

    def setPacketTimeout(self, _length: int) -> None:
        self._begun_ns = self.world.now_ns

    def setPacketTimeoutMillis(self, _duration_ms: float) -> None:
        self._begun_ns = self.world.now_ns

    def isPacketTimeout(self) -> bool:
        return self.world.now_ns - self._begun_ns > PATIENCE_NS

    def wait(self, duration_ms: float) -> None:
        self.world.advance(self.world.now_ns + round(duration_ms * 1e6))
