"""Each check of a model: break exactly one thing, expect one message that names it."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bdamper.model.structure import Body, Location, Model
from bdamper.model.validation import check_model
from bdamper.util.errors import ModelError
from bdamper.util.records import layout
from tests.each import each
from tests.models import (
    ALL_MODELS,
    acyclic_model,
    complete_model,
    ground_model,
    rigid_modes,
    shroud_model,
    wedge_model,
)

WEDGE = wedge_model(n_points=4, n_blade_modes=3)
SHROUD = shroud_model()
ACYCLIC = acyclic_model()


# -----------------------------------------------------------------------------------------------------------
# Ways to change one thing


def put(mapping: Any, key: Any, value: Any) -> dict:
    return {**mapping, key: value}


def without(mapping: Any, key: Any) -> dict:
    return {k: v for k, v in mapping.items() if k != key}


def at(array: np.ndarray, index: Any, value: Any) -> np.ndarray:
    changed = array.copy()
    changed[index] = value
    return changed


def body(name: str, model: Model = WEDGE, **changes: Any) -> Model:
    return replace(model, bodies=put(model.bodies, name, replace(model.bodies[name], **changes)))


def basis(name: str, d: int, model: Model = WEDGE, **changes: Any) -> Model:
    bases = model.bodies[name].bases
    return body(name, model, bases=put(bases, d, replace(bases[d], **changes)))


def load(**changes: Any) -> Model:
    return body("damper", load=replace(WEDGE.bodies["damper"].load, **changes))


def face(name: str, model: Model = WEDGE, **changes: Any) -> Model:
    return replace(
        model, interfaces=put(model.interfaces, name, replace(model.interfaces[name], **changes))
    )


def contact(**changes: Any) -> Model:
    return replace(WEDGE, contact={"left": replace(WEDGE.contact["left"], **changes)})


def mesh(**changes: Any) -> Model:
    return replace(WEDGE, meshes={"damper": replace(WEDGE.meshes["damper"], **changes)})


def mix_rigid(matrix: np.ndarray, model: Model = WEDGE) -> Model:
    """The damper's first six modes replaced by combinations of them."""
    modes = model.bodies["damper"].bases[0].contact_modes.copy()
    modes[:, :, :6] = modes[:, :, :6] @ matrix
    return basis("damper", 0, model, contact_modes=modes)


BLADE = WEDGE.bodies["blade"]
BLADE_2 = BLADE.bases[2]
DAMPER = WEDGE.bodies["damper"]
FREE = DAMPER.bases[0]
LEFT = WEDGE.interfaces["left"]
TIP = WEDGE.locations["tip"]
MESH = WEDGE.meshes["damper"]
STIFFNESS = WEDGE.contact["left"].stiffness
SWAP = np.eye(6)[[1, 0, 2, 3, 4, 5]]

