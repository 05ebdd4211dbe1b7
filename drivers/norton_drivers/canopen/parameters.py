"""A CANopen device's parameters, by SDO, and what it sends and receives by itself (PDOs), which is set up through them.

python-canopen's client waits here in the bench's time, and its errors become sentences. A PDO is switched off by bit 31
of its COB-ID while it is changed, and its mapping emptied before it is written, in this order: devices refuse any
other. Source: CiA 301, objects 1400h, 1600h, 1800h and 1A00h.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from canopen import RemoteNode
from canopen.objectdictionary import ObjectDictionary, ObjectDictionaryError
from canopen.sdo.base import SdoVariable
from canopen.sdo.client import SdoClient
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from norton_drivers.codecs import canopen as protocol
from norton_drivers.codecs.canopen import ABORT_NO_OBJECT, ABORT_NO_SUBINDEX
from norton_drivers.codecs.cia402 import PdoEntry
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import Link, wait_until

ANSWER_WITHIN_S = 0.5
_NOT_THERE = (ABORT_NO_OBJECT, ABORT_NO_SUBINDEX)

Result = TypeVar("Result")


class PolledClient(SdoClient):
    """Polls the link until an answer has come. ``unasked`` counts answers to no question, as of a second device."""

    def __init__(self, request_id: int, answer_id: int, dictionary: ObjectDictionary, link: Link) -> None:
        super().__init__(request_id, answer_id, dictionary)
        self.unasked = 0
        self.asking = False
        self._link = link

    def on_response(self, can_id: int, data: bytearray, timestamp: float) -> None:
        if not self.asking:
            self.unasked += 1
            return
        self.asking = False
        super().on_response(can_id, data, timestamp)

    def request_response(self, sdo_request: bytearray) -> bytes:
        """Ask again once: a frame may be lost on its way through an adapter."""
        try:
            return self._answer_to(sdo_request)
        except SdoCommunicationError:
            self.unasked -= 1  # the first answer may still come
            return self._answer_to(sdo_request)

    def _answer_to(self, request: bytearray) -> bytes:
        self.asking = True
        try:
            return bytes(super().request_response(request))
        finally:
            self.asking = False

    def read_response(self) -> bytes:
        if not wait_until(lambda: not self.responses.empty(), self._link, ANSWER_WITHIN_S):
            raise SdoCommunicationError("no answer")
        return bytes(super().read_response())


class PolledNode(RemoteNode):
    """python-canopen's remote node with a client that polls."""

    def __init__(self, node: int, dictionary: ObjectDictionary, link: Link) -> None:
        self._link = link
        super().__init__(node, dictionary)

    def add_sdo(self, rx_cobid: int, tx_cobid: int) -> PolledClient:
        client = PolledClient(rx_cobid, tx_cobid, self.object_dictionary, self._link)
        self.sdo_channels.append(client)
        return client


class Parameters:
    """Reads and writes parameters as the object dictionary types them; ``place`` begins every complaint.

    All methods raise ConnectionFailedError, DeviceTimeoutError where the device does not answer, and DeviceError where
    it refuses.
    """

    def __init__(self, remote: PolledNode, place: str) -> None:
        self._sdo = remote.sdo
        self._place = place

    def number(self, index: int, subindex: int = 0) -> int:
        """A whole number."""
        return int(self._of(index, subindex, lambda variable: variable.raw))

    def find_number(self, index: int, subindex: int = 0) -> int | None:
        """A whole number; None where the device, or its EDS file, has no such parameter."""
        try:
            return self.number(index, subindex)
        except ParameterMissingError:
            return None

    def find_text(self, index: int) -> str:
        """A text; empty where the device has none."""
        try:
            return str(self._of(index, 0, lambda variable: variable.raw)).strip("\0 ")
        except ParameterMissingError:
            return ""

    def write(self, index: int, subindex: int, value: int) -> None:
        def put(variable: SdoVariable) -> None:
            variable.raw = value

        self._of(index, subindex, put, f" = {value} (0x{value:X})")

    def write_if_there(self, index: int, subindex: int, value: int) -> bool:
        """False where the device, or its EDS file, has no such parameter."""
        try:
            self.write(index, subindex, value)
        except ParameterMissingError:
            return False
        return True

    def _of(self, index: int, subindex: int, action: Callable[[SdoVariable], Result], value: str = "") -> Result:
        name = f"{index:04X}h:{subindex}{value}"
        variable = self._sdo.get_variable(index, subindex)
        if variable is None:
            raise ParameterMissingError(f"{self._place}: parameter {name} is not in its EDS file")
        try:
            return action(variable)
        except SdoAbortedError as error:
            kind = ParameterMissingError if error.code in _NOT_THERE else DeviceError
            raise kind(f"{self._place}: refuses parameter {name}: {error}") from error
        except SdoCommunicationError as error:
            raise _complaint(self._place, name, error) from error
        except (ObjectDictionaryError, ValueError, TypeError) as error:
            raise DeviceError(f"{self._place}: parameter {name} is not what its EDS file says: {error}") from error


