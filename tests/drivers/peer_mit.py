"""A motor in MIT mode whose frames are packed and unpacked by a package that drives such motors.

Run as ``peer_mit.py GROUP PORT NODE MASTER PACKAGE``, with mini-cheetah-motor-driver-socketcan (replies of six bytes)
or TMotorCANControl (eight: temperature and error too). A flywheel; AK80-9's ranges.
"""

import contextlib
import io
import sys
import time

import can
from motor_driver import canmotorlib
from TMotorCANControl.mit_can import CAN_Manager

GROUP, PORT, NODE, MASTER = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
PACKAGE, TAIL = {"mini-cheetah": (canmotorlib, b""), "TMotorCANControl": (CAN_Manager, b"\x1f\0")}[sys.argv[5]]
P, V, T = 12.5, 50.0, 18.0


class Peer:
    def __init__(self) -> None:
        self.enabled = False
        self.torque_nm = self.position_rad = self.velocity_rad_s = 0.0
        self.moved_s = time.monotonic()

    def reply(self) -> bytes:
        position = PACKAGE.float_to_uint((self.position_rad + P) % (2 * P) - P, -P, P, 16)
        velocity = PACKAGE.float_to_uint(self.velocity_rad_s, -V, V, 12)
        torque = PACKAGE.float_to_uint(self.torque_nm if self.enabled else 0.0, -T, T, 12)
        bits = f"{NODE:08b}{position:016b}{velocity:012b}{torque:012b}"
        return int(bits, 2).to_bytes(6, "big") + TAIL

    def receive(self, data: bytes) -> bytes:
        self.move()
        reply = self.reply()
        if data[:7] == b"\xff" * 7:
            self.enabled = {0xFC: True, 0xFD: False}.get(data[7], self.enabled)
        else:
            self.torque_nm = PACKAGE.uint_to_float(int(f"{int.from_bytes(data, 'big'):064b}"[52:], 2), -T, T, 12)
        return reply

    def move(self) -> None:
        now_s = time.monotonic()
        elapsed_s, self.moved_s = now_s - self.moved_s, now_s
        torque_nm = self.torque_nm if self.enabled else 0.0
        self.velocity_rad_s += (20.0 * torque_nm - self.velocity_rad_s) * min(elapsed_s, 0.1)
        self.position_rad += self.velocity_rad_s * elapsed_s


def main() -> None:
    peer = Peer()
    with contextlib.redirect_stdout(io.StringIO()), can.Bus(GROUP, "udp_multicast", port=PORT) as bus:
        while True:
            frame = bus.recv(1.0)
            if frame is not None and frame.arbitration_id == NODE and not frame.is_extended_id:
                reply = peer.receive(bytes(frame.data))
                bus.send(can.Message(arbitration_id=MASTER, data=reply, is_extended_id=False))


main()