CASES: list[tuple[Any, str]] = [
    ({"n_blades": 3}, "model: expected a Model, found dict"),
    (replace(WEDGE, n_blades=0), "/@n_blades: expected at least 1, found 0"),
    (replace(WEDGE, bodies={}, interfaces={}), "/bodies: expected at least one body"),
    (replace(WEDGE, bodies=[]), "/bodies: expected a Mapping, found a list"),
    (
        replace(WEDGE, bodies=put(WEDGE.bodies, "a/b", Body("a/b", "ground"))),
        "/bodies/a/b: expected a name of printable characters without '/' and '.', found 'a/b'",
    ),
    (
        replace(WEDGE, bodies=put(WEDGE.bodies, "a.b", Body("a.b", "ground"))),
        "/bodies/a.b: expected a name of printable",
    ),
    (
        replace(WEDGE, bodies=put(WEDGE.bodies, "", Body("", "ground"))),
        "expected a name of printable characters",
    ),
    (
        replace(WEDGE, bodies=put(WEDGE.bodies, "a\0", Body("a\0", "ground"))),
        "expected a name of printable characters",
    ),
    (
        replace(WEDGE, bodies=put(WEDGE.bodies, "earth", Body("ground", "ground"))),
        "/bodies/earth: expected the name 'earth', found 'ground'",
    ),
    (replace(WEDGE, bodies=put(WEDGE.bodies, "x", 1)), "/bodies/x: expected"),
    (replace(WEDGE, provenance={"a": 1}), "/provenance: expected texts, found 'a'"),
    (replace(WEDGE, provenance={"a": "\0"}), "without NUL"),
    (replace(WEDGE, provenance={"a": "\ud800"}), "that UTF-8 can hold"),
    (face("left", area=at(LEFT.area, 2, 0.0)), "left/area: expected numbers > 0, found 0.0 at 2"),
    (face("left", area=np.zeros(0)), "left/area: expected at least one point, found none"),
    (
        face("left", points=at(LEFT.points, (1, 2), np.nan)),
        "left/points: expected finite numbers, found nan at (1, 2), one of 1 wrong values",
    ),
    (
        face("left", frame=at(LEFT.frame, 1, 1.001 * LEFT.frame[1])),
        "frame: expected orthonormal rows t1, t2, n (errors of their products), found 0.00200",
    ),
    (
        face("left", frame=at(LEFT.frame, 3, -LEFT.frame[3])),
        "left/frame: expected right-handed rows t1, t2, n (determinants), found -",
    ),
    (
        face("right", sector_b=2),
        "right/@sector_b: expected one of [-1, 0, 1] (n_blades = 12), found 2",
    ),
    (
        face("right", ACYCLIC, sector_b=1),
        "right/@sector_b: expected one of [0] (n_blades = 1), found 1",
    ),
    (
        face("front", body_b="earth"),
        "/interfaces/front/@body_b: expected a body of ['blade', 'damper', 'ground'], found 'earth'",
    ),
    (
        face("front", body_b="blade"),
        "/bodies/blade/@ports: expected the sides of interfaces that name this body, "
        "[('front', 'b'), ('left', 'b'), ('right', 'b')], found",
    ),
    (
        face("shroud", SHROUD, sector_b=0),
        "/interfaces/shroud: expected two bodies, or one body in two sectors, found body 'blade' of sector 0 on both sides",
    ),
    (
        replace(
            ground_model(),
            bodies={"blade": Body("blade", "ground"), "ground": Body("ground", "ground")},
            locations={},
        ),
        "/interfaces/pad: expected a body that can move, found ground on both sides",
    ),
    (
        body("blade", ports=(("up", "b"), ("right", "b"))),
        "/bodies/blade/@ports: expected the sides of interfaces that name this body, "
        "[('left', 'b'), ('right', 'b')], found [('up', 'b')",
    ),
    (
        body("blade", ports=(("left", "c"), ("right", "b"))),
        "/bodies/blade/@ports: expected pairs (interface, 'a' or 'b'), found ('left', 'c')",
    ),
    (
        body("blade", ports=(("left", "a"), ("right", "b"))),
        "/bodies/blade/@ports: expected the sides of interfaces that name this body, "
        "[('left', 'b'), ('right', 'b')], found [('left', 'a')",
    ),
    (
        body("blade", ports=(("left", "b"), ("left", "b"))),
        "/bodies/blade/@ports: expected the sides of interfaces that name this body",
    ),
    (
        body("blade", ports=(("left", "b"),)),
        "/bodies/blade/@ports: expected the sides of interfaces that name this body, "
        "[('left', 'b'), ('right', 'b')], found [('left', 'b')]",
    ),
    (body("blade", ports=("left.b", "right.b")), "/bodies/blade/@ports: expected pairs"),
    (body("blade", ports=[("left", "b")]), "/bodies/blade/@ports: expected a tuple"),
    (
        replace(WEDGE, locations={"tip": replace(TIP, body="vane")}),
        "/locations/tip/@body: expected a body of ['blade', 'damper', 'ground'], found 'vane'",
    ),
    (
        replace(WEDGE, locations={"tip": replace(TIP, body="ground")}),
        "/locations/tip/@body: expected a body that can move, found 'ground', which is ground",
    ),
    (basis("blade", 2, locations={}), "/bodies/blade/nd002/locations: expected ['tip'], found []"),
    (replace(WEDGE, locations={}), "/bodies/blade/nd000/locations: expected [], found ['tip']"),
    (
        body("blade", bases=without(BLADE.bases, 0)),
        "/bodies/blade/nd000: expected the modes of nodal diameter 0, found only [2, 4, 6]",
    ),
    (
        body("blade", bases=put(BLADE.bases, 7, BLADE_2)),
        "/bodies/blade: expected nodal diameters 0 to 6 of a constrained body (n_blades = 12), found 7",
    ),
    (
        body("blade", bases=put(BLADE.bases, -2, BLADE_2)),
        "/bodies/blade: expected nodal diameters 0 to 6",
    ),
    (
        body("blade", bases=put(BLADE.bases, "2", BLADE_2)),
        "/bodies/blade (nodal diameter): expected an integer, found '2'",
    ),
    (
        body("damper", bases=put(DAMPER.bases, 2, FREE)),
        "/bodies/damper: expected nodal diameters 0 to 0 of a free body (n_blades = 12), found 2",
    ),
    (
        body("left_blade", ACYCLIC, bases=put(ACYCLIC.bodies["left_blade"].bases, 1, BLADE_2)),
        "/bodies/left_blade: expected nodal diameters 0 to 0 of a constrained body (n_blades = 1), found 1",
    ),
    (
        body("ground", bases={0: FREE}),
        "/bodies/ground: expected no modes of a ground body, found nodal diameters [0]",
    ),
    (
        body("ground", load=DAMPER.load),
        "/bodies/ground/load: expected no load on a ground body, found one",
    ),
    (
        basis("blade", 2, omega2=at(BLADE_2.omega2, 1, -4.0)),
        "/bodies/blade/nd002/omega2: expected numbers > 0 for elastic modes, found -4.0 at 1",
    ),
    (
        basis("blade", 2, damping_ratio=np.array([0.0, -0.1, 0.0])),
        "/bodies/blade/nd002/damping_ratio: expected numbers >= 0 and < 1, found -0.1 at 1",
    ),
    (
        basis("blade", 0, contact_modes=BLADE.bases[0].contact_modes * np.exp(0.1j)),
        "/bodies/blade/nd000/modes: expected real numbers at nodal diameter 0, found imaginary parts",
    ),
    (
        basis("blade", 0, locations={"tip": BLADE.bases[0].locations["tip"] * 1j}),
        "/bodies/blade/nd000/locations/tip: expected real numbers at nodal diameter 0",
    ),
    (
        basis("blade", 2, flexibility=at(BLADE_2.flexibility, (0, 5), 1e-6)),
        "/bodies/blade/nd002/flexibility: expected a Hermitian matrix, found a difference of",
    ),
    (
        basis("blade", 2, flexibility=BLADE_2.flexibility + 1e-9j * np.eye(24)),
        "/bodies/blade/nd002/flexibility: expected a Hermitian matrix",
    ),
    (
        basis("blade", 2, flexibility=BLADE_2.flexibility.conj()),
        "/bodies/blade/nd002/flexibility: expected flexibility - Phi Omega^-2 Phi^H (elastic modes) "
        "positive semi-definite, found the eigenvalue -",
    ),
    (
        basis("damper", 0, flexibility=0.5 * FREE.flexibility),
        "/bodies/damper/nd000/flexibility: expected flexibility - Phi Omega^-2 Phi^H",
    ),
    (
        basis("blade", 2, flexibility=1e200 * np.eye(24)),
        "/bodies/blade/nd002/flexibility: expected numbers whose squares are finite",
    ),
    (
        basis(
            "blade",
            0,
            flexibility=BLADE.bases[0].flexibility + 1e-10j * (np.eye(24, k=1) - np.eye(24, k=-1)),
        ),
        "/bodies/blade/nd000/flexibility: expected real numbers at nodal diameter 0",
    ),
    (body("damper", mass=None), "/bodies/damper/mass: the mass of a free body is missing"),
    (body("damper", centre=None), "/bodies/damper/centre: the centre of a free body is missing"),
    (body("damper", inertia=None), "/bodies/damper/inertia: the inertia of a free body is missing"),
    (body("damper", mass=0.0), "damper/mass: expected a finite number > 0, found 0.0"),
    (
        body("damper", inertia=at(DAMPER.inertia, (0, 1), 1e-6)),
        "/bodies/damper/inertia: expected a symmetric matrix, found a difference of 1e-06 at (0, 1)",
    ),
    (
        body("damper", inertia=np.diag([1e-5, 1e-5, -1e-6])),
        "/bodies/damper/inertia: expected principal moments > 0, found -1e-06",
    ),
    (
        basis("damper", 0, omega2=at(FREE.omega2, 3, 1e-3)),
        "/bodies/damper/nd000/omega2: expected exactly 0 for the six rigid-body modes, found 0.001 at 3",
    ),
    (
        basis(
            "damper",
            0,
            omega2=np.zeros(5),
            damping_ratio=np.zeros(5),
            contact_modes=FREE.contact_modes[:, :, :5],
        ),
        "/bodies/damper/nd000/omega2: expected 6 rigid-body modes first, found 5 modes",
    ),
    (
        mix_rigid(np.diag([1, 1, 1, 1, 1.01, 1])),
        "damper/nd000/modes: expected mass-normalised independent rigid-body modes",
    ),
    (
        mix_rigid(np.eye(6) + 0.01 * np.eye(6, k=1)),
        "damper/nd000/modes: expected mass-normalised independent rigid-body modes",
    ),
    (
        mix_rigid(np.eye(6)[:, [0, 1, 2, 3, 4, 4]]),
        "damper/nd000/modes: expected mass-normalised independent rigid-body modes",
    ),
    (
        mix_rigid(np.diag([1.0, 1, 1, 0, 1, 1])),
        "damper/nd000/modes: expected mass-normalised independent rigid-body modes",
    ),
    (
        basis("damper", 0, contact_modes=at(FREE.contact_modes, (2, 1, 4), 0.0)),
        "damper/nd000/modes: expected rigid motions about the centre as the first six modes, found mode 4",
    ),
    (
        basis("damper", 0, contact_modes=FREE.contact_modes[:, :, ::-1], flexibility=None),
        "expected rigid motions about the centre as the first six modes, found mode",
    ),
    (
        body("damper", mass=1.1 * DAMPER.mass),
        "damper/nd000/modes: expected mass-normalised independent rigid-body modes",
    ),
    (
        body("damper", centre=DAMPER.centre + [0.0, 0.001, 0.0]),
        "damper/nd000/modes: expected mass-normalised independent rigid-body modes",
    ),
    (
        body("damper", inertia=1.2 * DAMPER.inertia),
        "damper/nd000/modes: expected mass-normalised independent rigid-body modes",
    ),
    (
        face("left", points=at(LEFT.points, (0, 2), 0.0)),
        "expected rigid motions about the centre as the first six modes",
    ),
    (
        face("left", frame=LEFT.frame[:, [1, 2, 0]]),
        "expected rigid motions about the centre as the first six modes",
    ),
    (
        load(direction=np.array([0.0, 1.1, 0.0])),
        "/bodies/damper/load/direction: expected a unit vector, found length 1.1",
    ),
    (
        replace(WEDGE, contact={"top": WEDGE.contact["left"]}),
        "/contact/top: expected the name of an interface of ['left', 'right', 'front', 'back'], found 'top'",
    ),
    (
        contact(stiffness=at(STIFFNESS, (1, 2), -1.0)),
        "/contact/left/stiffness: expected numbers >= 0, found -1.0 at (1, 2)",
    ),
    (
        replace(WEDGE, meshes={"disk": MESH}),
        "/mesh/disk: expected the name of a body of ['blade', 'damper', 'ground'], found 'disk'",
    ),
    (
        mesh(quads=at(MESH.quads, (1, 2), 6)),
        "/mesh/damper/quads: expected indices 0 to 5, found 6 at (1, 2)",
    ),
]


