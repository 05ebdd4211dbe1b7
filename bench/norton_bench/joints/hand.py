"""The stiffness of an arm at its hand, from that of its joints: K_hand = J⁻ᵀ K J⁻¹ where no force acts.

Mussa-Ivaldi, Hogan and Bizzi, "Neural, mechanical, and geometric factors subserving arm posture in humans", J.
Neurosci. 5(10), 1985.
"""

from dataclasses import dataclass
from math import cos, degrees, sin

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.distributions import t_quantile
from norton_bench.errors import ExperimentError
from norton_bench.joints.arm import BENT, LinksSection
from norton_bench.joints.impedance import LEVEL, JointImpedance

DRAWS = 2000


@dataclass(frozen=True)
class HandStiffness:
    """In N/m, ``x`` along the line from which the shoulder's angle counts; (2, 2), with 95 % half-widths.

    ``major_n_m`` and ``minor_n_m`` are the axes of the ellipse of its symmetric part, ``direction_deg`` the direction
    of the greater. ``curl`` is the antisymmetric part as a share of the symmetric one: what no spring has.
    """

    stiffness_n_m: FloatArray
    half_n_m: FloatArray
    major_n_m: float
    minor_n_m: float
    direction_deg: float
    curl: float
    curl_half: float


def jacobian_m(links: LinksSection, turned_rad: FloatArray) -> FloatArray:
    """How the hand moves with the joints [m/rad], (2, 2), where these have turned so far (2,)."""
    shoulder = links.shoulder_rad + turned_rad[0]
    hand = shoulder + links.elbow_rad + turned_rad[1]
    upper, lower = links.upper_m, links.lower_m
    return np.array(
        [
            [-upper * sin(shoulder) - lower * sin(hand), -lower * sin(hand)],
            [upper * cos(shoulder) + lower * cos(hand), lower * cos(hand)],
        ]
    )


def hand_stiffness(impedance: JointImpedance, links: LinksSection) -> HandStiffness:
    """Where the joints were moved about. Raises ExperimentError for an arm that was stretched out or folded there."""
    jacobian = jacobian_m(links, np.asarray(impedance.place_rad))
    if abs(np.linalg.det(jacobian)) < BENT * links.upper_m * links.lower_m:
        raise ExperimentError("the arm was stretched out or folded: its hand has no stiffness along the arm")
    inverse = np.linalg.inv(jacobian)
    wide = t_quantile(LEVEL, impedance.freedom)
    random = np.random.default_rng(0)
    deviation = impedance.covariance[-4:, -4:]
    drawn = random.multivariate_normal(impedance.stiffness.ravel(), deviation, DRAWS).reshape(-1, 2, 2)
    at_hand = inverse.T @ drawn @ inverse
    stiffness = inverse.T @ impedance.stiffness @ inverse
    values, axes = np.linalg.eigh((stiffness + stiffness.T) / 2)
    direction = degrees(float(np.arctan2(axes[1, 1], axes[0, 1]))) % 180.0
    return HandStiffness(
        stiffness,
        wide * np.std(at_hand, axis=0),
        float(values[1]),
        float(values[0]),
        direction,
        float(_curl(stiffness)),
        wide * float(np.std(_curl(at_hand))),
    )


def _curl(stiffness: FloatArray) -> FloatArray:
    """The antisymmetric part over the symmetric one, by their norms; for (..., 2, 2)."""
    other = np.swapaxes(stiffness, -1, -2)
    skew = (stiffness[..., 0, 1] - stiffness[..., 1, 0]) / np.sqrt(2)
    return np.asarray(skew / np.linalg.norm((stiffness + other) / 2, axis=(-2, -1)))
