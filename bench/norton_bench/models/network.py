"""The identified nonlinear Norton network: its motion source and its impedance (paper, sections III and IV.D).

The source is the motion under zero port torque; the impedance is the torque under any other motion:

    τ = Km·Ka·lag(c) − Im·ω̇ − B·ω − σ0·φ − σ1·φ̇,     φ̇ = ω − (σ0/τc)·|ω|·φ

``torque(command, free_motion(command))`` is zero: the source is the zero of the impedance.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import ceil, inf, isfinite
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.errors import UsageError
from norton_bench.models import sliding
from norton_bench.models.network_file import (
    FORMAT,
    VERSION,
    VERSION_WITH_TERMS,
    as_object,
    read_matrix,
    read_network,
    read_prediction,
    read_term,
    term_as_json,
)
from norton_bench.models.parameters import BY_NAME, PredictionError
from norton_bench.models.servo_file import servo_as_json, servo_from_json
from norton_bench.models.terms import (
    DRAG,
    LOAD,
    Factor,
    NetworkTerm,
    factors_of,
    joint_of,
    joint_values,
    row_of,
    waves_of,
)
from norton_drivers.servo import Servo

REQUIRED = (
    "torque_gain",
    "amplifier_bandwidth_rad_s",
    "inertia_kgm2",
    "viscous_damping_nms_rad",
    "coulomb_torque_nm",
    "presliding_stiffness_nm_rad",
    "presliding_damping_nms_rad",
)
# Fields of the network and the names of the one table of parameters, in its order.
PARAMETER_OF_FIELD = {
    "torque_gain": "torque_gain",
    "amplifier_bandwidth_rad_s": "amplifier_bandwidth",
    "inertia_kgm2": "inertia",
    "viscous_damping_nms_rad": "viscous_damping",
    "coulomb_torque_nm": "coulomb_torque",
    "presliding_stiffness_nm_rad": "presliding_stiffness",
    "presliding_damping_nms_rad": "presliding_damping",
    "torque_constant": "torque_constant",
    "amplifier_gain": "amplifier_gain",
    "torque_limit_nm": "torque_limit",
}
# In the provenance: the status of each parameter that is not valid, "name=status; name=status".
STATUS = "status"
# Likewise: the standard deviation of each that the covariance does not have, and the verdict on each condition.
DEVIATION, CONDITIONS = "deviation", "conditions"
SIGNED = ("torque_gain", "amplifier_gain")
# Steps no longer than this resolve the friction contact of a small motor (hundreds of rad/s, well damped).
LONGEST_STEP_S = 1e-4
# Where friction grows with the port's torque, that torque depends on itself: each iteration leaves the share μ of the
# error before it.
LOAD_ITERATIONS = 5


def told(provenance: Mapping[str, str], key: str) -> dict[str, str]:
    """What a network's provenance tells under ``key``, by name: of "name=text; name=text"."""
    return dict(pair.split("=", 1) for pair in provenance.get(key, "").split("; ") if "=" in pair)


def told_statuses(provenance: Mapping[str, str]) -> dict[str, str]:
    """Of each parameter that is not valid, by its name, as a network's provenance tells it."""
    return told(provenance, STATUS)


def told_deviations(network: "NortonNetwork") -> dict[str, float]:
    """The standard deviation of each parameter that has one, by its name: from the covariance, else as told."""
    more = {name: float(text) for name, text in told(network.provenance, DEVIATION).items()}
    stds = np.sqrt([row[place] for place, row in enumerate(network.covariance)])
    return more | dict(zip(network.covariance_names, stds.tolist(), strict=True))


