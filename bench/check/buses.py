"""One bus judged: how busy it is, who is heard, who shares an address."""

from collections.abc import Iterator, Mapping, Sequence

from bench.check.doubles import answered_twice, sent_by_two
from bench.check.findings import BusCheck, Problem
from bench.check.senders import Claims, claims_on, in_words, owner, senders_on
from bench.check.survey import BusSurvey, Key
from bench.errors import ExperimentError
from drivers.recognition import Recogniser
from drivers.wiring import CanBusSettings, DeviceSettings

# A bus as busy as this holds frames back now and then.
BUSY = 0.7


def check_bus(
    settings: CanBusSettings,
    survey: BusSurvey,
    devices: Sequence[DeviceSettings],
    recognisers: Mapping[str, Recogniser],
    troubles: Mapping[str, int],
    took_s: float,
) -> BusCheck:
    """``devices`` are those of the rig on this bus, ``troubles`` what was counted on it."""
    claims = claims_on(survey, recognisers, devices)
    known = {key for key, claimed in claims.items() if claimed}
    return BusCheck(
        settings.name,
        settings.interface,
        settings.channel,
        survey.frames,
        survey.frames / took_s,
        survey.bits / took_s / settings.bitrate_bit_s,
        senders_on(survey, claims, devices),
        tuple(heard.name for key, heard in sorted(survey.heard.items()) if key not in known),
        dict(troubles),
        tuple(_problems(settings, survey, claims, devices)),
    )


def remarks_on(bus: BusCheck, bitrate_bit_s: int) -> Iterator[str]:
    """What is worth knowing of it."""
    for what, count in bus.troubles.items():
        yield f"bus {bus.name}: {what}, {count} times while it was watched"
    if bus.load > BUSY:
        yield (
            f"bus {bus.name}: {bus.load:.0%} of its {bitrate_bit_s} bit/s are taken; let devices send less often, or "
            "put them on two buses"
        )


def _problems(
    settings: CanBusSettings, survey: BusSurvey, claims: Claims, devices: Sequence[DeviceSettings]
) -> Iterator[Problem]:
    for who, seen in _shared(survey, claims, devices).items():
        yield ExperimentError(
            f"bus {settings.name}: two devices share the address of {who} ({seen}); give each one of its own"
        )
    for role, name in _commanded(survey, claims, devices).items():
        yield ExperimentError(
            f"bus {settings.name}: somebody else commands [{role}] ({name}); stop the other program, or the other "
            "computer"
        )


def _shared(survey: BusSurvey, claims: Claims, devices: Sequence[DeviceSettings]) -> dict[str, str]:
    """Who there are two of, and how that shows."""
    found: dict[str, str] = {}
    for key in sorted(answered_twice(survey)):
        found.setdefault(_who(key, survey, claims, devices), "each question has two answers")
    for key in sorted(sent_by_two(survey)):
        found.setdefault(_who(key, survey, claims, devices), f"{survey.heard[key].name} comes from two senders")
    return found


def _commanded(survey: BusSurvey, claims: Claims, devices: Sequence[DeviceSettings]) -> dict[str, str]:
    """Devices of the rig that are commanded by somebody else, and the identifier of the commands."""
    found: dict[str, str] = {}
    for key, claimed in claims.items():
        for driver, claim in claimed:
            role = owner(driver, claim, devices) if claim.from_host else None
            if role is not None:
                found.setdefault(role, survey.heard[key].name)
    return found


def _who(key: Key, survey: BusSurvey, claims: Claims, devices: Sequence[DeviceSettings]) -> str:
    for driver, claim in claims.get(key, ()):
        if role := owner(driver, claim, devices):
            return f"[{role}]"
    for _, claim in claims.get(key, ()):
        return f"{claim.device} at {in_words(claim.options)}"
    return survey.heard[key].name
