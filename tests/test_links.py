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
            if re.match(r"\w+:", link):
                continue
            path, _, anchor = link.partition("#")
            target = (page.parent / path).resolve() if path else page
            seen += 1
            if not target.is_file() or (anchor and anchor not in anchors(text_of(target))):
                wrong.append(f"{page.relative_to(ROOT)}: {link}")
    assert not wrong
    assert seen > 50


def test_pages_of_a_checkout_show_lists_instead_of_directives():
    """The build makes tables of contents and of names from the lists of these pages."""
    shown = [
        *DOCS.glob("*.md"),
        DOCS / "specification" / "classes.md",
        ROOT / "notebooks" / "index.md",
    ]
    directives = [page.name for page in shown if re.search(r"^```\{", page.read_text(), re.M)]
    assert not directives


def test_the_first_page_lists_every_page():
    """A page that is not listed is not in the table of contents."""
    text = (DOCS / "index.md").read_text()
    listed = re.findall(r"\]\(([\w/.-]+\.md)\)", text[text.index("## All pages") :])
    pages = {str(page.relative_to(DOCS)) for page in PAGES if DOCS in page.parents}
    assert {*listed, "index.md"} == pages | {"../notebooks/index.md"}
    assert len(listed) == len(set(listed))
    tutorials = (ROOT / "notebooks" / "index.md").read_text()
    for notebook in (ROOT / "notebooks").glob("*.ipynb"):
        assert f"]({notebook.name})" in tutorials
