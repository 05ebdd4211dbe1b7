"""A device's parameters, by SDO: python-canopen's client, waiting in the bench's time, and its errors as sentences."""

from collections.abc import Callable
from typing import TypeVar

from canopen import RemoteNode
from canopen.objectdictionary import ObjectDictionary, ObjectDictionaryError
from canopen.sdo.base import SdoVariable
from canopen.sdo.client import SdoClient
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from norton_drivers.codecs.canopen import ABORT_NO_OBJECT, ABORT_NO_SUBINDEX
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import Link
from norton_drivers.waiting import wait_until

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
