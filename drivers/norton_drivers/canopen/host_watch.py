"""Lets a drive watch the host: it misses our heartbeat (1016h), and then does what 6007h says.

Off by default in every drive, and in force only once our first heartbeat has come. Sources: CiA 301, objects 1016h and
1029h; CiA 402-2, object 6007h. What 6007h leaves to the drive is not believed but tried before an experiment.
"""

from norton_drivers.canopen.node import CONSUMER_HEARTBEAT, Node
from norton_drivers.codecs.canopen import consumer_heartbeat
from norton_drivers.codecs.cia402 import Object
from norton_drivers.errors import DeviceError

_FIRST = 1
_NO_ACTION, _FAULT = 0, 1


def arm(node: Node, master: int, timeout_s: float) -> None:
    """From our next heartbeat on, silence of ``timeout_s`` is a fault. Raises DeviceError where that is not taken."""
    parameters = node.parameters
    if parameters.find_number(Object.ABORT_CONNECTION_OPTION) == _NO_ACTION:
        parameters.write(Object.ABORT_CONNECTION_OPTION, 0, _FAULT)
    wanted = consumer_heartbeat(master, round(timeout_s * 1e3))
    if not parameters.write_if_there(CONSUMER_HEARTBEAT, _FIRST, wanted):
        raise DeviceError(
            f'{node.place}: cannot watch the host\'s heartbeat (no parameter 1016h); give it watchdog = "0 s" only if '
            "it has another watchdog, and set that one in the drive"
        )
    taken = parameters.number(CONSUMER_HEARTBEAT, _FIRST)
    if taken != wanted:
        raise DeviceError(
            f"{node.place}: its watchdog does not take {timeout_s:g} s (1016h says 0x{taken:08X} after 0x{wanted:08X} "
            "was written); check in its manual which times it allows"
        )


def disarm(node: Node) -> None:
    """Watch no more. Raises DeviceError."""
    node.parameters.write_if_there(CONSUMER_HEARTBEAT, _FIRST, 0)


def disarm_without_waiting(node: Node) -> None:
    """Watch no more. Raises ConnectionFailedError."""
    node.put(CONSUMER_HEARTBEAT, _FIRST, bytes(4))