def spoiled(record, put=lambda new: new):
    """Yield the place of each value below a record, and what ``put`` makes of a record in which it has another type, shape,
    or a number that is none.
    """
    for field in layout(type(record)):
        value, mapped = getattr(record, field.name), field.keys is not None
        for key, part in (
            (value or {}).items() if mapped else () if value is None else (("", value),)
        ):

            def changed(new, field=field, key=key, value=value):
                return put(
                    replace(
                        record,
                        **{field.name: {**value, key: new} if field.keys is not None else new},
                    )
                )

            if field.is_record:
                yield from spoiled(part, changed)
            for bad in bad_values(part, field):
                yield field.place() if field.kind is str else field.place(key), changed(bad)


def bad_values(value, field):
    if isinstance(value, np.ndarray):
        number = value.astype(float if value.dtype.kind in "iub" else value.dtype)
        return [value.tolist(), value[..., None], value.astype("S8"), number * np.nan]
    return {int: [1.5, True], float: [np.nan, "1"], str: [1]}.get(field.kind, [1.0])


SPOILED = list(spoiled(complete_model()))


@pytest.mark.slow
@each(("place", "broken"), SPOILED, ids=[place for place, _ in SPOILED])
def test_type_shape_and_numbers_of_every_field(place, broken):
    with pytest.raises(ModelError, match=rf"/@?{re.escape(place)}: expected") as caught:
        check_model(broken)
    assert len(str(caught.value).splitlines()) == 1


