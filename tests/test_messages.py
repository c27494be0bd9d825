"""Messages that docs/messages.md explains are those of the package."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def texts(path: Path) -> str:
    """Return the strings of a file, the values of f-strings as an ellipsis, one string on each line."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.JoinedStr):
            found.append("".join(part.value if isinstance(part, ast.Constant) else " ... " for part in node.values))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.append(node.value)
    return "\n".join(found)


def test_quoted_messages_occur_in_the_package():
    said = " ".join(re.sub(r"\s+", " ", texts(path)) for path in sorted((ROOT / "src").rglob("*.py")))
    page = (ROOT / "docs" / "messages.md").read_text(encoding="utf-8")
    quoted = [phrase for row in re.findall(r"^\| ([^|]*) \|", page, re.M) for phrase in re.findall(r'"([^"]+)"', row)]
    parts = {phrase: [part.strip(" .:") for part in phrase.split("...")] for phrase in quoted}
    assert len(parts) > 40
    assert not [phrase for phrase, of in parts.items() if not all(part in said for part in of)]
