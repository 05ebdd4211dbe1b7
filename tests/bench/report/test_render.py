import re
from dataclasses import fields, replace
from html.parser import HTMLParser
from typing import TextIO

import numpy as np
import pytest
from matplotlib.backends.backend_svg import FigureCanvasSVG

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError
from norton_bench.identification.results import Cogging
from norton_bench.models.parameters import Estimate, Status
from norton_bench.models.terms import NetworkTerm
from norton_bench.report import figures_fit, figures_tables
from norton_bench.report.render import DIGITS, derived_facts, model_of, render, row, write_report
from norton_bench.result import Result
from norton_drivers.servo import Servo
from tests.bench.report.test_words import read_back

SECTIONS = [
    "parameters",
    "equation",
    "derived",
    "conditions",
    "source",
    "impedance",
    "validation",
    "without-model",
    "fit",
    "residuals",
    "friction",
    "blocked",
    "trials",
    "rendered",
    "in-situ",
    "live",
    "timing",
    "events",
    "glossary",
    "provenance",
]


class Outline(HTMLParser):
    """What a browser would make of the page: section anchors, and everything it would have to fetch."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.sections: list[str] = []
        self.fetched: list[str] = []
        self.pictures = 0
        self.text = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        known = dict(attrs)
        if tag == "section":
            self.sections.append(known.get("id") or "")
        self.pictures += tag == "svg"
        self.fetched += [value or "" for name, value in attrs if name in ("src", "href", "data", "xlink:href")]
        if tag in ("script", "link", "iframe", "image", "img"):
            self.fetched.append(tag)

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.fixture(scope="module")
def page_of_all(full: Result) -> str:
    return render(full)


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are made, of few points, and left blank: drawing takes nearly all of a page's time."""

    def blank(_: FigureCanvasSVG, file: TextIO, **_more: object) -> None:
        file.write('<svg viewBox="0 0 1 1"></svg>')

    def few(time_s: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        return time_s[::100], values[::100]

    monkeypatch.setattr(FigureCanvasSVG, "print_svg", blank)
    for module in (figures_fit, figures_tables):
        monkeypatch.setattr(module, "envelope", few)


@pytest.mark.long
def test_everything_known_shows_every_section(page_of_all: str) -> None:
    page = Outline(page_of_all)
    assert page.sections == SECTIONS
    assert page.pictures == 14


@pytest.mark.long
def test_the_same_data_give_the_same_bytes(full: Result, page_of_all: str, tmp_path) -> None:
    written = write_report(tmp_path / "a" / "r.html", full).read_bytes()
    assert written == page_of_all.encode()
    assert len(written) < 2_000_000


def test_nothing_is_fetched_from_anywhere(page_of_all: str) -> None:
    text = page_of_all
    assert [place for place in Outline(text).fetched if not place.startswith("#")] == []
    without_namespaces = re.sub(r'xmlns(:\w+)?="[^"]*"', "", text)
    assert not re.search(r"https?:|@import|url\((?!#)", without_namespaces)


def test_no_stand_in_colour_is_left(page_of_all: str) -> None:
    assert "#0a00" not in page_of_all


# What a full report has, and the sections that are gone without it.
GONE: dict[str, set[str]] = {
    "metadata": set(),
    "notes": set(),
    "fit": {"equation", "derived", "fit", "impedance", "without-model"},
    "without_model": {"without-model"},
    "residuals": {"residuals"},
    "validation": {"validation"},
    "source_map": set(),
    "blocked_map": {"blocked"},
    "conditions": {"conditions"},
    "ladder": {"friction"},
    "trials": {"trials"},
    "rendered": {"rendered"},
    "in_situ": {"in-situ"},
    "live": {"live"},
    "measured": {"timing", "events", "impedance", "live"},
}


@pytest.mark.long
@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("missing", GONE)
def test_any_part_may_be_missing(full: Result, missing: str) -> None:
    empty = Result(full.rig_name)
    page = Outline(render(replace(full, **{missing: getattr(empty, missing)})))
    assert set(SECTIONS) - set(page.sections) == GONE[missing]


def test_every_other_part_is_missing_from_the_full_report(full: Result) -> None:
    """No page is needed to show that it may be missing."""
    empty = Result(full.rig_name)
    others = {each.name for each in fields(Result)} - set(GONE) - {"rig_name", "rig_text"}
    assert all(getattr(full, name) == getattr(empty, name) for name in others)


def test_a_rig_alone_still_gives_a_page() -> None:
    page = Outline(render(Result("bare")))
    assert page.sections == ["parameters", "glossary", "provenance"]
    assert "Nothing was fitted" in page.text


def test_unknown_numbers_are_dashes(without_numbers: Result) -> None:
    page = Outline(render(without_numbers))
    assert "nan" not in page.text.lower().split()
    assert "did not converge" in page.text


def test_what_the_data_cannot_tell_is_said(page_of_all: str) -> None:
    text = Outline(page_of_all).text
    assert "known only as a product" in text
    assert "The staircase was cut short." in text
    assert "unexcited" in text


def test_the_ladder_shows_every_model_and_the_one_selected(page_of_all: str) -> None:
    text = " ".join(re.sub(r"<[^>]+>", " ", page_of_all).split())
    assert "Selected is dahl" in text
    assert "coulomb-viscous 2 19.3 19.6 2.30" in text
    assert "lugre 6 0.990 0.996 0.0190 did not converge" in text


def test_each_condition_is_told_with_its_figure(page_of_all: str) -> None:
    text = Outline(page_of_all).text
    assert "Impedance form: cannot be told; no torque was measured." in text
    assert "Unique zero: holds; it vanishes at one velocity." in text
    assert "9.00·10⁻⁴ … 0.00110" in text


def test_every_figure_says_what_it_is_for(page_of_all: str) -> None:
    captions = re.findall(r"<figcaption>(.*?)</figcaption>", page_of_all)
    assert len(captions) == 14
    purposes = [re.fullmatch(r"<strong>(.+?[.?])</strong> .+\.", caption) for caption in captions]
    assert all(purposes)
    assert len({found.group(1) for found in purposes if found}) == 14


def test_intervals_are_called_intervals(page_of_all: str) -> None:
    """Of parameters and delays no bare "±" is left to be guessed at."""
    text = Outline(page_of_all).text
    assert "±" not in text[text.index("The model and its parameters") : text.index("The motion source")]
    assert "command 0.1200 ms (95 % interval 0.1141 … 0.1259)" in text


def test_every_status_is_explained(page_of_all: str) -> None:
    text = Outline(page_of_all).text
    assert all(f"{status.value} (status)" in text for status in Status)


def test_a_small_table_knows_its_columns_for_a_phone(page_of_all: str) -> None:
    assert '<table class="cards">' in page_of_all
    assert '<td data-column="95 % interval">' in page_of_all


def test_a_repeated_movement_is_shown_trial_by_trial(page_of_all: str) -> None:
    assert "The movement was repeated 5 times and converged: noise hides what is left." in page_of_all
    assert "The last trial lies at least 36.5 dB below the first." in page_of_all


def test_an_assembled_actuator_has_its_trials_and_its_source(page_of_all: str) -> None:
    assert "The load&#39;s inertia is 1.26e-4 kg*m^2." in page_of_all
    end = "the scatter of movements and the load&#39;s values explain what is left."
    assert f"repeated 6 times and converged: {end}" in page_of_all
    assert "Trials differ by 0.0080 rad/s rms." in page_of_all


@pytest.mark.usefixtures("undrawn")
def test_text_from_outside_is_escaped(full: Result, page_of_all: str) -> None:
    """The rig's name is in no figure."""
    assert "<b>x</b>" not in render(replace(full, rig_name="<b>x</b>"))
    for text in ("a rig", "removed"):
        assert f"<{text}>" not in page_of_all
        assert f"&lt;{text}&gt;" in page_of_all


def test_a_report_that_cannot_be_written_says_so(full: Result, tmp_path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ExperimentError, match="cannot write the report"):
        write_report(tmp_path / "file" / "r.html", Result("bare"))


NAMES = {"ωN": "source_velocity", "dτm/dt": "amplifier", "τ": "impedance", "dφ/dt": "contact"}


def told(full: Result) -> dict[str, str]:
    """The right side of each equation with its values, by its left side."""
    assert full.fit is not None
    lines = model_of(full.fit, "N*m").lines
    return dict(line.values.split(" = ", 1) for line in lines)


def test_the_printed_source_gives_the_networks_velocity(full: Result) -> None:
    """Evaluated as a reader would, with the sign that the page prescribes."""
    assert full.network is not None
    above, _, under = told(full)["ωN"].partition(" / ")
    gain, friction = (read_back(part.removesuffix("·c")) for part in above.strip("()").split(" ∓ "))
    for command in (-0.08, 0.05):
        expected = (gain * command - np.sign(command) * friction) / read_back(under)
        assert full.network.source_velocity(command) == pytest.approx(expected, rel=10.0**-DIGITS)


def test_every_parameter_stands_in_the_equations(full: Result) -> None:
    assert set(told(full)) == set(NAMES)
    assert told(full)["τ"] == "τm − 5.000·10⁻⁵·dω/dt − 0.001000·ω − 10.00·φ − 0.01000·dφ/dt"
    assert told(full)["dτm/dt"] == "600.0·(0.9000·c − τm)"
    assert told(full)["dφ/dt"] == "ω − (10.00 / 0.02000)·|ω|·φ"


def test_what_is_not_known_stays_a_symbol(full: Result) -> None:
    assert full.fit is not None
    unknown = tuple(
        replace(each, status=Status.AT_BOUND) if each.name == "presliding_damping" else each
        for each in full.fit.estimates
    )
    lines = model_of(replace(full.fit, estimates=unknown), "N*m").lines
    assert lines[2].values.endswith("− σ1·dφ/dt")


def test_a_negative_value_stands_in_brackets(full: Result) -> None:
    assert full.fit is not None
    turned = tuple(
        replace(each, value=-each.value) if each.name == "torque_gain" else each for each in full.fit.estimates
    )
    assert "((−0.9000)·c − τm)" in model_of(replace(full.fit, estimates=turned), "N*m").lines[0].values


def test_without_torque_the_scale_is_said_to_be_open(full: Result) -> None:
    assert full.fit is not None
    network = full.fit.network.with_provenance({"scale": "free motion only"})
    model = model_of(replace(full.fit, network=network), "A")
    assert "one common factor" in model.remark
    assert ("τm", "torque of the motor [A]") in model.variables
    assert model_of(full.fit, "N*m").remark == ""


@pytest.mark.parametrize(
    ("servo", "amplifier", "source", "symbols"),
    [
        (
            Servo(0.0, 0.9, 1e-4, 4e-4),
            "600.0·(0.9000·(c − ω) − τm)",
            "ωN = (0.9000·c ∓ 0.02000) / (0.001000 + 0.9000)",
            ["ωN"],
        ),
        (Servo(0.9, 0.01), "600.0·(0.9000·(c − θ − T·ω) − τm)", "θN = c ± 0.02000 / 0.9000", ["θ", "T", "θN"]),
    ],
)
def test_a_servos_equations_have_its_loop_and_no_figures_of_a_motor(full, servo, amplifier, source, symbols) -> None:
    assert full.fit is not None
    fit = replace(full.fit, network=replace(full.fit.network, servo=servo))
    model = model_of(fit, "rad/s")
    assert model.lines[0].values == f"dτm/dt = {amplifier}"
    assert model.lines[3].values == source
    assert [symbol for symbol, _ in model.variables[-len(symbols) :]] == symbols
    assert derived_facts(fit) is None


DRAWS, SEED = 200_000, 5


def ends(interval: str) -> tuple[float, float]:
    """The two numbers of an interval as it is written."""
    inner, _, power = interval.partition(")")
    low, high = (read_back(text.strip("( ") + power) for text in inner.split("…"))
    return low, high


def test_values_and_intervals_follow_from_parameters_and_covariance(full: Result) -> None:
    """Against draws of the parameters: correlated ones, so that leaving the covariance out would show."""
    assert full.fit is not None
    names = tuple(each.name for each in full.fit.estimates if each.status is Status.VALID)
    values = np.array([each.value for each in full.fit.estimates if each.status is Status.VALID])
    correlation = 0.8 * np.ones((len(names), len(names))) + 0.2 * np.eye(len(names))
    std = 0.004 * values
    covariance = correlation * np.outer(std, std)
    network = replace(
        full.fit.network, covariance_names=names, covariance=tuple(tuple(map(float, row)) for row in covariance)
    )
    facts = derived_facts(replace(full.fit, network=network))
    assert facts is not None
    drawn = dict(zip(names, np.random.default_rng(SEED).multivariate_normal(values, covariance, DRAWS).T, strict=True))
    expected = {
        "breakaway command": drawn["coulomb_torque"] / drawn["torque_gain"],
        "free speed per command": drawn["torque_gain"] / drawn["viscous_damping"],
        "mechanical time constant": drawn["inertia"] / drawn["viscous_damping"],
        "presliding displacement": drawn["coulomb_torque"] / drawn["presliding_stiffness"],
    }
    assert [row[0] for row in facts.rows] == list(expected)
    for name, value, interval, _unit, _use in facts.rows:
        low, high = np.quantile(expected[name], (0.025, 0.975))
        # A quantile of so many draws strays by half a per cent of the width; the ends are written to two digits.
        assert ends(interval) == pytest.approx((low, high), abs=0.06 * (high - low))
        assert low < read_back(value) < high


def test_a_figure_whose_parameter_is_not_known_is_left_out(full: Result) -> None:
    assert full.fit is not None
    lost = tuple(
        replace(each, status=Status.AT_BOUND) if each.name == "viscous_damping" else each for each in full.fit.estimates
    )
    facts = derived_facts(replace(full.fit, estimates=lost))
    assert facts is not None
    assert [row[0] for row in facts.rows] == ["breakaway command", "presliding displacement"]
    nothing = tuple(replace(each, status=Status.DOUBTFUL) for each in full.fit.estimates)
    assert derived_facts(replace(full.fit, estimates=nothing)) is None


def test_without_a_covariance_there_is_no_interval(full: Result) -> None:
    assert full.fit is not None
    facts = derived_facts(full.fit)
    assert facts is not None
    assert {row[2] for row in facts.rows} == {"–"}


@pytest.mark.parametrize(
    ("term", "symbols"),
    [
        (NetworkTerm("cogging", (1e-4, 2e-4), 42), ["θ", "p"]),
        (NetworkTerm("saturation", (0.1,)), ["lag(c)"]),
        (NetworkTerm("gain_drift", (1e-4, 0.0)), ["t"]),
        (NetworkTerm("compliance", (50.0, 0.01, 1e-5)), ["θ", "q", "τ_j"]),
        (NetworkTerm("asymmetry", (0.1,)), []),
    ],
)
def test_the_symbols_of_terms_are_explained(full: Result, term: NetworkTerm, symbols: list[str]) -> None:
    assert full.fit is not None
    without = model_of(replace(full.fit, network=replace(full.fit.network, terms=())), "N*m")
    found = model_of(replace(full.fit, network=replace(full.fit.network, terms=(term,))), "N*m")
    assert [symbol for symbol, _ in found.variables[len(without.variables) :]] == symbols


def test_the_amplitude_of_cogging_stands_below_the_equation_with_its_interval(full: Result) -> None:
    assert full.fit is not None
    fit = replace(full.fit, cogging=(Cogging(42, 0.299e-3, 0.0056e-3),))
    assert "0.30 ± 0.01 mN·m at 42 periods a turn" in model_of(fit, "N*m").remark
    assert "Amplitude" not in model_of(replace(fit, cogging=()), "N*m").remark


def test_terms_stand_among_the_equations_and_the_parameters(full: Result) -> None:
    assert full.fit is not None
    term = NetworkTerm("asymmetry", (0.1,))
    lines = model_of(replace(full.fit, network=replace(full.fit.network, terms=(term,))), "N*m").lines
    assert (lines[-1].symbols, lines[-1].values) == ("γ = 1 + a·sgn ω", "a = 0.1000")
    shown = row(Estimate("coulomb_asymmetry", 0.1, 0.01, "1", Status.VALID))
    assert (shown.symbol, shown.meaning[:40]) == ("a", "share by which the Coulomb torque is gre")
