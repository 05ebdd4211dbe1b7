"""What may stand in a session file's tables: the options of every step, conditions, expectations, and what repeats."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from norton_bench.procedures.options import (
    BlockedOptions,
    CalibrateOptions,
    FreeOptions,
    History,
    ImposedOptions,
    InSituOptions,
    IterateOptions,
    Options,
    RefineOptions,
    RestOptions,
    TabulateImpedanceOptions,
    TabulateSourceOptions,
    TareOptions,
    ValidateOptions,
)
from norton_bench.session.conditions import Comparison, Condition, compared, parameter_name, share, status_name
from norton_bench.session.items import AskOptions, Expectation
from norton_bench.units import MOST_IN_RANGE, parse_quantity, parse_range, quantity_in


def _velocities(written: object) -> tuple[float, ...]:
    """A range "-40:8:40 rad/s" or a list of quantities, in rad/s."""
    if written == []:
        raise ValueError('names no velocity; write "-40:8:40 rad/s", or leave the key out')
    if isinstance(written, list):
        return tuple(parse_quantity(each, "rad/s") for each in written)
    return parse_range(written, "rad/s")


def _texts(written: object) -> object:
    return tuple(written) if isinstance(written, list) else written


def _quantity_text(written: object) -> str:
    if not isinstance(written, str):
        raise ValueError(f'expected a quantity in quotes such as "0.02 N*m", not {written!r}')  # noqa: TRY004
    return written


MOST_LEVELS = MOST_IN_RANGE  # as many as can be written as a range

Seconds = Annotated[float, quantity_in("s")]
Hertz = Annotated[float, quantity_in("Hz")]
Damping = Annotated[float, quantity_in("N*m*s/rad")]
Inertia = Annotated[float, quantity_in("kg*m^2")]
Fraction = Annotated[float, quantity_in("")]
ParameterName = Annotated[str, AfterValidator(parameter_name)]
StatusName = Annotated[str, AfterValidator(status_name)]
Compared = Annotated[Comparison, BeforeValidator(compared)]
Share = Annotated[Comparison, BeforeValidator(share)]


class StepModel(BaseModel):
    """Base of every step's options; fields are named as in :mod:`norton_bench.procedures.options`."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid", arbitrary_types_allowed=True)


class _Tare(StepModel):
    duration_s: Seconds = Field(TareOptions.duration_s, alias="duration", ge=0.5, examples=["2 s"])


class _Calibrate(StepModel):
    duration_s: Seconds = Field(CalibrateOptions.duration_s, alias="duration", ge=2, examples=["8 s"])


class _Free(StepModel):
    amplitude: Fraction = Field(FreeOptions.amplitude, gt=0, le=1, examples=["60 %"])
    levels: int = Field(FreeOptions.levels, ge=3, le=MOST_LEVELS, examples=[11])
    dwell_s: Seconds = Field(FreeOptions.dwell_s, alias="dwell", ge=0.1, examples=["400 ms"])
    duration_s: Seconds = Field(FreeOptions.duration_s, alias="duration", ge=1, examples=["12 s"])


class _Blocked(StepModel):
    levels: int = Field(BlockedOptions.levels, ge=2, le=MOST_LEVELS, examples=[5])
    hold_s: Seconds = Field(BlockedOptions.hold_s, alias="hold", ge=0.1, examples=["500 ms"])
    histories: Annotated[tuple[History, ...], BeforeValidator(_texts)] = Field(
        BlockedOptions.histories, min_length=1, examples=[["slow", "fast", "rest"]]
    )


class _Imposed(StepModel):
    amplitude: Fraction = Field(ImposedOptions.amplitude, gt=0, le=1, examples=["50 %"])
    velocities_rad_s: Annotated[tuple[float, ...], BeforeValidator(_velocities)] = Field(
        ImposedOptions.velocities_rad_s, alias="velocities", examples=["-40:8:40 rad/s"]
    )
    commands: int = Field(ImposedOptions.commands, ge=1, le=MOST_LEVELS, examples=[3])
    duration_s: Seconds = Field(ImposedOptions.duration_s, alias="duration", ge=1, examples=["20 s"])


class _Refine(StepModel):
    until: Fraction = Field(RefineOptions.until, gt=0, lt=1, examples=["1 %"])
    at_most_s: Seconds = Field(RefineOptions.at_most_s, alias="at_most", gt=0, examples=["5 min"])


class _Iterate(StepModel):
    trials: int = Field(IterateOptions.trials, ge=4, le=100, examples=[10])
    duration_s: Seconds = Field(IterateOptions.duration_s, alias="duration", ge=2, examples=["8 s"])
    highest_hz: Hertz = Field(IterateOptions.highest_hz, alias="highest", gt=0.2, le=20, examples=["3 Hz"])
    seed: int = Field(IterateOptions.seed, ge=0, examples=[5])