@dataclass(frozen=True)
class NortonNetwork:
    """A motion source and a nonlinear impedance, for an actuator whose command is in ``command_unit``.

    ``torque_gain`` is in N m per command; ``torque_constant`` [N m/A] and ``amplifier_gain`` [A per command] are there
    only where current was measured. ``covariance`` belongs to ``covariance_names`` (names of the table of parameters),
    row by row; ``provenance`` says in words where the network comes from.
    """

    torque_gain: float
    amplifier_bandwidth_rad_s: float
    inertia_kgm2: float
    viscous_damping_nms_rad: float
    coulomb_torque_nm: float
    presliding_stiffness_nm_rad: float
    presliding_damping_nms_rad: float
    command_unit: str
    torque_constant: float | None = None
    amplifier_gain: float | None = None
    torque_limit_nm: float | None = None
    covariance_names: tuple[str, ...] = ()
    covariance: tuple[tuple[float, ...], ...] = ()
    provenance: Mapping[str, str] = field(default_factory=dict)
    prediction: PredictionError | None = None  # how far it is off on motion not seen, where that was looked at
    terms: tuple[NetworkTerm, ...] = ()  # what it has beside the paper's motor
    servo: Servo | None = None  # its own loop: c is then the lag of what the shaft leaves of the command

    @classmethod
    def of_parameters(cls, values: Mapping[str, float], command_unit: str, **more: Any) -> "NortonNetwork":
        """From values by the names of the table of parameters; ``more`` are other fields by their own names."""
        named: dict[str, Any] = {field: values[name] for field, name in PARAMETER_OF_FIELD.items() if name in values}
        return cls(**named, command_unit=command_unit, **more)

    def dissipative(self) -> "NortonNetwork":
        """The same with dampings no less than none: one that the data hardly tell may come out below zero, and a motion
        predicted with it would run away."""
        return replace(
            self,
            viscous_damping_nms_rad=max(self.viscous_damping_nms_rad, 0.0),
            presliding_damping_nms_rad=max(self.presliding_damping_nms_rad, 0.0),
        )

    @property
    def thresholds(self) -> tuple[float, float]:
        """The commands, lower and upper, at which a shaft at rest begins to move; what changes with the position is
        taken at its mean."""
        return sliding.thresholds(self)

    def source_velocity(self, command: npt.ArrayLike) -> FloatArray:
        """ω_N(c) [rad/s], the steady free velocity: three branches (section IV.D), of the shape of ``command``.

        A servo that holds a position has none: it goes where its command says.

        Of a shaft that was at rest: where friction falls with the velocity, it may go on sliding at commands that would
        not set it in motion. What changes with the position is taken at its mean. Infinite where nothing holds it.
        """
        return sliding.source_velocity(self, command)

    def free_motion(
        self,
        command: npt.ArrayLike,
        tick_s: float,
        *,
        port_torque_nm: npt.ArrayLike = 0.0,
        position_rad: float = 0.0,
        velocity_rad_s: float = 0.0,
        motor_torque_nm: float = 0.0,
        friction_torque_nm: float = 0.0,
        longest_step_s: float = LONGEST_STEP_S,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The motion source: position [rad], velocity [rad/s] and acceleration [rad/s²] at each tick, shape (n,).

        ``command`` (n,) is held from each tick to the next, and so is ``port_torque_nm``, (n,) or one for all: what the
        shaft exerts on its load where that is not quite zero. The state is that at the first tick;
        ``friction_torque_nm`` is what the deflected contact (σ0·φ) holds then. Steps longer than the default are
        quicker and less exact.
        """
        from norton_bench.models import network_steps  # noqa: PLC0415  (compiled: slow to import)

        phi = friction_torque_nm / self.presliding_stiffness_nm_rad
        held = np.ascontiguousarray(command, dtype=float)
        port = np.ascontiguousarray(np.broadcast_to(np.asarray(port_torque_nm, dtype=float), held.shape))
        start = np.array([position_rad, velocity_rad_s, motor_torque_nm, phi])
        row, waves = self.row, waves_of(self.terms)
        if self.joint is not None:
            from norton_bench.models import joint_steps  # noqa: PLC0415  (compiled: slow to import)

            motion = joint_steps.free_motion(held, port, tick_s, self._motor, self.joint, row, waves, start)
            return motion[0], motion[1], motion[2]
        substeps = ceil(tick_s / longest_step_s - 1e-9)
        motion = network_steps.free_motion(
            held, port, tick_s, substeps, self._motor, row, waves, start, self._loop, self.servo is not None
        )
        return motion[0], motion[1], motion[2]

    @property
    def joint(self) -> tuple[float, float, float, float] | None:
        """k [N m/rad], d [N m s/rad], J [kg m²] and half of the play [rad] of what is between motor and port."""
        return None if joint_of(self.terms) is None else joint_values(self.row, self.inertia_kgm2)

    @property
    def rigid(self) -> "NortonNetwork":
        """The same without what gives between motor and port: one inertia, there."""
        if self.joint is None:
            return self
        kept = tuple(each for each in self.terms if each.term.factor is not Factor.JOINT)
        return replace(self, inertia_kgm2=self.inertia_kgm2 + self.joint[2], terms=kept)

    @property
    def _motor(self) -> tuple[float, float, float, float, float, float, float]:
        """As the compiled integrations take it."""
        return (
            self.torque_gain,
            self.amplifier_bandwidth_rad_s,
            self.inertia_kgm2,
            self.viscous_damping_nms_rad,
            self.presliding_stiffness_nm_rad / self.coulomb_torque_nm,
            self.presliding_stiffness_nm_rad,
            self.presliding_damping_nms_rad,
        )

    def torque(
        self,
        command: npt.ArrayLike,
        position_rad: npt.ArrayLike,
        tick_s: float,
        *,
        motor_torque_nm: float = 0.0,
        friction_torque_nm: float = 0.0,
    ) -> FloatArray:
        """The impedance: port torque [N m] at each tick, shape (n,), under a motion sampled at the ticks.

        ``position_rad`` is differentiated twice: give it smooth. The state is that at the first tick.
        """
        from norton_bench.models import network_steps  # noqa: PLC0415  (compiled: slow to import)

        position = np.ascontiguousarray(position_rad, dtype=float)
        held = np.ascontiguousarray(command, dtype=float)
        lagged = self._lagged(held, position, tick_s, motor_torque_nm / self.torque_gain)
        row, s = self.row, self.presliding_stiffness_nm_rad / self.coulomb_torque_nm
        if self.joint is not None:
            return self._torque_behind(self.joint, held, position, tick_s, motor_torque_nm, friction_torque_nm)
        velocity = np.gradient(position, tick_s)
        known = self.torque_gain * network_steps.gains(row, lagged, position) * lagged
        known -= self.inertia_kgm2 * _second_difference(position, tick_s)
        known -= self.viscous_damping_nms_rad * (1.0 + row[DRAG] * np.abs(velocity)) * velocity
        for periods, cosine, sine in waves_of(self.terms):
            known += cosine * np.cos(periods * position) + sine * np.sin(periods * position)
        torque, start = known, friction_torque_nm / self.presliding_stiffness_nm_rad
        for _ in range(LOAD_ITERATIONS if row[LOAD] else 1):
            strengths = network_steps.strengths(row, velocity, position, torque)
            phi = network_steps.dahl_path(position, s, strengths, start)
            torque = known - self.presliding_stiffness_nm_rad * phi
            torque -= self.presliding_damping_nms_rad * np.gradient(phi, tick_s)
        return np.asarray(torque)

    def _torque_behind(
        self,
        joint: tuple[float, float, float, float],
        held: FloatArray,
        position: FloatArray,
        tick_s: float,
        motor_torque_nm: float,
        friction_torque_nm: float,
    ) -> FloatArray:
        """The impedance behind a joint. The motor begins where the port is, as fast as that."""
        from scipy.interpolate import CubicSpline  # noqa: PLC0415  (as the next: slow to import)

        from norton_bench.models import joint_steps, network_steps  # noqa: PLC0415

        if position.size < 2:
            return np.zeros(position.size)
        parts = ceil(tick_s / LONGEST_STEP_S - 1e-9)
        step_s, ticks = tick_s / parts, np.arange(position.size)
        fine = CubicSpline(ticks, position)(np.arange((position.size - 1) * parts + 1) / parts)
        decay = float(np.exp(-self.amplifier_bandwidth_rad_s * step_s))
        start = motor_torque_nm / self.torque_gain
        asked = np.repeat(held, parts)[: fine.size]
        lagged = network_steps.lagged(asked, decay, start)
        mean_decay = (1.0 - decay) / (self.amplifier_bandwidth_rad_s * step_s)
        drive = self.torque_gain * (asked + (lagged - asked) * mean_decay)
        state = [fine[0], (fine[1] - fine[0]) / step_s, friction_torque_nm / self.presliding_stiffness_nm_rad]
        carried = joint_steps.behind(
            fine, drive, step_s, self._motor, joint, self.row, waves_of(self.terms),
            np.ones((2, 1)), np.zeros(1, dtype=np.int64), np.array([state]), 0.0,
        )  # fmt: skip
        return np.asarray(carried[::parts] - joint[2] * _second_difference(position, tick_s))

    def _lagged(self, command: FloatArray, position_rad: FloatArray, tick_s: float, start: float) -> FloatArray:
        """Behind the amplifier's lag, at every tick (n,), per unit of gain."""
        from norton_bench.models import network_steps, servo_steps  # noqa: PLC0415  (compiled: slow to import)

        bandwidth_rad_s = self.amplifier_bandwidth_rad_s
        if self.servo is None:
            return network_steps.lagged(command, float(np.exp(-bandwidth_rad_s * tick_s)), start)
        substeps = ceil(tick_s / LONGEST_STEP_S - 1e-9)
        return servo_steps.lagged(command, position_rad, bandwidth_rad_s, tick_s, substeps, self._loop, start)

    @property
    def holds_position(self) -> bool:
        """Whether its command is a position, which the loop of a servo holds: its source is then a place."""
        return self.servo is not None and self.servo.holds_position

    @property
    def _loop(self) -> tuple[float, float, float, float, float]:
        """As the compiled integrations take it (:mod:`norton_bench.models.servo_steps`); nothing without a servo."""
        if (servo := self.servo) is None:
            return 0.0, 0.0, 0.0, 1.0, inf
        limit = inf if self.torque_limit_nm is None else self.torque_limit_nm / abs(self.torque_gain)
        return servo.of_angle, servo.of_velocity, servo.delay_s, servo.window_s, limit

    @property
    def relative_terms(self) -> tuple[NetworkTerm, ...]:
        """Its factors with values over those that they are relative to."""
        own = {name: getattr(self, field) for field, name in PARAMETER_OF_FIELD.items()}
        return tuple(term.relative_to(own) for term in factors_of(self.terms))

    @property
    def row(self) -> FloatArray:
        """What the factors of its terms are computed from (:mod:`norton_bench.models.network_steps`)."""
        return row_of(self.relative_terms)

    def parameters(self) -> dict[str, tuple[float, str]]:
        """Value and unit of each parameter that it has, by the names of the table of parameters."""
        return {
            name: (value, BY_NAME[name].unit_for(self.command_unit))
            for attribute, name in PARAMETER_OF_FIELD.items()
            if (value := getattr(self, attribute)) is not None
        }

    def values(self) -> dict[str, float]:
        """Of these parameters and of those of its terms, by name; of several waves of cogging the last."""
        own = {name: value for name, (value, _) in self.parameters().items()}
        return own | {name: value for term in self.terms for name, value in term.named().items()}

    def with_values(self, values: Mapping[str, float]) -> "NortonNetwork":
        """The same with those of ``values``, by the names of parameters, its own and its terms'; what these do not have
        stays."""
        own: dict[str, Any] = {field: values[name] for field, name in PARAMETER_OF_FIELD.items() if name in values}
        return replace(self, terms=tuple(term.with_values(values) for term in self.terms), **own)

    def with_provenance(self, provenance: Mapping[str, str]) -> "NortonNetwork":
        """The same network, with more said of where it comes from."""
        return replace(self, provenance={**self.provenance, **provenance})

    def save(self, path: Path | str) -> None:
        """Write the network as JSON (docs/identification.md). Raises UsageError where that is impossible."""
        try:
            Path(path).write_text(json.dumps(self._as_json(), indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
        except OSError as error:
            sentence = f"{path}: cannot write the network file ({error.strerror}); choose another place"
            raise UsageError(sentence) from error

    def _as_json(self) -> dict[str, Any]:
        parameters = {name: {"value": value, "unit": unit} for name, (value, unit) in self.parameters().items()}
        return {
            "format": FORMAT,
            "version": VERSION_WITH_TERMS if self.terms or self.servo else VERSION,
            "command_unit": self.command_unit,
            "parameters": parameters,
            **({"terms": [term_as_json(term, self.command_unit) for term in self.terms]} if self.terms else {}),
            **({} if self.servo is None else {"servo": servo_as_json(self.servo)}),
            "covariance": {"names": list(self.covariance_names), "matrix": [list(row) for row in self.covariance]},
            **({} if self.prediction is None else {"prediction": self.prediction.as_json(self.command_unit)}),
            "provenance": dict(self.provenance),
        }

    @classmethod
    def load(cls, path: Path | str) -> "NortonNetwork":
        """Read a network file. Raises UsageError, in a sentence, for a file that is none."""
        content = read_network(path)
        covariance = as_object(content.get("covariance", {}))
        return cls(
            **_read_parameters(path, as_object(content.get("parameters"))),
            command_unit=content["command_unit"],
            covariance_names=tuple(str(name) for name in covariance.get("names", [])),
            covariance=read_matrix(path, covariance),
            provenance={str(key): str(value) for key, value in as_object(content.get("provenance", {})).items()},
            prediction=read_prediction(path, content.get("prediction")),
            terms=tuple(read_term(path, as_object(each)) for each in content.get("terms") or ()),
            servo=None if content.get("servo") is None else servo_from_json(path, content["servo"]),
        )


def impossible(name: str, value: float) -> bool:
    """Whether no network may have this value of a parameter of the table."""
    return (value < 0.0 and name not in SIGNED) or (value == 0.0 and name != "presliding_damping")


def _second_difference(position: FloatArray, tick_s: float) -> FloatArray:
    if position.size <= 2:
        return np.zeros_like(position)
    return np.asarray(np.pad(np.diff(position, 2), 1, mode="edge") / tick_s**2)


def _read_parameters(path: Path | str, parameters: dict[str, Any]) -> dict[str, float]:
    values = {}
    for attribute, name in PARAMETER_OF_FIELD.items():
        value = as_object(parameters.get(name)).get("value")
        if value is None and attribute not in REQUIRED:
            continue
        if not isinstance(value, (int, float)) or isinstance(value, bool) or not isfinite(value):
            raise UsageError(f'{path}: parameters.{name} needs a finite number under "value", not {value!r}')
        if impossible(name, value):
            raise UsageError(f"{path}: parameters.{name} = {value} is not possible; it must be positive")
        values[attribute] = float(value)
    return values
