"""A script brought to its end: what it yields is carried out, and what fails is thrown back into it."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import islice
from typing import Protocol

from norton_bench.errors import BenchError, ExperimentError
from norton_bench.session.script import Action, Remark, Script, Turn
from norton_drivers.errors import DeviceError

# What a script may still want after its experiment was stopped; it could want things forever.
MOST_LAST_TURNS = 100

Yielded = Action | Turn | Remark


class Performer(Protocol):
    """Carries out what a script yields."""

    def turn(self, yielded: Yielded) -> None:
        """Raises what the action does."""
        ...

    def last_turn(self, yielded: Yielded, error: Exception) -> None:
        """The same after ``error`` has stopped everything: nothing moves any more."""
        ...


def perform(script: Script, performer: Performer) -> None:
    """Until the script is done.

    An ExperimentError may be caught by the script, which then goes on. Every other BenchError and DeviceError is final:
    the script's ``finally`` blocks get their last turns, and it is raised whatever the script makes of it.
    """
    with _closed(script):
        yielded = next(script, None)
        while yielded is not None:
            try:
                performer.turn(yielded)
            except ExperimentError as error:
                yielded = _thrown_into(script, error)
            except (BenchError, DeviceError) as error:
                for last in islice(_last(script, error), MOST_LAST_TURNS):
                    performer.last_turn(last, error)
                raise
            else:
                yielded = next(script, None)


@contextmanager
def _closed(script: Script) -> Iterator[None]:
    try:
        yield
    finally:
        # One that wants turns even now, when the program itself is ended, gets none.
        with suppress(RuntimeError):
            script.close()


def _thrown_into(script: Script, error: Exception) -> Yielded | None:
    """What the script yields next. Raises ``error`` where the script lets it through."""
    try:
        return script.throw(error)
    except StopIteration:
        return None


def _last(script: Script, error: Exception) -> Iterator[Yielded]:
    with suppress(StopIteration, type(error)):
        yield script.throw(error)
        yield from script
