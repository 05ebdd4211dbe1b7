"""The last check before commands are sent, and which plausibility checks a rig gets."""

from collections.abc import Collection
from dataclasses import dataclass, field
from math import inf, isfinite

from norton_bench.errors import SafetyStopError, UsageError
from norton_bench.guard.check import NOTHING, Check, Commands, DriveHealth, GuardModel, Limited
from norton_bench.guard.drive_checks import CurrentAgreement, StuckModulator
from norton_bench.guard.motion_checks import CouplingCheck, EncoderAgreement, HeldShaft, Standstill
from norton_bench.guard.torque_checks import FrozenTorque, SaturationCheck, TorqueBalance, TorqueJump
from norton_bench.rig.rig import Command, Limits
from norton_bench.sample import Sample
from norton_bench.units import conversion, same_dimension
from norton_drivers.readings import DriveState


# Which plausibility checks a rig gets: those whose signals it has.
@dataclass(frozen=True)
class Equipment:
    """What is on the bench. Resolutions are 0 where unknown.

    ``runs``: without a load, a command beyond friction makes the shaft turn on and on.
    """

    load: bool
    torque_sensor: bool
    runs: bool = False
    range_nm: float = inf
    resolution_rad: float = 0.0
    load_resolution_rad: float = 0.0
    modulation: Command | None = None  # of a second drive
    modulator_resolution_rad: float = 0.0


def checks_for(
    limits: Limits, command: Command, tick_s: float, fitted: Equipment, leave_out: Collection[str] = ()
) -> tuple[Check, ...]:
    """In the order in which they are asked: what tells the cause before what tells the effect."""
    checks: list[Check] = [EncoderAgreement("actuator encoder", fitted.resolution_rad)]
    if fitted.load:
        checks.append(EncoderAgreement("load encoder", fitted.load_resolution_rad))
        resolution_rad = fitted.resolution_rad + fitted.load_resolution_rad
        checks.append(CouplingCheck(limits.twist_rad, limits.torque_nm, resolution_rad, tick_s))
    modulation = fitted.modulation
    if modulation is not None:
        checks.append(StuckModulator(modulation.limit, modulation.unit, fitted.modulator_resolution_rad))
    if fitted.runs and not fitted.load:
        checks.append(Standstill(command.unit))
    checks += _of_current(limits, command, fitted)
    if fitted.torque_sensor:
        checks += [FrozenTorque(tick_s), TorqueJump(limits.torque_nm, tick_s)]
    if isfinite(fitted.range_nm):
        checks.append(SaturationCheck(fitted.range_nm))
    if fitted.load and fitted.torque_sensor:
        checks.append(TorqueBalance(limits.torque_nm))
        if fitted.resolution_rad > 0.0:
            checks.append(HeldShaft(limits.torque_nm, fitted.resolution_rad))
    return tuple(check for check in checks if check.name not in leave_out)


def _of_current(limits: Limits, command: Command, fitted: Equipment) -> list[Check]:
    """None for a drive that takes no current and no torque: how much current it makes depends on the speed."""
    checks: list[Check] = []
    taken_as = command.unit if command.sent_as is None else command.sent_as
    if same_dimension(taken_as, "A"):
        checks.append(CurrentAgreement("actuator", command.limit, command.unit, conversion(taken_as, "A")[0]))
    elif same_dimension(taken_as, "N*m"):
        checks.append(CurrentAgreement("actuator", command.limit, command.unit))
    if fitted.load:
        checks.append(CurrentAgreement("load", min(limits.load_torque_nm, limits.torque_nm), "N*m"))
    return checks


MENDS = {
    "velocity": "ask for less (amplitude of the steps, [actuator.command] limit)",
    "position": "begin further from the end, or ask for less (amplitude of the steps)",
    "torque": "ask for less ([actuator.command] limit, [load] torque_limit)",
    "power": "ask for less (amplitude of the steps, [actuator.command] limit)",
}

# A command that acted for longer than it was meant to is worth a word with a limit that is reached so soon after.
STALL_SHOWS_NS = 200_000_000
WORTH_A_WORD_NS = 5_000_000


