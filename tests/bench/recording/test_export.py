import csv

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy.io import loadmat

from norton_bench.errors import ExperimentError, UsageError
from norton_bench.models.parameters import Estimate, Status
from norton_bench.recording.contents import RecordedEstimates
from norton_bench.recording.export import export
from norton_bench.recording.recorder import Recorder

TABLES = [
    "ticks",
    "motion",
    "load_motion",
    "torque",
    "current",
    "load_current",
    "modulator_motion",
    "modulator_current",
    "temperature",
    "segments",
    "events",
    "frames",
    "estimates",
]


@pytest.fixture
def recorded(tmp_path, part):
    with Recorder(tmp_path / "r.mcap", rig_text="", metadata={}, patience_s=10.0) as recorder:
        recorder.put(part(0, 20))
        recorder.put_estimate(RecordedEstimates(7, 20, (Estimate("inertia", 5e-5, 1e-6, "kg*m^2", Status.VALID),)))
    return tmp_path / "r.mcap"


def test_parquet_holds_every_table(recorded, part, tmp_path) -> None:
    paths = export(recorded, "parquet", tmp_path / "out")
    assert [path.name for path in paths] == [f"r.{name}.parquet" for name in TABLES]
    ticks = pq.read_table(tmp_path / "out" / "r.ticks.parquet")
    np.testing.assert_array_equal(ticks["position_rad"].to_numpy(), part(0, 20).ticks["position_rad"])
    frames = pq.read_table(tmp_path / "out" / "r.frames.parquet").to_pylist()
    assert [bytes.fromhex(row["data_hex"]) for row in frames] == [frame.data for frame in part(0, 20).frames]
    assert pq.read_table(tmp_path / "out" / "r.estimates.parquet").to_pylist()[0]["status"] == "valid"


def test_csv_names_units_in_its_head(recorded, part, tmp_path) -> None:
    export(recorded, "csv", tmp_path)
    with (tmp_path / "r.torque.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["arrival_ns", "device_ns", "sequence", "torque_nm", "valid"]
    assert [float(row["torque_nm"]) for row in rows] == part(0, 20).torque["torque_nm"].tolist()


def test_matlab_gets_one_struct_a_table(recorded, part, tmp_path) -> None:
    (path,) = export(recorded, "mat", tmp_path)
    content = loadmat(path, simplify_cells=True)
    assert set(TABLES) <= set(content)
    np.testing.assert_array_equal(content["motion"]["velocity_rad_s"], part(0, 20).motion["velocity_rad_s"])
    assert content["events"]["text"] == "part at 0 · µ"
    hexadecimal = [frame.data.hex() for frame in part(0, 20).frames]
    assert [text.strip() for text in np.atleast_1d(content["frames"]["data_hex"])] == hexadecimal
    assert loadmat(path)["frames"]["data_hex"][0, 0].dtype.kind == "U"  # characters, not cells, which take minutes


def test_an_unknown_format_names_the_known_ones(recorded, tmp_path) -> None:
    with pytest.raises(UsageError, match="choose one of parquet, csv, mat, candump"):
        export(recorded, "hdf5", tmp_path)


def test_a_folder_that_cannot_be_written_is_told(recorded, tmp_path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ExperimentError, match="choose another folder"):
        export(recorded, "csv", tmp_path / "file")
