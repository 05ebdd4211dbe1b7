"""A host that speaks to an emulated ODrive in raw frames, and reads its answers with ODrive's own DBC files."""

from pathlib import Path
from struct import pack
from typing import Any, ClassVar

import can
import cantools
import odrive_can

from norton_drivers.wiring import Wiring
from norton_sim.backend import SimulatedBackend

MS = 1_000_000
NODE = 1


class ODriveHost:
    """Speaks to the actuator's drive; ``dbc`` names the file of its firmware."""

    dbc: ClassVar[str]

    def __init__(self, backend: SimulatedBackend, wiring: Wiring) -> None:
        self.world = backend.world
        self.bus = backend.open_can(wiring.buses[0]).bus
        self.device = backend.world.devices["actuator"]
        self._messages = cantools.database.load_file(Path(odrive_can.__file__).parent / "dbc" / f"{self.dbc}.dbc")

    def send(self, command: int, data: bytes = b"", *, remote: bool = False) -> None:
        frame = can.Message(
            arbitration_id=NODE << 5 | command,
            is_extended_id=False,
            is_remote_frame=remote,
            data=None if remote else data,
            dlc=8 if remote else None,
        )
        self.bus.send(frame)

    def torque(self, torque_nm: float) -> None:
        self.send(0x0E, pack("<f", torque_nm))

    def wait(self, duration_ms: float) -> None:
        self.world.advance(self.world.now_ns + round(duration_ms * MS))

    def message(self, name: str) -> cantools.database.Message:
        """As the file has it for axis 0: its identifier is the command's."""
        return self._messages.get_message_by_name(f"Axis0_{name}")

    def heard(self) -> dict[int, list[bytes]]:
        """Payloads of the axis since the last call, by command."""
        payloads: dict[int, list[bytes]] = {}
        for frame in iter(lambda: self.bus.recv(0), None):
            if frame.arbitration_id >> 5 == NODE:
                payloads.setdefault(frame.arbitration_id & 31, []).append(bytes(frame.data))
        return payloads

    def ask(self, name: str, **how: Any) -> dict[str, Any]:
        """The answer to a remote frame, or to what ``how`` says."""
        message = self.message(name)
        self.heard()
        self.send(message.frame_id, **(how or {"remote": True}))
        self.wait(1)
        return message.decode(self.heard()[message.frame_id][-1], decode_choices=False)

    def state(self) -> tuple[int, int]:
        """Active errors and axis state, by the drive's own word."""
        heartbeat = self.ask("Heartbeat")
        return heartbeat["Axis_Error"], heartbeat["Axis_State"]
