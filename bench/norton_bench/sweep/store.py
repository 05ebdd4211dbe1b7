"""A sweep's results on disk: a line of JSON for each, as they come, and what they are results of."""

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from io import TextIOWrapper
from pathlib import Path

from norton_bench.errors import UsageError
from norton_bench.sweep.task import Outcome

RESULTS, ABOUT = "results.jsonl", "sweep.json"


@dataclass
class Store:
    """``done`` holds what earlier runs have finished, by name: what failed then is not among it."""

    folder: Path
    done: dict[str, Outcome] = field(default_factory=dict)
    _file: TextIOWrapper | None = field(default=None, init=False)

    @classmethod
    def opened(cls, folder: Path, about: Mapping[str, str]) -> "Store":
        """The store in ``folder``, made where it is not there; ``about`` says what is swept.

        Raises UsageError where the folder cannot be made, or holds another sweep.
        """
        try:
            folder.mkdir(parents=True, exist_ok=True)
            _check_same(folder, about)
            outcomes = {outcome.name: outcome for outcome in _read(folder / RESULTS)}
        except OSError as error:
            raise UsageError(
                f"{folder}: cannot be used ({error.strerror}); choose another folder with --out"
            ) from error
        return cls(folder, {name: outcome for name, outcome in outcomes.items() if not outcome.failure})

    def put(self, outcome: Outcome) -> None:
        """On disk when this returns. Raises UsageError where it cannot be written."""
        try:
            if self._file is None:
                self._file = _appending(self.folder / RESULTS)
            self._file.write(json.dumps(outcome.as_json(), ensure_ascii=False) + "\n")
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise UsageError(f"{self.folder / RESULTS}: cannot be written ({error.strerror})") from error
        if not outcome.failure:
            self.done[outcome.name] = outcome

    def close(self) -> None:
        if self._file is not None:
            self._file.close()


def _check_same(folder: Path, about: Mapping[str, str]) -> None:
    path = folder / ABOUT
    if not path.exists():
        path.write_text(json.dumps(dict(about), indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
        return
    try:
        before = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise UsageError(f"{path}: is not what a sweep has written; choose another folder with --out") from error
    for key, value in about.items():
        if before.get(key) != value:
            raise UsageError(f"{folder}: holds a sweep with another {key}; choose another folder with --out")


def _read(path: Path) -> Iterator[Outcome]:
    """All that was written whole: whoever was killed while writing leaves half a line."""
    if not path.exists():
        return
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            yield Outcome.of_json(json.loads(line))
        except (ValueError, KeyError, TypeError):
            continue


def _appending(path: Path) -> TextIOWrapper:
    """At the beginning of a line."""
    torn = path.exists() and not path.read_bytes().endswith(b"\n") and path.stat().st_size > 0
    file = path.open("a", encoding="utf-8")
    if torn:
        file.write("\n")
    return file
