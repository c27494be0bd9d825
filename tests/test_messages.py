"""The page of messages is made of the catalogue and of the texts of the package."""

import ast

import pytest

from tools import messages
from tools.messages import pattern, read_catalogue, sources, strings


def fragments():
    """Parts of messages that the catalogue explains."""
    rows = [row for section in read_catalogue()["section"] for row in section.get("row", ())]
    return [fragment for row in rows for fragment in row["texts"]]


@pytest.mark.slow
def test_the_page_is_made_of_the_texts_of_the_package():
    """``python tools/messages.py`` writes it again."""
    assert messages.PAGE.read_text(encoding="utf-8") == messages.page()


def test_a_text_that_the_package_does_not_have_is_an_error():
    code = '''
def f(n):
    """Return the seat of the damper."""
    "the seat of the damper"
    raise ValueError(f"{n:.3g} points; seat of '{n}', expected one", "the budget was " "spent")
'''
    texts = [*strings(ast.parse(code))]
    assert texts == ["... points; seat of '...', expected one", "the budget was spent"]
    assert messages.text_of("the budget", texts) == "the budget was spent"
    assert messages.text_of("points ... expected", texts) == texts[0]
    assert messages.text_of("late", [f"{'long ' * 20} late"]) == "late"
    assert messages.text_of("seat", ["...: a seat"]) == "a seat"
    # docstrings are no messages
    with pytest.raises(SystemExit, match="no text of the package contains 'seat of the damper'"):
        messages.text_of("seat of the damper", texts)


@pytest.mark.slow
def test_every_warning_is_on_the_page():
    """Warnings with a text in the call, and the likely mistakes of values that are not plausible."""
    explained = [pattern(fragment) for fragment in fragments() if len(fragment) > 8]
    texts = []
    for tree in sources():
        calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
        warned = [
            call for call in calls if getattr(call.func, "id", "") in ("warn", "warn_implausible")
        ]
        texts += ["\n".join(strings(call)) for call in warned]
    texts = [text for text in texts if len(text) > 60]
    mistakes = [text for tree in sources() for text in strings(tree) if text.startswith("possibly")]
    # a text of values alone has no words to search for
    texts += [text for text in mistakes if len(text) > 8 and text != "possibly given in ..."]
    assert len(texts) > 40
    assert not [text for text in texts if not any(known.search(text) for known in explained)]
