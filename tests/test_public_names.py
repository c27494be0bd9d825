"""The public names: few, and each in the API reference."""

import dataclasses
import datetime
import importlib
import inspect
import re
from importlib import metadata
from pathlib import Path

import pytest

import bdamper as bd
import bdamper.fem
import bdamper.importers
from bdamper.harmonic_balance.settings import Settings

ROOT = Path(__file__).parents[1]
METHODS = ROOT / "tests" / "golden" / "study_methods.txt"


def test_every_public_name_is_in_the_reference():
    reference = (ROOT / "docs" / "api.md").read_text()
    named = re.findall(r"^\* `bdamper\.(\w+)`", reference, re.M)
    rooms = {path.stem for path in (ROOT / "bdamper").iterdir()}
    public = set(bd.__all__) - rooms
    assert set(named) - rooms == public
    assert len(public) <= 44


def test_every_name_of_the_import_is_in_the_reference():
    reference = (ROOT / "docs" / "api.md").read_text()
    elsewhere = {
        "load_model",
        "save_model",
        "Measurement",
        "read_response",
        "read_responses",
    }  # by bdamper or their module
    for name in set(bdamper.importers.__all__) - elsewhere:
        assert f"bdamper.importers.{name}" in reference, name


def test_everything_in_the_reference_is_there():
    pages = [(ROOT / "docs" / name).read_text() for name in ("api.md", "specification/classes.md")]
    for path in re.findall(r"^\* `(bdamper\.[\w.]+)`", "\n".join(pages), re.M):
        assert found(path).__doc__, path


def found(path):
    home, _, name = path.rpartition(".")
    inside = getattr(importlib.import_module(home), name, None)
    return importlib.import_module(path) if inside is None else inside


def test_an_unknown_name_is_an_ordinary_error():
    with pytest.raises(AttributeError, match="Stduy"):
        bd.Stduy  # noqa: B018


def test_the_former_name_of_the_elastic_material_names_both_classes():
    with pytest.raises(
        AttributeError, match=r"now ElasticMaterial; bdamper\.fatigue\.Material has"
    ):
        bdamper.fem.Material  # noqa: B018


def test_the_version_stands_in_one_place():
    (version,) = re.findall(
        r"^project\(.*\bversion: '([^']+)'", (ROOT / "meson.build").read_text(), re.M
    )
    assert bd.__version__ == metadata.version("bdamper") == version, (
        "an older build is installed: run make"
    )
    newest = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.M)[1]
    cited = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(), re.M)[1]
    assert cited == newest, "CITATION.cff cites the newest release"
    if version.endswith(".dev0"):
        # between releases stored results must not name the last release
        assert tuple(map(int, newest.split("."))) < tuple(map(int, version[:-5].split(".")))
    else:
        assert newest == version, "the newest heading of CHANGELOG.md is this version"
    assert "version" not in re.findall(r"^(\w+) *=", (ROOT / "pyproject.toml").read_text(), re.M)


def test_a_citation_names_release_date_and_method():
    citation = (ROOT / "CITATION.cff").read_text()
    date = re.search(r"^date-released: (\S+)$", citation, re.M)[1]
    assert datetime.date.fromisoformat(date) <= datetime.date.today()
    for author in ("Cigeroglu", "An", "Menq"):
        assert f"{{family-names: {author}," in citation
    assert "journal: Journal of Engineering for Gas Turbines and Power\n" in citation
    assert re.search(r"^    volume: 131\n    year: 2009$", citation, re.M)


def test_pushes_are_checked_and_tags_build_wheels():
    folder = ROOT / ".github" / "workflows"
    checks, wheels = ((folder / f"{name}.yml").read_text() for name in ("checks", "wheels"))
    assert re.search(r"^on:\n  push:\n    branches: \[main\]$", checks, re.M)
    assert re.search(r"^on:\n  push:\n    tags: \[\"v\*\"\]$", wheels, re.M)


def study_methods():
    """Return the signature and the first line of the explanation of a study and of each of its methods."""
    methods = {"Study": bd.Study} | {
        name: getattr(bd.Study, name) for name in dir(bd.Study) if not name.startswith("_")
    }
    lines = []
    for name, method in methods.items():
        if callable(method):
            lines += [
                f"{name}{inspect.signature(method)}",
                f"    {inspect.getdoc(method).splitlines()[0]}",
            ]
    return "\n".join(lines) + "\n"


class TestStudy:
    """What a user sees of a study: few names, each with its parameters."""

    @pytest.fixture(scope="class")
    def study(self):
        return bd.Study(bd.reference_model("turbine_blade"), bd.Excitation("tip"), 5)

    def test_help_and_editors_show_what_a_user_types(self):
        """After an intended change: ``python -m tests.test_public_names`` writes the file again."""
        assert study_methods() == METHODS.read_text()

    def test_each_setting_is_a_parameter_with_its_default(self):
        own = inspect.signature(bd.Study).parameters
        assert {name: p.default for name, p in own.items()} == {
            name: p.default for name, p in inspect.signature(Settings).parameters.items()
        }

    def test_each_setting_arrives_under_its_name(self, monkeypatch):
        """Every parameter is passed on, with its own value."""
        given = {name: object() for name in inspect.signature(bd.Study).parameters}
        arrived = {}
        monkeypatch.setattr(
            "bdamper.study.Settings", lambda **settings: arrived.update(settings) or settings
        )
        monkeypatch.setattr("bdamper.study.Problem", lambda settings: settings)
        monkeypatch.setattr(bd.Study, "_ask", lambda study, problem: None)
        bd.Study(**given)
        assert arrived == given

    def test_tab_shows_few_names(self, study):
        shown = [name for name in dir(study) if not name.startswith("_")]
        assert len(shown) <= 52 and {
            "frequency_response",
            "peak",
            "optimal_curve",
            "static",
            "replace",
            "save",
            "model",
        } <= set(shown)
        assert all(hasattr(bd.Study, name) or name in vars(study) for name in shown)

    def test_help_explains_every_setting_with_its_default(self):
        for setting in dataclasses.fields(Settings):
            if setting.init:
                default = (
                    "required"
                    if setting.default is dataclasses.MISSING
                    else f"default {setting.default!r}"
                )
                (line,) = re.findall(
                    rf"^(?:\w+, )*{setting.name}(?:, \w+)* : .*$", bd.Study.__doc__, re.M
                )
                assert default in line

    def test_every_method_lists_its_own_parameters(self, study):
        missing = []
        for name in dir(study):
            method = getattr(bd.Study, name, None)
            if inspect.isfunction(method) and not name.startswith("_"):
                text = inspect.getdoc(method)
                assert "explains" not in text, name
                for one in list(inspect.signature(method).parameters)[1:]:
                    if len(inspect.signature(method).parameters) > 2 and not re.search(
                        rf"(?:^|[, *`]){one}\b", text, re.M
                    ):
                        missing.append(f"{name}({one})")
        assert not missing


if __name__ == "__main__":
    METHODS.write_text(study_methods())
