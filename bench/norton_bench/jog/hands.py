"""A bench moved by hand: its setpoints, their bounds, and who sets them, an operator or given values."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from math import inf, isfinite
from typing import TYPE_CHECKING, Protocol

from norton_bench.errors import RigError, UsageError
from norton_bench.jog.certifying import Certifying
from norton_bench.loop.stop_word import StopWord
from norton_bench.procedures.knowledge import VELOCITY_SHARE, require_load
from norton_bench.procedures.tare import greatest_load_torque
from norton_bench.rig.rig import Rig
from norton_bench.segments import GLIDE_S, LAW_UNITS, ZERO_TORQUE, Admittance
from norton_bench.session.operator import Operator, Order

if TYPE_CHECKING:
    from norton_bench.control.calibration import LoadCalibration

NAME = "jog"
# How the text of a mark that describes a device begins.
DEVICE = "device "
# Default share of [limits] velocity. Above it there is room for the speed that the shaft still gains until a command of
# zero takes effect.
SPEED_SHARE = 0.5


class LoadDoes(Enum):
    """What somebody who moves the bench by hand may ask for, and how far.

    What the load machine does.
    """

    COAST = "coasts"
    TORQUE = "pushes"
    VELOCITY = "turns"
    ZERO_TORQUE = "zero torque"
    BODY = "acts a body"


# These take the controller, which is tuned from the calibration.
CONTROLLED = (LoadDoes.VELOCITY, LoadDoes.ZERO_TORQUE, LoadDoes.BODY)
# The way from one body to another is gone to its end; it begins with the next segment, which may be a little late.
CHANGES_WITHIN_S = GLIDE_S + 0.3


@dataclass(frozen=True)
class Setpoints:
    """``command`` is the actuator's, in its own unit; ``load_value`` a torque [N m] or a velocity [rad/s], else 0;
    ``law`` is that of the body that the load acts, if it acts one."""

    command: float = 0.0
    load: LoadDoes = LoadDoes.COAST
    load_value: float = 0.0
    law: Admittance = ZERO_TORQUE

    @property
    def at_zero(self) -> bool:
        return self.command == 0.0 and self.load_value == 0.0 and self.load is not LoadDoes.BODY

    def zeroed(self) -> "Setpoints":
        """All values zero; the load keeps its mode, but lets go of a body: that may turn by itself."""
        return Setpoints(0.0, LoadDoes.COAST if self.load is LoadDoes.BODY else self.load)

    def words(self, command_unit: str) -> str:
        """In a few words, for the watcher and the recording."""
        load = {
            LoadDoes.COAST: "load coasts",
            LoadDoes.TORQUE: f"load {self.load_value:+.4g} N*m",
            LoadDoes.VELOCITY: f"load {self.load_value:+.4g} rad/s",
            LoadDoes.ZERO_TORQUE: "zero torque at the port",
            LoadDoes.BODY: "body "
            + ", ".join(map("{:g} {}".format, self.law.values, LAW_UNITS.values()))
            + ("" if self.law.wall_rad is None else f", wall {self.law.wall_rad:g} rad"),
        }
        return f"actuator {self.command:+.4g} {command_unit}, {load[self.load]}"


@dataclass(frozen=True)
class Bounds:
    """How far setpoints may go. ``speed_rad_s`` is the speed of the shaft at which torques are switched off; an imposed
    velocity stays below it. ``load_torque_nm`` is 0 without a load, and inf where the rig does not limit it."""

    command_unit: str
    command: tuple[float, float]
    load_torque_nm: float
    velocity_rad_s: float
    speed_rad_s: float

    @property
    def greatest_command(self) -> float:
        return max(abs(self.command[0]), self.command[1])

    def greatest_load(self, load: LoadDoes) -> float:
        """The greatest value of the load in this mode; 0 where the mode has no value."""
        return {LoadDoes.TORQUE: self.load_torque_nm, LoadDoes.VELOCITY: self.velocity_rad_s}.get(load, 0.0)

    def clamped(self, wanted: Setpoints) -> tuple[Setpoints, str]:
        """``wanted`` within bounds, and a sentence about what was limited; empty where nothing was."""
        command = min(max(wanted.command, self.command[0]), self.command[1])
        most = self.greatest_load(wanted.load)
        load_value = min(max(wanted.load_value, -most), most)
        said = []
        if command != wanted.command:
            said.append(f"the actuator stays at {command:+.4g} {self.command_unit}: the rig allows no more")
        if load_value != wanted.load_value:
            said.append(f"the load stays at {self._load_words(wanted.load, load_value)}")
        return replace(wanted, command=command, load_value=load_value), "; ".join(said)

    def _load_words(self, load: LoadDoes, value: float) -> str:
        if load is LoadDoes.VELOCITY:
            most = f"{VELOCITY_SHARE:.0%} of the {self.speed_rad_s:.4g} rad/s"
            return f"{value:+.4g} rad/s: {most} at which torques are switched off"
        return f"{value:+.4g} N*m: the rig allows no more"


def bounds_of(rig: Rig, speed_rad_s: float | None = None) -> Bounds:
    """The bounds on this rig. Raises UsageError for a ``speed_rad_s`` too near to the rig's limit."""
    most_rad_s = VELOCITY_SHARE * rig.limits.velocity_rad_s
    if speed_rad_s is None:
        speed_rad_s = SPEED_SHARE * rig.limits.velocity_rad_s
    if not 0.0 < speed_rad_s <= most_rad_s:
        raise UsageError(
            f"a speed of {speed_rad_s:g} rad/s: must be greater than 0, and at most {most_rad_s:g} rad/s, which is "
            f"{VELOCITY_SHARE:.0%} of [limits] velocity, at which the guard stops"
        )
    low, high = rig.command.span
    torque_nm = greatest_load_torque(rig) if rig.wiring.load is not None else 0.0
    return Bounds(rig.command.unit, (min(low, 0.0), high), torque_nm, VELOCITY_SHARE * speed_rad_s, speed_rad_s)


