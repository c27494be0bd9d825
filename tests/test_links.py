"""Links between the pages of the repository lead somewhere, anchors included; Sphinx sees only those below docs/."""

import json
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = [
    *ROOT.glob("*.md"),
    *DOCS.glob("*.md"),
    *DOCS.glob("evidence/*.md"),
    *DOCS.glob("specification/*.md"),
]
PAGES += (ROOT / "notebooks").glob("*.[mi]*")
MADE = {"gallery/index", "gallery/index.md"}
"""Pages that ``make docs`` writes; it copies the notebooks to docs/tutorial as well."""


def text_of(path):
    text = path.read_text(encoding="utf-8")
    return (
        "\n".join("".join(cell["source"]) for cell in json.loads(text)["cells"])
        if path.suffix == ".ipynb"
        else text
    )


def anchors(text):
    """Those that headings get, as GitHub and MyST make them."""
    heads = re.findall(r"^#+ (.+)$", re.sub(r"```.*?```", "", text, flags=re.S), re.M)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


def test_internal_links():
    wrong, seen = [], 0
    for page in PAGES:
        for link in re.findall(
            r"\]\(([^)\s]+)\)", re.sub(r"```.*?```", "", text_of(page), flags=re.S)
        ):
            if re.match(r"\w+:", link) or link in MADE:
                continue
            path, _, anchor = link.partition("#")
            source = (
                ROOT / path.replace("tutorial/", "notebooks/")
                if path.startswith("tutorial/")
                else page.parent / path
            )
            target = source.resolve() if path else page
            seen += 1
            if not target.is_file() or (anchor and anchor not in anchors(text_of(target))):
                wrong.append(f"{page.relative_to(ROOT)}: {link}")
    assert not wrong
    assert seen > 50
