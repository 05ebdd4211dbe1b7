"""What an ODrive's error bits, results and states mean, in words that help at the bench.

Source: ODrive API reference (firmware 0.6), "ODrive.Error", "ODrive.ProcedureResult", "ODrive.Axis.AxisState".
"""

from norton_drivers.codecs.odrive import ERROR_ESTOP, ERROR_WATCHDOG, AxisState

_ERROR_WORDS: tuple[tuple[int, str], ...] = (
    (1 << 0, "the drive is initialising"),
    (1 << 1, "system-level fault in the firmware"),
    (1 << 2, "timing error: the drive's processor is overloaded"),
    (1 << 3, "no valid position or velocity estimate: check the encoder"),
    (1 << 4, "configuration invalid or incomplete"),
    (1 << 5, "gate driver fault"),
    (1 << 6, "no input value was given before the loop was closed"),
    (1 << 8, "bus voltage too high"),
    (1 << 9, "bus voltage too low: is the supply on?"),
    (1 << 10, "bus current too high"),
    (1 << 11, "regenerated bus current too high: check the brake resistor"),
    (1 << 12, "motor current limit violated"),
    (1 << 13, "motor too hot"),
    (1 << 14, "inverter too hot"),
    (1 << 15, "the drive's velocity limit was violated"),
    (1 << 16, "the drive's position limit was violated"),
    (ERROR_WATCHDOG, "watchdog expired: no command arrived in time"),
    (ERROR_ESTOP, "emergency stop requested"),
    (1 << 26, "spin-out: electrical and mechanical power disagree"),
    (1 << 27, "brake resistor disarmed"),
    (1 << 28, "thermistor disconnected"),
    (1 << 30, "calibration failed"),
)
_ERROR_BITS_KNOWN = sum(bit for bit, _ in _ERROR_WORDS)

_PROCEDURE_RESULTS = (
    "success",
    "busy",
    "cancelled",
    "disarmed",
    "no response",
    "pole pairs and encoder counts disagree",
    "phase resistance out of range",
    "phase inductance out of range",
    "phases unbalanced",
    "motor type invalid",
    "illegal Hall state",
    "timed out",
    "homing without an end stop",
    "not possible in this state",
    "not calibrated",
    "does not converge",
)


def describe_errors(bits: int) -> tuple[str, ...]:
    """Active errors or a disarm reason in words, lowest bit first; empty where there are none."""
    if not bits:
        return ()  # as every healthy heartbeat says: going through all of them takes a third of a tick's work
    words = tuple(text for bit, text in _ERROR_WORDS if bits & bit)
    unknown = bits & ~_ERROR_BITS_KNOWN
    return (*words, f"unknown error bits 0x{unknown:08X}") if unknown else words


def describe_procedure_result(result: int) -> str:
    """How the last procedure (for instance closing the loop) ended."""
    return _PROCEDURE_RESULTS[result] if result < len(_PROCEDURE_RESULTS) else f"unknown result {result}"


def describe_axis_state(state: int) -> str:
    """An axis state in words; unknown numbers are said as such."""
    try:
        return AxisState(state).name.lower().replace("_", " ")
    except ValueError:
        return f"unknown state {state}"
