"""Rules of tools/prose.py: each finds its example and accepts the replacement."""

import subprocess
import sys

import pytest

from tools.prose import ROOT, RULES, Sentence, broken_rules, sentences


@pytest.mark.parametrize(
    "rule", [rule for rule in RULES if rule.pattern], ids=lambda rule: rule.name
)
def test_each_rule_finds_its_example(rule):
    def broken(text):
        return broken_rules(Sentence(ROOT, 1, rule.kind or "text", text))

    assert rule.name in broken(rule.instead_of)
    assert rule.name not in broken(rule.write)


def test_long_sentences_and_many_relative_clauses():
    assert broken_rules(Sentence(ROOT, 1, "text", "word " * 46)) == ["long"]
    text = "These are values that follow those which the model has where it lies."
    assert "relative clauses" in broken_rules(Sentence(ROOT, 1, "text", text))


def test_texts_of_a_module(tmp_path):
    path = tmp_path / "module.py"
    path.write_text(
        'def f(x):\n    """Return the sum.  It is a number.\n\n    Parameters\n    ----------\n    x : float\n'
        '        The value.\n    """\n    # A comment about\n    # the value.\n'
        '    raise ValueError(f"the value is {x}, not a number")\n'
    )
    found = [(s.line, s.kind, s.text) for s in sentences(path)]
    assert found == [
        (11, "message", "the value is X, not a number"),
        (2, "function", "Return the sum."),
        (2, "text", "It is a number."),
        (7, "text", "The value."),
        (9, "text", "A comment about the value."),
    ]


def test_the_list_may_only_become_shorter(tmp_path):
    """A copy of the tool with a list of one line: both directions of the comparison fail."""
    for name in ("bdamper", "csrc", "tests", "tools"):
        (tmp_path / name).mkdir()
    tool = tmp_path / "tools" / "prose.py"
    tool.write_text((ROOT / "tools" / "prose.py").read_text(encoding="utf-8"), encoding="utf-8")
    module = tmp_path / "bdamper" / "module.py"
    module.write_text("# What the rows of it represent.\n")

    def run(*arguments):
        done = subprocess.run(
            [sys.executable, str(tool), *arguments], capture_output=True, text=True
        )
        return done.returncode, done.stdout

    assert run()[0] == 1 and "bdamper/module.py:1: start" in run()[1]
    assert run("--update")[0] == 0 and run() == (0, "")
    module.write_text("# The rows are points.\n")
    code, text = run()
    assert code == 1 and "no longer in use" in text and "--update" in text
