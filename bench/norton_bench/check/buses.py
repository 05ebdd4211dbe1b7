"""One bus judged: how busy it is, who is heard, who shares an address."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.check.survey import BusCheck, BusSurvey, HeardId, Key, Problem, Sender, message_of
from norton_bench.errors import ExperimentError
from norton_bench.rig.files import toml
from norton_drivers.readings import RawFrame
from norton_drivers.registry import Answers, Recognised, Recognition, answers_remotely
from norton_drivers.wiring import CanBusSettings, DeviceSettings


# Who is heard on a bus: the frames shown to every driver that offers to recognise them.
class Claim(NamedTuple):
    """Which driver takes a frame for what, and the role of the rig's device that then sent it, if any did."""

    driver: str
    claim: Recognised
    role: str | None

    @property
    def who(self) -> tuple[Any, ...]:
        """The sender, by its driver and how it is reached."""
        return (self.driver, *sorted(self.claim.options.items()))


Claims = dict[Key, list[Claim]]  # by identifier


def claims_on(survey: BusSurvey, recognition: Mapping[str, Recognition], devices: Sequence[DeviceSettings]) -> Claims:
    """What each driver takes each identifier for; claims that are not sure stand only beside one that is."""
    claims: Claims = {}
    for key, received in survey.heard.items():
        each = (claim for frame in received.samples.values() for claim in claims_of(frame, recognition, devices))
        claims[key] = list({(claim.who, claim.claim.says): claim for claim in each}.values())
    sure = [claim for claimed in claims.values() for claim in claimed if claim.claim.sure]
    # A frame that does not tell which of its kind sent it belongs to any of them.
    present = {claim.who for claim in sure} | {(claim.driver,) for claim in sure}
    return {key: [each for each in claimed if each.who in present] for key, claimed in claims.items()}


def by_sender(
    heard: HeardId, claims: Sequence[Claim], recognition: Mapping[str, Recognition], devices: Sequence[DeviceSettings]
) -> Iterator[tuple[list[Claim], list[int]]]:
    """The arrivals [ns] of one identifier's frames, parted by who sent them as far as ``claims`` tell: several devices
    may answer under one identifier, each in its own rhythm."""
    standing = {claim.who for claim in claims}
    claimed = {
        begins: [claim for claim in claims_of(frame, recognition, devices) if claim.who in standing]
        for begins, frame in heard.samples.items()
    }
    parts: dict[frozenset[tuple[Any, ...]], tuple[list[Claim], list[int]]] = {}
    for begins, arrival_ns in zip(heard.begun, heard.arrivals_ns, strict=True):
        claims = claimed.get(begins, [])
        parts.setdefault(frozenset(claim.who for claim in claims), (claims, []))[1].append(arrival_ns)
    yield from parts.values()


def claims_of(
    frame: RawFrame, recognition: Mapping[str, Recognition], devices: Sequence[DeviceSettings]
) -> Iterator[Claim]:
    """What each driver takes one frame for."""
    options = {device.driver: device.options for device in devices}
    message = message_of(frame)
    for driver, offered in recognition.items():
        claim = offered.recognise(message, options.get(driver, {})) if offered.recognise is not None else None
        if claim is not None:
            yield Claim(driver, claim, owner(driver, claim, devices))


def senders_on(survey: BusSurvey, claims: Claims) -> tuple[Sender, ...]:
    """One for each device that is heard. What a device of the rig sends is not taken for a stranger's as well."""
    result: dict[tuple[Any, ...], list[tuple[Claim, int]]] = defaultdict(list)
    for key, claimed in claims.items():
        ours = any(each.role is not None for each in claimed)
        for each in claimed:
            anybodys = not (each.claim.sure or each.claim.options)
            if not (each.claim.from_host or anybodys) and (not ours or each.role is not None):
                result[each.who].append((each, survey.heard[key].count))
    return tuple(_sender(claims) for _, claims in sorted(result.items(), key=str))


def in_words(options: Mapping[str, Any]) -> str:
    """Options as a rig file has them."""
    return ", ".join(f"{name} = {toml(value)}" for name, value in options.items())


def owner(driver: str, claim: Recognised, devices: Sequence[DeviceSettings]) -> str | None:
    """The role of the rig's device that sends this, by its driver and its options."""
    return next((each.role for each in devices if each.driver == driver and _matches(claim.options, each)), None)


def _matches(options: Mapping[str, Any], settings: DeviceSettings) -> bool:
    return all(settings.options.get(name) == value for name, value in options.items())


def _sender(claims: Sequence[tuple[Claim, int]]) -> Sender:
    surest = sorted(claims, key=lambda each: (not each[0].claim.sure, each[0].claim.says))
    first = surest[0][0]
    says = dict.fromkeys(each.claim.says for each, _ in surest)
    frames = sum(count for _, count in claims)
    return Sender(first.driver, first.claim.device, dict(first.claim.options), tuple(says), frames, first.role)


_READINGS_MIN = 40
# A rhythm is judged where the period is long against what an adapter and the host may hold frames up.
_SLOWEST_SEEN_NS = 20_000_000
_GAPS_MIN = 8
_STEADY = 0.15  # of the period
_APART = 0.15
_MOST = 0.8  # of the gaps: the host may be late now and then


# Two devices that share one address: two answers to one question, two rhythms in one stream, values that contradict
# each other.
def answered_twice(survey: BusSurvey, answers: Sequence[Answers]) -> list[RawFrame]:
    """An answer of each device whose every question had two."""
    counts: dict[tuple[Key, bytes], list[int]] = {}
    example: dict[tuple[Key, bytes], RawFrame] = {}
    for question, result in survey.answered(answers):
        asked = ((question.arbitration_id, question.extended), b"" if question.remote else question.data)
        counts.setdefault(asked, []).append(len(result))
        example[asked] = result[0]
    return [example[asked] for asked, each in counts.items() if min(each) >= 2 and median(each) == 2]


