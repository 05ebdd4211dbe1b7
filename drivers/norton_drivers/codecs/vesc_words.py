"""What a VESC's fault codes mean, in words that help at the bench.

Source: vedderb/bldc, datatypes.h (``mc_fault_code``).
"""

_FAULTS = (
    "no fault",
    "supply voltage too high: can the supply take back what is braked?",
    "supply voltage too low: is the supply on?",
    "gate driver fault",
    "motor current beyond its absolute limit",
    "transistors too hot",
    "motor too hot",
    "gate driver voltage too high",
    "gate driver voltage too low",
    "processor voltage too low",
    "restarted by its own watchdog",
    "encoder does not answer (SPI)",
    "sin/cos encoder: amplitude too small",
    "sin/cos encoder: amplitude too large",
    "flash memory corrupt",
    "current sensor 1: offset too high",
    "current sensor 2: offset too high",
    "current sensor 3: offset too high",
    "phase currents unbalanced",
    "brake input active",
    "resolver: loss of tracking",
    "resolver: degradation of signal",
    "resolver: loss of signal",
    "flash memory corrupt: app settings",
    "flash memory corrupt: motor settings",
    "encoder: no magnet",
    "encoder: magnet too strong",
    "phase filter fault",
    "encoder fault",
    "low-voltage output fault",
)


def describe_fault(code: int) -> str:
    """A fault code in words; unknown numbers are said as such."""
    return _FAULTS[code] if code < len(_FAULTS) else f"unknown fault code {code}"
