"""Who is heard on a bus: the frames shown to every driver that offers to recognise them."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from norton_bench.check.findings import Sender
from norton_bench.check.survey import BusSurvey, HeardId, Key, message_of
from norton_bench.rig.mistakes import toml
from norton_drivers.readings import RawFrame
from norton_drivers.recognition import Recognised, Recognition
from norton_drivers.wiring import DeviceSettings


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
    for key, heard in survey.heard.items():
        each = (claim for frame in heard.samples.values() for claim in claims_of(frame, recognition, devices))
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
        said = claimed.get(begins, [])
        parts.setdefault(frozenset(claim.who for claim in said), (said, []))[1].append(arrival_ns)
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
    found: dict[tuple[Any, ...], list[tuple[Claim, int]]] = defaultdict(list)
    for key, claimed in claims.items():
        ours = any(each.role is not None for each in claimed)
        for each in claimed:
            anybodys = not (each.claim.sure or each.claim.options)
            if not (each.claim.from_host or anybodys) and (not ours or each.role is not None):
                found[each.who].append((each, survey.heard[key].count))
    return tuple(_sender(said) for _, said in sorted(found.items(), key=str))


def in_words(options: Mapping[str, Any]) -> str:
    """Options as a rig file has them."""
    return ", ".join(f"{name} = {toml(value)}" for name, value in options.items())


def owner(driver: str, claim: Recognised, devices: Sequence[DeviceSettings]) -> str | None:
    """The role of the rig's device that sends this, by its driver and its options."""
    return next((each.role for each in devices if each.driver == driver and _matches(claim.options, each)), None)


def _matches(options: Mapping[str, Any], settings: DeviceSettings) -> bool:
    return all(settings.options.get(name) == value for name, value in options.items())


def _sender(said: Sequence[tuple[Claim, int]]) -> Sender:
    surest = sorted(said, key=lambda each: (not each[0].claim.sure, each[0].claim.says))
    first = surest[0][0]
    says = dict.fromkeys(each.claim.says for each, _ in surest)
    frames = sum(count for _, count in said)
    return Sender(first.driver, first.claim.device, dict(first.claim.options), tuple(says), frames, first.role)
