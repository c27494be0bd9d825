"""Every notebook runs from the first cell to the last, and is stored without outputs."""

from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")
pytest.importorskip("ipykernel")

CLAIMS = Path(__file__).parent / "tutorials"
"""What the notebooks state, as assertions that run after a cell of theirs; a reader does not see them."""
NOTEBOOKS = sorted((Path(__file__).parents[2] / "notebooks").glob("*.ipynb"))


def checks(path):
    """Assertions by the number of the code cell after which they hold."""
    file = CLAIMS / f"{path.stem}.txt"
    parts = file.read_text().split("# after cell ")[1:] if file.exists() else []
    return {int(number): text for number, _, text in (part.partition("\n") for part in parts)}


def test_every_notebook_is_in_the_tutorial():
    page = (NOTEBOOKS[0].parent / "index.md").read_text()
    assert len(NOTEBOOKS) == 11
    for path in NOTEBOOKS:
        assert f"]({path.name})" in page


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_notebook_is_stored_without_outputs(path):
    notebook = nbformat.read(path, 4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(not cell.outputs and cell.execution_count is None for cell in code)
    assert len(checks(path)) >= 2 or sum("assert " in cell.source for cell in code) >= 2, (
        "what it states is asserted"
    )


@pytest.mark.nightly
@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_notebook_runs(path, tmp_path):
    notebook = nbformat.read(path, 4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    for number, text in checks(path).items():
        notebook.cells.insert(
            notebook.cells.index(code[number]) + 1, nbformat.v4.new_code_cell(text)
        )
    client = nbclient.NotebookClient(
        notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}
    )
    client.execute()  # an error or a failed assertion in a cell is an error here
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert any("image/png" in o.get("data", {}) for o in code[0].outputs), "a picture comes first"


@pytest.mark.slow
def test_an_implausible_value_is_an_error_in_every_notebook(tmp_path):
    code = "import bdamper as bd\nimport warnings\nwarnings.warn('possibly given in per cent', bd.PlausibilityWarning)"
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(code)])
    client = nbclient.NotebookClient(notebook, resources={"metadata": {"path": str(tmp_path)}})
    with pytest.raises(nbclient.exceptions.CellExecutionError, match="possibly given in per cent"):
        client.execute()
