"""Check the sentences of docstrings, comments and messages against rules of plain English.

    python tools/prose.py             check bdamper, csrc and the messages of tests; exit code 1 for differences from the list
    python tools/prose.py --update    write the list again from the sentences of today
    python tools/prose.py --rules     print the rules, with an example of each
    python tools/prose.py FILE ...    show all sentences of these files that break a rule

``tools/prose_known.txt`` lists the sentences that broke a rule when the check was introduced.  The list may only become
shorter: a sentence that is not listed is an error, and so is an entry that no longer occurs.  A rule can be wrong about a
good sentence.  Rewrite such a sentence if a shorter one says the same; otherwise add it to the list.
"""

# ruff: noqa: E501  (the rules are a table)
from __future__ import annotations

import argparse
import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
KNOWN = ROOT / "tools" / "prose_known.txt"
MOST_WORDS = 45


class Sentence(NamedTuple):
    """A sentence with its file and line; kinds are "function" (first sentence of a function), "text" and "message"."""

    path: Path
    line: int
    kind: str
    text: str


class Rule(NamedTuple):
    """A pattern of sentences to avoid, with an example and its replacement; ``kind`` limits it to one kind."""

    name: str
    pattern: str
    instead_of: str
    write: str
    kind: str = ""


THING = (
    r"(?:curve|model|file|result|study|table|deck|point|mode|body|blade|page|row|value|setting|field|picture|line|peak|report|"
    r"reason|status|note|head|name|search|solution|damper|motion|type|order|wheel|message|error|figure|structure|class|module|"
    r"header|step|law|interface|face|matrix|equation|object)s?"
)
PLACE = r"(?:it|they|that|this|none|nothing|no|there|one|neither|these|those|any|both)"
RULES = (
    Rule("fragment", r"^(?:\([^)]*\)[,:]? )?Of (?!course|note|interest|particular|these)", "Of the processor.", "Processor time (s)."),
    Rule("start", r"^(?:Those|That of|That which|That with|What|Whatever|As of|Else|Besides)\b(?![^.]*\?$)",
         "What the rows represent.", "Name of the dimension of the rows."),
    Rule("noun phrase", r"^(?:The|A|An|Those|That|What|How|Where|With|Without|Of|From|As|By|In|Its|Their|On|At|So|No|One|All|Both|Each|"
         r"Some|Whose|Parts?|Ends?)\b", "The curves at some preloads.", "Compute the curve at each preload.", "function"),
    Rule("what", r"\b(?:what|whatever) (?:was|were|is|are|it|they|the|a|an|\w+s)\b(?! (?:happens|this means|you|kind|if|type))",
         "what was computed", "the computed part"),
    Rule("that of", r"\b(?:as|than|is|are|to|from|with|by|and|of|at) (?:that|those) (?:of|with|in|at|by|beyond|under|before)\b",
         "the preload is that of the first one", "the preload is the load on the first damper"),
    Rule("thing as person", rf"\b(?:the |an? |each |every |its |their ){THING} (?:then |also |never |only |still |that |which |itself )?"
         r"(?:says?|said|tells?|told|asks?|asked|knows?|knew|keeps?|kept|stands?|stood|wants?|sees?|saw|speaks?|goes|comes?|bears?)\b",
         "the result says so", "the result contains a warning"),
    Rule("passive", r"\b(?:is|are|was|were|be|been|being|not) (?:asked|kept|said|told|refused|carried|meant(?! for| to)|answered|spared|"
         r"struck|gone|spelt|driven|taken (?:for|so|by|as)|looked for|left over|handed|stood)\b", "unless it is asked for", "if requested"),
    Rule("stands", r"\b(?:stands?|stood|standing) (?:in|for|at|on|under|alone|below|above|there|here|with|the)\b",
         "types stand in the modules that make them", "each module defines its types"),
    Rule("beside", r"(?i:\b(?:besides?|likewise|anew|meanwhile|alike|once more|therein|hereafter)\b)"
         r"|\bfor itself\b", "stands beside the peak", "is listed next to the peak"),
    Rule("so many", r"\b(?:so|as) many\b(?! as)(?! \w+ as)|\bas far as (?:there|it|they|the|one|that)\b|\bnot so (?:many|much|far)\b",
         "in so many digits", "in the given number of digits"),
    Rule("wherever", r"(?i:\b(?:wherever|whichever|whatever)\b)", "wherever they lie", "for any of their values"),
    Rule("where for if", rf"\b[Ww]here {PLACE}(?: \w+)? (?:is|are|was|were|has|have|had|does|do|did|can|cannot|may|could|\w+s)\b",
         "NULL where it is not needed", "NULL if it is not needed"),
    Rule("too", r", too\b(?=[.,;:)]|$)", "Dampers have it, too.", "Dampers also have it."),
    Rule("derivative by", r"\b(?:derivatives?|differentiated|gradients?|slopes?|Jacobian) by (?:the|a|an|omega)\b(?! (?:method|rule))",
         "derivative by omega", "derivative with respect to omega"),
    Rule("inverted", r"^(?i:not )?(?i:Checked|Gone|Removed|Left|Known|Shown|Omitted|Compared|Modelled|Drawn|Written|Kept) (?:are|is|was|were)\b",
         "Not modelled are waves.", "The model omits waves."),
    Rule("own", r"(?<!its )(?<!their )(?<!your )(?<!our )(?<!'s )(?<!s' )(?<!to )(?<!an )\bown (?!\w+ed\b)\w+"
         r"|\bof (?:its|their|your|our|one's) own\b", "a law of your own", "a user-defined law"),
    Rule("tail", r"(?:, |; )(?:the \w+ first|kept|alike|one by one|none of \w+|that of .{1,40}|those of .{1,40}|"
         r"of (?:that|those|both|all|each)\b.{0,40}|and why(?: not)?|(?:NaN|None) (?:where|of|else).{0,40})[.]?$",
         "; None of fewer than two.", "Return None for fewer than two values."),
    Rule("image", r"\b(?:rooms?|ladders?|rungs?|scenes?|witness(?:es)?|climb(?:s|ed|ing)?|mend(?:s|ed|ing)?|hand(?:s|ed)? back|goes? on|"
         r"went on|gives? up|has a say|comes? to|came to|falls? (?:from|through)|tips? of|on its way|told apart|tell(?:s)? apart|"
         r"look(?:s|ed)? after)\b", "the rooms of the package", "the subpackages"),
    Rule("message", r"expected (?:it|none|one|those|that|what|each|such|something)\b|found (?:that|those|one that|what|it)\b",
         "expected one of those, found that", "peak() has no option 'n'", "message"),
    Rule("one", r"\b(?:of|with|from|to|by|as|for) (?:a|an|the|another|that|every) (?:\w+ )?ones?\b(?!-)(?! (?:\w+ed|given|of|side|or|to|"
         r"that|which|with|by|from|in|for|at|above|below)\b)", "of a symmetric one, both triangles", "both triangles of the matrix"),
    Rule("relative clauses", "", "what was made where those that follow are", "one subordinate clause"),
    Rule("long", "", f"more than {MOST_WORDS} words", "two sentences"),
)  # fmt: skip
COMPILED = {rule: re.compile(rule.pattern) for rule in RULES if rule.pattern}
RELATIVE = re.compile(r"\b(?:that|those|what|which|whose|where|whatever|wherever)\b", re.IGNORECASE)
ABBREVIATION = re.compile(
    r"\b(?:e\.g|i\.e|vs|cf|al|Eqs?|Figs?|Refs?|Secs?|No|pp|Vol|eds?|Int|Eng|Proc|Trans|approx|\w)\.$"
)
HEADED = (
    "Parameters",
    "Attributes",
    "Returns",
    "Yields",
    "Raises",
    "Warns",
    "Parameters of the class",
)
REPORTS = {
    "warn",
    "invalid",
    "check",
    "check_value",
    "mismatch",
    "implausible",
    "warn_implausible",
    "error",
    "note",
}


