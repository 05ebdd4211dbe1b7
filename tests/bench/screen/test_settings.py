"""The settings file: what may stand in it, and a sentence for everything else."""

from pathlib import Path

import pytest

from norton_bench.errors import UsageError
from norton_bench.screen.screens.keys import KNOWN as KEYS
from norton_bench.screen.settings import KNOWN as THEMES
from norton_bench.screen.settings import PLACE, Settings, load_settings, settings_path, user_themes

WRITTEN = """
theme = "lab"
fps = 10

[keys]
pause = "f5"
stop = "f12"

[themes.lab]
primary = "#4f9dde"
dark = false
"""


def read(path: Path, text: str) -> Settings:
    path.write_text(text)
    return load_settings(path, KEYS, THEMES)


def test_everything_can_be_set(tmp_path: Path) -> None:
    settings = read(tmp_path / "config.toml", WRITTEN)
    assert (settings.theme, settings.fps) == ("lab", 10.0)
    assert user_themes(settings.themes)[0].dark is False


def test_space_stops_whatever_else_does(tmp_path: Path) -> None:
    assert read(tmp_path / "config.toml", WRITTEN).keys == {"pause": "f5", "stop": "space,f12"}


def test_without_a_file_all_is_as_usual(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(PLACE, raising=False)
    assert load_settings(tmp_path / "none.toml", KEYS, THEMES) == Settings()
    assert settings_path().name == "config.toml"
    monkeypatch.setenv(PLACE, str(tmp_path / "mine.toml"))
    assert settings_path() == tmp_path / "mine.toml"
    with pytest.raises(UsageError, match="no such settings file"):
        load_settings(settings_path(), KEYS, THEMES)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('keys = { paus = "f5" }', 'did you mean "pause"?'),
        ('keys = { pause = "space" }', "space always stops"),
        ('keys = { pause = "f5, space" }', "space always stops"),
        ('keys = { pause = "" }', "is empty"),
        ('theme = "nrd"', 'did you mean "nord"?'),
        ("fps = 200", "must be at most 60"),
        ("colour = 1", "unknown key"),
        ('[themes.lab]\nprimary = "blue"', 'expected a colour like "#4f9dde", not "blue"'),
        ('[themes.lab]\nprimry = "#000000"', 'did you mean "primary"?'),
        ('[themes.lab]\nprimary = "#000000"\ndark = 1', "expected true or false, not 1"),
        ("[themes.lab]\ndark = true", "is missing"),
        ("theme = ", "is not TOML"),
    ],
)
def test_every_mistake_is_a_sentence_with_its_place(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "config.toml"
    with pytest.raises(UsageError, match=r".") as error:
        read(path, text)
    assert said in str(error.value)
    assert all(line.startswith(str(path)) for line in str(error.value).splitlines())
