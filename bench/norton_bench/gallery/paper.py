"""What the paper claims of an actuator, shown on the shipped rigs: the experiments, and what they show."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from norton_bench.errors import ExperimentError, UsageError
from norton_bench.gallery import gravity, in_situ, motor, muscle, spring
from norton_bench.gallery.claim import LEVEL, PaperExperiment, Row, Shown
from norton_bench.gallery.dynamic_source import SwungCommand
from norton_bench.gallery.gravity import TwoPorts
from norton_bench.gallery.impedances import PortImpedances
from norton_bench.gallery.motor_experiments import FreeLevels, SameDeviation, SlowStops, SteadySpeeds
from norton_bench.gallery.muscle import MuscleSweeps
from norton_bench.procedures.calibrate import CalibrateProcedure
from norton_bench.procedures.knowledge import Adaptive, Procedure
from norton_bench.procedures.tare import TareProcedure
from norton_bench.report.render import HeadlineNumber, fill, write_page
from norton_bench.report.svg import standalone, style, svg
from norton_bench.report.words import Facts, Picture, Section, number, pretty_unit
from norton_bench.result import Result
from norton_bench.rig.load import load_rig, true_parameters
from norton_bench.rig.rig import Rig
from norton_bench.session.engine import record_script
from norton_bench.session.pool import process_pool
from norton_bench.session.script import Script, SoFar

HEAD = ("seed", "figure", "expected", "found", f"± ({100 * LEVEL:g} %)", "unit", "")

ABOUT = Section(
    "about",
    "Expected and found",
    (
        "Expected is the paper's closed form with the simulated machine's true values; found is what the bench "
        "measured, through frames, bytes, noise, counts and delays, with an interval from its own repetitions.",
    ),
)


@dataclass(frozen=True)
class Proof:
    """One claim at one seed, with its picture as SVG."""

    seed: int
    name: str
    title: str
    section: str
    says: str
    rows: tuple[Row, ...]
    picture: str
    caption: str

    @property
    def passed(self) -> bool:
        return all(row.passed for row in self.rows)


# The gallery as files: a picture for each claim, and a page with all of them.
def write_gallery(folder: Path, proofs: Sequence[Proof], command: str) -> tuple[Path, tuple[Path, ...]]:
    """Page and pictures in ``folder``; the pictures are those of the first seed.

    Raises ExperimentError where they cannot be written.
    """
    first = [proof for proof in proofs if proof.seed == proofs[0].seed]
    pictures = tuple(_write_picture(folder / f"gallery-{proof.name.replace(' ', '-')}.svg", proof) for proof in first)
    passed = sum(row.passed for proof in proofs for row in proof.rows)
    rows = sum(len(proof.rows) for proof in proofs)
    text = fill(
        data=Result("A general actuator model, shown"),
        headline=[HeadlineNumber(f"{passed} of {rows}", "rows pass"), HeadlineNumber(str(len(first)), "claims")],
        rows=[],
        verdict=[],
        sections=[
            ABOUT,
            *(_section(claim, [proof for proof in proofs if proof.name == claim.name]) for claim in first),
        ],
        commands=[(command, "runs all of it again")],
    )
    return write_page(folder / "gallery.html", text), pictures


def _section(claim: Proof, seeds: Sequence[Proof]) -> Section:
    table = Facts(HEAD, tuple(cells for proof in seeds for cells in cells_of(proof)))
    says = (f"{claim.says} (Section {claim.section}.)",)
    return Section(
        claim.name.replace(" ", "-"), claim.title, says, (Picture(claim.picture, "", claim.caption),), (table,)
    )


def cells_of(proof: Proof) -> list[tuple[str, ...]]:
    """The claim's rows as text, in the order of HEAD."""
    return [
        (
            str(proof.seed),
            row.what,
            number(row.expected),
            number(row.found),
            number(0.5 * (row.interval[1] - row.interval[0]), 2),
            pretty_unit(row.unit),
            "pass" if row.passed else "FAIL",
        )
        for row in proof.rows
    ]