class ParameterMissingError(DeviceError):
    """The device has no such parameter."""


def _complaint(place: str, name: str, error: SdoCommunicationError) -> DeviceError:
    if "instead" in str(error):
        return DeviceError(f"{place}: answers another question ({error}); are there two devices with this node id?")
    return DeviceTimeoutError(
        f"{place}: does not answer for parameter {name} ({error}); is it powered and on this bus, and are its node id "
        "and bitrate these?"
    )


_RECEIVE_COMMUNICATION, _RECEIVE_MAPPING = 0x1400, 0x1600
_TRANSMIT_COMMUNICATION, _TRANSMIT_MAPPING = 0x1800, 0x1A00
_COB_ID, _TYPE, _INHIBIT_TIME, _EVENT_TIMER = 1, 2, 3, 5


@dataclass(frozen=True)
class Pdo:
    """One PDO as it shall be; ``number`` is 1 to 4.

    ``transmission`` is 1 to 240 for every so many SYNCs, or 255 for at once; then ``timer_ms`` repeats a sent one.
    """

    number: int
    identifier: int
    entries: Sequence[PdoEntry]
    transmission: int
    timer_ms: int = 0


def set_up_received(parameters: Parameters, pdo: Pdo) -> None:
    """What the device receives. Raises DeviceError."""
    _set_up(parameters, pdo, _RECEIVE_COMMUNICATION, _RECEIVE_MAPPING)


def set_up_sent(parameters: Parameters, pdo: Pdo) -> None:
    """What the device sends. Raises DeviceError."""
    _set_up(parameters, pdo, _TRANSMIT_COMMUNICATION, _TRANSMIT_MAPPING)


def switch_off_sent(parameters: Parameters, number: int) -> None:
    """Let the device not send this PDO, where it has it. Raises DeviceError."""
    communication = _TRANSMIT_COMMUNICATION + number - 1
    cob_id = parameters.find_number(communication, _COB_ID)
    if cob_id is not None and not cob_id & protocol.PDO_NOT_VALID:
        parameters.write(communication, _COB_ID, cob_id | protocol.PDO_NOT_VALID)


def trigger_sent(parameters: Parameters, number: int, transmission: int, timer_ms: int = 0) -> None:
    """Change when a PDO is sent, and leave its content as it is. Raises DeviceError."""
    communication = _TRANSMIT_COMMUNICATION + number - 1
    cob_id = parameters.number(communication, _COB_ID)
    parameters.write(communication, _COB_ID, cob_id | protocol.PDO_NOT_VALID)
    _write_trigger(parameters, communication, transmission, timer_ms)
    parameters.write(communication, _COB_ID, cob_id & ~protocol.PDO_NOT_VALID)


def _set_up(parameters: Parameters, pdo: Pdo, first_communication: int, first_mapping: int) -> None:
    communication, mapping = first_communication + pdo.number - 1, first_mapping + pdo.number - 1
    # Whether a remote frame may ask for it is the device's own matter: some refuse to have that bit changed.
    cob_id = pdo.identifier | parameters.number(communication, _COB_ID) & protocol.PDO_NO_REMOTE
    parameters.write(communication, _COB_ID, cob_id | protocol.PDO_NOT_VALID)
    _write_trigger(parameters, communication, pdo.transmission, pdo.timer_ms)
    parameters.write(mapping, 0, 0)
    for position, entry in enumerate(pdo.entries, start=1):
        parameters.write(mapping, position, protocol.mapping_word(entry.index, 0, entry.bits))
    parameters.write(mapping, 0, len(pdo.entries))
    parameters.write(communication, _COB_ID, cob_id)


def _write_trigger(parameters: Parameters, communication: int, transmission: int, timer_ms: int) -> None:
    parameters.write(communication, _TYPE, transmission)
    if timer_ms:
        parameters.write_if_there(communication, _INHIBIT_TIME, 0)  # else it may hold the timer's frames back
        parameters.write(communication, _EVENT_TIMER, timer_ms)
