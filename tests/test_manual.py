"""Form of the evidence pages, the README and the changelog."""

import re
import tomllib
from pathlib import Path

import pytest

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
    parts = {"short", "changes", "renamed", "new", "fixed", "internal"}
    for path in (ROOT / "changelog.d").iterdir():
        if path.name not in ("README.md", "template.jinja"):
            assert re.fullmatch(r"[\w-]+\.(\w+)\.md", path.name)[1] in parts
            text = path.read_text()
            assert len(text.split()) <= 40
            assert not text.startswith("* "), f"{path.name}: the template adds the mark of the list"
            if not path.name.endswith(".internal.md"):
                assert "python -m tools" not in text and "csrc/" not in text, path.name


def test_the_changelog_leaves_out_what_only_developers_see():
    """The template of towncrier, with two fragments that users see and one that they do not."""
    jinja2 = pytest.importorskip("jinja2", reason="jinja2 is not installed (extra bdamper[report])")
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["towncrier"]
    names = {part["directory"]: {"name": part["name"]} for part in settings["type"]}
    assert "internal" in names
    fragments = {
        "new": {"A new thing.": []},
        "fixed": {"A fault.": []},
        "internal": {"A test.": []},
    }
    template = jinja2.Template((ROOT / "changelog.d" / "template.jinja").read_text())
    text = template.render(
        definitions=names, sections={"": fragments}, versiondata={"version": "1.2.3"}
    )
    assert "## 1.2.3" in text and "* A new thing." in text and "* A fault." in text
    assert "A test." not in text and "Internal" not in text


README = (ROOT / "README.md").read_text(encoding="utf-8")
INDEX = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")


def test_the_readme_defines_the_package_in_its_first_sentence():
    paragraph = " ".join(README.split("\n\n")[1].split())
    first = paragraph.partition(". ")[0]
    assert first.startswith("bdamper is a Python package with a C core")
    assert "bladed disk" in first and "friction damper" in first
    assert "under-platform damper" in paragraph and "Designers of turbines" in paragraph


def test_the_readme_fits_a_screen_of_100_columns():
    assert max(len(line) for line in README.splitlines()) <= 100
    assert len(README.split()) <= 800


def test_readme_and_manual_name_the_two_commands():
    (commands,) = re.findall(r"```\n(make .*?)```", README, re.S)
    assert [line.split("#")[0].strip() for line in commands.splitlines()] == [
        "make demo",
        "make test",
    ]
    for text in (README, INDEX):
        assert "`.venv`" in text and '`pip install ".[fe,report]"`' in text
        assert "make demo" in text and "make test" in text
    assert "make readme" not in README
    # continuous integration runs the commands of the README, and the quick tests by them alone
    lanes = re.findall(r"^check (.+?)(?: >.*)?$", (ROOT / ".ci" / "run").read_text(), re.M)
    targets = " ".join(lanes).split()
    assert "readme" in targets and "test-slow" in targets and "test" not in targets


def test_the_manual_begins_where_the_readme_ends():
    """No eight words in a row are the same, except for parts of one printed result."""
    runs = [
        {tuple(words[k : k + 8]) for k in range(len(words) - 7)}
        for words in (
            re.sub(r"^```.*?^```", "", page, flags=re.S | re.M).split() for page in (README, INDEX)
        )
    ]
    assert not runs[0] & runs[1]


def largest_deviation(*headings):
    """Largest relative error that docs/evidence/validated.md states for quantities that agree."""
    text = (ROOT / "docs" / "evidence" / "validated.md").read_text(encoding="utf-8")
    found = []
    for heading in headings:
        (section,) = re.findall(rf"^## {heading}$(.*?)(?=^## )", text, re.S | re.M)
        # a row that differs states its reason
        rows = [
            row
            for row in section.splitlines()
            if "differs" not in row and "time integration" not in row
        ]
        found += [float(row.split("|")[3]) for row in rows if re.search(r"\d[eE][-+]\d+ \|$", row)]
    return max(found)


def test_deviations_of_the_readme_are_those_of_the_evidence():
    """Rows of its table, by the pages that it names."""
    rows = dict(re.findall(r"^\| (.+?) \| (.+?) \|$", README, re.M))
    simple = largest_deviation(
        "Griffin's oscillator", "Duffing", "Nonlinear mode of the Jenkins element", "Limit cycles"
    )
    assert rows["closed forms: Griffin, Duffing, Jenkins element, limit cycles"] == "below 1e-5"
    assert 1e-6 < simple < 1e-5
    rigid = largest_deviation("Den Hartog's oscillator", "Goodman and Klumpp's beam")
    assert rows["closed forms: Den Hartog, Goodman and Klumpp"] == "below 1 %"
    assert 1e-3 < rigid < 1e-2
    peaks = largest_deviation(
        "Two masses beside pyHarm", "NLvib's two masses", "NLvib's chain of three masses"
    )
    assert rows["peaks of NLvib and pyHarm: amplitude, frequency"] == "below 0.2 %"
    assert 1e-3 < peaks < 2e-3
    mesh = largest_deviation("CalculiX")
    assert rows["CalculiX, same mesh: frequencies, stress"] == "below 0.01 %"
    assert 1e-5 < mesh < 1e-4

    measured = (ROOT / "docs" / "measurements.md").read_text(encoding="utf-8")
    low, high, test = re.search(
        r"damping ([\d.]+) to ([\d.]+) % instead of up to (\d+) %", measured
    ).groups()
    excess = [100.0 * (float(damping) / float(test) - 1.0) for damping in (low, high)]
    beam = rows["measured beam with a friction contact, nothing fitted"]
    assert beam == f"damping {excess[0]:.0f} to {excess[1]:.0f} % too high"
    assert "fitted to the sweeps | -15 to +2 % |" in measured
    assert "fitted to the hammer test | -10 % at 94 µm, -54 % at 275 µm |" in measured
    small = rows["bolted joint, predicted from a test at larger amplitudes"]
    assert small == "damping up to 15 % too low"
    larger = rows["the same, from a test at smaller amplitudes"]
    assert larger == "damping up to 54 % too low"
    factors = [float(f) for f in re.findall(r"^\| .* \| \d+ % \| ([\d.]+) \|$", measured, re.M)]
    assert f"[{min(factors):g} to {max(factors):g}](docs/measurements.md" in README
