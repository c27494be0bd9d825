"""The registry of pictures: every object with a picture finds the function that draws it."""

import importlib
import pkgutil
import subprocess
import sys

import pytest

import bdamper
from bdamper import plot
from bdamper.model.structure import Model
from bdamper.util.display import _DRAWINGS, InContact, Plottable, draw
from tests.each import each


def plottable_types():
    for module in pkgutil.walk_packages(bdamper.__path__, "bdamper."):
        importlib.import_module(module.name)
    kinds = {*Plottable.__subclasses__(), *InContact.__subclasses__()} - {InContact}
    return sorted(kinds, key=lambda cls: cls.__name__)


@each("cls", plottable_types(), ids=lambda cls: cls.__name__)
def test_the_docstring_names_the_function_that_draws(cls):
    name = cls.__doc__.split(":func:`bdamper.plot.")[1].split("`")[0]
    assert _DRAWINGS[cls, "plot"] is getattr(plot, name)


def test_arguments_are_passed_on(monkeypatch):
    monkeypatch.setitem(
        _DRAWINGS, (Model, "film"), lambda *arguments, **options: (arguments, options)
    )
    model = Model(1, {}, {})
    assert draw(model, "film", 1, size=2) == ((model, 1), {"size": 2})


def test_a_derived_type_is_drawn_as_what_it_derives_from():
    class Special(Model):
        pass

    with pytest.raises(bdamper.SettingError, match="expected at least one body with a mesh"):
        Special(1, {}, {}).plot()


def test_what_has_no_picture_is_refused():
    with pytest.raises(TypeError, match="there is no picture 'film' of Model"):
        draw(Model(1, {}, {}), "film")


@pytest.mark.slow
def test_importing_bdamper_loads_little_and_the_first_picture_the_room(tmp_path):
    code = (
        "import sys, bdamper as bd; assert not {'matplotlib', 'skfem', 'scipy.stats'} & set(sys.modules);"
        "model = bd.reference_model(); assert 'matplotlib' not in sys.modules;"
        "import matplotlib; matplotlib.use('Agg'); model.plot(); assert 'bdamper.plot' in sys.modules"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=False).returncode == 0
