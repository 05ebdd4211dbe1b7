"""A moteus controller whose frames are taken apart and put together by the maker's own package.

Run as ``peer_moteus.py GROUP PORT NODE``. A flywheel; it starts in 20 ms, and has a watchdog.
"""

import io
import math
import sys
import time

import can
from moteus import Mode, Register, multiplex
from moteus.protocol import Writer, parse_registers

GROUP, PORT, NODE = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
STARTING_S = 0.02


class Peer:
    def __init__(self) -> None:
        self.mode = Mode.STOPPED
        self.torque_nm = self.turns = self.turns_s = 0.0
        self.moved_s = self.started_s = self.commanded_s = time.monotonic()
        self.timeout_s = math.nan

    def values(self) -> dict[int, float]:
        torque_nm = self.torque_nm if self.mode == Mode.POSITION else 0.0
        return {
            Register.MODE: self.mode,
            Register.POSITION: self.turns,
            Register.VELOCITY: self.turns_s,
            Register.TORQUE: torque_nm,
            Register.Q_CURRENT: 10 * torque_nm,
            Register.VOLTAGE: 24.0,
            Register.TEMPERATURE: 30.0,
            Register.FAULT: 0,
            Register.MODEL_NUMBER: 0x0604,
            Register.FIRMWARE_VERSION: 0x010304,
            Register.REGISTER_MAP_VERSION: 5,
        }

    def answer(self, query: list[tuple[int, int]]) -> bytes:
        """Each register by itself, which is as good as rows of them."""
        buffer = io.BytesIO()
        writer, values = Writer(buffer), self.values()
        scaled = {Register.VOLTAGE: writer.write_voltage, Register.TEMPERATURE: writer.write_temperature}
        for register, resolution in query:
            writer.write_int8(0x21 | resolution << 2)
            writer.write_varuint(register)
            if resolution == multiplex.F32:
                writer.write_f32(values[register])
            else:
                scaled.get(register, writer.write_int)(values[register], resolution)
        data = buffer.getvalue()
        return data.ljust(next(each for each in (*range(9), 12, 16, 20, 24, 32, 48, 64) if each >= len(data)), b"\x50")

    def obey(self, command: dict[int, float], now_s: float) -> None:
        if command[Register.MODE] == Mode.STOPPED:
            self.mode = Mode.STOPPED
        elif command[Register.MODE] == Mode.POSITION and self.mode not in (Mode.FAULT, Mode.TIMEOUT):
            if self.mode == Mode.STOPPED:
                self.mode, self.started_s = 2, now_s
            self.torque_nm, self.commanded_s = command[Register.COMMAND_FEEDFORWARD_TORQUE], now_s
            self.timeout_s = command[Register.COMMAND_TIMEOUT]

    def move(self, now_s: float) -> None:
        elapsed_s, self.moved_s = now_s - self.moved_s, now_s
        if self.mode == 2 and now_s - self.started_s > STARTING_S:
            self.mode = Mode.POSITION
        if self.mode == Mode.POSITION and now_s - self.commanded_s > self.timeout_s:
            self.mode = Mode.TIMEOUT
        torque_nm = self.torque_nm if self.mode == Mode.POSITION else 0.0
        self.turns_s += (20.0 * torque_nm / math.tau - self.turns_s) * min(elapsed_s, 0.1)
        self.turns += self.turns_s * elapsed_s


def main() -> None:
    peer = Peer()
    with can.Bus(GROUP, "udp_multicast", port=PORT, fd=True) as bus:
        while True:
            frame = bus.recv(1.0)
            if frame is None or frame.arbitration_id != (0x8000 | NODE):
                continue
            asked, now_s = parse_registers(bytes(frame.data)), time.monotonic()
            peer.move(now_s)
            if asked.query:
                reply = peer.answer(asked.query)
                bus.send(can.Message(arbitration_id=NODE << 8, data=reply, is_fd=True, bitrate_switch=True))
            if asked.command:
                peer.obey(asked.command, now_s)


main()