@each(("broken", "message"), CASES, ids=[message for _, message in CASES])
def test_one_broken_thing_is_named(broken, message):
    with pytest.raises(ModelError, match=re.escape(message)) as caught:
        check_model(broken)
    assert len(str(caught.value).splitlines()) == 1


@each("name", ALL_MODELS)
@each("seed", range(5))
def test_small_models_pass(name, seed):
    check_model(ALL_MODELS[name](seed))


@pytest.mark.slow
@each("n_points", [1, 3, 4, 9, 12])
@each("n_blades", [2, 3, 12, 13])
def test_wedge_model_passes_in_other_sizes(n_points, n_blades):
    check_model(wedge_model(1, n_blades, 5, n_points, 2, 4, alpha=0.6, beta=0.9, n_damper_modes=0))


# -----------------------------------------------------------------------------------------------------------
# What must pass


def test_negative_gap_is_an_interference_fit():
    check_model(face("left", gap=np.full(4, -1e-6)))


def test_complex_array_without_imaginary_part_is_real():
    modes = BLADE.bases[0].contact_modes.astype(complex)
    check_model(basis("blade", 0, contact_modes=modes))


def test_any_rotation_of_the_rigid_modes_is_as_good():
    rotation = np.linalg.qr(np.random.default_rng(3).standard_normal((6, 6)))[0]
    check_model(mix_rigid(rotation))
    check_model(mix_rigid(SWAP))


