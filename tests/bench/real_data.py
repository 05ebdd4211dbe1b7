"""Where the measurements of other people lie; they are no part of this project."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DATA = Path(os.environ.get("NORTON_BENCH_DATA", ROOT.parent / "shared" / "data"))


def data_file(*parts: str) -> Path:
    """The file, or a skipped test with the reason."""
    path = DATA.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"no measured data at {path}; set NORTON_BENCH_DATA to where they are")
    return path