def broken_rules(sentence: Sentence) -> list[str]:
    """Return the names of the rules that a sentence breaks."""
    words, clauses = len(sentence.text.split()), len(RELATIVE.findall(sentence.text))
    if words < 3:
        return []
    names = [
        rule.name
        for rule, pattern in COMPILED.items()
        if rule.kind in ("", sentence.kind) and pattern.search(sentence.text)
    ]
    names += ["relative clauses"] * (clauses > 3 or (clauses == 3 and words < 26))
    return names + ["long"] * (words > MOST_WORDS)


def split(text: str) -> Iterator[str]:
    """Yield the sentences of a paragraph, with code and formulas replaced by a word."""
    text = re.sub(r":\w+:`[^`]*`|``[^`]+``|`[^`]+`", "CODE", text)
    text = re.sub(r"\s+", " ", re.sub(r"\$[^$\n]+\$", "MATH", text)).strip()
    start = 0
    for end in re.finditer(r"[.!?][\")']*\s+(?=[\"'(]*[A-Z0-9])", text):
        if not ABBREVIATION.search(text[start : end.end()].strip()):
            yield text[start : end.end()].strip()
            start = end.end()
    if text[start:].strip():
        yield text[start:].strip()


def docstring_paragraphs(text: str) -> Iterator[tuple[int, str]]:
    """Yield (line, paragraph) of a numpydoc docstring, without names of parameters, examples and references."""
    lines, section, block, first = [*text.splitlines(), ""], "", [], 0
    for i, line in enumerate(lines):
        rule = re.match(r"\s*[-=~^]{3,}\s*$", line)
        heading = (
            i + 1 < len(lines) and line.strip() and re.match(r"\s*[-=~^]{3,}\s*$", lines[i + 1])
        )
        section = line.strip() if heading else section
        code = re.match(r"\s*(?:>>>|\.\.\. |\.\. |\||\[\d+\])", line) or section in (
            "Examples",
            "References",
            "See Also",
        )
        name = section in HEADED and not line.startswith(" ")
        item = re.match(r"\s*(?:[*+-]|\d+\.)\s+", line)
        if block and (not line.strip() or rule or heading or code or name or item):
            yield first, " ".join(block)
            block = []
        if line.strip() and not (rule or heading or code or name):
            first = first if block else i
            block.append(line[item.end() :] if item else line.strip())


