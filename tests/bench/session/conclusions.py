"""What is concluded from a session, without what takes long and is tested elsewhere."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from norton_bench.report import render
from norton_bench.result import Result
from norton_bench.session import conclusion


def _unwritten(path: Path, _: Result) -> Path:
    return path


@contextmanager
def fit_alone() -> Iterator[None]:
    """No other law of friction is fitted, and no report is drawn."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(conclusion, "bench_ladder", lambda *_: ())
        patch.setattr(render, "write_report", _unwritten)
        yield
