import json
import re
import shutil
from pathlib import Path

import pytest

from norton_bench import shipped
from norton_bench.cli import app
from norton_bench.errors import ExitCode
from norton_bench.rig.load import load_rig
from norton_bench.session.schema import load_session


def test_the_list_says_what_each_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert app.main(["examples", "--json"]) == ExitCode.OK
    found = json.loads(capsys.readouterr().out)
    assert {"rigs/sim-odrive.toml", "sessions/quick.toml", "examples/identify.py"} <= set(found)
    assert "examples/third-party-driver/README.md" in found
    assert all(len(words) > 10 for words in found.values())


def test_copies_refer_to_each_other(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.main(["examples", str(tmp_path / "mine")]) == ExitCode.OK
    assert "norton-bench identify" in capsys.readouterr().out
    for path in sorted((tmp_path / "mine" / "sessions").glob("*.toml")):
        session = load_session(path)
        assert session.rig is None or load_rig(session.rig).backend == "simulated"
    assert (tmp_path / "mine" / "docs" / "rig-file.md").is_file()
    assert not [*tmp_path.rglob("*.pyc")]


def test_the_links_of_copied_documents_lead_somewhere(tmp_path: Path) -> None:
    assert app.main(["examples", str(tmp_path)]) == ExitCode.OK
    documents = sorted(tmp_path.rglob("*.md"))
    links = {
        (str(document.relative_to(tmp_path)), link.partition("#")[0])
        for document in documents
        for link in re.findall(r"\]\(([^)\s]+)\)", re.sub(r"```.*?```", "", document.read_text(), flags=re.DOTALL))
        if not link.startswith(("http", "#"))
    }
    assert len(links) > 200
    assert [
        (document, to) for document, to in sorted(links) if not (tmp_path / document).parent.joinpath(to).exists()
    ] == []
    # What is copied keeps its links, and what is not keeps its words.
    text = (tmp_path / "docs" / "architecture.md").read_text()
    assert "[`procedures/catalogue.py`]" not in text
    assert "`procedures/catalogue.py`" in text
    assert "](../README.md#what-it-identifies)" in "".join(document.read_text() for document in documents)


def test_what_is_there_stays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = tmp_path / "rigs" / "sim-odrive.toml"
    mine.parent.mkdir()
    mine.write_text("# mine")
    assert app.main(["examples", str(tmp_path)]) == ExitCode.OK
    assert mine.read_text() == "# mine"
    copied = capsys.readouterr().out
    assert app.main(["examples", str(tmp_path)]) == ExitCode.OK
    assert capsys.readouterr().out.startswith("0 files copied")
    assert not copied.startswith("0 files copied")


def test_a_folder_that_cannot_be_written_to(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert app.main(["examples", str(tmp_path / "file")]) == ExitCode.USAGE
    assert "choose another folder" in capsys.readouterr().err


def test_the_demonstration_needs_no_repository(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What is installed lies inside the package, and the demonstration is that of any other folder."""
    package = tmp_path / "norton_bench"
    shutil.copytree(shipped.shipped_folder() / "rigs", package / "shipped" / "rigs")
    monkeypatch.setattr(shipped, "__file__", str(package / "shipped.py"))
    asked: list[Path] = []
    monkeypatch.setattr("norton_bench.cli.examples.identify", lambda rig, **_: asked.append(rig) or ExitCode.OK)
    assert app.main(["demo", "--quiet"]) == ExitCode.OK
    assert load_rig(asked[0]).name == "sim-odrive"
    assert asked[0].is_relative_to(package)
