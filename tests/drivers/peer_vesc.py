"""A VESC as another program would emulate it: bytes by hand from comm_can.c, none of this project's code,
its checksum crccheck's.

Run as ``peer_vesc.py GROUP PORT NODE TIMEOUT_S``. A flywheel, driven by the current that was commanded.
"""

import math
import struct
import sys
import time

import can
from crccheck.crc import CrcXmodem

GROUP, PORT, NODE, TIMEOUT_S = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4])
POLE_PAIRS, PERIOD_S = 7, 0.002


class Peer:
    def __init__(self, bus: can.BusABC) -> None:
        self.bus = bus
        self.current_a = self.position_rad = self.velocity_rad_s = 0.0
        self.commanded_s = time.monotonic()

    def send(self, packet: int, to: int, data: bytes) -> None:
        self.bus.send(can.Message(arbitration_id=packet << 8 | to, data=data, is_extended_id=True))

    def receive(self, frame: can.Message) -> None:
        packet, node, data = frame.arbitration_id >> 8, frame.arbitration_id & 0xFF, bytes(frame.data)
        if not frame.is_extended_id or node != NODE:
            return
        if packet == 1:
            self.current_a = struct.unpack(">i", data)[0] / 1000
            self.commanded_s = time.monotonic()
        elif packet == 17:
            self.send(18, data[0], bytes((NODE, 0)))
        elif packet == 8 and data[1:] == b"\0\0":
            self.send_long(data[0], bytes((0, 5, 3)) + b"410\0" + bytes(16))
        elif packet == 8 and data[1:3] == b"\0\x32":
            self.send(8, data[0], bytes((NODE, 1)) + data[2:] + b"\0")

    def send_long(self, to: int, payload: bytes) -> None:
        for at in range(0, len(payload), 7):
            self.send(5, to, bytes((at,)) + payload[at : at + 7])
        self.send(7, to, struct.pack(">BBHH", NODE, 1, len(payload), CrcXmodem.calc(payload)))

    def step(self) -> None:
        if time.monotonic() - self.commanded_s > TIMEOUT_S:
            self.current_a = 0.0
        self.velocity_rad_s += (self.current_a * 50.0 - self.velocity_rad_s) * PERIOD_S
        self.position_rad += self.velocity_rad_s * PERIOD_S
        erpm = int(self.velocity_rad_s * 60 / (2 * math.pi) * POLE_PAIRS)
        forward = 1 if 0.1 * self.current_a + 0.03 * self.velocity_rad_s >= 0 else -1
        drawn = int(forward * self.current_a * 10)
        self.send(9, NODE, struct.pack(">ihh", erpm, drawn, forward * 50))
        angle = int(math.degrees(self.position_rad) % 360 * 50)
        self.send(16, NODE, struct.pack(">hhhh", 300, 250, 0, angle))


def main() -> None:
    with can.Bus(GROUP, "udp_multicast", port=PORT) as bus:
        peer, next_s = Peer(bus), time.monotonic()
        while True:
            frame = bus.recv(max(0.0, next_s - time.monotonic()))
            if frame is not None:
                peer.receive(frame)
            if time.monotonic() >= next_s:
                next_s += PERIOD_S
                peer.step()


main()