def text_of(node: ast.expr) -> str:
    """Return the text of an expression of strings, with X for each value."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(
            str(part.value) if isinstance(part, ast.Constant) else "X" for part in node.values
        )
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return text_of(node.left) + text_of(node.right)
    return ""


def python_docstrings(path: Path, tree: ast.Module) -> Iterator[Sentence]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and (
            text := ast.get_docstring(node)
        ):
            decorators = [ast.unparse(d) for d in getattr(node, "decorator_list", [])]
            kind = (
                "function"
                if isinstance(node, ast.FunctionDef)
                and not any("property" in d for d in decorators)
                else "text"
            )
            for offset, block in docstring_paragraphs(text):
                for sentence in split(block):
                    yield Sentence(path, node.body[0].lineno + offset, kind, sentence)
                    kind = "text"


def python_messages(path: Path, tree: ast.Module) -> Iterator[Sentence]:
    for node in ast.walk(tree):
        arguments: list[ast.expr] = []
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            arguments = node.exc.args
        elif isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in REPORTS:
            arguments = node.args
        elif isinstance(node, ast.Assert) and node.msg is not None:
            arguments = [node.msg]
        texts = [text for text in map(text_of, arguments) if len(text) > 12]
        for sentence in split(": ".join(texts)):
            yield Sentence(path, node.lineno, "message", sentence)


def python_comments(path: Path, text: str) -> Iterator[Sentence]:
    tokens = [
        t
        for t in tokenize.generate_tokens(io.StringIO(text).readline)
        if t.type == tokenize.COMMENT
    ]
    blocks: list[tuple[int, list[str]]] = []
    last = -1
    for token in tokens:
        line, alone = token.start[0], not token.line[: token.start[1]].strip()
        if not (alone and line == last + 1):
            blocks.append((line, []))
        blocks[-1][1].append(token.string.lstrip("#: "))
        last = line if alone else -1
    for line, block in blocks:
        if not re.match(r"type:|noqa|fmt:|ruff:|!|-{4}", block[0]):
            for sentence in split(" ".join(block)):
                yield Sentence(path, line, "text", sentence)


def c_comments(path: Path, text: str) -> Iterator[Sentence]:
    for comment in re.finditer(r"/\*.*?\*/|(?://[^\n]*\n\s*)+", text, re.DOTALL):
        body = re.sub(r"^\s*(?:\*|//) ?", "", comment.group().strip("/* \n"), flags=re.MULTILINE)
        for block in re.split(r"\n\s*\n", body):
            prose = " ".join(
                row for row in block.splitlines() if not re.match(r"\s{4,}|-{3}|={3}", row)
            )
            for sentence in split(prose):
                yield Sentence(path, text.count("\n", 0, comment.start()) + 1, "text", sentence)


def sentences(path: Path) -> Iterator[Sentence]:
    """Yield the sentences of a file; of a test the messages alone."""
    text = path.read_text(encoding="utf-8")
    if path.suffix in (".c", ".h"):
        yield from c_comments(path, text)
        return
    tree = ast.parse(text)
    yield from python_messages(path, tree)
    if not path.is_relative_to(ROOT / "tests"):
        yield from python_docstrings(path, tree)
        yield from python_comments(path, text)


def main() -> int:
    """Return 0 if the sentences that break a rule are those of the list."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "files", nargs="*", type=Path, help="show all sentences of these files that break a rule"
    )
    parser.add_argument(
        "--update", action="store_true", help=f"write {KNOWN.name} from the sentences of today"
    )
    parser.add_argument("--rules", action="store_true", help="print the rules")
    arguments = parser.parse_args()
    if arguments.rules:
        print(
            *(f"{rule.name}\n    not: {rule.instead_of}\n    but: {rule.write}" for rule in RULES),
            sep="\n",
        )
        return 0
    folders = (("bdamper", "*.py"), ("csrc", "*.[ch]"), ("tests", "*.py"))
    files = [f.resolve() for f in arguments.files] or sorted(
        p for name, ends in folders for p in (ROOT / name).rglob(ends)
    )
    found = [
        (sentence, names)
        for path in files
        for sentence in sentences(path)
        if (names := broken_rules(sentence))
    ]
    now = {sentence.text for sentence, _ in found}
    if arguments.update:
        KNOWN.write_text("".join(f"{text}\n" for text in sorted(now)), encoding="utf-8")
        print(f"{KNOWN.relative_to(ROOT)}: {len(now)} sentences")
        return 0
    known = (
        set()
        if arguments.files or not KNOWN.exists()
        else set(KNOWN.read_text(encoding="utf-8").splitlines())
    )
    for sentence, names in found:
        if sentence.text not in known:
            print(
                f"{sentence.path.relative_to(ROOT)}:{sentence.line}: {', '.join(names)}: {sentence.text}"
            )
    gone = sorted(known - now)
    for text in gone:
        print(
            f"{KNOWN.relative_to(ROOT)}: no longer in use, delete the line or run tools/prose.py --update: {text}"
        )
    new = len(now - known)
    print(
        f"{new} new sentences break a rule (tools/prose.py --rules), {len(gone)} entries are no longer in use",
        file=sys.stderr,
    )
    return int(bool(new or gone))


if __name__ == "__main__":
    sys.exit(main())
