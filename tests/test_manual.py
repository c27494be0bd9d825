"""Form of the evidence pages, the README and the changelog."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PARTS = ["In short", "Results that change", "Renamed and removed", "New", "Fixed"]


def test_the_evidence_says_what_it_is():
    assert "You do not need these pages" in (ROOT / "docs" / "evidence" / "index.md").read_text()


def test_every_version_of_the_changelog_has_the_five_parts():
    _, *versions = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(), flags=re.M)
    for version in versions:
        parts = re.findall(r"^### (.*)$", version, re.M)
        assert parts == [part for part in PARTS if part in parts], version[:5]
        assert parts[0] == "In short"


def test_fragments_of_the_changelog_have_a_part():
    parts = {"short", "changes", "renamed", "new", "fixed"}
    for path in (ROOT / "changelog.d").iterdir():
        if path.name not in ("README.md", "template.jinja"):
            assert re.fullmatch(r"[\w-]+\.(\w+)\.md", path.name)[1] in parts
            assert len(path.read_text().split()) <= 40


def test_the_readme_has_at_most_350_words_with_the_terms_of_the_field():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.split()) <= 350
    assert "under-platform damper" in text and "bladed disk" in text
