"""What an ODrive looks like on a bus that it shares with others; firmware 0.5 and 0.6 alike."""

from collections.abc import Mapping
from typing import Any

import can

from norton_drivers.codecs import odrive as protocol
from norton_drivers.codecs.odrive import Command
from norton_drivers.recognition import Recognised

_AXIS_STATE_MAX = 16  # 13 in firmware 0.6.10; later ones may know more
_DEVICE = "an ODrive"
_SAYS: dict[int, str] = {
    Command.HEARTBEAT: "heartbeat",
    Command.ENCODER_ESTIMATES: "encoder estimates",
    Command.IQ: "current",
    Command.TEMPERATURE: "temperature",
    Command.BUS_VOLTAGE_CURRENT: "supply",
    Command.TORQUES: "torques",
}
_COMMANDS = frozenset(
    (
        Command.ESTOP,
        Command.SET_AXIS_STATE,
        Command.SET_CONTROLLER_MODE,
        Command.SET_INPUT_TORQUE,
        Command.SET_LIMITS,
        Command.CLEAR_ERRORS,
    )
)


def recognise(message: can.Message, _options: Mapping[str, Any]) -> Recognised | None:
    """A heartbeat is sure; all else only belongs to a node that sends one, whose 32 identifiers are its own."""
    if message.is_extended_id or message.is_remote_frame:
        return None
    node, number = protocol.split_id(message.arbitration_id)
    heartbeat = number == Command.HEARTBEAT and message.dlc == 8 and 1 <= message.data[4] <= _AXIS_STATE_MAX
    says = _SAYS.get(number, f"message 0x{number:02X}")
    return Recognised(_DEVICE, says, {"node": node}, sure=heartbeat, from_host=number in _COMMANDS)
