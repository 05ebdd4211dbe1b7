"""``sim serve`` and ``sim truth``: the simulator, loaded through entry points, so that the bench does not import it."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from norton_bench.cli.arguments import Json, Quiet, RigFile, Seed
from norton_bench.cli.output import Output, plain_table
from norton_bench.loop.stop_word import operator_stop

Witness = Annotated[Path | None, Parameter(help="A CSV file for the true values, with a line for every millisecond.")]


def serve(rig_file: RigFile, /, *, seed: Seed = None, witness: Witness = None, quiet: Quiet = False) -> None:
    """Serve the simulated devices of a rig on its buses and ports, for another process, until Ctrl-C."""
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
            on_ready=lambda: output.say(f"serving {rig.name} on {', '.join(dict.fromkeys(places))}; Ctrl-C ends it"),
            stop=lambda: stop_word.heard() is not None,
            witness=witness,
        )
        output.say(str(standstills))


def truth(rig_file: RigFile, /, *, seed: Seed = None, json: Json = False) -> None:
    """Print the true values of the simulated actuator, under the names of the parameters."""
    from norton_bench.rig.load import load_rig, true_parameters  # noqa: PLC0415

    values = true_parameters(load_rig(rig_file, backend="simulated"), seed)
    Output(json).result(
        {"parameters": {name: {"value": value, "unit": unit} for name, (value, unit) in values.items()}},
        truth_table(values),
    )


def truth_table(values: dict[str, tuple[float, str]]) -> Any:
    """A row for each parameter: name, value and unit."""

    table = plain_table()
    for heading in ("parameter", "true value", "unit"):
        table.add_column(heading, justify="right" if heading == "true value" else "left", no_wrap=True)
    for name, (value, unit) in values.items():
        table.add_row(name, f"{value:.6g}", unit)
    return table
