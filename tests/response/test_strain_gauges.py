"""Strain gauges as response and as measurement, against bars, all stress rows, and exact data."""

import re
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

import bdamper as bd
from bdamper.fem.generated_models import bladed_disk
from bdamper.fem.meshes import (
    ElasticMaterial,
    Geometry,
    MeshDensity,
    damper_mesh,
    discretise,
    local_order,
)
from bdamper.importers import ContactFaces, read_arrays, read_response
from bdamper.util.errors import BdamperError
from tests.each import each
from tests.imports import build

STEEL = ElasticMaterial()
ELASTIC = (STEEL.youngs_modulus, STEEL.poisson_ratio)


class TestBar:
    """A prismatic bar along Z, held at one end, which the base accelerates along Z."""

    @pytest.fixture(scope="class")
    @classmethod
    def study(cls):
        density = MeshDensity(2, 2, 1, 4, 2, 2, 1, 6, 2, 1, 1, 12)
        body = discretise(damper_mesh(Geometry(), density), STEEL)
        z = body.nodes[:, 2]
        middle = np.unique(np.round(z, 9))
        # away from the held end, where the contraction is prevented
        middle = middle[np.argmin(np.abs(middle - 0.6 * z.min() - 0.4 * z.max()))]
        sets = {
            "end": np.flatnonzero(z > z.max() - 1e-9),
            "face": np.flatnonzero(z < z.min() + 1e-9),
            "middle": np.flatnonzero(np.abs(z - middle) < 1e-8),
        }
        arrays = read_arrays(
            body.stiffness,
            body.mass,
            body.nodes,
            elements=body.elements[:, local_order()],
            sets=sets,
        )
        pad = ContactFaces("pad", "face", None, "blade", "ground", points=(2, 2), gap=1e-5)
        model = build(
            arrays, n_blades=1, fixed="end", contacts=[pad], n_modes=4, base=True,
            stress={"middle": "middle"}, elasticity=ELASTIC,
        ).model  # fmt: skip
        gauge = bd.Response("middle node " + str(sets["middle"][0]), "axial", elastic=ELASTIC)
        cls.length = middle - z.min()
        return bd.Study(
            model, bd.Excitation("base", "axial", 50.0), response=gauge, harmonics=1,
            blade_modes=4, damping_ratio=1e-3, contact_stiffness=1e6,
        )  # fmt: skip

    def test_strain_under_acceleration(self, study):
        """Strain is density times acceleration times the length beyond the gauge, over the modulus."""
        curve = study.frequency_response(0.0, (50.0, 60.0))
        expected = STEEL.density * 50.0 * self.length / STEEL.youngs_modulus
        np.testing.assert_allclose(curve.amplitude, expected, rtol=0.02)
        # the bar is shorter than wide, so that the closed form is that of the mean over the section
        names = study.model.stress["middle"].point_names
        strains = [study.gauge_stress(curve, name, "axial", ELASTIC)[0, 1] for name in names]
        assert np.mean(np.abs(strains)) == pytest.approx(expected, rel=5e-3)
        place = study.settings.response
        exact = study.gauge_stress(curve, place.location, place.direction, place.elastic)
        np.testing.assert_allclose(curve.amplitude, np.abs(exact[:, 1]), rtol=2e-3)

    def test_unit_and_record(self, study, tmp_path):
        assert "strain" in str(study)
        first = np.sqrt(study.model.bodies["blade"].bases[0].omega2[0]) / (2.0 * np.pi)
        peak = study.peak(0.0, (0.9 * first, 1.1 * first))
        assert "m/m at" in str(peak)
        study.save(tmp_path / "study.h5")
        again = bd.load_study(tmp_path / "study.h5")
        assert again.settings.response == study.settings.response
        curve = study.frequency_response(0.0, (50.0, 60.0))
        curve.to_csv(tmp_path / "curve.csv")
        read = read_response(tmp_path / "curve.csv")
        assert read.is_strain
        np.testing.assert_allclose(np.abs(read.displacement), curve.amplitude, rtol=1e-9)
        pytest.importorskip("matplotlib")
        assert "m/m" in curve.plot().axes[0].get_ylabel()


@pytest.mark.nightly
@pytest.mark.slow
@each(("point", "allowed"), [(1, 0.02), (4, 0.005)])
def test_the_response_is_the_strain_of_all_stress_rows(point, allowed):
    """Residual modes contain the strain that stuck and slipping dampers cause at a blade."""
    model = bladed_disk(9, nodal_diameters=(5,), n_modes=20, stress=True)
    direction, name = (0.0, 1.0, 0.2), f"blade point {point}"
    at_point = model.stress["blade"].points[point - 1]
    for place in (name, tuple(at_point + 1e-6)):
        study = bd.Study(
            model, bd.Excitation("tip"), 5, harmonics=1, blade_modes=20, damper_modes=4,
            friction_coefficient=0.4, response=bd.Response(place, direction, elastic=ELASTIC),
            # with the vectors of partial contact stuck dampers are exact for the first vector alone: 0.7 and 0.5 % off
            contact_stiffness=bd.ResidualModes(partial_contact=False),
        )  # fmt: skip
        curve = study.frequency_response(20e3, (335.0, 340.0))
        strain = study.gauge_stress(curve, place, direction, ELASTIC)[:, 1]
        np.testing.assert_allclose(curve.amplitude, np.abs(strain), rtol=allowed)