class _InSitu(StepModel):
    trials: int = Field(InSituOptions.trials, ge=4, le=100, examples=[12])
    duration_s: Seconds = Field(InSituOptions.duration_s, alias="duration", ge=2, examples=["8 s"])
    shake_s: Seconds = Field(InSituOptions.shake_s, alias="shake", ge=4, examples=["24 s"])
    highest_hz: Hertz = Field(InSituOptions.highest_hz, alias="highest", gt=0.2, le=20, examples=["3 Hz"])
    amplitude: Fraction = Field(InSituOptions.amplitude, gt=0, le=1, examples=["50 %"])
    left_alone: Fraction = Field(InSituOptions.left_alone, ge=0, lt=1, examples=["25 %"])
    viscous_damping_nms_rad: Damping | None = Field(
        InSituOptions.viscous_damping_nms_rad, alias="viscous_damping", ge=0, examples=["3e-4 N*m*s/rad"]
    )
    inertia_kgm2: Inertia | None = Field(InSituOptions.inertia_kgm2, alias="inertia", gt=0, examples=["1.2e-4 kg*m^2"])
    seed: int = Field(InSituOptions.seed, ge=0, examples=[6])


class _Validate(StepModel):
    duration_s: Seconds = Field(ValidateOptions.duration_s, alias="duration", ge=1, examples=["8 s"])
    seed: int = Field(ValidateOptions.seed, ge=0, examples=[7])


class _Rest(StepModel):
    duration_s: Seconds = Field(RestOptions.duration_s, alias="duration", ge=0.1, le=3600, examples=["10 s"])


class _Tabulate(StepModel):
    """What both tabulations share."""

    settled_rad_s: Annotated[float, quantity_in("rad/s")] = Field(
        TabulateSourceOptions.settled_rad_s, alias="settled", gt=0, examples=["2 mrad/s"]
    )
    at_most_s: Seconds = Field(TabulateSourceOptions.at_most_s, alias="at_most", gt=0, examples=["3 s"])


class _TabulateSource(_Tabulate):
    levels: int = Field(TabulateSourceOptions.levels, ge=2, le=MOST_LEVELS, examples=[7])
    lowest: Fraction = Field(TabulateSourceOptions.lowest, ge=-1, le=1, examples=["-100 %"])
    highest: Fraction = Field(TabulateSourceOptions.highest, ge=-1, le=1, examples=["100 %"])
    port: Literal["actuator", "external"] = Field("actuator", examples=["external"])
    read_s: Seconds = Field(TabulateSourceOptions.read_s, alias="read", ge=0.1, examples=["500 ms"])


class _TabulateImpedance(_Tabulate):
    commands: int = Field(TabulateImpedanceOptions.commands, ge=1, le=MOST_LEVELS, examples=[3])
    lowest: Fraction = Field(TabulateImpedanceOptions.lowest, ge=-1, le=1, examples=["-50 %"])
    highest: Fraction = Field(TabulateImpedanceOptions.highest, ge=-1, le=1, examples=["50 %"])
    displacement_rad: Annotated[float, quantity_in("rad")] = Field(
        TabulateImpedanceOptions.displacement_rad, alias="displacement", gt=0, examples=["50 mrad"]
    )
    steps: int = Field(TabulateImpedanceOptions.steps, ge=1, examples=[4])
    hold_s: Seconds = Field(TabulateImpedanceOptions.hold_s, alias="hold", ge=0.2, examples=["400 ms"])
    shake_rad: Annotated[float, quantity_in("rad")] = Field(
        TabulateImpedanceOptions.shake_rad, alias="shake", ge=0, examples=["5 mrad"]
    )
    sweep_rad_s: Annotated[float, quantity_in("rad/s")] = Field(
        TabulateImpedanceOptions.sweep_rad_s, alias="sweep", ge=0, examples=["50 mrad/s"]
    )


class _Ask(StepModel):
    name: str = Field(pattern=r"^[\w.-]+$", examples=["fixture"])
    text: str = Field(min_length=1, examples=["Which fixture is mounted?"])
    choices: Annotated[tuple[str, ...], BeforeValidator(_texts)] = Field(AskOptions.choices, examples=[["A", "B"]])


