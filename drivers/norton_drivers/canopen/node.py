"""One CANopen device as the master sees it: parameters, network management, heartbeats and emergencies."""

from collections.abc import Callable, Collection, Iterator, Mapping
from configparser import Error as EdsSyntaxError
from pathlib import Path
from typing import Any, Final

import can
from canopen.objectdictionary import ObjectDictionary, ObjectDictionaryError, import_od

from norton_drivers.canopen.master import FrameHandler, Listener, Master
from norton_drivers.canopen.parameters import ANSWER_WITHIN_S, Parameters, PolledNode
from norton_drivers.codecs import canopen as protocol
from norton_drivers.codecs.canopen import (
    NODE_MAX,
    NmtCommand,
    NmtState,
    describe_error,
    describe_nmt_state,
    sdo_answer_id,
    sdo_request_id,
)
from norton_drivers.errors import DeviceError, DeviceTimeoutError, WiringError
from norton_drivers.link import Link, wait_until
from norton_drivers.readings import DeviceIdentity, RawFrame
from norton_drivers.registry import Question, Recognised, nobodys

_DEVICE = "a CANopen device"
_HEARTBEAT, _ANSWER, _REQUEST, _EMERGENCY = 0x700, 0x580, 0x600, 0x080
_SENT = {0x180: "PDO 1", 0x280: "PDO 2", 0x380: "PDO 3", 0x480: "PDO 4", _EMERGENCY: "emergency"}
_TOLD = (0x200, 0x300, 0x400, 0x500)
_READ_DEVICE_TYPE = bytes.fromhex("4000100000000000")  # SDO: upload 1000h


def recognise(message: can.Message, _options: Mapping[str, Any]) -> Recognised | None:
    """A heartbeat is sure, and so is the answer to the device's type; all else only beside one of them."""
    function, node = message.arbitration_id & ~NODE_MAX, message.arbitration_id & NODE_MAX
    if message.is_extended_id or message.is_remote_frame or not node:
        return None
    options = {"node": node}
    if function == _HEARTBEAT and message.dlc == 1:
        return Recognised(_DEVICE, "heartbeat", options, sure=message.data[0] in set(NmtState))
    if function == _ANSWER and message.dlc == 8:
        return Recognised(_DEVICE, "answers", options, sure=message.data[1:4] == _READ_DEVICE_TYPE[1:4])
    if function in _SENT:
        return Recognised(_DEVICE, _SENT[function], options, sure=False)
    if function == _REQUEST or function in _TOLD:
        return Recognised(_DEVICE, "command", options, sure=False, from_host=True)
    return None


def answers(question: RawFrame, frame: RawFrame) -> bool:
    """An SDO's answer comes from the node that was asked."""
    node = question.arbitration_id - _REQUEST
    return (
        0 < node <= NODE_MAX
        and len(question.data) == 8
        and not (question.extended or frame.extended)
        and frame.arbitration_id == sdo_answer_id(node)
    )


def probes(_options: Mapping[str, Any], heard: Collection[int]) -> Iterator[Question]:
    """Every node is asked what type of device it is."""
    for node in range(1, NODE_MAX + 1):
        if nobodys(sdo_request_id(node), heard):
            yield Question(sdo_request_id(node), _READ_DEVICE_TYPE)


SHIPPED = Path(__file__).parent / "eds"
HEARTBEATS_MISSED = 3
STARTS_WITHIN_S = 2.0
# The first ones tell what happened; a device that babbles has no end of them.
_EMERGENCIES_TOLD = 8
# A second device with the same node id answers within this time of the first.
_ECHO_NS = 5_000_000

DEVICE_TYPE: Final = 0x1000
DEVICE_NAME: Final = 0x1008
HARDWARE_VERSION: Final = 0x1009
SOFTWARE_VERSION: Final = 0x100A
CONSUMER_HEARTBEAT: Final = 0x1016
PRODUCER_HEARTBEAT: Final = 0x1017
IDENTITY: Final = 0x1018

Then = Callable[[bytes], None]


