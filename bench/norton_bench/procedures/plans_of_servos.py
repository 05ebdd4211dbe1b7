"""What is imposed on a servo, by what its command is."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from norton_bench.arrays import FloatArray
from norton_bench.procedures import servo_plans, velocity_plans
from norton_bench.procedures.excitations import Sized, SizedPush
from norton_bench.procedures.knowledge import Knowledge
from norton_bench.procedures.servo_room import SHAKES
from norton_bench.procedures.waves import Motion
from norton_bench.rig.rig import Rig

LIMIT_STRETCH, SHAKEN = "limit", "shaken"
Loops = tuple[tuple[float, float, int], ...]


@dataclass(frozen=True)
class ServoPlans:
    """Stretches of command and motion, each with its name; a torque of the load and a command to shake with; a stretch
    beyond the limit; and how long all that takes but for the loops."""

    stretches: Callable[[Knowledge, float, int, Loops], Iterator[tuple[str, Sized]]]
    shaken: Callable[[Knowledge, float, int], SizedPush]
    limit: Callable[[Knowledge], tuple[FloatArray, Motion] | None]
    imposed_s: Callable[[float], float]

    def shakes(self, known: Knowledge, duration_s: float, seed: int) -> tuple[SizedPush, ...]:
        """Some of them, each half as long as the multisine's ``duration_s``."""
        return tuple(self.shaken(known, 0.5 * duration_s, seed + 2 * each) for each in range(SHAKES))

    def shaken_share(self, known: Knowledge, duration_s: float, seed: int) -> tuple[str, float]:
        """Their name, and the share of its usual size of the smallest."""
        return SHAKEN, min(each.share for each in self.shakes(known, duration_s, seed))


_OF_POSITION = ServoPlans(
    servo_plans.imposed_stretches,
    servo_plans.shaken,
    servo_plans.limit_stretch,
    servo_plans.servo_imposed_s,
)
_OF_VELOCITY = ServoPlans(
    velocity_plans.imposed_stretches,
    velocity_plans.shaken,
    velocity_plans.limit_stretch,
    velocity_plans.imposed_s,
)


def plans_for(rig: Rig) -> ServoPlans | None:
    """None for a motor."""
    if rig.servo is None:
        return None
    return _OF_POSITION if rig.servo.holds_position else _OF_VELOCITY
