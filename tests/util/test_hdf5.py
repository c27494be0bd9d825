"""Result files: one function reads every kind, and refuses other files with one error."""

import ast
import importlib
import json
import pkgutil
import tracemalloc
from dataclasses import fields, replace
from pathlib import Path
from typing import ClassVar

import h5py
import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses.fit_result import Fitted
from bdamper.analyses.sweep import Comparison, SweepResult
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.util.records import named_fields, names_of
from bdamper.util.storage import FORMATS, INSTALLED, Storable, read_hdf5
from tests.each import each
from tests.every_result import RESULTS, WITHOUT_TABLE, result
from tests.test_codebase import nodes_of, spelled
from tests.util.test_disk import pressed


def same(a, b):
    """Whether two results hold the same, arrays bit by bit."""
    if isinstance(a, np.ndarray) and a.dtype.names:
        return a.dtype == b.dtype and all(same(a[name], b[name]) for name in a.dtype.names)
    if isinstance(a, np.ndarray):
        return (
            isinstance(b, np.ndarray)
            and a.dtype == b.dtype
            and np.array_equal(a, b, equal_nan=a.dtype.kind in "fc")
        )
    if isinstance(a, Storable):
        return type(a) is type(b) and all(
            same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a)
        )
    if isinstance(a, tuple):
        return isinstance(b, tuple) and len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, dict):
        return isinstance(b, dict) and list(a) == list(b) and all(same(a[key], b[key]) for key in a)
    return type(a) is type(b) and (a == b or a != a)


@pytest.fixture(scope="module")
def curve():
    made = result("frequency_response")
    return replace(
        made, unstable=np.zeros(len(made), bool), made_with=replace(INSTALLED, bdamper="0.4.0")
    )


@pytest.fixture(scope="module")
def answers(curve):
    """Results by their name, of which the curve was made by another version."""
    return lambda name: curve if name == "frequency_response" else result(name)


def through_a_file(result, path):
    result.save(path)
    return bd.load(path)


class TestReading:
    def test_every_kind_is_known_once_the_package_is_imported(self):
        for module in pkgutil.walk_packages(bd.__path__, "bdamper."):
            importlib.import_module(module.name)
        classes = list(Storable.__subclasses__())
        for cls in classes:
            classes += cls.__subclasses__()
        kinds = {cls._format for cls in classes}
        assert set(FORMATS) == kinds | {"bdamper-model", "bdamper-study"}
        assert len(kinds) == len(classes) >= 10

    def test_models(self, tmp_path):
        model = bd.reference_model(contact_points=24)
        bd.save_model(model, tmp_path / "model.h5")
        assert bd.load(tmp_path / "model.h5").hash == model.hash

    def test_what_is_no_such_file_is_refused(self, tmp_path):
        path = tmp_path / "result.h5"
        with pytest.raises(FileNotFoundError, match=r"there is no file '.*result\.h5'"):
            bd.load(path)
        path.write_bytes(b"not HDF5")
        with pytest.raises(
            bd.BdamperError,
            match=rf"{path}: expected a file written by bdamper, found a damaged or different file",
        ):
            bd.load(path)
        h5py.File(path, "w").close()
        with pytest.raises(
            bd.BdamperError,
            match=rf"{path}: expected a file written by bdamper, found the format 'none'",
        ):
            bd.load(path)
        with h5py.File(path, "w") as file:
            file.attrs["format"] = "other"
        with pytest.raises(
            bd.BdamperError,
            match=rf"{path}: expected a file written by bdamper, found the format 'other'",
        ):
            bd.load(path)

    def test_errors_without_a_text_are_named(self, tmp_path):
        h5py.File(path := tmp_path / "result.h5", "w").close()
        with (
            pytest.raises(
                bd.BdamperError, match=r"found a damaged or different file \(EOFError\)$"
            ),
            read_hdf5(path, "a file"),
        ):
            raise EOFError

    @each("cls", Storable.__subclasses__(), ids=lambda cls: cls.__name__)
    def test_an_incomplete_file_is_refused(self, tmp_path, cls):
        path = tmp_path / "result.h5"
        with h5py.File(path, "w") as file:
            file.attrs["format"], file.attrs["version"] = cls._format, 4
        with pytest.raises(
            bd.BdamperError,
            match=r"result\.h5: /made_with: the group or dataset is missing \(written by an unknown",
        ):
            bd.load(path)

    @each("name", ["@model_hash", "@preload", "frequency", "residual", "settings"])
    def test_what_is_missing_is_named_first(self, tmp_path, curve, name):
        path = tmp_path / "curve.h5"
        curve.save(path)
        with h5py.File(path, "a") as file:
            owner = file.attrs if name.startswith("@") else file
            del owner[name.removeprefix("@")]
        with pytest.raises(
            bd.BdamperError,
            match=rf"^{path}: /{name}: the .* is missing \(written by bdamper 0\.4\.0, ",
        ):
            bd.load(path)

    def test_a_study_without_settings_names_them(self, tmp_path):
        with h5py.File(path := tmp_path / "study.h5", "w") as file:
            file.attrs["format"], file.attrs["model_hash"] = "bdamper-study", "0123"
        with pytest.raises(
            bd.BdamperError, match=rf"^{path}: /settings: the group or dataset is missing$"
        ):
            bd.load_study(path)