def unlimited(bounds: Bounds, load: LoadDoes) -> bool:
    """Whether there is no limit, so that a step, which is a share of it, has no size."""
    return not isfinite(bounds.greatest_load(load)) and bounds.greatest_load(load) == inf


# After this time without a key everything returns to zero: time to read a figure and to write it down. A person who
# walks away at 1.6 m/s (ISO 13855) is hardly out of sight of the bench by then.
DEAD_MAN_S = 10.0
# After this time without a key drives that are enabled at zero are idled.
ABANDONED_S = 300.0
LOAD_WORDS = {
    "coast": LoadDoes.COAST,
    "torque": LoadDoes.TORQUE,
    "velocity": LoadDoes.VELOCITY,
    "zero_torque": LoadDoes.ZERO_TORQUE,
}


class Hand(Protocol):
    """The source of setpoints: an operator at a keyboard, or given values.

    It is asked before every segment. With ``leaves`` the drives go idle once everything is at zero; with ``calibrates``
    the load is calibrated then.
    """

    @property
    def leaves(self) -> bool: ...
    @property
    def calibrates(self) -> bool: ...
    def begin(self, calibration: "LoadCalibration | None") -> None:
        """Called before the drives are enabled, at zero."""
        ...

    def wanted(self, elapsed_s: float) -> Setpoints:
        """The setpoints, within bounds. ``elapsed_s`` is bench time since the drives were enabled."""
        ...

    def let_go(self, why: str) -> None:
        """Called when all setpoints were put to zero, with the reason."""
        ...

    def could_not_calibrate(self, why: str) -> None: ...


@dataclass
class Preset:
    """``setpoints`` for ``duration_s``, then zero. ``cut_short`` is the reason of an early end, else empty."""

    setpoints: Setpoints
    duration_s: float
    calibrates: bool = field(init=False)
    leaves: bool = field(default=False, init=False)
    cut_short: str = field(default="", init=False)

    def __post_init__(self) -> None:
        self.calibrates = self.setpoints.load in CONTROLLED

    def begin(self, calibration: "LoadCalibration | None") -> None:
        self.calibrates = False

    def wanted(self, elapsed_s: float) -> Setpoints:
        self.leaves = self.leaves or elapsed_s >= self.duration_s
        return self.setpoints.zeroed() if self.leaves else self.setpoints

    def let_go(self, why: str) -> None:
        if not self.leaves:  # on its way to zero nothing is cut short any more
            self.leaves, self.cut_short = True, why

    def could_not_calibrate(self, why: str) -> None:
        self.leaves, self.cut_short = True, why


