"""Several fits of one actuator, each of a session of its own, as one result; and what differs between the sessions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.fit import network_of
from norton_bench.identification.motor_values import PHYSICAL
from norton_bench.identification.results import FitResult
from norton_bench.identification.statistics import LOOSE_BEYOND, Combined, combine
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import BY_NAME, Estimate, Status
from norton_bench.models.terms import TERM_PARAMETERS, NetworkTerm
from norton_bench.networks.left_out import cost_percent, standard_motion

# What chance may name, of all parameters together, as different between sessions where nothing is.
ALARM = 0.05
# Probabilities below this say no more than that they are.
LEAST_P = 1e-9
# Waves of cogging whose periods a turn differ by no more than this share are the same.
SAME_WAVE = 0.01


@dataclass(frozen=True)
class SessionFit:
    """One session: what messages call it, and its fit."""

    name: str
    fit: FitResult

    def taking_part(self, parameter: str) -> Estimate | None:
        """Its estimate of the parameter, where that is valid and has a deviation."""
        for estimate in self.fit.estimates:
            if estimate.name == parameter:
                sound = np.isfinite(estimate.value) and 0.0 < estimate.std < np.inf
                return estimate if sound and estimate.status is Status.VALID else None
        return None


@dataclass(frozen=True)
class Together:
    """``estimates`` as those of one fit; ``spreads`` by name, of what is valid in two sessions or more.

    ``network`` is None where one of its parameters is valid in no session.
    """

    estimates: tuple[Estimate, ...]
    spreads: Mapping[str, Combined]
    network: NortonNetwork | None
    verdict: tuple[str, ...]

    @property
    def combined(self) -> bool:
        """Whether anything could be combined at all."""
        return bool(self.spreads)


def together(sessions: Sequence[SessionFit], command_unit: str) -> Together:
    """Combine the sessions, parameter by parameter: only what is valid in a session takes part."""
    known = {estimate.name for session in sessions for estimate in session.fit.estimates}
    terms = _common_terms(sessions)
    own = {name for term in terms for name in term.named()}
    names = [name for name in (*BY_NAME, *TERM_PARAMETERS) if name in known and (name in BY_NAME or name in own)]
    takers = {name: [session for session in sessions if session.taking_part(name)] for name in names}
    spreads = {name: _combined(name, takers[name]) for name in names if len(takers[name]) > 1}
    estimates = tuple(_estimate(name, sessions, spreads.get(name)) for name in names)
    result = [estimate for estimate in estimates if np.isfinite(estimate.value)]
    whole = set(PHYSICAL) <= {estimate.name for estimate in result}
    network = network_of(result, command_unit, _covariance(sessions, result, spreads)) if whole else None
    if network is not None and terms:
        network = _with_terms(network, terms, result)
    verdict = (*_verdict(sessions, takers, estimates, spreads), *_terms_left_out(sessions, terms))
    return Together(estimates, spreads, network, verdict)


def differing(spreads: Mapping[str, Combined]) -> tuple[str, ...]:
    """Parameters that differ between sessions by more than the sessions' own intervals allow.

    By Cochran's Q; chance is counted for all that are looked at (Holm 1979, Scand. J. Stat. 6:65).
    """
    result: list[str] = []
    for name in sorted(spreads, key=lambda name: spreads[name].p):
        if spreads[name].p * (len(spreads) - len(result)) > ALARM:
            break
        result.append(name)
    return tuple(result)


def _lasting(session: SessionFit) -> tuple[NetworkTerm, ...]:
    """Its terms but for drifts: these are of one session alone."""
    return tuple(term for term in session.fit.network.terms if not term.term.in_time)


def _common_terms(sessions: Sequence[SessionFit]) -> tuple[NetworkTerm, ...]:
    """Those that every session has, with the mean of their values."""
    common = []
    for term in _lasting(sessions[0]):
        alike = [next((other for other in each.fit.network.terms if _alike(term, other)), None) for each in sessions]
        if None not in alike:
            values = np.mean([each.values for each in alike if each is not None], axis=0)
            common.append(replace(term, values=tuple(values.tolist())))
    return tuple(common)


def _alike(one: NetworkTerm, other: NetworkTerm) -> bool:
    """Whether two sessions' terms are of one kind, and of one wave: a gear's is known to a part of its periods."""
    periods, its = one.periods_per_turn, other.periods_per_turn
    return one.name == other.name and abs(periods - its) <= SAME_WAVE * periods


def _with_terms(network: NortonNetwork, terms: Sequence[NetworkTerm], estimates: Sequence[Estimate]) -> NortonNetwork:
    """The network with terms, whose values are combined as parameters are; cogging's are the mean of the sessions'.

    Deviations of the terms go in; how they go with other parameters does not.
    """
    known = {each.name: each for each in estimates}
    combined = [
        replace(
            term, values=tuple(known[name].value if name in known else value for name, value in term.named().items())
        )
        for term in terms
    ]
    names = [name for term in combined for name in term.named() if name in known]
    covariance = np.diag(np.concatenate([np.zeros(len(PHYSICAL)), [known[name].std ** 2 for name in names]]))
    covariance[: len(PHYSICAL), : len(PHYSICAL)] = network.covariance
    return replace(
        network,
        terms=tuple(combined),
        covariance_names=(*network.covariance_names, *names),
        covariance=tuple(map(tuple, covariance.tolist())),
    )


def _terms_left_out(sessions: Sequence[SessionFit], common: Sequence[NetworkTerm]) -> tuple[str, ...]:
    """One sentence for each term that some sessions have: what it costs to be without it."""
    found = {(term.name, term.periods_per_turn): (term, each) for each in sessions for term in _lasting(each)}
    return tuple(
        f"The network of all sessions is without the term {name}{f' ({periods:g} a turn)' if periods else ''}, which "
        f" only some have. In {session.name}, being without it costs {_cost(session.fit.network, term):.2g} % of "
        "the torque's rms; the parameters that it changes are those of fits with and without it."
        for (name, periods), (term, session) in found.items()
        if not any(_alike(term, each) for each in common)
    )


def _cost(network: NortonNetwork, term: NetworkTerm) -> float:
    without = replace(network, terms=tuple(each for each in network.terms if each != term))
    return cost_percent(network, without, standard_motion(network))


def _combined(name: str, takers: Sequence[SessionFit]) -> Combined:
    estimates = [session.fit.estimate(name) for session in takers]
    values = np.array([each.value for each in estimates])
    # What a fit makes alike in every session of one bench: no average makes it smaller.
    simulated = [session.fit.simulated for session in takers]
    repeated = [0.0 if each is None else each.repeated_std.get(name, 0.0) for each in simulated]
    return combine(values, np.array([each.std for each in estimates]), float(np.mean(repeated)))


def _estimate(name: str, sessions: Sequence[SessionFit], spread: Combined | None) -> Estimate:
    """What one session alone knows is not settled: nothing tells how far another would be from it."""
    own = [estimate for session in sessions for estimate in session.fit.estimates if estimate.name == name]
    unit = own[0].unit
    if spread is not None:
        settled = spread.std <= LOOSE_BEYOND * abs(spread.value)
        return Estimate(name, spread.value, spread.std, unit, Status.VALID if settled else Status.LEARNING)
    sound = next((estimate for session in sessions if (estimate := session.taking_part(name))), None)
    if sound is not None:
        return Estimate(name, sound.value, sound.std, unit, Status.LEARNING)
    return Estimate(name, float("nan"), float("nan"), unit, own[0].status)


def _covariance(
    sessions: Sequence[SessionFit], estimates: Sequence[Estimate], spreads: Mapping[str, Combined]
) -> FloatArray:
    """Of PHYSICAL: correlations within each session go in with its weights; between sessions none are known.

    The deviations are those of the combined estimates.
    """
    weights = np.array([_weights(name, sessions, spreads.get(name)) for name in PHYSICAL]).T
    between = np.array([spreads[name].between_std ** 2 if name in spreads else 0.0 for name in PHYSICAL])
    count = len(PHYSICAL)  # a network's covariance has its terms' parameters behind these
    total = np.diag(between * np.sum(weights**2, axis=0))
    for session, own in zip(sessions, weights, strict=True):
        share = np.outer(own, own)
        total += share * np.where(share > 0.0, np.array(session.fit.network.covariance)[:count, :count], 0.0)
    result = {estimate.name: estimate.std for estimate in estimates}
    factor = np.array([result[name] for name in PHYSICAL]) / np.sqrt(np.diag(total))
    return np.asarray(total * np.outer(factor, factor))


def _weights(name: str, sessions: Sequence[SessionFit], spread: Combined | None) -> FloatArray:
    """How much each session counts for the parameter, 0 where it took no part; shape (sessions,)."""
    weights = np.array([float(session.taking_part(name) is not None) for session in sessions])
    if spread is not None:
        weights[weights > 0.0] = spread.weights
    return weights


def _verdict(
    sessions: Sequence[SessionFit],
    takers: Mapping[str, Sequence[SessionFit]],
    estimates: Sequence[Estimate],
    spreads: Mapping[str, Combined],
) -> tuple[str, ...]:
    sentences = [_difference(spreads)] if spreads else ["No parameter is valid in two sessions: nothing was combined."]
    if len(sessions) == 2 and spreads:
        sentences.append("Two sessions tell little of the spread between sessions: record three or more.")
    wide = [_plain(each.name) for each in estimates if each.name in spreads and each.status is Status.LEARNING]
    if wide:
        sentences.append(f"Uncertain by more than half of the value: {', '.join(wide)}; record more sessions.")
    sentences += _left_out(sessions, takers)
    alone = [_plain(name) for name, taking in takers.items() if len(taking) == 1]
    if alone:
        sentences.append(f"Known from one session alone, without any spread between sessions: {', '.join(alone)}.")
    missing = [_plain(name) for name in PHYSICAL if not takers.get(name)]
    if missing:
        sentences.append(f"There is no network of all sessions: none has a valid {' or '.join(missing)}.")
    shared = [message for message in sessions[0].fit.verdict if all(message in other.fit.verdict for other in sessions)]
    return (*sentences, *shared)


def _difference(spreads: Mapping[str, Combined]) -> str:
    named = differing(spreads)
    if not named:
        return "No parameter differs between sessions by more than their own intervals allow."
    each = [
        f"{_plain(name)} (standard deviation {_percent(spread.between_std / abs(spread.value))}, "
        f"at most {_percent(spread.between_std_upper / abs(spread.value))}, {_chance(spread.p)})"
        for name in named
        for spread in (spreads[name],)
    ]
    return (
        f"Between sessions differ, by more than their own intervals allow: {', '.join(each)}. The combined intervals "
        "hold this; look for what changed: temperature, wear, mounting."
    )


def _left_out(sessions: Sequence[SessionFit], takers: Mapping[str, Sequence[SessionFit]]) -> list[str]:
    """One sentence for each session that lacks what another has."""
    sentences = []
    for session in sessions:
        lacking = [_plain(name) for name, taking in takers.items() if taking and session not in taking]
        if lacking:
            why = "" if session.fit.converged else ", whose fit did not converge"
            sentences.append(f"Left out of {session.name}{why}, for want of a valid value: {', '.join(lacking)}.")
    return sentences


def _plain(name: str) -> str:
    return name.replace("_", " ")


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %" if share < 1.0 else f"{100 * share:.0f} %"


def _chance(p: float) -> str:
    return f"p = {p:.1g}" if p >= LEAST_P else f"p < {LEAST_P:.0e}"
