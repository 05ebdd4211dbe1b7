"""Every link in the documents leads to a file and to a heading of it; the table of terms is that of the program."""

import re
from pathlib import Path

import pytest

from norton_bench.models.terms import TERMS

ROOT = Path(__file__).parents[1]
DOCUMENTS = [ROOT / "README.md", *sorted(ROOT.glob("docs/**/*.md")), *sorted(ROOT.glob("examples/**/*.md"))]
FENCED = re.compile(r"```.*?```", re.DOTALL)


def prose(document: Path) -> str:
    return FENCED.sub("", document.read_text(encoding="utf-8"))


def anchors(document: Path) -> set[str]:
    """As GitHub makes them: lower case, punctuation left out, hyphens for spaces."""
    headings = re.findall(r"^#+ (.*)$", prose(document), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(document: Path) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", prose(document)):
        if link.startswith("http"):
            continue
        name, _, anchor = link.partition("#")
        target = (document.parent / name).resolve() if name else document
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


def test_the_table_of_terms_is_that_of_the_program() -> None:
    """docs/networks.md, "Terms": every line, with its equation, its parameters and their units, and no other."""
    text = (ROOT / "docs/networks.md").read_text(encoding="utf-8").partition("\n## Terms\n")[2]
    table = re.findall(r"^\| `(\w+)` \| (.*?) \| (.*?) \| (.*?) \|$", text.partition("A network has")[0], re.MULTILINE)
    expected = [
        (
            term.name,
            term.equation.replace("|", "\\|"),
            ", ".join(
                f"`{each.name}` {each.symbol}" + ("" if each.unit == "1" else f" [{each.unit}]")
                for each in term.parameters
            ),
            term.meaning,
        )
        for term in TERMS
    ]
    assert table == expected
