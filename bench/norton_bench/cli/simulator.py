"""``sim serve`` and ``sim truth``: the simulator, found by its entry points so that the bench never knows it."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from norton_bench.cli.arguments import Json, Quiet, RigFile, Seed
from norton_bench.cli.operator import operator_stop
from norton_bench.cli.output import Output, plain_table

Witness = Annotated[Path | None, Parameter(help="A CSV file for what is true meanwhile, a line a millisecond.")]


def serve(rig_file: RigFile, /, *, seed: Seed = None, witness: Witness = None, quiet: Quiet = False) -> None:
    """Serve the simulated devices on the rig's own bus and ports until Ctrl-C, for another process to meet."""
    from norton_bench.rig.load import load_rig, simulator  # noqa: PLC0415

    rig = load_rig(rig_file, backend="simulated")
    output = Output(quiet=quiet)
    places = [bus.channel for bus in rig.wiring.buses]
    places += [device.port for device in rig.wiring.devices() if device.port is not None]
    with operator_stop() as stop_word:
        standstills = simulator("serve")(
            rig.wiring,
            rig.simulated,
            seed=seed,
            place=str(rig_file),
            on_ready=lambda: output.say(f"serving {rig.name} on {', '.join(places)}; Ctrl-C ends it"),
            stop=lambda: stop_word.heard() is not None,
            witness=witness,
        )
        output.say(str(standstills))


def truth(rig_file: RigFile, /, *, seed: Seed = None, json: Json = False) -> None:
    """Print the true values that the simulator has for the actuator, under the identifier's names."""
    from norton_bench.rig.load import load_rig, true_parameters  # noqa: PLC0415

    values = true_parameters(load_rig(rig_file, backend="simulated"), seed)
    Output(json).result(
        {"parameters": {name: {"value": value, "unit": unit} for name, (value, unit) in values.items()}},
        truth_table(values),
    )


def truth_table(values: dict[str, tuple[float, str]]) -> Any:
    """Name, value and unit, a row each."""

    table = plain_table()
    for heading in ("parameter", "true value", "unit"):
        table.add_column(heading, justify="right" if heading == "true value" else "left", no_wrap=True)
    for name, (value, unit) in values.items():
        table.add_row(name, f"{value:.6g}", unit)
    return table
