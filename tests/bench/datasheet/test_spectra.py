"""The estimate of both paths, on signals of a known linear port whose load feeds noise back into the motion."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from norton_bench.datasheet.spectra import Piece, Spectra, Transfer, impedance_line, spectra, torque_line
from norton_bench.models.network import NortonNetwork
from norton_bench.models.sliding import resistance_nm
from norton_bench.models.terms import NetworkTerm

TICK_S, COUNT = 1e-3, 40_000
DELAY_S = 2e-3
# Nearly no friction, so that the port is linear.
NETWORK = NortonNetwork(0.9, 300.0, 5e-5, 1e-3, 1e-9, 10.0, 0.01, "N*m")


def synthesised(seed: int, noise_nm: float, highest_hz: float = 60.0) -> Piece:
    """Periodic signals made in the frequency domain: the loop feeds the torque's noise back into the motion."""
    rng = np.random.default_rng(seed)
    hz = np.fft.rfftfreq(COUNT, TICK_S)
    s = 2j * pi * hz

    def random(rms: float, up_to_hz: float) -> np.ndarray:
        spectrum = rng.standard_normal(hz.size) + 1j * rng.standard_normal(hz.size)
        spectrum[(hz == 0.0) | (hz > up_to_hz)] = 0.0
        return spectrum * rms / np.std(np.fft.irfft(spectrum, COUNT))

    command, asked, noise = random(0.03, 200.0), random(5.0, highest_hz), random(noise_nm, 500.0)
    velocity = asked + 300.0 * noise / (1 + s / 100.0)
    torque = torque_line(NETWORK, hz) * command * np.exp(-s * DELAY_S)
    torque += noise - (s * NETWORK.inertia_kgm2 + NETWORK.viscous_damping_nms_rad) * velocity
    return Piece(*(np.fft.irfft(each, COUNT) for each in (command, velocity, torque, asked)))


def inside(path: Transfer, line: np.ndarray) -> float:
    """How many of the points have the true magnitude in their interval."""
    return float(np.mean(np.abs(np.abs(path.response) - np.abs(line)) <= path.half_width))


@pytest.fixture(scope="module")
def found() -> list[Spectra]:
    told = [spectra([synthesised(seed, 3e-3)], TICK_S, DELAY_S) for seed in range(6)]
    return [each for each in told if each is not None]


def test_both_paths_are_found_though_the_load_feeds_noise_back(found: list[Spectra]) -> None:
    assert len(found) == 6
    torque = np.mean([inside(each.torque, torque_line(NETWORK, each.torque.frequency_hz)) for each in found])
    motion = np.mean([inside(each.impedance, impedance_of(each)) for each in found])
    # Some 300 points of each; neighbours share half of their power.
    assert 0.91 < torque < 0.985
    assert 0.91 < motion < 0.985


def impedance_of(each: Spectra) -> np.ndarray:
    return impedance_line(NETWORK, each.impedance.frequency_hz, each.velocity_rms_rad_s)


def test_phases_are_those_of_the_machine_without_its_wires(found: list[Spectra]) -> None:
    path = found[0].torque
    off = np.angle(path.response / torque_line(NETWORK, path.frequency_hz))
    assert np.all(np.abs(off) < 3 * path.half_width / np.abs(path.response))


def test_nothing_is_told_where_no_motion_was_asked_for(found: list[Spectra]) -> None:
    assert all(np.max(each.impedance.frequency_hz) <= 62.0 for each in found), "and the window's own width"


def test_coherence_falls_with_noise(found: list[Spectra]) -> None:
    quiet = spectra([synthesised(0, 3e-4)], TICK_S, DELAY_S)
    assert quiet is not None
    assert np.median(quiet.impedance.coherence) > 0.99
    assert np.median(found[0].impedance.coherence) < np.median(quiet.impedance.coherence)


def test_too_short_a_record_tells_nothing() -> None:
    piece = synthesised(0, 1e-3)
    short = Piece(
        *(each[:2000] for each in (piece.command, piece.velocity_rad_s, piece.torque_nm, piece.reference_rad_s))
    )
    assert spectra([short], TICK_S, DELAY_S) is None
    assert spectra([], TICK_S, DELAY_S) is None


def test_friction_looks_like_a_damping_while_the_port_slides_to_and_fro() -> None:
    """Coulomb friction under a normally distributed velocity, estimated, beside Bussgang's closed form."""
    piece = synthesised(1, 1e-6)
    with_friction = Piece(
        piece.command,
        piece.velocity_rad_s,
        piece.torque_nm - 0.02 * np.sign(piece.velocity_rad_s),
        piece.reference_rad_s,
    )
    told = spectra([with_friction], TICK_S, DELAY_S)
    assert told is not None
    rubbing = NortonNetwork(0.9, 300.0, 5e-5, 1e-3, 0.02, 10.0, 0.01, "N*m")
    line = impedance_line(rubbing, told.impedance.frequency_hz, told.velocity_rms_rad_s)
    assert np.median(told.impedance.response.real) == pytest.approx(np.median(line.real), rel=0.05)


def test_the_line_of_sliding_is_the_average_that_it_says_with_terms_too() -> None:
    """Against many normal velocities."""
    network = replace(
        NETWORK, coulomb_torque_nm=0.02, terms=(NetworkTerm("stribeck", (0.008, 2.0)), NetworkTerm("drag", (2e-5,)))
    )
    velocity = 5.0 * np.random.default_rng(1).standard_normal(1_000_000)
    average = float(np.mean(resistance_nm(network, velocity) * velocity) / 25.0)
    assert impedance_line(network, np.zeros(1), 5.0)[0].real == pytest.approx(average, rel=3e-3)