@dataclass
class Board:
    """An :class:`Operator` between the session and another one: it takes that one's orders "jog", and passes on the
    rest.

    Its messages are marks, so that the recording has them too. ``clock`` gives seconds. The text of an order:

    - ``actuator 0.02``, ``load -0.02``: by this share of the greatest value
    - ``coast``, ``torque``, ``velocity``, ``zero_torque``: the mode of the load, starting at zero
    - ``body 0.0005 0.02 0.5``: the load acts this mass [kg m²], damping [N m s/rad] and stiffness [N m/rad]; the
      stiffness of a wall with a fourth number, its angle [rad]
    - ``zero``: everything back to zero; ``here``: the operator is present
    - ``calibrate``: measure the load, with the drives idle before and after; ``end``: back to zero, and end
    """

    operator: Operator
    rig: Rig
    bounds: Bounds
    dead_man_s: float = DEAD_MAN_S
    clock: Callable[[], float] = time.monotonic
    calibrates: bool = field(default=False, init=False)
    leaves: bool = field(default=False, init=False)
    _wanted: Setpoints = field(default_factory=Setpoints, init=False)
    _calibration: "LoadCalibration | None" = field(default=None, init=False)
    _certifying: Certifying | None = field(default=None, init=False)  # the last that was begun
    _asked: Certifying | None = field(default=None, init=False)  # the same, while its law is still wanted
    _changed_s: float = field(default=-inf, init=False)  # when the last law was taken over
    _touched_s: float = field(default=0.0, init=False)
    _said: list[Order] = field(default_factory=list, init=False)

    @property
    def stop(self) -> StopWord:
        return self.operator.stop

    @property
    def answers(self) -> bool:
        return self.operator.answers

    def orders(self) -> Sequence[Order]:
        """The orders for the session, and marks with the messages."""
        others = tuple(self._others())
        said, self._said = self._said, []
        return (*others, *said)

    def _others(self) -> Iterator[Order]:
        for order in self.operator.orders():
            if order.kind == "jog":
                self._take(order.text)
            else:
                yield order

    def begin(self, calibration: "LoadCalibration | None") -> None:
        self._calibration, self.calibrates, self.leaves, self._changed_s = calibration, False, False, -inf
        self._wanted, self._touched_s, self._asked = Setpoints(), self.clock(), None

    def wanted(self, elapsed_s: float) -> Setpoints:
        self._certified(elapsed_s)
        silent_s = self.clock() - self._touched_s
        if silent_s > self.dead_man_s and not self._wanted.at_zero:
            self.let_go(f"no key for {self.dead_man_s:g} s: everything returns to zero")
        if silent_s > max(ABANDONED_S, self.dead_man_s) and not self.leaves:
            self.leaves, self._asked = True, None
            self._tell(f"no key for {silent_s:.0f} s: the drives go idle")
        return self._wanted

    def let_go(self, why: str) -> None:
        self._wanted, self._asked = self._wanted.zeroed(), None
        self._tell(why)

    def could_not_calibrate(self, why: str) -> None:
        self._tell(why)

    def _tell(self, said: str) -> None:
        self._said.append(Order("mark", said))

    def _take(self, text: str) -> None:
        self._touched_s = self.clock()
        word, _, share = text.partition(" ")
        if self.leaves or self.calibrates:
            return  # on its way to zero: ignore orders
        if word == "actuator":
            self._want(
                replace(self._wanted, command=self._wanted.command + float(share) * self.bounds.greatest_command)
            )
        elif word == "load":
            self._nudge_load(float(share))
        elif word == "body":
            values = [float(value) for value in share.split()]
            self._act(Admittance.of(values[: len(LAW_UNITS)], *values[len(LAW_UNITS) :]))
        elif word in LOAD_WORDS:
            self._choose(LOAD_WORDS[word])
        elif word in ("zero", "calibrate", "end"):
            self._wanted, self._asked = self._wanted.zeroed(), None
            self.leaves = word != "zero"
            self.calibrates = word == "calibrate" and self._may_calibrate()

    def _want(self, wanted: Setpoints) -> None:
        self._wanted, said = self.bounds.clamped(wanted)
        if said:
            self._tell(said)

    def _nudge_load(self, share: float) -> None:
        load = self._wanted.load
        if load not in (LoadDoes.TORQUE, LoadDoes.VELOCITY):
            self._tell("the load has no value in this mode: let it push (t) or turn (v) first")
        elif unlimited(self.bounds, load):
            self._tell("the load's torque has no limit, of which a nudge could be a share: write [load] torque_limit")
        else:
            by = share * self.bounds.greatest_load(load)
            self._want(replace(self._wanted, load_value=self._wanted.load_value + by))

    def _choose(self, load: LoadDoes) -> None:
        self._asked = None
        if load is not self._wanted.load and self._may(load):
            self._wanted = Setpoints(self._wanted.command, load)

    def _may(self, load: LoadDoes) -> bool:
        if self.rig.wiring.load is None:
            self._tell("this rig has no load drive")
            return False
        if load in CONTROLLED and self._calibration is None:
            self._tell("this needs the controller, which is tuned from a calibration of the load: press k first")
            return False
        return True

    def _act(self, law: Admittance) -> None:
        if law.shortcoming:
            self._tell(law.shortcoming)
        elif not law.has_body:
            self._tell("a body has a mass, a damping or a stiffness; for none of them keep the port at zero torque (z)")
        elif self._certifying is not None and not self._certifying.done:
            self._tell("the last body is still being looked at: ask again in a moment")
        elif self._may(LoadDoes.BODY):
            assert self._calibration is not None
            acts = self._wanted.load is LoadDoes.BODY and self._wanted.law.wall_rad == law.wall_rad
            before = self._wanted.law if acts else None
            self._asked = self._certifying = Certifying(self._calibration, self.rig.tick_s, law, before)

    def _certified(self, elapsed_s: float) -> None:
        """Take the law over that the bench can render, once the body has become what was asked for before."""
        asked = self._asked
        if asked is None or not asked.done:
            return
        if not asked.certificate:
            self._tell(asked.refusal)
        elif elapsed_s < self._changed_s + CHANGES_WITHIN_S:
            return
        else:
            self._tell(asked.certificate)
            self._wanted = Setpoints(self._wanted.command, LoadDoes.BODY, law=asked.law)
            self._changed_s = elapsed_s
        self._asked = None

    def _may_calibrate(self) -> bool:
        try:
            require_load(self.rig, "calibrate", "to calibrate")
        except RigError as error:
            self._tell(str(error))
            self.leaves = False
            return False
        return True