def rewritten(path, name, change):
    """Change one array or text in a file."""
    with h5py.File(path, "r+") as file:
        value = file[name][()]
        del file[name]
        file[name] = (
            change(value)
            if isinstance(value, np.ndarray)
            else json.dumps(change(json.loads(value)))
        )


class TestDamaged:
    """Fields of another length, and what would fill the memory, are refused before anything is made of them."""

    COLUMNS: ClassVar = {
        "frequency_response": ("frequency", "harmonics", "residual", "shares", "backward", "branch", "point_kind",
                               "unstable", "unknowns"),
        "optimal_curve": ("preload", "amplitude", "frequency", "status", "kind", "goes_on"),
        "hysteresis": ("interface", "energy", "points", "area", "displacement", "force", "gap"),
        "dissipation": ("frequency", "energy", "damping", "interface"),
        "optimal_curve_uncertainty": ("preload", "amplitude", "frequency"),
        "margin_curve": ("margin", "response", "amplitude", "mean", "factor", "frequency"),
        "margins": ("names", "amplitude", "factor"),
        "static": ("closing", "area", "friction", "frame", "status"),
        "stress": ("points", "names", "counted", "spread", "coefficients"),
        "campbell": ("speed", "nodal_diameter", "free", "stuck"),
        "sweep": ("points", "values", "status", "seconds", "shape"),
        "mistuned_sample": ("disks", "preload", "amplitude", "frequency", "status"),
    }  # fmt: skip

    @pytest.mark.slow
    @each(("name", "field"), [(name, field) for name, own in COLUMNS.items() for field in own])
    def test_a_column_of_another_length_is_refused(self, tmp_path, name, field, answers):
        path = tmp_path / "result.h5"
        answers(name).save(path)
        rewritten(path, field, lambda value: [*value, *value] if field == "shape" else value[:-1])
        with pytest.raises(
            bd.BdamperError, match=rf"{path}: expected a file written by \w+\.save.*, found .*"
        ) as caught:
            bd.load(path)
        assert "\n" not in str(caught.value)

    WIDE: ClassVar = {
        "frequency_response": ("harmonics", "shares"),
        "hysteresis": ("points",),
        "static": ("force", "points", "frame", "status"),
    }

    @each(("name", "field"), [(name, field) for name, own in WIDE.items() for field in own])
    def test_a_column_of_another_width_is_refused(self, tmp_path, name, field, answers):
        """Without the first harmonic, the normal direction or the open contacts, nothing could be printed."""
        path = tmp_path / "result.h5"
        answers(name).save(path)
        rewritten(
            path, field, lambda value: value[..., :-1] if field != "harmonics" else value[:, :1]
        )
        with pytest.raises(
            bd.BdamperError, match=rf"{path}: expected a file written by \w+\.save.*, found .*"
        ) as caught:
            bd.load(path)
        assert "\n" not in str(caught.value)

    @each(
        "field",
        ["place", "measured", "model", "test", "residual", "prediction", "values", "information"],
    )
    def test_points_of_a_fit_without_one_of_their_values_are_refused(self, tmp_path, field):
        """Two points of one test, and one parameter."""
        one, two = np.ones(1), np.ones(2)
        fit = Fitted(
            names=("friction",), values=one, low=one, high=one, deviation=one, left_out=one, information=np.ones((1, 1)),
            tests=("a",), noise=0.02, place=two, measured=two + 0j, model=two + 0j, residual=np.ones((2, 2)),
            test=np.zeros(2, int), prediction=np.ones((2, 2)),
        )  # fmt: skip
        fit.save(tmp_path / "fit.h5")
        assert bd.load(tmp_path / "fit.h5").names == fit.names
        rewritten(tmp_path / "fit.h5", field, lambda value: value[..., :-1])
        with pytest.raises(
            bd.BdamperError,
            match=r"expected a file written by Fitted\.save, found .*'\w+' needs the shape .*, but has the shape ",
        ):
            bd.load(tmp_path / "fit.h5")

    def test_what_would_fill_the_memory_is_not_read(self, tmp_path, curve, monkeypatch):
        curve.save(tmp_path / "zeros.h5")
        with h5py.File(tmp_path / "zeros.h5", "r+") as file:
            del file["residual"]
            file.create_dataset(
                "residual", (625_000_000,), "f8", chunks=(1_000_000,), compression="gzip"
            )
        monkeypatch.setattr("bdamper.util.storage.MOST_TEXT", 1_000_000)
        for name, text in (("long.h5", "x" * 8_000_000), ("fixed.h5", np.bytes_(b"x" * 8_000_000))):
            with h5py.File(tmp_path / name, "w", libver="latest") as file:
                file.attrs["format"] = text
        text = r"texts and attributes of 80\d+ bytes"
        for name, found in (
            ("zeros", r"arrays that expand from \d+ to 50000"),
            ("long", text),
            ("fixed", text),
        ):
            tracemalloc.start()
            with pytest.raises(
                bd.BdamperError,
                match=rf"{name}\.h5: expected a file written by bdamper, found .*{found}",
            ):
                bd.load(tmp_path / f"{name}.h5")
            assert tracemalloc.get_traced_memory()[1] < 4_000_000
            tracemalloc.stop()


