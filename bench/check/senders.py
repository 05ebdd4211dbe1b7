"""Who is heard on a bus: the frames shown to every driver that offers to recognise them."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from bench.check.findings import Sender
from bench.check.survey import BusSurvey, HeardId, Key
from bench.rig.mistakes import toml
from drivers.recognition import Recognised, Recogniser
from drivers.wiring import DeviceSettings

Claims = dict[Key, list[tuple[str, Recognised]]]  # by identifier: which driver takes it for what


def claims_on(survey: BusSurvey, recognisers: Mapping[str, Recogniser], devices: Sequence[DeviceSettings]) -> Claims:
    """What each driver takes each identifier for; claims that are not sure stand only beside one that is."""
    options = {device.driver: device.options for device in devices}
    claims: Claims = {key: list(_claims(heard, recognisers, options)) for key, heard in survey.heard.items()}
    present = {_who(driver, claim) for claimed in claims.values() for driver, claim in claimed if claim.sure}
    return {key: [each for each in claimed if _who(*each) in present] for key, claimed in claims.items()}


def senders_on(survey: BusSurvey, claims: Claims, devices: Sequence[DeviceSettings]) -> tuple[Sender, ...]:
    """One for each device that is heard. What a device of the rig sends is not taken for a stranger's as well."""
    found: dict[tuple[Any, ...], list[tuple[Recognised, int]]] = defaultdict(list)
    for key, claimed in claims.items():
        ours = any(owner(*each, devices) for each in claimed)
        for driver, claim in claimed:
            if not claim.from_host and (not ours or owner(driver, claim, devices)):
                found[_who(driver, claim)].append((claim, survey.heard[key].count))
    return tuple(_sender(str(who[0]), said, devices) for who, said in sorted(found.items(), key=str))


def in_words(options: Mapping[str, Any]) -> str:
    """Options as a rig file has them."""
    return ", ".join(f"{name} = {toml(value)}" for name, value in options.items())


def _claims(
    heard: HeardId, recognisers: Mapping[str, Recogniser], options: Mapping[str, Mapping[str, Any]]
) -> Iterator[tuple[str, Recognised]]:
    message = heard.message()
    for driver, recognise in recognisers.items():
        claim = recognise(message, options.get(driver, {}))
        if claim is not None:
            yield driver, claim


def _who(driver: str, claim: Recognised) -> tuple[Any, ...]:
    return (driver, *sorted(claim.options.items()))


def owner(driver: str, claim: Recognised, devices: Sequence[DeviceSettings]) -> str | None:
    """The role of the rig's device that sends this, by its driver and its options."""
    return next((each.role for each in devices if each.driver == driver and _matches(claim.options, each)), None)


def _matches(options: Mapping[str, Any], settings: DeviceSettings) -> bool:
    return all(settings.options.get(name) == value for name, value in options.items())


def _sender(driver: str, said: Sequence[tuple[Recognised, int]], devices: Sequence[DeviceSettings]) -> Sender:
    surest = sorted(said, key=lambda each: (not each[0].sure, each[0].says))
    claim = surest[0][0]
    return Sender(
        driver,
        claim.device,
        dict(claim.options),
        tuple(each.says for each, _ in surest),
        sum(count for _, count in said),
        owner(driver, claim, devices),
    )
