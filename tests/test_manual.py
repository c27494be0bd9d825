"""Sizes of the manual, its evidence, the README and the changelog."""

import re
from pathlib import Path

from tests.test_words import prose

ROOT = Path(__file__).resolve().parents[1]
PARTS = ["In short", "Results that change", "Renamed and removed", "New", "Fixed"]


def words(page: Path, tables: bool = True) -> int:
    """Return the number of words of a page without code and equations."""
    lines = prose(page).splitlines()
    return sum(len(re.findall(r"\w[^\s|]*", line)) for line in lines if tables or not line.startswith("|"))


def test_the_manual_is_short():
    pages = sorted((ROOT / "docs").glob("*.md"))
    assert len(pages) <= 15
    assert sum(words(page) for page in pages) <= 15_000


def test_the_evidence_is_short_and_says_what_it_is():
    pages = sorted((ROOT / "docs" / "evidence").glob("*.md"))
    assert sum(words(page, tables=False) for page in pages) <= 8_000
    assert "You do not need these pages" in (ROOT / "docs" / "evidence" / "index.md").read_text()


def test_every_version_of_the_changelog_is_short_and_in_five_parts():
    _, *versions = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(), flags=re.M)
    for version in versions:
        parts = re.findall(r"^### (.*)$", version, re.M)
        assert len(version.split()) <= 600 and parts == [part for part in PARTS if part in parts], version[:5]
        assert parts[0] == "In short"


def test_fragments_of_the_changelog_have_a_part():
    parts = {"short", "changes", "renamed", "new", "fixed"}
    for path in (ROOT / "changelog.d").iterdir():
        if path.name not in ("README.md", "template.jinja"):
            assert re.fullmatch(r"[\w-]+\.(\w+)\.md", path.name)[1] in parts
            assert len(path.read_text().split()) <= 40
