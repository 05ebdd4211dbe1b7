"""All codecs, by name."""

from collections.abc import Callable, Iterator, Mapping
from random import Random
from typing import Protocol

from . import (
    adapters,
    canopen_objects,
    drivers_on_can,
    drives_on_serial,
    motors_on_can,
    sensors_on_serial,
    servos_on_serial,
)
from .outcome import Outcome
from .packets import PacketCodec


class Codec(Protocol):
    def outcomes(self, count: int, random: Random) -> Iterator[Outcome]: ...


CODECS: Mapping[str, Callable[[], Codec]] = {
    "odrive-0.6": drivers_on_can.odrive_06,
    "odrive-0.5": drivers_on_can.odrive_05,
    "canopen": canopen_objects.services,
    "cia402": canopen_objects.process_data,
    "vesc": drivers_on_can.vesc_status,
    "vesc-packets": PacketCodec,
    "vesc-uart": drives_on_serial.vesc_values,
    "odrive-ascii": drives_on_serial.odrive_feedback,
    "simplefoc": drives_on_serial.simplefoc_states,
    "mit": motors_on_can.mit_replies,
    "damiao": motors_on_can.damiao_feedback,
    "robstride": motors_on_can.robstride_feedback,
    "cubemars": motors_on_can.cubemars_uploads,
    "moteus": drivers_on_can.moteus_replies,
    "dbc": drivers_on_can.dbc,
    "bota": sensors_on_serial.bota_frames,
    "dyn200-push": sensors_on_serial.pushed_frames,
    "dyn200-polled": sensors_on_serial.modbus_answers,
    "ascii": sensors_on_serial.bare_lines,
    "ascii-padded": sensors_on_serial.padded_lines,
    "mantracourt": sensors_on_serial.mantracourt_answers,
    "dynamixel": servos_on_serial.dynamixel_answers,
    "dynamixel-fast": servos_on_serial.dynamixel_together,
    "feetech": servos_on_serial.feetech_answers,
    "slcan": adapters.slcan_lines,
    "fdcanusb": adapters.fdcanusb_lines,
}
