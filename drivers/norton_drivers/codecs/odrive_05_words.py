"""What the error bits of ODrive firmware 0.5 mean, part by part, in words that help at the bench.

Source: ODrive firmware 0.5.6, ``Firmware/odrive-interface.yaml`` ("ODrive.Axis.error", "ODrive.Motor.error",
"ODrive.Encoder.error", "ODrive.Controller.error", "ODrive.SensorlessEstimator.error").
"""

from collections.abc import Mapping
from typing import Final

AXIS: Final = {
    0: "the state asked for is not possible: is the axis calibrated?",
    6: "the motor failed",
    7: "the sensorless estimator failed",
    8: "the encoder failed",
    9: "the controller failed",
    11: "watchdog expired: no command arrived in time",
    12: "the lower end stop is pressed",
    13: "the upper end stop is pressed",
    14: "emergency stop requested",
    17: "homing without an end stop",
    18: "a temperature is too high",
    19: "position unknown",
}
MOTOR: Final = {
    0: "phase resistance out of range",
    1: "phase inductance out of range",
    3: "gate driver fault",
    4: "control deadline missed",
    7: "modulation magnitude: is the bus voltage too low for this current?",
    10: "current sense saturated",
    12: "motor current limit violated",
    16: "modulation is not a number",
    17: "motor too hot",
    18: "inverter too hot",
    19: "timer update missed",
    20: "current measurement unavailable",
    21: "the controller failed",
    22: "bus current out of range",
    23: "brake resistor disarmed",
    24: "system-level fault: bus voltage or brake resistor",
    25: "timing error: the drive's processor is overloaded",
    26: "phase estimate unknown: check the encoder",
    27: "phase velocity unknown: check the encoder",
    28: "torque unknown",
    29: "current command unknown",
    30: "current measurement unknown",
    31: "bus voltage unknown",
    32: "voltage command unknown",
    33: "gains unknown",
    34: "controller initialising",
    35: "phases unbalanced",
}
ENCODER: Final = {
    0: "encoder gain unstable",
    1: "pole pairs and encoder counts disagree",
    2: "no response from the encoder",
    3: "encoder mode not supported",
    4: "illegal Hall state",
    5: "encoder index not found yet",
    6: "absolute encoder: timeout",
    7: "absolute encoder: communication failed",
    8: "absolute encoder: not ready",
    9: "Hall sensors not calibrated yet",
}
CONTROLLER: Final = {
    0: "the drive's velocity limit was violated",
    1: "input mode invalid",
    2: "controller gain unstable",
    3: "mirrored axis invalid",
    4: "load encoder invalid",
    5: "no valid position or velocity estimate: check the encoder",
    6: "circular range invalid",
    7: "spin-out: electrical and mechanical power disagree",
}
SENSORLESS: Final = {
    0: "sensorless estimator: gain unstable",
    1: "sensorless estimator: current measurement unknown",
}


def describe(bits: int, words: Mapping[int, str], part: str) -> tuple[str, ...]:
    """Error bits of ``part`` in words, lowest bit first; empty where there are none."""
    known = tuple(text for bit, text in words.items() if bits >> bit & 1)
    unknown = bits & ~sum(1 << bit for bit in words)
    return (*known, f"unknown {part} error bits 0x{unknown:X}") if unknown else known
