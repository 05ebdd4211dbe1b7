"""The result of an arm for people and programs: sentences, tables, a page, and data for JSON."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from norton_bench.joints.arm import JOINTS
from norton_bench.joints.hand import HandStiffness
from norton_bench.joints.impedance import UNITS, JointImpedance
from norton_bench.joints.run import ArmResult
from norton_bench.joints.source import SourcePath
from norton_bench.report.figures_network import legend
from norton_bench.report.render import HeadlineNumber, fill, write_page
from norton_bench.report.svg import ACCENT, MEASURED, PREDICTED, figure, picture, style
from norton_bench.report.words import Facts, Section, number, pretty_unit, within
from norton_bench.result import Result

SYMBOLS = {"inertia": "M", "damping": "B", "stiffness": "K"}


def arm_data(result: ArmResult) -> dict[str, Any]:
    """What ``--json`` prints; half-widths are those of 95 % intervals."""
    impedance, source, hand = result.impedance, result.source, result.hand
    return {
        "arm": result.name,
        "joints": list(JOINTS),
        **{
            name: {"unit": UNITS[name], "value": matrix.tolist(), "half_width": impedance.half[name].tolist()}
            for name, matrix in impedance.matrices.items()
        },
        "place_rad": list(impedance.place_rad),
        "swing_rad": list(impedance.swing_rad),
        "misfit": impedance.misfit,
        "adequate": impedance.adequate,
        "hand": None if hand is None else _hand_data(hand),
        "source": None if source is None else _source_data(source),
        "notes": list(result.notes),
        "recordings": list(result.recordings),
    }


def _hand_data(hand: HandStiffness) -> dict[str, Any]:
    return {
        "unit": "N/m",
        "value": hand.stiffness_n_m.tolist(),
        "half_width": hand.half_n_m.tolist(),
        "major": hand.major_n_m,
        "minor": hand.minor_n_m,
        "direction_deg": hand.direction_deg,
        "curl": hand.curl,
        "curl_half_width": hand.curl_half,
    }


def _source_data(source: SourcePath) -> dict[str, Any]:
    return {
        "trials": source.trials,
        "torque_left_nm": list(source.torque_nm),
        "corrected_rad": list(source.corrected_rad),
        "greatest_half_width_rad": source.half_rad.max(axis=0).tolist(),
        "end_rad": source.angle_rad[-1].tolist(),
    }


def impedance_facts(impedance: JointImpedance) -> Facts:
    """Each entry with half of its 95 % interval: the torque at one joint by the motion of one."""
    entries = [(row, column) for row in range(len(JOINTS)) for column in range(len(JOINTS))]
    named = [f"{JOINTS[row]} by {JOINTS[column]}" if row != column else JOINTS[row] for row, column in entries]
    rows = []
    for name, matrix in impedance.matrices.items():
        half = impedance.half[name]
        cells = [within(float(matrix[entry]), float(half[entry])) for entry in entries]
        rows.append((f"{name} {SYMBOLS[name]}", *cells, pretty_unit(UNITS[name])))
    return Facts(("", *named, "unit"), tuple(rows))


def sentences(result: ArmResult) -> Iterator[str]:
    """What the figures mean, and what they do not say."""
    impedance, source, hand = result.impedance, result.source, result.hand
    places = " and ".join(f"{name} {1e3 * at:.2f} mrad" for name, at in zip(JOINTS, impedance.place_rad, strict=True))
    low_hz, high_hz = impedance.frequency_hz[[0, -1]]
    yield (
        f"Impedance about {places}, under zero commands, for motions of up to {1e3 * max(impedance.swing_rad):.2g} "
        f"mrad to either side, {low_hz:.3g} to {high_hz:.3g} Hz."
    )
    left = f"what is left is {impedance.misfit:.2f} times the noise"
    if impedance.adequate:
        yield f"An inertia, a damper and a spring explain the torques: {left}."
    else:
        yield (
            f"An inertia, a damper and a spring do not explain the torques: {left}, more than chance makes once in a "
            "thousand times. The intervals are wider by as much. Friction, play or too large a swing do this; try a "
            "smaller one."
        )
    if hand is not None:
        yield (
            f"At the hand: {number(hand.major_n_m, 3)} N/m along {hand.direction_deg:.0f}°, "
            f"{number(hand.minor_n_m, 3)} N/m across; {within(100 * hand.curl, 100 * hand.curl_half)} % of it is "
            "antisymmetric, as of no spring."
        )
    if source is not None:
        torques = " and ".join(
            f"{1e3 * at:.2g} mN·m at the {name}" for name, at in zip(JOINTS, source.torque_nm, strict=True)
        )
        yield (
            f"Source: mean of {source.trials} reaches. {torques} rms were left at the ports, and are accounted for "
            "with the impedance of the posture."
        )
    yield from result.notes


def write_arm(path: Path, result: ArmResult, command: str) -> Path:
    """Write the page; ``command`` makes it again. Raises ExperimentError where it cannot be written."""
    impedance = result.impedance
    with style():
        drawn = picture(
            draw_impedance(impedance),
            "impedance",
            "Check that the impedance is that of an inertia, a damper and a spring.",
            "Real part, and imaginary part over angular frequency, as measured (dots) and by M, B and K (lines).",
        )
        facts = impedance_facts(impedance)
        parts = [Section("impedance", "Impedance of both joints", figures=(drawn,), tables=(facts,))]
        if result.source is not None:
            drawn = picture(
                draw_source(result.source),
                "source",
                "See how the arm moves when nothing holds it.",
                "Mean of the reaches; the band is its 95 % interval.",
            )
            parts.append(Section("source", "Motion source", figures=(drawn,)))
    text = fill(
        data=Result(result.name, metadata=result.metadata),
        headline=_headline(result),
        rows=[],
        verdict=list(sentences(result)),
        sections=parts,
        commands=[(command, "measures this arm again")],
    )
    return write_page(path, text)


def _headline(result: ArmResult) -> list[HeadlineNumber]:
    shown = [HeadlineNumber("yes" if result.impedance.adequate else "no", "explained by M, B and K")]
    if result.hand is not None:
        shown.append(HeadlineNumber(f"{number(result.hand.major_n_m, 3)} N/m", "greatest stiffness at the hand"))
    return shown


def draw_impedance(impedance: JointImpedance) -> Figure:
    """Real part (K − M ω²) and damping of each entry, against frequency."""
    drawing = figure(5.2)
    axes = drawing.subplots(2, 4, sharex=True)
    fine_hz = np.geomspace(impedance.frequency_hz[0], impedance.frequency_hz[-1], 200)
    model = impedance.at(2j * np.pi * fine_hz)
    for column, (row, moved) in enumerate(np.ndindex(2, 2)):
        for part, ax in zip(("real", "damping"), axes[:, column], strict=True):
            ax.plot(fine_hz, _part(model[:, row, moved], fine_hz, part), color=PREDICTED)
            seen = _part(impedance.measured[:, row, moved], impedance.frequency_hz, part)
            ax.plot(impedance.frequency_hz, seen, linestyle="none", marker="o", markersize=3.5, color=MEASURED)
        axes[0, column].set_title(f"{JOINTS[row]} by {JOINTS[moved]}")
        axes[1, column].set_xlabel("Hz")
    axes[0, 0].set_ylabel("Re Z [N·m/rad]")
    axes[1, 0].set_ylabel("Im Z/ω [N·m·s/rad]")
    return drawing


def _part(values: Any, frequency_hz: Any, part: str) -> Any:
    return values.real if part == "real" else values.imag / (2 * np.pi * frequency_hz)


def draw_source(source: SourcePath) -> Figure:
    """Both angles against time."""
    drawing = figure(3.2)
    ax = drawing.subplots()
    for joint, color in enumerate((PREDICTED, ACCENT)):
        mean, half = source.angle_rad[:, joint], source.half_rad[:, joint]
        ax.fill_between(source.time_s, mean - half, mean + half, color=color, alpha=0.3, linewidth=0)
        ax.plot(source.time_s, mean, color=color, label=JOINTS[joint])
    ax.set_xlabel("time since the commands changed [s]")
    ax.set_ylabel("angle [rad]")
    legend(ax)
    return drawing