ASK = "ask"
GROUP = "group"
STEPS: Mapping[str, tuple[type[StepModel], type[Options]]] = {
    "tare": (_Tare, TareOptions),
    "calibrate": (_Calibrate, CalibrateOptions),
    "free": (_Free, FreeOptions),
    "blocked": (_Blocked, BlockedOptions),
    "imposed": (_Imposed, ImposedOptions),
    "refine": (_Refine, RefineOptions),
    "iterate_zero_torque": (_Iterate, IterateOptions),
    "in_situ": (_InSitu, InSituOptions),
    "rest": (_Rest, RestOptions),
    "tabulate_source": (_TabulateSource, TabulateSourceOptions),
    "tabulate_impedance": (_TabulateImpedance, TabulateImpedanceOptions),
    "validate": (_Validate, ValidateOptions),
}
MODELS: Mapping[str, tuple[type[StepModel], type[Any]]] = {**STEPS, ASK: (_Ask, AskOptions)}


class ConditionModel(StepModel):
    """``{ parameter = ..., value | interval | status = ... }`` or ``{ answer = ..., is = ... }``."""

    parameter: ParameterName = Field("", examples=["coulomb_torque"], validate_default=False)
    value: Compared | None = Field(None, examples=["< 0.03 N*m"])
    interval: Share | None = Field(None, examples=["1 %"])
    status: StatusName = Field("", examples=["valid"], validate_default=False)
    answer: str = Field("", examples=["fixture"])
    expected: str = Field("", alias="is", examples=["A"])

    @model_validator(mode="after")
    def _complete(self) -> "ConditionModel":
        asked = self.value is not None or self.interval is not None or bool(self.status)
        answered = bool(self.answer) and bool(self.expected)
        if (
            bool(self.parameter) == bool(self.answer)
            or (self.parameter and not asked)
            or (self.answer and not answered)
        ):
            raise ValueError(
                'asks for nothing; write { parameter = "coulomb_torque", interval = "1 %" } (or value, or status), '
                'or { answer = "fixture", is = "A" }'
            )
        if (self.answer and asked) or (self.parameter and self.expected):
            raise ValueError("asks for a parameter and for an answer at once; leave one of them out")
        return self

    def condition(self) -> Condition:
        return Condition(self.parameter, self.value, self.interval, self.status, self.answer, self.expected)


class RepeatUntilModel(ConditionModel):
    """The same, with how often at most."""

    at_most: int = Field(ge=1, le=1000, examples=[5])


class ExpectModel(StepModel):
    """One ``[[expect]]``."""

    parameter: ParameterName = Field("", examples=["coulomb_torque"], validate_default=False)
    value: Annotated[str, BeforeValidator(_quantity_text)] = Field("", examples=["0.02 N*m"], validate_default=False)
    within: Annotated[str, BeforeValidator(_quantity_text)] = Field("", examples=["5 %"], validate_default=False)
    interval: Share | None = Field(None, examples=["1 %"])
    status: StatusName = Field("", examples=["valid"], validate_default=False)
    validation: Literal["torque", "velocity", ""] = Field("", examples=["torque"])
    at_most: Fraction | None = Field(None, gt=0, examples=["5 %"])

    @model_validator(mode="after")
    def _complete(self) -> "ExpectModel":
        of_parameter = bool(self.value) or self.interval is not None or bool(self.status)
        if bool(self.parameter) == bool(self.validation) or (self.parameter and not of_parameter):
            raise ValueError(
                'expects nothing; write parameter = "coulomb_torque" with value and within, interval, or status, '
                'or validation = "torque" with at_most'
            )
        if self.validation and (self.at_most is None or of_parameter or self.within):
            raise ValueError('validation = "..." goes with at_most = "5 %", and with nothing else')
        if self.parameter and self.at_most is not None:
            raise ValueError('at_most goes with validation = "torque"; for a parameter write within or interval')
        if self.within and not self.value:
            raise ValueError('within lacks the value it is about; add value = "0.02 N*m"')
        return self

    def expectation(self, where: str) -> Expectation:
        compares = None if self.within or not self.value else compared(self.value)
        condition = Condition(self.parameter, compares, self.interval, self.status)
        if self.validation:
            return Expectation(where, validation=self.validation, at_most=self.at_most or 0.0)
        return Expectation(where, condition, self.value if self.within else "", self.within)


class ControlModel(StepModel):
    """What any step may have beside its own options."""

    when: ConditionModel | None = None
    repeat: int = Field(1, ge=1, le=1000, examples=[3])
    repeat_until: RepeatUntilModel | None = None
    sweep: dict[str, Any] = Field(default_factory=dict, alias="for", examples=[{"speed": ["10 rad/s", "20 rad/s"]}])
    always: bool = Field(default=False, examples=[True])


CONTROL = frozenset(info.alias or name for name, info in ControlModel.model_fields.items())
