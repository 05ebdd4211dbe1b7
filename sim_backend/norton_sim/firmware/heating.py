"""How warm a drive's transistors are."""

from math import exp

AMBIENT_C = 25.0
LIMIT_C = 100.0
RISE_K_PER_A2 = 0.1  # in the end, for each ampere squared
TIME_CONSTANT_S = 20.0


class Heating:
    """One heat capacity that tends to ambient + rise · current²; a test may set ``temperature_c``."""

    def __init__(self) -> None:
        self.temperature_c = AMBIENT_C

    def carry(self, current_a: float, duration_s: float) -> None:
        """Let a current flow for a while."""
        end_c = AMBIENT_C + RISE_K_PER_A2 * current_a**2
        self.temperature_c += (end_c - self.temperature_c) * (1 - exp(-duration_s / TIME_CONSTANT_S))

    @property
    def too_hot(self) -> bool:
        return self.temperature_c > LIMIT_C
