"""The manual is written in the terms of the field: phrases that a reader would have to guess are not used.

Every page, and every notebook, says within its first lines which question it answers.  The search for phrases leaves out
code, printed results and links.
"""

import json
import re
from pathlib import Path

import pytest

from tests.each import each

ROOT = Path(__file__).resolve().parents[1]
RECORDS = {
    "api.md",
    "classes.md",
    *(page.name for page in (ROOT / "docs" / "evidence").glob("measured*.md")),
}
"""Tables of measurements and lists of names: no prose to read from the beginning."""
BETTER = {
    r"\b(blades?|it|wheels?) keeps?\b|\bkeeps? to (a|its|them)\b|what is kept": "steady-state amplitude in time",
    r"\bhard(er)? (disks?|cases?|models?|ones?)\b": "difficult disk, difficult case",
    r"\bunequal (blades|wheels)\b": "mistuned",
    r"\brungs?\b|(?-i:\bladders?\b)": "numbers of harmonics, convergence",
    r"\btops\b": "peaks",
    r"\bthe tries\b|\bclimb(s|ed|ing)?\b": "attempts, local searches",
    r"\bjudge[sd]?\b|\bjudging\b": "determined, examined",
    r"\bwalk(s|ed|ing)?\b": "steps",
    r"\bfalls? (to|from|at|back)\b": "jumps to, decreases",
    r"\bchatters?\b": "vibrates on its contact stiffness",
    r"\bsays? so (itself|themselves|by)\b": "carries a warning",
    r"\bin the place of\b|\btakes? the place of\b": "instead of, replaces",
    r"\bdear(er|est)\b": "more expensive",
    r"\bhangs? (on|upon)\b": "depends on",
    r"\bgives? way\b": "yields, depends on",
    r"\bleft open for further\b": "not shut down",
    r"\bbrought along\b|\bof one's own\b": "supplied, user-defined",
    r"\bforgets?\b": "does not depend on",
    r"\bfreedoms\b(?<!degrees of freedoms)": "degrees of freedom",
    r"\bbut for\b": "except for",
    r"\bis told\b|\btells? the truth\b": "is stated",
    r"\bpercent\b": "per cent",
    r"\bcalled for\b": "needed",
    r"\b(is|are) no (peak|optimum|answer|design value)\b": "is not a peak",
    r"\bcomes? out as\b": "is",
}
"""Phrases, as regular expressions, and what to write instead."""


def pages() -> list[Path]:
    folders = ("docs/*.md", "docs/evidence/*.md", "docs/specification/*.md", "notebooks/*.[mi]*")
    found = [
        ROOT / "README.md",
        *(page for folder in folders for page in sorted(ROOT.glob(folder))),
    ]
    return [page for page in found if page.name not in RECORDS]


def prose(page: Path) -> str:
    """The text of a page, or of the cells of a notebook that hold text, without code and targets of links."""
    text = page.read_text(encoding="utf-8")
    if page.suffix == ".ipynb":
        cells = json.loads(text)["cells"]
        text = "\n\n".join(
            "".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown"
        )
    text = re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)
    text = re.sub(r"^\$\$.*?^\$\$[^\n]*", "", text, flags=re.S | re.M)
    return re.sub(r"`[^`\n]*`|\$[^$\n]*\$|(?<=\])\([^)\n]*\)", "", text)


def phrases(text: str) -> list[str]:
    """Each phrase that stands in a text, also across the end of a line, with what to write instead."""
    flat = " ".join(text.split())
    return [
        f"{flat[max(0, hit.start() - 30) : hit.end() + 30]!r}: write {better!r}"
        for phrase, better in BETTER.items()
        for hit in re.finditer(phrase, flat, re.I)
    ]


@each("page", pages(), ids=lambda page: page.name)
def test_plain_words(page):
    assert not phrases(prose(page))


# the first page defines the package instead (tests/test_manual.py)
@each("page", [page for page in pages() if page.name != "README.md"], ids=lambda page: page.name)
def test_a_page_begins_with_its_purpose(page):
    lines = [
        line for line in prose(page).splitlines() if line.strip() and not line.startswith("![")
    ]
    beginning = " ".join(lines[:4])
    # pages of results answer a question
    assert lines[1].startswith("This page ") or "?" in beginning, lines[:4]


@pytest.mark.parametrize(
    "sentence",
    [
        "There a blade\nkeeps 70 µm.", "In wheels of a hard disk it is twice as much.", "The ladder has five rungs.",
        "The motion falls to 0.1 mm.", "It then chatters on them.", "There are harder disks, which say so themselves.",
    ],
)  # fmt: skip
def test_phrases_are_found(sentence):
    assert phrases(sentence)
