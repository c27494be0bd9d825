"""Forced response of structures with frictional contacts: bladed disks with friction dampers.

The public names are listed in ``__init__.pyi``.  Each module is imported when one of its names is
first used.  "Where to find" in ``CONTRIBUTING.md`` is an index of the code.
"""

from importlib import import_module
from importlib.machinery import EXTENSION_SUFFIXES
from os.path import exists, join
from pkgutil import extend_path
from typing import Any


def _folders_with_core(path: list[str]) -> list[str]:
    """Return the folders of this package in which the compiled core lies.

    Python finds the sources of a checkout before an installed package if it is started there.
    Sources have no core, so that the installed package replaces them as a whole: its Python and its
    core always belong to one version.
    """
    folders = extend_path(path, __name__)
    cores = [f"_core{suffix}" for suffix in EXTENSION_SUFFIXES]
    compiled = [folder for folder in folders if any(exists(join(folder, core)) for core in cores)]
    if not compiled:
        raise ImportError(
            f"bdamper in {path[0]} has no compiled core; run 'pip install .' in the checkout, or "
            "'make demo' for an editable installation"
        )
    return compiled


# in an editable installation a special loader finds the core
if __spec__ is not None and type(__spec__.loader).__module__ != "_bdamper_editable_loader":
    __path__ = _folders_with_core(list(__path__))
    __file__ = join(__path__[0], "__init__.py")

import lazy_loader  # noqa: E402 - sources without a core may lack every dependency, and the error above says more

_import_name, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return import_module("bdamper.util.storage").INSTALLED.bdamper
    try:
        return _import_name(name)
    except AttributeError:
        near = import_module("bdamper.util.validation").suggest_name(name, __all__)
        raise AttributeError(f"bdamper has no attribute '{name}'{near}", name=name) from None
