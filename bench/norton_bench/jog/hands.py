"""Who decides what is wanted: an operator at a keyboard, or values given beforehand."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

from norton_bench.errors import RigError
from norton_bench.jog.setpoints import CONTROLLED, Bounds, LoadDoes, Setpoints, unlimited
from norton_bench.loop.stop_word import StopWord
from norton_bench.procedures.knowledge import require_load
from norton_bench.rig.rig import Rig
from norton_bench.session.operator import Operator, Order

# Without any key for so long all goes back to zero. It is time to look at figures, and to write one down; who walks off
# meanwhile is, at the 1.6 m/s that ISO 13855 takes a person to walk, hardly out of sight of the bench.
DEAD_MAN_S = 10.0
# Without any key for so long nobody is there, and drives that are enabled at zero are idled.
ABANDONED_S = 300.0
LOAD_WORDS = {
    "coast": LoadDoes.COAST,
    "torque": LoadDoes.TORQUE,
    "velocity": LoadDoes.VELOCITY,
    "zero_torque": LoadDoes.ZERO_TORQUE,
}


class Hand(Protocol):
    """Asked before every segment. ``leaves`` ends it once all is at zero; ``calibrates`` says what comes then."""

    @property
    def leaves(self) -> bool: ...
    @property
    def calibrates(self) -> bool: ...
    def begin(self, *, calibrated: bool) -> None:
        """The drives are about to be enabled, at zero."""
        ...

    def wanted(self, elapsed_s: float) -> Setpoints:
        """Within bounds. ``elapsed_s`` is bench time since the drives were enabled."""
        ...

    def let_go(self, why: str) -> None:
        """Nothing is wanted any more, because of ``why``."""
        ...

    def could_not_calibrate(self, why: str) -> None: ...


@dataclass
class Preset:
    """``setpoints`` for ``duration_s``, then zero. ``cut_short`` is why it was over before, empty where it was not."""

    setpoints: Setpoints
    duration_s: float
    calibrates: bool = field(init=False)
    leaves: bool = field(default=False, init=False)
    cut_short: str = field(default="", init=False)

    def __post_init__(self) -> None:
        self.calibrates = self.setpoints.load in CONTROLLED

    def begin(self, *, calibrated: bool) -> None:
        self.calibrates = False

    def wanted(self, elapsed_s: float) -> Setpoints:
        self.leaves = self.leaves or elapsed_s >= self.duration_s
        return self.setpoints.zeroed() if self.leaves else self.setpoints

    def let_go(self, why: str) -> None:
        self.leaves, self.cut_short = True, self.cut_short or why

    def could_not_calibrate(self, why: str) -> None:
        self.leaves, self.cut_short = True, why


@dataclass
class Board:
    """An :class:`Operator` between the session and another one, whose orders "jog" it keeps for itself.

    What that one has to know it says as marks, so that the recording has it too. ``clock`` gives seconds; tests have
    their own. The text of an order:

    - ``actuator 0.02``, ``load -0.02``: by this share of the greatest value
    - ``coast``, ``torque``, ``velocity``, ``zero_torque``: what the load shall do, from zero on
    - ``zero``: everything back to zero; ``here``: nothing but a sign of life
    - ``calibrate``: measure the load, with the drives idle before and after; ``end``: back to zero, and no more
    """

    operator: Operator
    rig: Rig
    bounds: Bounds
    dead_man_s: float = DEAD_MAN_S
    clock: Callable[[], float] = time.monotonic
    calibrates: bool = field(default=False, init=False)
    leaves: bool = field(default=False, init=False)
    _wanted: Setpoints = field(default_factory=Setpoints, init=False)
    _calibrated: bool = field(default=False, init=False)
    _touched_s: float = field(default=0.0, init=False)
    _said: list[Order] = field(default_factory=list, init=False)

    @property
    def stop(self) -> StopWord:
        return self.operator.stop

    @property
    def answers(self) -> bool:
        return self.operator.answers

    def orders(self) -> Sequence[Order]:
        """Those that are the session's, and marks of what is to be known."""
        others = tuple(self._others())
        said, self._said = self._said, []
        return (*others, *said)

    def _others(self) -> Iterator[Order]:
        for order in self.operator.orders():
            if order.kind == "jog":
                self._take(order.text)
            else:
                yield order

    def begin(self, *, calibrated: bool) -> None:
        self._calibrated, self.calibrates, self.leaves = calibrated, False, False
        self._wanted, self._touched_s = Setpoints(), self.clock()

    def wanted(self, elapsed_s: float) -> Setpoints:
        silent_s = self.clock() - self._touched_s
        if silent_s > self.dead_man_s and not self._wanted.at_zero:
            self.let_go(f"no key for {self.dead_man_s:g} s: everything goes back to zero")
        if silent_s > max(ABANDONED_S, self.dead_man_s) and not self.leaves:
            self.leaves = True
            self._tell(f"no key for {silent_s:.0f} s: nobody is there, the drives go idle")
        return self._wanted

    def let_go(self, why: str) -> None:
        self._wanted = self._wanted.zeroed()
        self._tell(why)

    def could_not_calibrate(self, why: str) -> None:
        self._tell(why)

    def _tell(self, said: str) -> None:
        self._said.append(Order("mark", said))

    def _take(self, text: str) -> None:
        self._touched_s = self.clock()
        word, _, share = text.partition(" ")
        if self.leaves or self.calibrates:
            return  # on its way to zero, and not to be held up
        if word == "actuator":
            self._want(
                replace(self._wanted, command=self._wanted.command + float(share) * self.bounds.greatest_command)
            )
        elif word == "load":
            self._nudge_load(float(share))
        elif word in LOAD_WORDS:
            self._choose(LOAD_WORDS[word])
        elif word in ("zero", "calibrate", "end"):
            self._wanted = self._wanted.zeroed()
            self.leaves = word != "zero"
            self.calibrates = word == "calibrate" and self._may_calibrate()

    def _want(self, wanted: Setpoints) -> None:
        self._wanted, said = self.bounds.clamped(wanted)
        if said:
            self._tell(said)

    def _nudge_load(self, share: float) -> None:
        load = self._wanted.load
        if load not in (LoadDoes.TORQUE, LoadDoes.VELOCITY):
            self._tell("the load is not told a value now: let it push (t) or turn (v) first")
        elif unlimited(self.bounds, load):
            self._tell("the load's torque has no limit, of which a nudge could be a share: write [load] torque_limit")
        else:
            by = share * self.bounds.greatest_load(load)
            self._want(replace(self._wanted, load_value=self._wanted.load_value + by))

    def _choose(self, load: LoadDoes) -> None:
        if load is self._wanted.load:
            return
        if self.rig.wiring.load is None:
            self._tell("this rig has no load drive")
        elif load in CONTROLLED and not self._calibrated:
            self._tell("that takes the controller, which is tuned from the load's calibration: k calibrates")
        else:
            self._wanted = Setpoints(self._wanted.command, load)

    def _may_calibrate(self) -> bool:
        try:
            require_load(self.rig, "calibrate", "to calibrate")
        except RigError as error:
            self._tell(str(error))
            self.leaves = False
            return False
        return True
