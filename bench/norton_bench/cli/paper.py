"""``paper``: the claims of the paper, tested in simulated experiments."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from norton_bench.cli.arguments import Jobs, Json, Quiet, numbers_in
from norton_bench.cli.output import Output, plain_table
from norton_bench.errors import ExitCode
from norton_bench.shipped import shipped_folder

if TYPE_CHECKING:
    from rich.console import RenderableType

    from norton_bench.gallery.paper import Proof

Seeds = Annotated[str, Parameter(help="Seeds of the simulation, such as 1-5 or 1,4.")]
Rigs = Annotated[Path | None, Parameter(help="A folder of rigs; replaces the shipped ones.")]
Pictures = Annotated[Path | None, Parameter(name="--out", help="Also write pictures and an HTML page to this folder.")]


def paper(
    *,
    seeds: Seeds = "1",
    out: Pictures = None,
    rigs: Rigs = None,
    jobs: Jobs = None,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Test the claims of the paper in simulated experiments: the expected value by its formula, the measured value,
    pass or fail.
    """
    from norton_bench.cli.progress import counting  # noqa: PLC0415
    from norton_bench.gallery.paper import (  # noqa: PLC0415
        gallery,
        rigs_in,
        write_gallery,
    )

    output, chosen = Output(json, quiet), numbers_in("--seeds", seeds)
    rig_files = rigs_in(rigs or shipped_folder() / "rigs")
    count = len(rig_files) * len(chosen)
    with counting(output, count) as done:
        proofs = gallery(rig_files, chosen, min(count, jobs or os.cpu_count() or 1), done)
    data, view = paper_data(proofs), [*paper_view(proofs)]
    if out is not None:
        data["page"], data["pictures"] = write_gallery(out, proofs, f"norton-bench paper --seeds {seeds} --out {out}")
        view.append(str(data["page"]))
    output.result(data, *view)
    return ExitCode.OK if all(proof.passed for proof in proofs) else ExitCode.EXPERIMENT_FAILED


def paper_data(proofs: Sequence["Proof"]) -> dict[str, Any]:
    """What ``--json`` prints."""
    from norton_bench.gallery.claim import LEVEL  # noqa: PLC0415

    return {
        "passed": all(proof.passed for proof in proofs),
        "level": LEVEL,
        "rows": [
            {
                "seed": proof.seed,
                "claim": row.claim,
                "figure": row.what,
                "unit": row.unit,
                "expected": row.expected,
                "found": row.found,
                "interval": list(row.interval),
                "rival": row.rival,
                "pass": row.passed,
            }
            for proof in proofs
            for row in proof.rows
        ],
    }


def paper_view(proofs: Sequence["Proof"]) -> Iterator["RenderableType"]:
    """The same for a terminal: each claim, and below it a line for each figure."""

    from norton_bench.gallery.paper import HEAD, cells_of  # noqa: PLC0415

    for claim in dict.fromkeys(proof.title for proof in proofs):
        yield claim
        table = plain_table()
        for heading in HEAD:
            right = heading not in ("figure", "unit", "")
            table.add_column(heading, justify="right" if right else "left", no_wrap=heading != "figure")
        for proof in proofs:
            if proof.title == claim:
                for cells in cells_of(proof):
                    table.add_row(*cells)
        yield table
        yield ""
    passed, rows = sum(row.passed for proof in proofs for row in proof.rows), sum(len(proof.rows) for proof in proofs)
    yield f"{passed} of {rows} rows pass"