@dataclass
class Guard:
    """The last check before commands are sent: it holds the limits of one rig.

    It depends on no controller and no procedure. It fails closed: where it cannot judge, it stops the bench. Once
    tripped it stays tripped until an operator resets it.

    ``has_load`` and ``has_torque_sensor`` say which signals must be there; ``command_limit`` is the greatest
    actuator command, in its own unit, ``modulation_limit`` that of a modulator, None where there is none.
    ``checks`` are asked in their order, after all limits: a limit is the clearer word. Below ``load_dead_band_nm``
    the load does nothing.
    """

    limits: Limits
    command_limit: float
    tick_s: float
    has_load: bool
    has_torque_sensor: bool
    checks: tuple[Check, ...] = ()
    modulation_limit: float | None = None
    load_dead_band_nm: float = 0.0
    tripped: SafetyStopError | None = field(default=None, init=False)
    _sent: Commands = field(default=NOTHING, init=False)
    _home_rad: float | None = field(default=None, init=False)
    _stalls: list[tuple[int, int]] = field(default_factory=list, init=False)  # when each was over, and how long it was

    def permit(self) -> None:
        """Asked before any drive is enabled. Raises SafetyStopError while an earlier trip has not been reset."""
        if self.tripped is not None:
            raise SafetyStopError(
                f"the guard stopped the bench and nothing is enabled again before an operator says so "
                f"(Loop.reset_guard); it was: {self.tripped}",
                self.tripped.by,
            )

    def reset(self, word: str) -> None:
        """Forget the trip, on an operator's ``word`` that the bench is safe. Raises UsageError where there is none."""
        if not word.strip():
            raise UsageError("a guard that tripped is reset by an operator's word: say who looked, and what was done")
        self.tripped = None

    def learn(self, model: GuardModel) -> None:
        """Use what the bench has measured of itself. Call it with the drives idle."""
        for check in self.checks:
            check.learn(model)

    def begin(self, sample: Sample) -> None:
        """The drives were just enabled at zero. The position window is centred where the shaft first stood."""
        self._sent = NOTHING
        if self._home_rad is None and isfinite(sample.position_rad):
            self._home_rad = sample.position_rad
        for check in self.checks:
            check.begin(sample)

    def limit(self, wished: Commands, sample: Sample, drives: tuple[DriveHealth, ...]) -> Commands:
        """``wished`` within its bounds. Raises SafetyStopError where the bench is not as it must be."""
        if self.tripped is not None:
            raise self.trip(str(self.tripped), self.tripped.by)
        if not (isfinite(wished.command) and isfinite(wished.load_torque_nm) and isfinite(wished.modulation)):
            raise self._no_number(wished)
        self._check_freshness(sample)
        self._check_values(sample)
        self._check_drives(drives, sample.tick_ns)
        for check in self.checks:
            message = check.fault(sample, self._sent)
            if message is not None:
                raise self.trip(message, check.name)
        return self._clip(wished)

    def stood_still(self, until_ns: int, stall_ns: int) -> None:
        """The loop did, and the last commands acted meanwhile: a limit that is reached soon after may be for that."""
        recent = [(end_ns, each_ns) for end_ns, each_ns in self._stalls if until_ns - end_ns <= STALL_SHOWS_NS]
        self._stalls = [*recent, (until_ns, stall_ns)]

    def trip(self, reason: str, by: str) -> SafetyStopError:
        """Latch ``reason``; returns the error to raise. ``by`` is what tripped, in a word or two."""
        self.tripped = SafetyStopError(reason, by)
        return self.tripped

    def _no_number(self, wished: Commands) -> SafetyStopError:
        if isfinite(wished.command) and isfinite(wished.load_torque_nm):
            return self.trip(f"the procedure asked for modulation {wished.modulation}: not a number", "wish")
        return self.trip(
            f"the controller asked for command {wished.command} and load torque {wished.load_torque_nm} N m: "
            "not a number, so nothing was sent",
            "wish",
        )

    def _check_freshness(self, sample: Sample) -> None:
        stale_ns = self.limits.stale_after_ns
        if not 0 <= sample.motion_age_ns <= stale_ns:
            raise self._silent("actuator encoder", sample.motion_age_ns, sample)
        if self.has_load and not 0 <= sample.load_motion_age_ns <= stale_ns:
            raise self._silent("load encoder", sample.load_motion_age_ns, sample)
        if self.has_torque_sensor and not 0 <= sample.torque_age_ns <= stale_ns:
            raise self._silent("torque sensor", sample.torque_age_ns, sample)
        if self.modulation_limit is not None and not 0 <= sample.modulator_motion_age_ns <= stale_ns:
            raise self._silent("modulator encoder", sample.modulator_motion_age_ns, sample)

    def _silent(self, name: str, age_ns: int, sample: Sample) -> SafetyStopError:
        if age_ns < 0:
            return self.trip(f"{name}: no reading yet", "stale")
        message = (
            f"{name}: silent for {age_ns / 1e6:.1f} ms, more than [limits] stale_after = "
            f"{self.limits.stale_after_ns / 1e6:g} ms"
        )
        return self.trip(f"{message}; {self._meanwhile(age_ns, sample)}", "stale")

    def _meanwhile(self, age_ns: int, sample: Sample) -> str:
        """What else was heard while a device was silent, and what follows from that."""
        ages_ns = (
            sample.motion_age_ns,
            sample.load_motion_age_ns,
            sample.torque_age_ns,
            sample.modulator_motion_age_ns,
        )
        if min(age for age in ages_ns if age >= 0) < age_ns / 2:
            return (
                "others were heard meanwhile: check its cable and power; a computer that is busy may be late to hand "
                "on what a serial port has received: end other programs"
            )
        return (
            "nothing else was heard either: the bus, its adapter or the computer stood still, or `sim serve` in a "
            "rehearsal: check the bus, and end other programs"
        )

    def _check_values(self, sample: Sample) -> None:
        # Written so that NaN fails, with which a comparison is never true, and infinity where there is no limit.
        limits, velocity_rad_s, position_rad = self.limits, sample.velocity_rad_s, sample.position_rad
        bound = limits.velocity_rad_s
        if not (isfinite(velocity_rad_s) and abs(velocity_rad_s) <= bound):
            raise self._outside("actuator velocity", velocity_rad_s, bound, "velocity", "rad/s", sample)
        if self._home_rad is None:
            raise self.trip("actuator position: not a number when the drives were enabled", "position")
        travel_rad = position_rad - self._home_rad
        if not (isfinite(travel_rad) and abs(travel_rad) <= limits.position_rad):
            raise self._outside(
                "travel from where the shaft stood", travel_rad, limits.position_rad, "position", "rad", sample
            )
        if self.has_load:
            load_rad_s = sample.load_velocity_rad_s
            if not (isfinite(load_rad_s) and abs(load_rad_s) <= bound):
                raise self._outside("load velocity", load_rad_s, bound, "velocity", "rad/s", sample)
            if not isfinite(sample.load_position_rad):
                raise self._outside("load position", sample.load_position_rad, inf, "position", "rad", sample)
        if self.has_torque_sensor:
            torque_nm = sample.torque_nm
            if not (isfinite(torque_nm) and abs(torque_nm) <= limits.torque_nm):
                raise self._outside("port torque", torque_nm, limits.torque_nm, "torque", "N m", sample)
            power_w = torque_nm * velocity_rad_s
            if not (isfinite(power_w) and abs(power_w) <= limits.power_w):
                raise self._outside("port power", power_w, limits.power_w, "power", "W", sample)

    def _outside(self, name: str, value: float, bound: float, key: str, unit: str, sample: Sample) -> SafetyStopError:
        if isfinite(value):
            message = f"{name}: {value:.4g} {unit} is outside [limits] {key} = {bound:g} {unit}"
            return self.trip(f"{message}; {self._why_late(sample.tick_ns) or self._mend(key)}", key)
        return self.trip(
            f"{name}: is no number: the device marks its reading as invalid, or reads beyond its range; "
            "check the device",
            key,
        )

    def _why_late(self, now_ns: int) -> str:
        """What to do where the loop had just stood still; empty where it had not."""
        still_ns = sum(stall_ns for end_ns, stall_ns in self._stalls if now_ns - end_ns <= STALL_SHOWS_NS)
        if still_ns < WORTH_A_WORD_NS:
            return ""
        return (
            f"the loop had stood still for {still_ns / 1e6:.0f} of the last {STALL_SHOWS_NS / 1e6:g} ms, with its last "
            "commands acting: other programs kept it from the processor, or a virtual machine's host did; end them"
        )

    def _mend(self, key: str) -> str:
        """What to do where a limit was reached."""
        mend = f"{MENDS[key]}, or raise [limits] {key} where the bench stands more"
        if self.load_dead_band_nm > 0.0:
            mend += (
                f"; the load does nothing below {self.load_dead_band_nm:g} N m, where its drive lets go of its motor: "
                "where that is much of the friction it has to overcome, lower the drive's minimum current, and what "
                "[load] says of it"
            )
        return mend

    def _check_drives(self, drives: tuple[DriveHealth, ...], tick_ns: int) -> None:
        limit_c = self.limits.temperature_c
        for name, status, timeout_ns in drives:
            if status.state is not DriveState.ENABLED:
                words = "; ".join(status.errors) or "no reason given"
                raise self.trip(f"{name} drive: left its torque loop ({status.state.value}: {words})", "drive")
            if status.heartbeat_ns is None or tick_ns - status.heartbeat_ns > timeout_ns:
                raise self.trip(f"{name} drive: no heartbeat for {timeout_ns / 1e6:g} ms", "heartbeat")
            # Drives that report no temperature leave NaN, which is no alarm; a hot one is.
            if status.transistor_temperature_c > limit_c:
                raise self._hot(name, "transistors", status.transistor_temperature_c)
            if status.motor_temperature_c > limit_c:
                raise self._hot(name, "motor", status.motor_temperature_c)

    def _hot(self, name: str, part: str, celsius: float) -> SafetyStopError:
        return self.trip(
            f"{name} drive: {part} at {celsius:.0f} °C, above [limits] temperature = {self.limits.temperature_c:g} °C",
            "temperature",
        )

    def _clip(self, wished: Commands) -> Commands:
        limited = 0
        command = min(max(wished.command, -self.command_limit), self.command_limit)
        if command != wished.command:
            limited |= Limited.COMMAND
        step = self.limits.command_rate_per_s * self.tick_s
        slewed = min(max(command, self._sent.command - step), self._sent.command + step)
        if slewed != command:
            limited |= Limited.COMMAND_RATE
        load_nm = min(max(wished.load_torque_nm, -self.limits.load_torque_nm), self.limits.load_torque_nm)
        if load_nm != wished.load_torque_nm:
            limited |= Limited.LOAD_TORQUE
        modulation = wished.modulation
        if self.modulation_limit is not None:
            modulation = min(max(modulation, -self.modulation_limit), self.modulation_limit)
            if modulation != wished.modulation:
                limited |= Limited.MODULATION
        self._sent = Commands(slewed, load_nm, int(limited), modulation)
        return self._sent
