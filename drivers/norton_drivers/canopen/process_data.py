"""Sets up what a device sends and receives by itself (PDOs): identifier, content, and what triggers it.

A PDO is switched off by bit 31 of its COB-ID while it is changed, and its mapping emptied before it is written, in this
order: devices refuse any other. Source: CiA 301, objects 1400h, 1600h, 1800h and 1A00h.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from norton_drivers.canopen.parameters import Parameters
from norton_drivers.codecs import canopen as protocol
from norton_drivers.codecs.cia402 import PdoEntry

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
