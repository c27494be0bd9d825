"""Pages of the gallery from the examples: their docstrings, what they printed, their figures and times."""

from __future__ import annotations

import ast
import json
import shutil
from pathlib import Path

from PIL import Image

PICTURES = (".png", ".gif")


def split_docstring(path: Path) -> tuple[str, str]:
    """Title and body of the docstring of an example; tables of reStructuredText are kept as they are."""
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or path.stem
    title, _, body = text.partition("\n")
    return title.rstrip("."), body.strip()


def thumbnail(source: Path, target: Path, width: int = 200) -> None:
    """A small copy of a picture."""
    with Image.open(source) as picture:
        small = picture.convert("RGB")
        small.thumbnail((width, width))
        small.save(target)


def write_page(example: Path, folder: Path, out: Path, seconds: float | None) -> str | None:
    """One page; returns the file name of its first picture."""
    title, body = split_docstring(example)
    pictures = sorted(p for p in folder.glob("*") if p.suffix in PICTURES) if folder.is_dir() else []
    lines = [f"# {title}", "", "```{eval-rst}", body, "```", ""]
    for picture in pictures:
        shutil.copyfile(picture, out / picture.name)
        lines += [f"![{picture.stem.replace('_', ' ')}]({picture.name})", ""]
    output = folder / "output.txt"
    if output.is_file() and output.read_text(encoding="utf-8").strip():
        lines += ["What it prints:", "", "```text", output.read_text(encoding="utf-8").rstrip(), "```", ""]
    if seconds is not None:
        lines += [f"Time on one core, figures included: {seconds:.0f} s.", ""]
    lines += [f"`examples/{example.name}`:", "", "```python", example.read_text(encoding="utf-8").rstrip(), "```", ""]
    (out / f"{example.stem}.md").write_text("\n".join(lines), encoding="utf-8")
    return pictures[0].name if pictures else None


def write_gallery(examples: Path, figures: Path, out: Path) -> None:
    """Write all pages and an index with times; without figures (``make examples``) the pages have none."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    record = figures / "examples.json"
    times = json.loads(record.read_text(encoding="utf-8")) if record.is_file() else {}
    rows, names = [], []
    for example in sorted(examples.glob("fig*.py")):
        seconds = times.get(example.stem, {}).get("seconds")
        first = write_page(example, figures / example.stem, out, seconds)
        picture = f"![{example.stem}](thumb_{first})" if first else ""
        time = "" if seconds is None else f"{seconds:.0f} s"
        rows.append(f"| {picture} | [{split_docstring(example)[0]}]({example.stem}.md) | {time} |")
        names.append(example.stem)
        if first:
            thumbnail(out / first, out / f"thumb_{first}")
    total = sum(entry["seconds"] for entry in times.values())
    head = [
        "# Gallery: the studies of the paper",
        "",
        "Each figure of Cigeroglu, An and Menq (2009) from the reference models that come with the package. The finite",
        "element models of the paper are not published, so claims are compared, not curves; where the reference model",
        "disagrees, the page says so and why. `make examples` makes all figures"
        + (f", in {total:.0f} s here." if total else "."),
        "",
        "| | | time |",
        "|---|---|---|",
        *rows,
        "",
        "```{toctree}",
        ":hidden:",
        "",
        *names,
        "```",
        "",
    ]
    (out / "index.md").write_text("\n".join(head), encoding="utf-8")