class Node:
    """``place`` names the device in complaints; ``malformed`` counts its frames that could not be decoded.

    ``restarted`` is set by a boot-up message that nobody asked for: what the device was told before is gone.
    ``emergencies`` are the codes of the errors that are active, in the order of their appearance. ``on_change`` is
    called where any of these, or the heartbeat, has changed. Raises WiringError where its node id is taken.
    """

    def __init__(self, role: str, node: int, dictionary: ObjectDictionary, master: Master, link: Link) -> None:
        if node == master.node:
            raise WiringError(f"[{role}] node = {node} is our own (master_node); give one of them another")
        self.role = role
        self.id = node
        self.place = f"[{role}] CANopen node {node} on {master.port.name}"
        self.malformed = 0
        self.heartbeat_ns: int | None = None
        self.state: NmtState | None = None
        self.restarted = False
        self.emergencies: list[int] = []
        self.on_change: Callable[[], None] = _nobody
        self._master = master
        self._link = link
        self._dictionary = dictionary
        self._heartbeat_s = 0.0
        self._starts = 0
        self._start_expected = False
        self._loose: dict[tuple[int, int], tuple[int, Then]] = {}
        self.listen(protocol.heartbeat_id(node), self._on_heartbeat)
        self.listen(protocol.emergency_id(node), self._on_emergency)
        self.listen(protocol.sdo_answer_id(node), self._on_answer)
        self._remote = PolledNode(node, dictionary, link)
        master.network[node] = self._remote
        self.parameters = Parameters(self._remote, self.place)

    def listen(self, identifier: int, handle: FrameHandler) -> None:
        """Hand this device's frames of one identifier to ``handle``. Raises WiringError where they are another's."""
        self._master.listen(identifier, Listener(self.role, handle, self._count_malformed))

    # ---- Network management --------------------------------------------------------------------------------------

    def order(self, command: NmtCommand) -> None:
        """Raises ConnectionFailedError."""
        self._remote.nmt.send_command(command)

    def begin(self, heartbeat_s: float) -> None:
        """Ready for being set up: pre-operational, with a heartbeat, and all that was before forgotten."""
        self.state = None
        self.restarted = False
        self.emergencies.clear()
        self.order(NmtCommand.PRE_OPERATIONAL)
        period_ms = round(heartbeat_s * 1e3)
        if self.parameters.number(PRODUCER_HEARTBEAT) != period_ms:
            self.parameters.write(PRODUCER_HEARTBEAT, 0, period_ms)
        self._heartbeat_s = heartbeat_s

    def start(self) -> None:
        """Begin the exchange of process data; return when the device says so. Raises DeviceTimeoutError."""
        self.order(NmtCommand.START)
        within_s = STARTS_WITHIN_S + HEARTBEATS_MISSED * self._heartbeat_s
        if not wait_until(lambda: self.state is NmtState.OPERATIONAL, self._link, within_s):
            state = "sends no heartbeat" if self.state is None else f"stays {describe_nmt_state(self.state)}"
            raise DeviceTimeoutError(f"{self.place}: told to start, but {state} ({within_s:g} s waited)")

    def reset_communication(self) -> None:
        """Back to the communication settings of its power-on. Raises DeviceTimeoutError where it does not return."""
        starts = self._starts
        self._start_expected = True
        try:
            self.order(NmtCommand.RESET_COMMUNICATION)
            if not wait_until(lambda: self._starts > starts, self._link, STARTS_WITHIN_S):
                raise DeviceTimeoutError(f"{self.place}: does not come back after a reset of its communication")
        finally:
            self._start_expected = False

    @property
    def operational(self) -> bool:
        return self.state is NmtState.OPERATIONAL

    @property
    def heartbeat_timeout_ns(self) -> int:
        """Silence longer than this means that the device is lost."""
        return round(HEARTBEATS_MISSED * self._heartbeat_s * 1e9)

    def troubles(self) -> tuple[str, ...]:
        """What is wrong with the device, in words."""
        troubles = [describe_error(code) for code in self.emergencies]
        if self.restarted:
            troubles.append("it restarted by itself, and has forgotten its settings")
        return tuple(troubles)

    # ---- Who it is -----------------------------------------------------------------------------------------------

    def identity(self, driver: str) -> DeviceIdentity:
        """By its own word. Raises DeviceError where its EDS file is of another product, or two devices answer."""
        client = self._remote.sdo
        unasked = client.unasked
        vendor = self.parameters.find_number(IDENTITY, 1)
        product = self.parameters.find_number(IDENTITY, 2)
        texts = [self.parameters.find_text(index) for index in (DEVICE_NAME, HARDWARE_VERSION, SOFTWARE_VERSION)]
        self._link.wait(_ECHO_NS)
        if client.unasked > unasked:
            raise DeviceError(f"{self.place}: two devices answer to this node id; give each its own")
        self._check_product(vendor, product)
        return DeviceIdentity(
            driver=driver,
            address=f"{self._master.port.name} node {self.id}",
            hardware=" ".join(filter(None, texts[:2])) or f"vendor 0x{vendor or 0:X} product 0x{product or 0:X}",
            firmware=texts[2],
        )

    def _check_product(self, vendor: int | None, product: int | None) -> None:
        message = self._dictionary.device_information
        for name, number, expected in (
            ("vendor", vendor, message.vendor_number),
            ("product", product, message.product_number),
        ):
            if expected and number is not None and number != expected:
                raise DeviceError(
                    f"{self.place}: its {name} number is 0x{number:X}, but that of its EDS file is 0x{expected:X}; is "
                    "this the device meant, and its EDS file?"
                )

    # ---- Parameters that nobody waits for ------------------------------------------------------------------------

    def ask(self, index: int, subindex: int, then: Then) -> None:
        """Ask for a short parameter; ``then`` is called if the answer comes. Raises ConnectionFailedError.

        Nothing is asked while another question is under way: many devices lose it, or both.
        """
        if self._remote.sdo.asking or self._is_awaited(index, subindex):
            return
        self._expect(index, subindex, then)
        self._master.port.send(protocol.sdo_request_id(self.id), protocol.SdoRead(index, subindex).encode())

    def put(self, index: int, subindex: int, value: bytes) -> None:
        """Set a short parameter without waiting. Raises ConnectionFailedError."""
        self._expect(index, subindex, _nothing)
        self._master.port.send(protocol.sdo_request_id(self.id), protocol.SdoWrite(index, subindex, value).encode())

    def _is_awaited(self, index: int, subindex: int) -> bool:
        until_ns, _ = self._loose.get((index, subindex), (0, _nothing))
        return self._link.clock.now_ns() < until_ns

    def _expect(self, index: int, subindex: int, then: Then) -> None:
        until_ns = self._link.clock.now_ns() + round(ANSWER_WITHIN_S * 1e9)
        self._loose[index, subindex] = (until_ns, then)

    # ---- What arrives --------------------------------------------------------------------------------------------

    def _on_answer(self, data: bytearray, arrival_ns: int) -> None:
        answer = protocol.sdo_answer_of(data)
        if not isinstance(answer, protocol.SdoSegment):
            until_ns, then = self._loose.pop((answer.index, answer.subindex), (0, _nothing))
            if arrival_ns <= until_ns:
                if isinstance(answer, protocol.SdoValue):
                    then(answer.value)
                return
        self._master.network.notify(protocol.sdo_answer_id(self.id), data, arrival_ns * 1e-9)

    def _on_heartbeat(self, data: bytearray, arrival_ns: int) -> None:
        self.state = protocol.heartbeat_of(data)
        self.heartbeat_ns = arrival_ns
        if self.state is NmtState.BOOT_UP:
            self._starts += 1
            self.restarted = self.restarted or not self._start_expected
        self.on_change()

    def _on_emergency(self, data: bytearray, arrival_ns: int) -> None:
        code = protocol.Emergency.decode(data).code
        if code & 0xFF00 == 0:
            self.emergencies.clear()
        elif code not in self.emergencies and len(self.emergencies) < _EMERGENCIES_TOLD:
            self.emergencies.append(code)
        self.on_change()

    def _count_malformed(self) -> None:
        self.malformed += 1


def load_dictionary(name: str, node: int, role: str) -> ObjectDictionary:
    """The object dictionary of an EDS file, or of a shipped one. Raises WiringError."""
    path = _file(name, role)
    try:
        return import_od(str(path), node)
    except (OSError, UnicodeDecodeError, EdsSyntaxError, ObjectDictionaryError, ValueError, KeyError) as error:
        raise WiringError(f'[{role}] eds = "{name}" is not an EDS file that can be read: {error}') from error


def _file(name: str, role: str) -> Path:
    for path in (Path(name).expanduser(), SHIPPED / f"{name}.eds"):
        if path.is_file():
            return path
    shipped = ", ".join(sorted(path.stem for path in SHIPPED.glob("*.eds")))
    raise WiringError(f'[{role}] eds = "{name}" is neither a file nor one of the shipped: {shipped}')


def _nobody() -> None:
    """Nobody is told."""


def _nothing(_value: bytes) -> None:
    """Nothing is done with the answer."""