def two_rhythms(arrivals_ns: Sequence[int]) -> bool:
    """Whether every other arrival belongs to one steady stream, and those between to another.

    Not to be seen where the second falls into the middle of the first's period.
    """
    gaps = np.diff(np.asarray(arrivals_ns, float))
    if len(gaps) < _GAPS_MIN:
        return False
    periods, changes = gaps[:-1] + gaps[1:], np.diff(gaps)
    period = float(np.median(periods))
    steady = np.mean(np.abs(periods - period) < _STEADY * period)
    # Of one device, a gap is followed by one of its like; of two, by what is left of the period.
    alternating = np.mean((changes[:-1] * changes[1:] < 0) & (np.abs(changes[1:]) > _APART * period))
    return bool(period >= _SLOWEST_SEEN_NS and steady > _MOST and alternating > _MOST)


def contradictory(values: Sequence[float]) -> bool:
    """Whether readings at rest jump to and fro between two values, as those of two devices do."""
    readings: FloatArray = np.asarray(values, float)
    readings = readings[np.isfinite(readings)]
    if len(readings) < _READINGS_MIN:
        return False
    # Means, for a reading that flickers by its last bit has medians of anything.
    to_next = float(np.mean(np.abs(np.diff(readings))))
    to_after_next = float(np.mean(np.abs(readings[2:] - readings[:-2])))
    return to_next > 5 * to_after_next


# A bus as busy as this holds frames back now and then.
BUSY = 0.7
FULL = 1.0  # no bus carries more; what is rehearsed without one may seem to
_TWICE = "each question has two answers"


def check_bus(
    settings: CanBusSettings,
    survey: BusSurvey,
    devices: Sequence[DeviceSettings],
    recognition: Mapping[str, Recognition],
    troubles: Mapping[str, int],
    took_s: float,
) -> BusCheck:
    """``devices`` are those of the rig on this bus, ``troubles`` what was counted on it."""
    claims = claims_on(survey, recognition, devices)
    known = {key for key, claimed in claims.items() if claimed}
    second_bit_s = settings.data_bitrate_bit_s or settings.bitrate_bit_s
    load = (survey.bits / settings.bitrate_bit_s + survey.data_bits / second_bit_s) / took_s
    overfull = _overfull(settings, load)
    return BusCheck(
        settings.name,
        settings.interface,
        settings.channel,
        survey.frames,
        survey.frames / took_s,
        load,
        senders_on(survey, claims),
        tuple(received.name for key, received in sorted(survey.heard.items()) if key not in known),
        dict(troubles),
        (
            *(() if overfull is None else (overfull,)),
            *_problems(settings, _Bus(survey, claims, devices, recognition)),
        ),
        overfull,
    )


def remarks_on(bus: BusCheck, rates: str) -> Iterator[str]:
    """What is worth knowing of it."""
    for what, count in bus.troubles.items():
        yield f"bus {bus.name}: {what}, {count} times while it was watched"
    if BUSY < bus.load <= FULL:
        yield (
            f"bus {bus.name}: {bus.load:.0%} of its {rates} are taken; let devices send less often, or "
            "put them on two buses"
        )


@dataclass(frozen=True)
class _Bus:
    """All that is known of what passed on one bus."""

    survey: BusSurvey
    claims: Claims
    devices: Sequence[DeviceSettings]
    recognition: Mapping[str, Recognition]

    def shared(self) -> dict[str, str]:
        """Who there are two of, and how that shows."""
        result: dict[str, str] = {}
        offered = [each.answers for each in self.recognition.values() if each.answers is not None]
        for frame in answered_twice(self.survey, [answers_remotely, *offered]):
            claims = list(claims_of(frame, self.recognition, self.devices))
            result.setdefault(_who(claims, self.survey.heard[frame.arbitration_id, frame.extended]), _TWICE)
        for key, received in sorted(self.survey.heard.items()):
            for claims, arrivals_ns in by_sender(received, self.claims.get(key, ()), self.recognition, self.devices):
                if two_rhythms(arrivals_ns):
                    result.setdefault(_who(claims, received), f"{received.name} comes from two senders")
        return result

    def commanded(self) -> dict[str, str]:
        """Devices of the rig that are commanded by somebody else, and the identifier of the commands."""
        result: dict[str, str] = {}
        for key, claimed in self.claims.items():
            for each in claimed:
                if each.claim.from_host and each.role is not None:
                    result.setdefault(each.role, self.survey.heard[key].name)
        return result


def _overfull(settings: CanBusSettings, load: float) -> Problem | None:
    if load <= FULL:
        return None
    return ExperimentError(
        f"bus {settings.name}: its devices send {load:.0%} of what {settings.rates} can carry; raise "
        "bitrate in every device and in the rig file, let devices send less often, or put them on two buses"
    )


def _problems(settings: CanBusSettings, bus: _Bus) -> Iterator[Problem]:
    for who, seen in bus.shared().items():
        yield ExperimentError(
            f"bus {settings.name}: two devices share the address of {who} ({seen}); give each one of its own"
        )
    for role, name in bus.commanded().items():
        yield ExperimentError(
            f"bus {settings.name}: somebody else commands [{role}] ({name}); stop the other program, or the other "
            "computer"
        )


def _who(claims: Sequence[Claim], received: HeardId) -> str:
    ours = next((each.role for each in claims if each.role is not None), None)
    if ours is not None:
        return f"[{ours}]"
    return next((f"{each.claim.device} at {in_words(each.claim.options)}" for each in claims), received.name)
