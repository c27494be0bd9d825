"""Settings of the documentation; ``make docs`` runs the examples first and then builds it."""

import shutil
import sys
from pathlib import Path

import bdamper

DOCS = Path(__file__).resolve().parent
sys.path.insert(0, str(DOCS))

project = "bdamper"
author = "the authors of bdamper"
release = bdamper.__version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_use_ivar = True
napoleon_use_rtype = False
exclude_patterns = ["_build"]
nb_execution_mode = "cache"  # a notebook runs again when one of its cells has changed
nb_execution_cache_path = str(DOCS / "_build" / "notebooks")
nb_execution_in_temp = True
nb_execution_timeout = 300
nb_execution_raise_on_error = True
linkcheck_timeout = 10
linkcheck_retries = 1
html_theme = "alabaster"
html_theme_options = {"page_width": "1080px", "description": "Forced response of structures with friction contacts"}

from gallery_pages import write_gallery  # noqa: E402

write_gallery(DOCS.parent / "examples", DOCS.parent / "figures", DOCS / "gallery")

# the tutorial: notebooks, whose links to pages are made those of this folder
shutil.rmtree(DOCS / "tutorial", ignore_errors=True)
(DOCS / "tutorial").mkdir()
for page in sorted((DOCS.parent / "notebooks").glob("*.[mi]*")):
    text = page.read_text(encoding="utf-8").replace("](../docs/", "](../")
    (DOCS / "tutorial" / page.name).write_text(text, encoding="utf-8")
