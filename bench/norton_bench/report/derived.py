"""A few figures that follow from the network at once; ``norton-bench datasheet`` has them all."""

from norton_bench.identification.results import FitResult
from norton_bench.models.derived import Figure, derived
from norton_bench.models.parameters import Status
from norton_bench.report.section import Facts
from norton_bench.report.words import between, pretty_unit

HEAD = ("figure", "value", "95 % interval", "unit", "meaning")
# Those that say most of how the actuator feels, and that no operating point belongs to.
SHOWN = ("breakaway_command", "free_speed_per_command", "mechanical_time_constant", "presliding_displacement")


def derived_facts(fit: FitResult) -> Facts | None:
    """A row for each figure whose parameters are known; None where there is none."""
    statuses = {each.name: each.status for each in fit.estimates}
    figures = {each.row.name: each for each in derived(fit.network, (), statuses=statuses)}
    rows = tuple(_row(figures[name]) for name in SHOWN if name in figures and figures[name].status is Status.VALID)
    return Facts(HEAD, rows) if rows else None


def _row(figure: Figure) -> tuple[str, ...]:
    value, interval = between(figure.value, figure.interval)
    return figure.words, value, interval, pretty_unit(figure.unit), figure.row.meaning