def test_flexibility_of_the_modes_alone_is_allowed():
    shapes = BLADE_2.contact_modes.reshape(24, 3)
    own = (shapes / BLADE_2.omega2) @ shapes.conj().T
    check_model(basis("blade", 2, flexibility=own))
    check_model(basis("blade", 2, flexibility=None))


def test_ground_may_name_its_ports():
    check_model(body("ground", ports=(("back", "b"), ("front", "b"))))


def test_free_body_in_the_neighbouring_sector():
    """The same wedge described from the sector before: its arrays do not change, its sector does."""
    turn = 2 * np.pi / 12
    c, s = np.cos(turn), np.sin(turn)
    to_sector = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])  # sector 0 onto sector +1
    faces = {}
    for name in ("front", "back"):
        interface = WEDGE.interfaces[name]
        faces[name] = replace(
            interface,
            sector_a=1,
            points=interface.points @ to_sector.T,
            frame=interface.frame @ to_sector.T,
        )
    check_model(replace(WEDGE, interfaces={**WEDGE.interfaces, **faces}))
    wrong = {name: replace(interface, sector_a=-1) for name, interface in faces.items()}
    with pytest.raises(ModelError, match="rigid motions about the centre"):
        check_model(replace(WEDGE, interfaces={**WEDGE.interfaces, **wrong}))