class TestWriting:
    @pytest.mark.slow
    @each("name", [name for name in RESULTS if name not in WITHOUT_TABLE])
    def test_what_is_written_is_read(self, tmp_path, name, answers):
        result = through_a_file(
            answers(name), tmp_path / "once.h5"
        )  # plain numbers of a file have become those of the types
        assert same(through_a_file(result, tmp_path / "twice.h5"), result)

    def test_fields_of_all_kinds(self, tmp_path):
        """Numbers are columns; lists, texts, mixed and missing values come back as they were."""
        kinds = {
            "N/m": [1.0, np.pi, None], "é": [1, 2, 3], "bool": [True, False, True], "text": ["a", None, "long " * 9999],
            "list": [[1.0, 2.0], None, [3.0]], "mixed": [1, 0.5, "x"], "some": [1, None, 3], "map": [{"a": [1]}, None, {}],
        }  # fmt: skip
        for columns in (kinds, {}):
            rows = named_fields(columns, 3)
            made = SweepResult(
                ("p",),
                named_fields({"p": [1.0, 2.0, 3.0]}, 3),
                rows,
                ("complete",) * 3,
                np.zeros(3),
                (3,),
            )
            made.save(tmp_path / "kinds.h5")
            again = bd.load(tmp_path / "kinds.h5").values
            assert again.dtype == rows.dtype and len(again) == 3
            assert [*map(repr, again.tolist())] == [*map(repr, rows.tolist())]
        kinds = named_fields(kinds, 3)
        assert [kinds.dtype[name].kind for name in names_of(kinds)] == list("fibOOOOO")

    def test_numbers_of_a_sweep_are_columns_in_its_file(self, tmp_path):
        """Not texts, of which a file has room for 256 MB."""
        n = 2000
        made = bd.sweep(pressed(), {"preload": np.linspace(1.0, 2.0, n)}, halved)
        made.save(tmp_path / "sweep.h5")
        with h5py.File(tmp_path / "sweep.h5") as file:
            assert file["values"].dtype == [("half", "f8")] and file["points"].dtype == [
                ("preload", "f8")
            ]
            assert (
                file["cost"].dtype["evaluations"] == np.int64
                and file["cost"].dtype["seconds"] == np.float64
            )
        assert (tmp_path / "sweep.h5").stat().st_size < 100 * n

    def test_results_within_a_result(self, tmp_path, curve):
        laws = tuple(f"law {i}" for i in range(11))  # in the order of numbers, not of their digits
        comparison = Comparison(laws, tuple(replace(curve, preload=float(i)) for i in range(11)))
        comparison.save(tmp_path / "laws.h5")
        assert same(bd.load(tmp_path / "laws.h5"), comparison)

    def test_optional_parts(self, tmp_path, curve):
        assert curve.unstable is not None
        replace(curve, unstable=None).save(tmp_path / "curve.h5")
        assert bd.load(tmp_path / "curve.h5").unstable is None

    def test_long_texts(self, tmp_path, curve):
        """An attribute of HDF5 has room for 64 KiB only."""
        notes = ("regular",) * 20_000
        replace(curve, notes=notes).save(tmp_path / "curve.h5")
        assert bd.load(tmp_path / "curve.h5").notes == notes

    def test_what_derives_from_a_result_is_saved_as_that(self, tmp_path, curve):
        class Special(ResponseCurve):
            pass

        Special(**{f.name: getattr(curve, f.name) for f in fields(curve)}).save(
            tmp_path / "curve.h5"
        )
        assert same(bd.load(tmp_path / "curve.h5"), curve)

    def test_a_file_is_replaced_once_all_is_written(self, tmp_path, curve):
        path = tmp_path / "curve.h5"
        curve.save(path)
        before = path.read_bytes()
        with pytest.raises(TypeError, match="expected a number"):
            replace(curve, settings={"broken": object()}).save(path)
        assert path.read_bytes() == before and [item.name for item in tmp_path.iterdir()] == [
            "curve.h5"
        ]

    def test_one_place_opens_files_for_writing(self):
        package = Path(bd.__file__).resolve().parent
        found = []
        for path in sorted(package.rglob("*.py")):
            for node in nodes_of(path):
                if isinstance(node, ast.Call) and spelled(node.func) in ("h5py.File", "File"):
                    mode = [*node.args[1:2], *(k.value for k in node.keywords if k.arg == "mode")]
                    if [ast.unparse(m) for m in mode] != ["'r'"]:
                        found.append(str(path.relative_to(package)))
        assert found == ["util/storage.py"]


