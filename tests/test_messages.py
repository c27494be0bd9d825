"""Messages that docs/messages.md explains are those of the package."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def texts(node: ast.AST) -> str:
    """Return the strings of a syntax tree, the values of f-strings as an ellipsis, one string on each line."""
    found = []
    for part in ast.walk(node):
        if isinstance(part, ast.JoinedStr):
            found.append(
                "".join(x.value if isinstance(x, ast.Constant) else " ... " for x in part.values)
            )
        elif isinstance(part, ast.Constant) and isinstance(part.value, str):
            found.append(re.sub(r"\s+", " ", part.value))
    return "\n".join(found)


def sources() -> dict[str, ast.Module]:
    paths = sorted((ROOT / "bdamper").rglob("*.py"))
    return {
        str(path.relative_to(ROOT)): ast.parse(path.read_text(encoding="utf-8")) for path in paths
    }


def quoted() -> dict[str, list[str]]:
    """Return the quoted messages of the page with their parts between ellipses."""
    page = (ROOT / "docs" / "messages.md").read_text(encoding="utf-8")
    phrases = [
        phrase
        for row in re.findall(r"^\| ([^|]*) \|", page, re.M)
        for phrase in re.findall(r'"([^"]+)"', row)
    ]
    return {phrase: [part.strip(" .:") for part in phrase.split("...")] for phrase in phrases}


def test_quoted_messages_occur_in_the_package():
    said = " ".join(texts(tree) for tree in sources().values())
    assert len(quoted()) > 40
    assert not [
        phrase for phrase, parts in quoted().items() if not all(part in said for part in parts)
    ]


def test_every_warning_is_on_the_page():
    """Warnings with a text in the call, and the likely mistakes of values that are not plausible."""
    parts = [part for of in quoted().values() for part in of if len(part) > 8]
    found = []
    for tree in sources().values():
        calls = (node for node in ast.walk(tree) if isinstance(node, ast.Call))
        found += [
            texts(call)
            for call in calls
            if getattr(call.func, "id", "") in ("warn", "warn_implausible")
        ]
    ranges = texts(sources()["bdamper/util/plausible_ranges.py"]).splitlines()
    found = [text for text in found if len(text) > 60] + [
        text for text in ranges if text.endswith("suspected")
    ]
    assert len(found) > 40
    assert not [text for text in found if not any(part in text for part in parts)]
