"""What CAN links of the kernel do that are not as they should be, and what this program says of it.

Every command that it names as a remedy is carried out as it stands, and must help.
"""

import os
import re
import socket
import struct
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import can
from guest import Tell
from program import bench_here, rig_on

from norton_bench.rig.load import load_rig
from norton_drivers.codecs.can_errors import CanErrorFrame, ControllerError, ErrorClass
from norton_drivers.codecs.odrive import AxisState, Heartbeat, MessageId, arbitration_id
from norton_drivers.errors import ConnectionFailedError
from norton_drivers.hardware import HardwareBackend
from norton_drivers.ports import CanPort
from norton_drivers.wiring import CanBusSettings

HOST, PEER = "can0", "can1"  # two controllers on one bus
FRAME = struct.Struct("=IB3x8s")  # <linux/can.h>
QUIET_S = 0.05
_REMEDY = re.compile(r"`sudo ([^`]+)`")
FASTEST = 99
NOTHING = "nothing"


def run(checkout: Path, _argument: str, tell: Tell) -> None:
    _set_up(checkout, tell)
    ip(f"link set {PEER} up type can bitrate 1000000")
    _frames(tell)
    _errors(tell)
    _full_queue(tell)
    _down_and_up(tell)
    _device(checkout, tell)


def ip(command: str) -> None:
    subprocess.run(["ip", *command.split()], check=True)


def apply(sentence: str) -> None:
    """Carry out every command that a sentence names."""
    for command in _REMEDY.findall(sentence):
        subprocess.run(command.replace("sudo ", ""), shell=True, check=True)


# ---- Before it is opened --------------------------------------------------------------------------------------------


def _set_up(checkout: Path, tell: Tell) -> None:
    """From a link that is not there to one that can be used, with nothing but what ``rig check`` says."""
    _mend("no such link", rig_on(checkout, "cia402", "vcan0", "virtual"), "there is no CAN link vcan0", tell)
    real = rig_on(checkout, "cia402", HOST, "real")
    _mend("a link that is down", real, "the link is down", tell)
    ip(f"link set {HOST} down")
    ip(f"link set {HOST} up type can bitrate 500000")
    _mend("another bitrate", real, "the link runs at 500000 bit/s, but the rig file says 1000000", tell)
    ip("link set vcan0 down")
    said = bench_here("devices")[1]
    tell("devices: a virtual link that is down", "`sudo ip link set vcan0 up`" in said, "listed, with the remedy")
    apply("`sudo ip link set vcan0 up`")


def _mend(what: str, rig: Path, words: str, tell: Tell) -> None:
    """``rig check`` says it once for each bus, and what it says to do helps."""
    _, said = bench_here("rig", "check", rig, "--backend", "hardware")
    line = next((line for line in said.splitlines() if "[bus." in line), said)
    tell(f"rig check: {what}", words in line, line)
    apply(line)
    bus = load_rig(rig).wiring.buses[0]
    left = _refusal(lambda: HardwareBackend().open_can(bus).close())
    tell(f"rig check: {what}, once mended", left == NOTHING, left)


# ---- While it is open -----------------------------------------------------------------------------------------------


def _opened() -> tuple[HardwareBackend, CanPort]:
    backend = HardwareBackend()
    return backend, backend.open_can(CanBusSettings("arm", "socketcan", HOST, 1_000_000))


def _refusal(act: Callable[[], object]) -> str:
    try:
        act()
    except ConnectionFailedError as error:
        return str(error)
    return NOTHING


def _raw(channel: str) -> socket.socket:
    """A CAN socket without python-can or any of this program's code."""
    raw = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    raw.bind((channel,))
    return raw


def _frames(tell: Tell) -> None:
    backend, port = _opened()
    got: list[tuple[can.Message, int]] = []
    port.subscribe(lambda message, arrival_ns: got.append((message, arrival_ns)))
    peer, neighbour = _raw(PEER), _raw(HOST)
    sent_ns = time.monotonic_ns()
    peer.send(FRAME.pack(0x21, 2, b"\1\2"))
    time.sleep(QUIET_S)
    began_ns = time.monotonic_ns()
    port.poll()
    ((message, arrival_ns),) = got
    tell("a frame from the other controller", bytes(message.data) == b"\1\2", str(message).strip())
    stamped = sent_ns <= arrival_ns < began_ns - QUIET_S * 0.5e9
    tell("its time is the kernel's, not that of reading", stamped, f"{(began_ns - arrival_ns) / 1e6:.1f} ms before it")
    port.send(0x123456, b"\3", extended=True)
    heard = FRAME.unpack(peer.recv(16))
    tell(
        "a frame to it", heard == (0x80123456, 1, b"\3".ljust(8, b"\0")), f"0x{heard[0]:x} {heard[2][: heard[1]].hex()}"
    )
    got.clear()
    neighbour.send(FRAME.pack(0x22, 1, b"\4"))
    time.sleep(QUIET_S)
    port.poll()
    identifiers = [each.arbitration_id for each, _ in got]
    tell(
        "another program's frame is heard, one's own is not", identifiers == [0x22], str([hex(i) for i in identifiers])
    )
    backend.close()


