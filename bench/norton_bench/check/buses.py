"""One bus judged: how busy it is, who is heard, who shares an address."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from norton_bench.check.doubles import answered_twice, two_rhythms
from norton_bench.check.findings import BusCheck, Problem
from norton_bench.check.senders import Claim, Claims, by_sender, claims_of, claims_on, in_words, senders_on
from norton_bench.check.survey import BusSurvey, HeardId
from norton_bench.errors import ExperimentError
from norton_drivers.recognition import Recognition, answers_remotely
from norton_drivers.wiring import CanBusSettings, DeviceSettings

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
    load = survey.bits / took_s / settings.bitrate_bit_s
    return BusCheck(
        settings.name,
        settings.interface,
        settings.channel,
        survey.frames,
        survey.frames / took_s,
        load,
        senders_on(survey, claims),
        tuple(heard.name for key, heard in sorted(survey.heard.items()) if key not in known),
        dict(troubles),
        (*_overfull(settings, load), *_problems(settings, _Bus(survey, claims, devices, recognition))),
    )


def remarks_on(bus: BusCheck, bitrate_bit_s: int) -> Iterator[str]:
    """What is worth knowing of it."""
    for what, count in bus.troubles.items():
        yield f"bus {bus.name}: {what}, {count} times while it was watched"
    if BUSY < bus.load <= FULL:
        yield (
            f"bus {bus.name}: {bus.load:.0%} of its {bitrate_bit_s} bit/s are taken; let devices send less often, or "
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
        found: dict[str, str] = {}
        offered = [each.answers for each in self.recognition.values() if each.answers is not None]
        for frame in answered_twice(self.survey, [answers_remotely, *offered]):
            claims = list(claims_of(frame, self.recognition, self.devices))
            found.setdefault(_who(claims, self.survey.heard[frame.arbitration_id, frame.extended]), _TWICE)
        for key, heard in sorted(self.survey.heard.items()):
            for claims, arrivals_ns in by_sender(heard, self.claims.get(key, ()), self.recognition, self.devices):
                if two_rhythms(arrivals_ns):
                    found.setdefault(_who(claims, heard), f"{heard.name} comes from two senders")
        return found

    def commanded(self) -> dict[str, str]:
        """Devices of the rig that are commanded by somebody else, and the identifier of the commands."""
        found: dict[str, str] = {}
        for key, claimed in self.claims.items():
            for each in claimed:
                if each.claim.from_host and each.role is not None:
                    found.setdefault(each.role, self.survey.heard[key].name)
        return found


def _overfull(settings: CanBusSettings, load: float) -> Iterator[Problem]:
    if load > FULL:
        yield ExperimentError(
            f"bus {settings.name}: its devices send {load:.0%} of what {settings.bitrate_bit_s} bit/s can carry; raise "
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


def _who(claims: Sequence[Claim], heard: HeardId) -> str:
    ours = next((each.role for each in claims if each.role is not None), None)
    if ours is not None:
        return f"[{ours}]"
    return next((f"{each.claim.device} at {in_words(each.claim.options)}" for each in claims), heard.name)
