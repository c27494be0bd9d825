"""Strain gauges: a point of a stress set, a direction, and the elastic constants of its material.

The strain along a direction is linear in the stress, so that a gauge is one more location of a
body: the row of its modes replaces the motion along X.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.model.loads import Direction, Response, direction_vector
from bdamper.model.structure import Location, Model, StressSet
from bdamper.util import validation
from bdamper.util.formatting import amount

GAUGE = "strain gauge"
"""Location of the gauge of a response in the model of a study."""
ALONG_GAUGE = np.array([1.0, 0.0, 0.0])
"""Direction of the response at this location."""


def gauge_point(
    stress: Mapping[str, StressSet], gauge: str | Sequence[float]
) -> tuple[StressSet, int]:
    """Return the stress set and the index of a point, given by name or by nearby coordinates."""
    places = {}
    for stress_set in stress.values():
        for index, name in enumerate(stress_set.point_names):
            places[name] = (stress_set, index)
    found = "none (docs/speed.md explains how to add them)"
    validation.check(places, "gauge", "a model with stress sets", found)
    if not isinstance(gauge, str):
        gauge = _nearest_point(validation.numbers("gauge, m", gauge, 3), places)
    return places[validation.choice("gauge", gauge, places)]


def _nearest_point(position: NDArray, places: Mapping[str, tuple[StressSet, int]]) -> str:
    """Return the name of the point nearest to a position, which must be close to it."""
    points = np.array([stress_set.points[index] for stress_set, index in places.values()])
    distance = np.linalg.norm(points - position, axis=1)
    nearest = int(distance.argmin())
    name = list(places)[nearest]
    least = float(distance[nearest])
    limit = 0.05 * np.abs(points).max()
    expected = f"coordinates within {amount(limit, 'm')} of a point of the stress sets"
    found = f"'{name}' as the nearest, {amount(least, 'm')} away"
    validation.check(least <= limit, "gauge", expected, found)
    return name


def gauge_weights(direction: Direction, elastic: Sequence[float] | None = None) -> NDArray:
    """Return the factors (6,) of the stress components for the normal stress along a direction, or
    with elastic constants for the strain.
    """
    # n^T sigma n with the components in the order xx, yy, zz, xy, yz, xz
    x, y, z = direction_vector(direction, "direction")
    weights = np.array([x * x, y * y, z * z, 2.0 * x * y, 2.0 * y * z, 2.0 * x * z])
    if elastic is None:
        return weights
    item = "elastic, Young's modulus and Poisson's ratio"
    modulus, poisson = validation.numbers(item, elastic, 2, least=0.0)
    expected = "a modulus above 0 and a ratio from 0 to 0.5"
    validation.check(modulus > 0.0 and poisson <= 0.5, "elastic", expected, elastic)
    # E epsilon = (1 + nu) sigma - nu trace(sigma)
    trace = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    return np.asarray(((1.0 + poisson) * weights - poisson * trace) / modulus)


def with_gauge(model: Model, place: Response) -> Model:
    """Return a model with the gauge of a response as a location."""
    stress_set, index = gauge_point(model.stress, place.location)
    weights = gauge_weights(place.direction, place.elastic)
    body = model.bodies[stress_set.body]
    bases = {}
    # an analysis names nodal diameters that the set lacks
    for diameter in set(body.bases) & set(stress_set.modes):
        basis = body.bases[diameter]
        row = weights @ stress_set.modes[diameter][index]
        rows = np.array([row, np.zeros_like(row), np.zeros_like(row)])
        bases[diameter] = replace(basis, locations={**basis.locations, GAUGE: rows})
    location = Location(GAUGE, body.name, stress_set.points[index])
    return replace(
        model,
        bodies={**model.bodies, body.name: replace(body, bases={**body.bases, **bases})},
        locations={**model.locations, GAUGE: location},
    )
