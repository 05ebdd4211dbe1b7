"""What a CANopen device's numbers mean, in words that help at the bench.

Sources: CiA 301 (emergency classes, communication errors), CiA 402-2 (error codes of drives) as the public header
cia402-error-codes.h of marel-keytech/openCANopen lists them.
"""

from norton_drivers.codecs.canopen import NmtState

_ERRORS = {
    0x2110: "short circuit or earth leakage at the supply",
    0x2130: "short circuit at the supply",
    0x2213: "over-current in a ramp",
    0x2214: "over-current",
    0x2220: "continuous over-current inside the drive",
    0x2230: "short circuit or earth leakage inside the drive",
    0x2240: "earth leakage inside the drive",
    0x2250: "short circuit inside the drive",
    0x2310: "continuous over-current in the motor",
    0x2320: "short circuit or earth leakage at the motor",
    0x2330: "earth leakage at the motor",
    0x2340: "short circuit at the motor",
    0x2350: "load too high for too long (I2t)",
    0x3110: "mains voltage too high",
    0x3120: "mains voltage too low",
    0x3130: "a mains phase is missing",
    0x3210: "bus voltage too high: check the brake resistor",
    0x3220: "bus voltage too low: is the supply on?",
    0x3310: "output voltage too high",
    0x3320: "armature circuit faulty",
    0x4110: "surroundings too hot",
    0x4120: "surroundings too cold",
    0x4210: "device too hot",
    0x4220: "device too cold",
    0x4310: "drive too hot",
    0x4320: "drive too cold",
    0x5210: "measurement circuit faulty",
    0x5430: "input stage faulty: is safe torque off active?",
    0x5530: "parameter memory faulty",
    0x6010: "the drive's processor restarted (its own watchdog)",
    0x6100: "internal software error",
    0x6310: "parameters lost",
    0x6320: "a parameter is wrong",
    0x7110: "brake chopper faulty",
    0x7121: "motor blocked",
    0x7122: "motor or its commutation faulty",
    0x7300: "sensor faulty",
    0x7305: "encoder faulty",
    0x7310: "speed too high or its sensor faulty",
    0x7320: "position sensor faulty",
    0x7380: "position sensor faulty",
    0x8110: "CAN frames lost: the device is overrun",
    0x8120: "CAN controller error passive: check termination and bitrate",
    0x8130: "host's heartbeat lost",
    0x8140: "recovered from bus-off: check termination and bitrate",
    0x8150: "another device has the same identifier",
    0x8210: "PDO too short for its mapping",
    0x8220: "PDO longer than its mapping",
    0x8240: "SYNC of an unexpected length",
    0x8250: "commands came too late (RPDO timeout)",
    0x8311: "torque limit exceeded",
    0x8400: "speed error too large",
    0x8500: "position error too large",
    0x8611: "following error",
    0x9000: "external error",
}
# By ever coarser masks, for codes that have no words of their own.
_CLASSES = (
    (0xFF00, 0x8100, "communication error"),
    (0xF000, 0x1000, "generic error"),
    (0xF000, 0x2000, "current error"),
    (0xF000, 0x3000, "voltage error"),
    (0xF000, 0x4000, "temperature error"),
    (0xF000, 0x5000, "hardware error"),
    (0xF000, 0x6000, "software error"),
    (0xF000, 0x7000, "error of an additional module"),
    (0xF000, 0x8000, "monitoring error"),
    (0xF000, 0x9000, "external error"),
    (0xFF00, 0xFF00, "maker's own error"),
    (0xF000, 0xF000, "additional function's error"),
)
_NMT_STATES = {
    NmtState.BOOT_UP: "just started",
    NmtState.STOPPED: "stopped",
    NmtState.OPERATIONAL: "operational",
    NmtState.PRE_OPERATIONAL: "pre-operational",
}


def describe_error(code: int) -> str:
    """An emergency's code (which is also 603Fh) in words, with the number to look up in the device's manual."""
    words = _ERRORS.get(code) or next((text for mask, value, text in _CLASSES if code & mask == value), "unknown error")
    return f"{words} (0x{code:04X})"


def describe_nmt_state(state: NmtState) -> str:
    """What a node's network management state is called."""
    return _NMT_STATES[state]
