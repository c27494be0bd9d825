"""Every type of result that draws itself has its pictures among those of the manual."""

import importlib
import json
import pkgutil
import re
from pathlib import Path

import bdamper
from bdamper.util.display import InContact, Plottable

PAGE = Path(__file__).resolve().parents[2] / "notebooks" / "result_pictures.ipynb"
PICTURES = {
    "Campbell": ("plot", "plot_safe"),
    "Margins": ("plot", "plot_critical"),
    "Hysteresis": ("plot", "plot_history", "plot_energy"),
    "Model": ("plot", "plot_mode"),
    "Peak": ("plot", "plot_contacts"),
    "MistunedSample": ("plot", "plot_tail"),
    "TimeResponse": ("plot", "mark"),
    "DiskPeak": ("plot", "plot_wheel"),
}
"""Types with more pictures than ``plot``."""


def descendants(kind):
    for one in kind.__subclasses__():
        yield one
        yield from descendants(one)


def sections():
    """Code of each section of the page by its heading."""
    found, name = {}, ""
    for cell in json.loads(PAGE.read_text())["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            name = re.findall(r"^## (\w+)$", source, re.M)[-1]
        else:
            found[name] = found.get(name, "") + source
    return found


def test_every_result_with_a_picture_is_on_the_page():
    for module in pkgutil.walk_packages(bdamper.__path__, "bdamper."):
        importlib.import_module(module.name)
    results = [kind for kind in descendants(Plottable) if kind is not InContact]
    kinds = {kind.__name__ for kind in results if kind.__module__.startswith("bdamper.")}
    shown = sections()
    assert kinds == set(shown)
    for name in kinds:
        for picture in PICTURES.get(name, ("plot",)):
            assert f".{picture}(" in shown[name], f"{name}.{picture}"


def test_pictures_of_their_own_are_known():
    for kind in descendants(Plottable):
        own = {n for n in vars(kind) if n.startswith("plot_") or n == "mark"}
        if kind.__module__.startswith("bdamper.") and kind is not InContact:
            assert own <= set(PICTURES.get(kind.__name__, ())), kind.__name__
