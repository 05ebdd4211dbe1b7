"""What the paper claims of an actuator, shown on the shipped rigs: the experiments, and what they show."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from norton_bench.errors import ExperimentError, UsageError
from norton_bench.gallery import gravity, in_situ, motor, muscle, spring
from norton_bench.gallery.claim import PaperExperiment, Row, Shown
from norton_bench.gallery.gravity import TwoPorts
from norton_bench.gallery.motor_experiments import FreeLevels, SlowStops, SteadySpeeds
from norton_bench.gallery.muscle import MuscleSweeps
from norton_bench.procedures.calibrate import CalibrateProcedure
from norton_bench.procedures.knowledge import Adaptive, Procedure
from norton_bench.procedures.tare import TareProcedure
from norton_bench.report.svg import style, svg
from norton_bench.rig.load import load_rig, true_parameters
from norton_bench.rig.rig import Rig
from norton_bench.session.engine import record_script
from norton_bench.session.pool import process_pool
from norton_bench.session.script import Script, SoFar


@dataclass(frozen=True)
class Entry:
    """The shipped rig's name, what is done on it once it is calibrated, and the claims that follow."""

    rig: str
    procedures: tuple[Procedure | Adaptive, ...]
    claims: Callable[[PaperExperiment], tuple[Shown, ...]]


CATALOGUE: Mapping[str, Entry] = {
    "motor": Entry(
        "sim-odrive",
        (FreeLevels(), SteadySpeeds(), SlowStops()),
        motor.claims,
    ),
    "muscle": Entry("sim-pneumatic", (MuscleSweeps(),), muscle.claims),
    "arms": Entry("sim-gravity", (TwoPorts(),), gravity.claims),
    "spring": Entry("sim-variable-stiffness", (spring.EXPERIMENT,), spring.claims),
    "in situ": Entry("sim-odrive", (in_situ.EXPERIMENT,), in_situ.claims),
}


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
        recorded = record_script(replace(rig, candump=False), script, out=Path(folder), seed=seed)
    tare = recorded.knowledge.tare
    if tare is None:
        raise ExperimentError(f"gallery, {name}: was not tared")
    true = {parameter: value for parameter, (value, _) in true_parameters(rig, seed).items()}
    return PaperExperiment(rig, recorded.measured, true, tare.torque_bias_nm)


def _drawn(claim: Shown, seed: int) -> Proof:
    with style():
        picture = svg(claim.draw(), claim.name.replace(" ", "-"), claim.caption)
    return Proof(seed, claim.name, claim.title, claim.section, claim.says, claim.rows, picture, claim.caption)
