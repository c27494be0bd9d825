"""Settings of the documentation; sphinx-gallery runs the examples that have changed."""

import os
import re
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
exclude_patterns = [
    "_build",
    "_templates",
    "gallery/*.ipynb",
    "gallery/*.py",
    "**/listed_names.rst",
]
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
html_title = "bdamper"
html_theme_options = {
    "logo": {"text": "bdamper"},
    # four links in the head; the column at the side has the others
    "navbar_center": ["head_links.html"],
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
}
html_static_path = ["_static"]
html_css_files = ["wide.css"]
# pages without subpages have no empty column beside them, and what is printed is no code
html_sidebars = {page.stem: [] for page in DOCS.glob("*.md") if page.stem != "index"}
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


# Pages are written for readers of a checkout.  The build makes directives of their lists of names and pages.
NAMES = re.compile(r"(?:^\* `bdamper\.[\w.]+`\n)+", re.M)
DATA = re.compile(r"^\* `(bdamper\.[A-Z_0-9]+)`: (.+)\n", re.M)
PAGES = re.compile(r"^\*\*(\w[\w ]*)\*\*: (\[.+)\n", re.M)
LINK = re.compile(r"\]\(([\w/.-]+?)(?:\.md|\.ipynb)?\)")


def autosummaries(text: str, folder: str) -> str:
    """Return text whose lists of names are autosummaries; the page of each name is in the folder."""
    modules = text.find("\n## Modules\n")

    def directive(found: re.Match[str]) -> str:
        is_module = 0 <= modules < found.start()
        option = ":template: autosummary/room.rst" if is_module else ":nosignatures:"
        names = re.findall(r"`(.+)`", found[0])
        head = [".. autosummary::", f"   :toctree: {folder}", f"   {option}", ""]
        return "\n".join([*head, *(f"   {name}" for name in names), "", ""])

    return NAMES.sub(directive, text)


def data_directive(found: re.Match[str]) -> str:
    """Return the directive of a constant; literals have double backquotes there."""
    description = found[2].replace("`", "``")
    return f"```{{eval-rst}}\n.. py:data:: {found[1]}\n\n   {description}\n```\n"


def toctree(caption: str, links: str) -> str:
    """Return a hidden table of contents of the pages in a text with links."""
    option = [f":caption: {caption}"] if caption else []
    return "\n".join(["", "```{toctree}", *option, ":hidden:", *LINK.findall(links), "```", ""])


def with_directives(app: object, docname: str, source: list[str]) -> None:
    """Replace the lists of a page by directives, and links into the checkout by links to built pages."""
    text = source[0]
    if docname in REFERENCES:
        listed = autosummaries(text, "reference")
        text = re.sub(
            r"(?:^\.\. autosummary::\n(?:   .*\n|\n)+)",
            lambda found: "```{eval-rst}\n" + found[0].rstrip() + "\n```\n\n",
            listed,
            flags=re.M,
        )
        text = DATA.sub(data_directive, text)
    up = "../" * docname.count("/")
    text = text.replace(f"](../{up}notebooks/", f"]({up}tutorial/")
    text = text.replace(f"](../{up}examples/GALLERY_HEADER.rst)", f"]({up}gallery/index)")
    if docname == "index":
        text += "".join(toctree(caption, links) for caption, links in PAGES.findall(text))
    if docname == "tutorial/index":
        notebooks = "".join(re.findall(r"\]\([\w]+\.ipynb\)", text))
        text += toctree("", notebooks)
    source[0] = text


# autosummary writes the pages of names from files on the disk
REFERENCES = ("api", "specification/classes")
autosummary_generate = []
for name in REFERENCES:
    home = (DOCS / name).parent / "reference"
    home.mkdir(exist_ok=True)
    listed_names = home / "listed_names.rst"
    listed_names.write_text(autosummaries((DOCS / f"{name}.md").read_text(encoding="utf-8"), "."))
    autosummary_generate.append(str(listed_names.relative_to(DOCS)))


def setup(app: object) -> None:
    app.connect("source-read", with_directives)