class TestVersions:
    def test_a_file_tells_what_made_it(self, tmp_path, curve):
        assert (
            replace(curve, preload=1.0).made_with == curve.made_with != INSTALLED
        )  # a copy of an old result stays old
        made_now = replace(curve, made_with=INSTALLED)
        assert (
            str(INSTALLED)
            == f"bdamper {bd.__version__}, NumPy {np.__version__}, SciPy {INSTALLED.scipy}"
        )
        made_now.save(tmp_path / "curve.h5")
        with h5py.File(tmp_path / "curve.h5", "a") as file:
            made_with = file["made_with"].attrs
            assert (
                made_with["bdamper"].decode() == bd.__version__
                and made_with["numpy"].decode() == np.__version__
            )
            made_with["scipy"] = "1.99"
        assert bd.load(tmp_path / "curve.h5").made_with == replace(INSTALLED, scipy="1.99")

    def test_results_within_results_keep_their_own(self, tmp_path, curve, answers):
        whole = answers("optimal_curve")
        replace(
            whole, curves=(curve, replace(curve, made_with=INSTALLED)), made_with=INSTALLED
        ).save(tmp_path / "whole.h5")
        again = bd.load(tmp_path / "whole.h5")
        assert again.made_with == INSTALLED and [c.made_with for c in again.curves] == [
            curve.made_with,
            INSTALLED,
        ]

    def test_a_kind_that_is_unknown_is_named_with_its_version(self, tmp_path, curve):
        curve.save(path := tmp_path / "curve.h5")
        with h5py.File(path, "a") as file:
            file.attrs["format"] = "bdamper-run-up"
        refused = r"curve\.h5: expected .*, found the format 'bdamper-run-up', written by bdamper 0\.4\.0.*, which this"
        with pytest.raises(bd.BdamperError, match=refused):
            bd.load(path)

    def test_fields_that_this_version_does_not_know_are_refused_with_the_version_that_wrote_them(
        self, tmp_path, curve
    ):
        curve.save(path := tmp_path / "curve.h5")
        with h5py.File(path, "a") as file:
            file.move("residual", "remainder")
        with pytest.raises(
            bd.BdamperError,
            match=r"curve\.h5: /remainder: expected .* \(written by bdamper 0\.4\.0, ",
        ):
            bd.load(path)

    def test_files_of_a_later_version_are_refused(self, tmp_path, curve):
        curve.save(tmp_path / "curve.h5")
        with h5py.File(tmp_path / "curve.h5", "a") as file:
            file.attrs["version"], file["made_with"].attrs["bdamper"] = 9, "7.0"
        expected = r"expected version 3 or 4 of .* found version 9, written by bdamper 7\.0"
        with pytest.raises(bd.BdamperError, match=expected):
            bd.load(tmp_path / "curve.h5")


class TestResumeFiles:
    @pytest.fixture
    def study(self):
        return pressed()

    def test_those_of_another_numpy_are_continued(self, study, tmp_path):
        path = tmp_path / "sweep.jsonl"
        asked = {"over": {"preload": [2000.0, 4000.0]}, "evaluate": halved}
        bd.sweep(study, **asked, resume=path)
        lines = path.read_text().splitlines()
        header = json.loads(lines[0])
        assert (
            header["numpy_version"] == np.__version__
            and header["bdamper_version"] == bd.__version__
        )
        path.write_text("\n".join([json.dumps({**header, "numpy_version": "1.0"}), lines[1], ""]))
        result = bd.sweep(study, **asked, resume=path)
        assert result.array("half").tolist() == [1000.0, 2000.0]
        assert len(path.read_text().splitlines()) == 3
        path.write_text(json.dumps({**header, "bdamper_version": "0.6.0"}) + "\n")
        with pytest.raises(
            bd.BdamperError, match=r"expected results of .*, found results of bdamper 0\.6\.0,"
        ):
            bd.sweep(study, **asked, resume=path)


def halved(study, preload):
    return {"half": 0.5 * preload}