def one_point_damper() -> Model:
    """A damper that touches at one point only: its rotations about that point cannot be seen."""
    small = wedge_model(n_points=1, n_blade_modes=1, n_damper_modes=0)
    blade, damper = small.bodies["blade"], small.bodies["damper"]
    bases = {
        d: replace(b, contact_modes=b.contact_modes[:1], flexibility=None)
        for d, b in blade.bases.items()
    }
    free = replace(
        damper.bases[0], contact_modes=damper.bases[0].contact_modes[:1], flexibility=None
    )
    bodies = {
        "blade": replace(blade, ports=(("left", "b"),), bases=bases),
        "damper": replace(damper, ports=(("left", "a"),), bases={0: free}, load=None),
    }
    interfaces = {"left": small.interfaces["left"]}
    contact = {"left": small.contact["left"]}
    return replace(small, bodies=bodies, interfaces=interfaces, contact=contact)


def test_rigid_modes_are_checked_where_the_points_do_not_determine_them():
    check_model(one_point_damper())
    with pytest.raises(
        ModelError, match=r"mass-normalised independent rigid-body modes .* difference of"
    ):
        check_model(mix_rigid(np.diag([1, 1, 1, 1, 1, 1.2]), one_point_damper()))


def test_rigid_modes_are_checked_at_locations():
    position = np.array([0.001, 0.301, 0.01])
    values = np.concatenate(
        [
            rigid_modes(DAMPER.mass, DAMPER.centre, DAMPER.inertia, position[None])[0],
            np.ones((3, 2)),
        ],
        axis=1,
    )
    probed = replace(
        WEDGE, locations=put(WEDGE.locations, "probe", Location("probe", "damper", position))
    )
    check_model(basis("damper", 0, probed, locations={"probe": values}))
    with pytest.raises(ModelError, match="found mode 1 off by"):
        check_model(basis("damper", 0, probed, locations={"probe": at(values, (1, 1), 0.0)}))


@pytest.mark.slow
def test_points_and_modes_are_checked_all_at_once():
    """As many calls for a large model as for a small one, so that its check takes little."""

    def calls(**size):
        model, count = wedge_model(harmonics=3, **size), 0

        def profile(frame, event, argument):
            nonlocal count
            count += event == "call"

        sys.setprofile(profile)
        try:
            check_model(model)
        finally:
            sys.setprofile(None)
        return count

    assert calls(n_points=24, n_blade_modes=8) <= 1.1 * calls(n_points=6, n_blade_modes=2)


def test_a_free_body_without_contacts_is_refused():
    model = wedge_model()
    blade, damper = (replace(model.bodies[name], ports=()) for name in ("blade", "damper"))
    bare = replace(model, bodies={"blade": blade, "damper": damper}, interfaces={})
    words = "/bodies/damper/@ports: expected at least one contact of a free body, found none"
    with pytest.raises(ModelError, match=words):
        check_model(bare)