@each(
    ("unit", "factor"),
    [("m/m", 1.0), ("µm/m", 1e-6), ("microstrain", 1e-6), ("µε", 1e-6), ("mm/m", 1e-3)],
)
def test_strain_is_read(unit, factor):
    table = {"frequency (Hz)": [1.0, 2.0, 3.0], f"strain ({unit})": [4.0, 5.0, 6.0]}
    data = read_response(table)
    assert data.is_strain
    np.testing.assert_allclose(data.displacement, factor * np.array([4.0, 5.0, 6.0]), rtol=1e-15)


@pytest.mark.slow
def test_strains_are_fitted():
    """A sum of degrees of freedom as strain: 40 1/m times the motion of an oscillator."""
    frequency = np.linspace(0.6, 1.0, 21)
    omega = 2.0 * np.pi * frequency
    strain = 40.0 * np.abs(1e-6 / (52.0 - 2.0 * omega**2 + 0.36j * omega))
    data = read_response({"frequency (Hz)": frequency, "strain (µm/m)": 1e6 * strain})

    def gauged(stiffness=50.0, damping=0.3):
        return bd.lumped(
            2.0, damping, stiffness, contacts=[bd.Contact(normal=0, kn=1.0, gap=1e3)],
            forces={0: 1e-6}, response={0: 40.0},
        )  # fmt: skip

    ranges = {"stiffness": (40.0, 70.0), "damping": (0.1, 1.0)}
    found = bd.fit(gauged, bd.MeasuredResponse(data), ranges, noise=0.01, intervals="linear")
    assert found.values == pytest.approx([52.0, 0.36], rel=1e-3)


@pytest.mark.slow
def test_a_measured_strain_is_fitted_at_the_gauge_of_a_model():
    model = bladed_disk(9, nodal_diameters=(5,), n_modes=10, stress=True)
    gauge = bd.Response("blade point 4", (0.0, 1.0, 0.2), elastic=ELASTIC)
    study = bd.Study(
        model, bd.Excitation("tip"), 5, harmonics=1, friction_coefficient=0.4, response=gauge
    )
    truth = study.replace(damping_ratio=0.004).free((300.0, 350.0))
    near = np.abs(truth.frequency - truth.peak.frequency) < 5.0
    data = read_response(
        {"frequency (Hz)": truth.frequency[near], "strain (µm/m)": 1e6 * truth.amplitude[near]}
    )
    start = study.replace(damping_ratio=0.003)
    found = bd.fit(
        start, bd.MeasuredResponse(data), {"damping_ratio": (1e-3, 1e-2)}, noise=0.01,
        intervals="linear",
    )  # fmt: skip
    assert found.values == pytest.approx([0.004], rel=1e-2)
    motion = study.replace(response=bd.Response("tip"))
    with pytest.raises(
        BdamperError, match="expected the response of the study in m, found strains"
    ):
        bd.fit(motion, bd.MeasuredResponse(data), {"friction_coefficient": (0.1, 0.9)})


def test_wrong_gauges_are_named():
    model = bd.reference_model("turbine_blade")
    study = bd.Study(model, bd.Excitation("tip"), 5)
    with pytest.raises(BdamperError, match=r"gauge: expected one of \('blade point 1'"):
        study.replace(response=bd.Response("tip", elastic=ELASTIC))
    with pytest.raises(BdamperError, match=r"the name of a location, or elastic="):
        bd.Response((0.0, 0.1, 0.2))


def as_strain(result):
    """The same result with the response of a gauge: its numbers are strains."""
    response = {**result.settings["response"], "elastic": [2.1e11, 0.3]}
    return replace(result, settings={**result.settings, "response": response})


@pytest.fixture(scope="module")
def two_masses():
    contact = bd.Contact(0, 1, kt=1.0, kn=1.0, mu=0.5)
    return bd.lumped([1.0, 1.0], [0.02, 0.02], [[2.0, -1.0], [-1.0, 2.0]], contacts=[contact],
                     load_per_preload={1: 1.0}, forces={0: 1e-3}, response=0, harmonics=1)  # fmt: skip


@pytest.mark.slow
def test_a_printed_optimum_has_strains_in_its_columns(two_masses):
    curve = two_masses.optimal_curve((2e-4, 6e-2), 5, frequency=(0.1, 0.4), check=False)
    plain, strain = str(curve), str(as_strain(curve))
    assert " mm/m" in strain and not re.search(r" [µm]?m\b(?!/)", strain)
    assert " mm" in plain and "mm/m" not in plain
    assert " mm/m" in as_strain(curve)._repr_html_()
    rows = [line for line in strain.split("\n") if line.startswith(("Preload", "Harmonic"))]
    columns = {re.match(r"\S.*?  +\S.*?  +(?=\S)", row).end() for row in rows[:2]}
    assert len(columns) == 1, "the remarks begin below each other"


def test_places_of_contact_points_remain_lengths(two_masses):
    loops = two_masses.hysteresis(two_masses.peak(9e-3, (0.1, 0.4)))
    plain, strain = loops.columns(), as_strain(loops).columns()
    assert {name: column.unit for name, column in strain.items()} == {
        name: column.unit for name, column in plain.items()
    }
    assert "m" in {column.unit for column in strain.values()}
