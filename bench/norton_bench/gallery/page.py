"""The gallery as files: a picture for each claim, and a page with all of them."""

from collections.abc import Sequence
from pathlib import Path

from norton_bench.errors import ExperimentError
from norton_bench.gallery.claim import LEVEL
from norton_bench.gallery.paper import Proof
from norton_bench.report.render import HeadlineNumber, fill, write_page
from norton_bench.report.section import Facts, Picture, Section
from norton_bench.report.svg import standalone
from norton_bench.report.words import number, pretty_unit
from norton_bench.result import Result

HEAD = ("seed", "figure", "expected", "found", f"± ({100 * LEVEL:g} %)", "unit", "")

ABOUT = Section(
    "about",
    "Expected and found",
    (
        "Expected is the paper's closed form with the simulated machine's true values; found is what the bench "
        "measured, through frames, bytes, noise, counts and delays, with an interval from its own repetitions.",
    ),
)


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