def _write_picture(path: Path, proof: Proof) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(standalone(proof.picture), encoding="utf-8")
    except OSError as error:
        raise ExperimentError(f"{path}: cannot be written ({error.strerror}); choose another folder") from error
    return path


@dataclass(frozen=True)
class Entry:
    """The shipped rig's name, what is done on it once it is calibrated, and the claims that follow."""

    rig: str
    procedures: tuple[Procedure | Adaptive, ...]
    claims: Callable[[PaperExperiment], tuple[Shown, ...]]


CATALOGUE: Mapping[str, Entry] = {
    "motor": Entry(
        "sim-odrive",
        (FreeLevels(), SteadySpeeds(), SameDeviation(), SlowStops()),
        motor.claims,
    ),
    "muscle": Entry("sim-pneumatic", (MuscleSweeps(), SwungCommand()), muscle.claims),
    "arms": Entry("sim-gravity", (TwoPorts(), PortImpedances()), gravity.claims),
    "spring": Entry("sim-variable-stiffness", (spring.EXPERIMENT, spring.MovingSource()), spring.claims),
    "in situ": Entry("sim-odrive", (in_situ.EXPERIMENT,), in_situ.claims),
}


def rigs_in(folder: Path) -> dict[str, Rig]:
    """The rig of every experiment, by the experiment's name. Raises UsageError where one is not in ``folder``."""
    result = {}
    for name, entry in CATALOGUE.items():
        path = folder / f"{entry.rig}.toml"
        if not path.is_file():
            raise UsageError(f"{path}: no such rig file; leave --rigs out, or give a folder that holds it")
        result[name] = load_rig(path, backend="simulated")
    return result


def gallery(rigs: dict[str, Rig], seeds: Sequence[int], jobs: int, on_done: Callable[[str], None]) -> tuple[Proof, ...]:
    """Every claim at every seed, in the catalogue's order; ``on_done`` hears of each experiment.

    Raises as a session does, and ExperimentError where an experiment does not show what its claims need.
    """
    with process_pool(jobs) as pool:
        todo = {pool.submit(prove, name, rigs[name], seed): (name, seed) for name in rigs for seed in seeds}
        for done in as_completed(todo):
            name, seed = todo[done]
            passed = sum(row.passed for proof in done.result() for row in proof.rows)
            rows = sum(len(proof.rows) for proof in done.result())
            on_done(f"{name}, seed {seed}: {passed} of {rows} rows pass")
        return tuple(proof for done in todo for proof in done.result())


def prove(name: str, rig: Rig, seed: int) -> tuple[Proof, ...]:
    """One experiment at one seed. Raises as :func:`gallery` does."""
    experiment = measure(name, rig, seed)
    try:
        shown = CATALOGUE[name].claims(experiment)
    except ExperimentError as error:
        raise ExperimentError(f"gallery, {name}, seed {seed}: {error}") from error
    return tuple(_drawn(claim, seed) for claim in shown)


def measure(
    name: str, rig: Rig, seed: int, procedures: Sequence[Procedure | Adaptive] | None = None
) -> PaperExperiment:
    """What the experiment of that name measures, and what is true meanwhile; ``procedures`` in place of its own."""
    chosen = CATALOGUE[name].procedures if procedures is None else procedures

    def script(_so_far: SoFar) -> Script:
        yield TareProcedure()
        yield CalibrateProcedure()
        yield from chosen

    with TemporaryDirectory(prefix="norton-bench-") as folder:
        recorded = record_script(replace(rig, candump=False), script, out=Path(folder), seed=seed, live=False)
    tare = recorded.knowledge.tare
    if tare is None:
        raise ExperimentError(f"gallery, {name}: was not tared")
    true = {parameter: value for parameter, (value, _) in true_parameters(rig, seed).items()}
    return PaperExperiment(rig, recorded.measured, true, tare.torque_bias_nm, recorded.knowledge.calibration)


def _drawn(claim: Shown, seed: int) -> Proof:
    with style():
        picture = svg(claim.draw(), claim.name.replace(" ", "-"), claim.caption)
    return Proof(seed, claim.name, claim.title, claim.section, claim.says, claim.rows, picture, claim.caption)
