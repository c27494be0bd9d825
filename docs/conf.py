"""Settings of the documentation; sphinx-gallery runs the examples that have changed."""

import os
import shutil
import sys
import warnings
from pathlib import Path

import bdamper

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools import messages

DOCS = Path(__file__).resolve().parent
os.environ.setdefault("MPLBACKEND", "Agg")

# a value of which the program warns is an error in notebooks and examples
KERNELS = DOCS / "_build" / "ipython"
startup = KERNELS / "profile_default" / "startup"
startup.mkdir(parents=True, exist_ok=True)
shutil.copy(DOCS / "plausible_values.py", startup)
os.environ["IPYTHONDIR"] = str(KERNELS)


def refuse_implausible(gallery_conf: object, example: str) -> None:
    """Set the filter before each example, which may have changed it."""
    warnings.simplefilter("error", bdamper.PlausibilityWarning)


project = "bdamper"
author = "the authors of bdamper"
release = bdamper.__version__
extensions = [
    "myst_nb", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.napoleon", "sphinx_gallery.gen_gallery",
]  # fmt: skip
templates_path = ["_templates"]
autosummary_generate = True
autosummary_ignore_module_all = False
nitpicky = True
nitpick_ignore_regex = [
    (r"py:.*", r"(?!bdamper\.).*")
]  # types of other packages, and the words of parameter lists
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_use_ivar = True
napoleon_use_rtype = False
exclude_patterns = ["_build", "_templates", "gallery/*.ipynb", "gallery/*.py"]
sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "ignore_pattern": r"^(?!fig)",  # matched with the name of the file alone
    "filename_pattern": r"/fig",
    "within_subsection_order": "FileNameSortKey",
    "image_srcset": ["2x"],
    "reset_modules": ("matplotlib", "seaborn", refuse_implausible),
    "abort_on_example_error": True,
    "download_all_examples": False,
}
nb_execution_mode = "cache"  # a notebook runs again when one of its cells has changed
nb_execution_cache_path = str(DOCS / "_build" / "notebooks")
nb_execution_in_temp = True
nb_execution_timeout = 300
nb_execution_raise_on_error = True
# the function among the settings of the gallery cannot be stored between runs
suppress_warnings = ["config.cache"]
linkcheck_timeout = 10
linkcheck_retries = 1
html_theme = "pydata_sphinx_theme"
html_theme_options = {
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
}
html_static_path = ["_static"]
html_css_files = ["wide.css"]
# pages without subpages have no empty column beside them, and what is printed is no code
html_sidebars = {
    page.stem: [] for page in DOCS.glob("*.md") if "toctree" not in page.read_text(encoding="utf-8")
}
highlight_language = "none"

# messages with their texts in the code
messages.PAGE.write_text(messages.page(), encoding="utf-8")

# the tutorial: notebooks, whose links to pages are made those of this folder
for made in (
    "tutorial",
    "reference",
    "specification/reference",
):  # nothing of what is gone from the package stays
    shutil.rmtree(DOCS / made, ignore_errors=True)
(DOCS / "tutorial").mkdir()
for page in sorted((DOCS.parent / "notebooks").glob("*.[mi]*")):
    text = page.read_text(encoding="utf-8").replace("](../docs/", "](../")
    (DOCS / "tutorial" / page.name).write_text(text, encoding="utf-8")
