"""Write docs/messages.md from docs/messages.toml and the texts of the package.

    python tools/messages.py

Each row of the catalogue has fragments of texts ("..." stands for values), their meaning and a
remedy. The page shows the text of the code that contains a fragment. A fragment that no text of
the code contains is an error.
"""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
CATALOGUE = ROOT / "docs" / "messages.toml"
PAGE = ROOT / "docs" / "messages.md"
LONGEST = 90
"""Characters of a text of the code up to which it is shown as a whole."""


def as_text(node: ast.AST) -> str:
    """Return a string of the code, with "..." for the values of an f-string; "" otherwise."""
    if isinstance(node, ast.JoinedStr):
        parts = [x.value if isinstance(x, ast.Constant) else "..." for x in node.values]
        text = " ".join("".join(map(str, parts)).split())
        return re.sub(r"\.{4,}", "...", text)
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return " ".join(node.value.split())
    return ""


def strings(tree: ast.AST) -> Iterator[str]:
    """Yield the strings of a syntax tree except docstrings, each f-string as a whole."""
    # a string that is a statement of its own documents the code and is never printed
    if isinstance(tree, ast.Expr) and isinstance(tree.value, ast.Constant):
        return
    text = as_text(tree)
    if text:
        yield text
    for child in ast.iter_child_nodes(tree):
        # the constant parts of an f-string belong to the text above, formats are no texts
        belongs_to_text = isinstance(tree, ast.JoinedStr) and isinstance(child, ast.Constant)
        is_format = isinstance(tree, ast.FormattedValue) and isinstance(child, ast.JoinedStr)
        is_value = not is_format or child is tree.value
        if is_value and not belongs_to_text:
            yield from strings(child)


def sources() -> list[ast.Module]:
    """Return the syntax trees of the package."""
    paths = sorted((ROOT / "bdamper").rglob("*.py"))
    return [ast.parse(path.read_text(encoding="utf-8")) for path in paths]


def pattern(fragment: str) -> re.Pattern[str]:
    """Return the pattern of a fragment, whose ellipses match values and other words."""
    parts = [re.escape(part.strip()) for part in fragment.split("...")]
    return re.compile(".*?".join(parts))


def text_of(fragment: str, texts: list[str]) -> str:
    """Return the shortest text of the code with a fragment, or the fragment of a long text."""
    wanted = pattern(fragment)
    containing = [text for text in texts if wanted.search(text)]
    if not containing:
        raise SystemExit(f"{CATALOGUE.name}: no text of the package contains {fragment!r}")
    shortest = min(containing, key=len)
    if len(shortest) > LONGEST:
        return fragment
    # a text that continues another one begins with its separator
    return re.sub(r"^(\.\.\.)?[;,:] ", "", shortest)


def cell(row: dict[str, Any], column: str, texts: list[str]) -> str:
    """Return the cell of a row: the texts in the first column, otherwise meaning or remedy."""
    if column not in ("meaning", "remedy"):
        found = dict.fromkeys(text_of(fragment, texts) for fragment in row["texts"])
        return ", ".join(f'"{text}"' for text in found).replace("|", r"\|")
    return str(row[column])


def read_catalogue() -> dict[str, Any]:
    """Return the catalogue: introduction, and sections with their rows."""
    return tomllib.loads(CATALOGUE.read_text(encoding="utf-8"))


def page() -> str:
    """Return the page."""
    catalogue = read_catalogue()
    texts = sorted({text for tree in sources() for text in strings(tree)})
    parts = [catalogue["intro"]]
    for section in catalogue["section"]:
        parts += [f"## {section['title']}\n", section.get("before", "")]
        if "row" in section:
            columns = ["message", *(c for c in ("meaning", "remedy") if c in section["row"][0])]
            lines = [columns, ["---"] * len(columns)]
            lines += [[cell(row, name, texts) for name in columns] for row in section["row"]]
            parts.append("".join(f"| {' | '.join(line)} |\n" for line in lines))
        parts.append(section.get("after", ""))
    return "\n".join(part for part in parts if part)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
