"""The driver keeps the bench's contract, against a drive in a script."""

import can
from norton_bench_turnwell import protocol

from norton_bench.testing import AmplifierContract, ScriptedWorld, SetUp
from norton_drivers.wiring import DeviceSettings

NODE = 5
WATCHDOG_NS = 100_000_000


class ScriptedTurnwell:
    """Does as the protocol's description says."""

    def __init__(self, world: ScriptedWorld) -> None:
        self.world = world
        self.there = True
        self.state, self.error, self.torque_nm = protocol.IDLE, 0, 0.0
        self.position_rad = self.velocity_rad_s = 0.0
        self.fed_ns = self.told_ns = 0
        world.bus.peer = self.hear
        world.clock.alarms.append(self.tick)

    # ---- What the contract asks of a far end ----

    def vanish(self) -> None:
        self.there = False

    @property
    def armed(self) -> bool:
        return self.state == protocol.TORQUE

    @property
    def command(self) -> float:
        return self.torque_nm if self.armed else 0.0

    def turn(self, position_rad: float, velocity_rad_s: float) -> None:
        self.position_rad, self.velocity_rad_s = position_rad, velocity_rad_s

    # ---- What the drive does ----

    def hear(self, frame: can.Message) -> None:
        if not self.there:
            return
        if frame.arbitration_id == protocol.CLEAR + NODE:
            self.state, self.error = protocol.IDLE, 0
        elif frame.arbitration_id == protocol.COMMAND + NODE:
            mode, self.torque_nm = protocol.command_of(bytes(frame.data))
            self.fed_ns = self.world.clock.ns
            if self.state != protocol.FAILED:
                self.state = mode

    def tick(self, now_ns: int) -> None:
        if self.armed and now_ns - self.fed_ns > WATCHDOG_NS:
            self.state, self.error = protocol.FAILED, 1
        if not self.there:
            return
        said = protocol.Motion(self.position_rad, self.velocity_rad_s, 0.0)
        self.world.bus.arrive(protocol.MOTION + NODE, protocol.motion(said))
        if now_ns - self.told_ns >= 20_000_000:
            self.told_ns = now_ns
            self.world.bus.arrive(protocol.STATE + NODE, protocol.state(protocol.State(self.state, self.error, 4)))


class TestTurnwell(AmplifierContract):
    command_resolution = 0.5e-3

    def set_up(self, direction: int) -> SetUp:
        world = ScriptedWorld()
        settings = DeviceSettings("actuator", "turnwell", bus="can0", direction=direction, options={"node": NODE})
        return SetUp(world, settings, ScriptedTurnwell(world), world.buses)