def _errors(tell: Tell) -> None:
    """The controller's own: its buffer overflows while the thread of its interrupt may not run.

    The emulated bus knows no others; bus-off is said by an error frame of another program's, over a virtual link.
    """
    backend, port = _opened()
    _let_run(HOST, 1)
    _let_run(PEER, FASTEST)
    os.sched_setaffinity(0, {0})
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FASTEST - 9))
    peer, end_s = _raw(PEER), time.monotonic() + 0.4
    while time.monotonic() < end_s:
        try:
            peer.send(FRAME.pack(0x21, 8, b"overflow"))
        except OSError:
            time.sleep(0)
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    time.sleep(4 * QUIET_S)
    port.poll()
    tell("an overrun of the controller", "receive overrun" in port.troubles(), str(dict(port.troubles())))
    backend.close()
    backend = HardwareBackend()
    port = backend.open_can(CanBusSettings("arm", "socketcan", "vcan0", 1_000_000))
    for frame in (
        CanErrorFrame(ErrorClass.CONTROLLER, ControllerError.TX_PASSIVE),
        CanErrorFrame(ErrorClass.BUS_OFF),
    ):
        identifier, data = frame.encode()
        _raw("vcan0").send(FRAME.pack(socket.CAN_ERR_FLAG | identifier, 8, data))
    time.sleep(QUIET_S)
    said = _refusal(port.poll)
    counted = port.troubles()
    tell("error frames: error-passive, bus-off", "bus-off" in said and "error-passive" in counted, f"{said} {counted}")
    backend.close()


def _let_run(channel: str, priority: int) -> None:
    """The thread of a controller's interrupt, beside the processor's first core."""
    for thread in Path("/proc").glob("[0-9]*/comm"):
        if re.fullmatch(rf"irq/\d+-{channel}", thread.read_text().strip()):
            number = int(thread.parent.name)
            os.sched_setscheduler(number, os.SCHED_FIFO, os.sched_param(priority))


def _full_queue(tell: Tell) -> None:
    """The emulated bus takes every frame at once; one that is busy takes few, which a token bucket does here."""
    backend, port = _opened()
    subprocess.run(
        ["tc", "qdisc", "replace", "dev", HOST, "root", "tbf", "rate", "8kbit", "burst", "32", "limit", "160"],
        check=True,
    )

    def fill() -> None:
        for _ in range(200):
            port.send(0x21, bytes(8))

    said = _refusal(fill)
    tell("a full transmit queue", "the kernel's transmit queue is full" in said, said)
    apply(said)
    subprocess.run(["tc", "qdisc", "del", "dev", HOST, "root"], check=True)
    tell("the next frame, once it is empty", (said := _refusal(lambda: port.send(0x21, b""))) == NOTHING, said)
    backend.close()


def _down_and_up(tell: Tell) -> None:
    backend, port = _opened()
    ip(f"link set {HOST} down")
    said, sent = _refusal(port.poll), _refusal(lambda: port.send(0x21, b""))
    tell("taken down while it is read", "lost (the link is down)" in said, said)
    tell("taken down while it is written to", "cannot send (the link is down)" in sent, sent)
    apply(sent)
    peer = _raw(PEER)
    port.send(0x21, b"\5")
    tell("up again", (heard := FRAME.unpack(peer.recv(16)))[:2] == (0x21, 1), f"0x{heard[0]:x}")
    backend.close()


def _device(checkout: Path, tell: Tell) -> None:
    """A device on one controller, ``rig check`` on the other."""
    ip(f"link set {HOST} txqueuelen 10")
    with _heartbeats(node=3):
        _, said = bench_here("rig", "check", rig_on(checkout, "mit", HOST, "real"), "--backend", "hardware")
    for what, words in (
        ("rig check: a device at another address", "nobody is heard at node = 2, but an ODrive at node = 3"),
        ("rig check: a short queue", "the kernel queues 10 frames at most"),
    ):
        line = next((line for line in said.splitlines() if words in line), said)
        tell(what, words in line, line)


@contextmanager
def _heartbeats(node: int) -> Iterator[None]:
    """An ODrive's, ten a second, sent by the kernel itself."""
    identifier = arbitration_id(node, MessageId.HEARTBEAT)
    with can.Bus(interface="socketcan", channel=PEER, ignore_config=True) as bus:
        data = Heartbeat(error_bits=0, axis_state=AxisState.IDLE).encode()
        task = bus.send_periodic(can.Message(arbitration_id=identifier, is_extended_id=False, data=data), 0.1)
        yield
        task.stop()
