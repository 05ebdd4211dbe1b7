"""How heavy an actuator is at its port, from readings made with an inertia that is known."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification.apparent_inertia import apparent_inertia_kgm2
from norton_bench.procedures.waves import multisine
from norton_bench.records import MOTION, NO_DEVICE_TIME, TICK, TORQUE, Measured, SegmentInfo
from norton_bench.segments import Use

TICK_S, TICKS = 1e-3, 8000
LOAD_KGM2 = 6e-3


def shaken(impedance, noise_nm: float = 0.02, actuator_nm: float = 3.0, late_ticks: int = 0) -> Measured:
    """A load of LOAD_KGM2 and an actuator with this impedance(s), rigidly joined, shaken from both ends."""
    pushed = 10.0 * multisine(TICKS * TICK_S, TICK_S, low_hz=1.0, high_hz=200.0, seed=1)
    own = actuator_nm * multisine(TICKS * TICK_S, TICK_S, low_hz=1.0, high_hz=200.0, seed=2)
    s = 2j * np.pi * np.fft.rfftfreq(TICKS, TICK_S)
    s[0] = 1.0
    spectra = [np.fft.rfft(each) for each in (pushed, own)]
    angle = sum(spectra) / (LOAD_KGM2 * s**2 + impedance(s))
    position = np.fft.irfft(angle, TICKS)
    torque = np.roll(np.fft.irfft(spectra[1] - impedance(s) * angle, TICKS), late_ticks)
    random = np.random.default_rng(3)
    stamps = np.arange(TICKS) * 1_000_000
    ticks, motion, readings = np.zeros(TICKS, TICK), np.zeros(TICKS, MOTION), np.zeros(TICKS, TORQUE)
    ticks["tick_ns"], ticks["load_torque_nm"], ticks["command"] = stamps, pushed, own
    motion["arrival_ns"] = readings["arrival_ns"] = stamps
    motion["sequence"] = readings["sequence"] = np.arange(TICKS)
    motion["device_ns"] = readings["device_ns"] = NO_DEVICE_TIME
    motion["position_rad"], readings["torque_nm"] = position, torque + random.normal(0, noise_nm, TICKS)
    readings["valid"] = True
    segment = SegmentInfo(0, "calibrate", "shake", Use.CALIBRATE, "torque", 0, int(stamps[-1]) + 1_000_000)
    return Measured(ticks=ticks, motion=motion, load_motion=motion, torque=readings, segments=(segment,))


@pytest.mark.parametrize("inertia_kgm2", [2e-3, 0.02, 0.3])
def test_an_inertia_on_a_damped_spring_is_weighed(inertia_kgm2):
    measured = shaken(lambda s: inertia_kgm2 * s**2 + 1.0 * s + 22.0)
    assert apparent_inertia_kgm2(measured, TICK_S) == pytest.approx(inertia_kgm2, rel=0.1)


def test_a_machine_that_resonates_in_the_band_has_no_one_inertia():
    def impedance(s):
        spring = 0.2 * s + 0.02 * (2 * np.pi * 18.0) ** 2  # a body of 0.02 behind it resonates at 18 Hz
        return 2e-3 * s**2 + spring * 0.02 * s**2 / (0.02 * s**2 + spring)

    assert apparent_inertia_kgm2(shaken(impedance), TICK_S) is None


def test_beside_a_stiff_spring_a_light_body_is_not_weighed():
    measured = shaken(lambda s: 1e-4 * s**2 + 0.5 * s + 1000.0)
    assert apparent_inertia_kgm2(measured, TICK_S) is None


def test_a_delay_that_is_known_is_taken_off():
    late = shaken(lambda s: 0.02 * s**2 + 0.5 * s + 100.0, late_ticks=2)
    assert apparent_inertia_kgm2(late, TICK_S, 2 * TICK_S) == pytest.approx(0.02, rel=0.1)


def test_nothing_is_said_without_shaking():
    measured = shaken(lambda s: 0.02 * s**2 + 1.0 * s + 22.0)
    assert apparent_inertia_kgm2(replace(measured, segments=()), TICK_S) is None
