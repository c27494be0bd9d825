from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

_Parts = list[tuple[float, float, int]]
_Laws = tuple[tuple[Any, ...] | None, ...] | None

jenkins: Any
bouc_wen: Any

class Counts(NamedTuple):
    contact: float
    assembly: float
    algebra: float
    processor: float
    evaluations: int
    jacobians: int
    factorisations: int
    least_norm: int
    condensed: int

class Solved(NamedTuple):
    status: int
    iterations: int
    residual: float
    first_step: float
    last_step: float
    condition: float
    rank: int
    orientation: int
    slope: float
    curvature: float
    shares: tuple[float, float, float]

class _Equations:
    @property
    def n_unknown(self) -> int: ...
    @property
    def cost(self) -> Counts: ...
    def evaluate(
        self,
        y: NDArray[np.float64],
        r: NDArray[np.float64],
        J: NDArray[np.float64] | None = None,
        C: NDArray[np.float64] | None = None,
    ) -> int: ...
    def solve(
        self,
        y: NDArray[np.float64],
        tangent: NDArray[np.float64],
        scale: NDArray[np.float64],
        tolerance: float,
        max_iterations: int,
        line_search: int = 0,
        reach: float = 0.0,
        row: NDArray[np.float64] | None = None,
        re: NDArray[np.float64] | None = None,
        im: NDArray[np.float64] | None = None,
        curvature: float = 0.0,
        place_tolerance: float = 0.0,
        max_step: float = 0.0,
        loose: float = 0.0,
        rough: float = 0.0,
    ) -> Solved: ...
    def bordered(
        self,
        y: NDArray[np.float64],
        row: NDArray[np.float64],
        scale: NDArray[np.float64],
        b: NDArray[np.float64],
        transposed: bool = False,
    ) -> tuple[int, float, int, int]: ...
    def gradient(
        self,
        y: NDArray[np.float64],
        tangent: NDArray[np.float64],
        scale: NDArray[np.float64],
        row: NDArray[np.float64],
        nu: NDArray[np.float64],
        step: float,
        re: NDArray[np.float64] | None = None,
        im: NDArray[np.float64] | None = None,
    ) -> int: ...
    def contact(
        self,
        y: NDArray[np.float64],
        X: NDArray[np.float64],
        F: NDArray[np.float64],
        share: NDArray[np.float64],
    ) -> int: ...

class SectorEquations(_Equations):
    def __init__(
        self,
        n_mode: NDArray[np.intc],
        stiffness: NDArray[np.float64],
        mass: NDArray[np.float64],
        damping: NDArray[np.float64],
        G: NDArray[np.complex128],
        kt: NDArray[np.float64],
        kn: NDArray[np.float64],
        mu: NDArray[np.float64],
        n0: NDArray[np.float64],
        w: NDArray[np.float64],
        law: NDArray[np.intc],
        shift: NDArray[np.float64],
        force: NDArray[np.float64],
        evaluation: int = 0,
        n_time: int = 0,
        load: NDArray[np.float64] | None = None,
        nodes: tuple[SectorEquations, ...] | None = None,
        squares: NDArray[np.float64] | None = None,
        order: float = 0.0,
        row_scale: NDArray[np.float64] | None = None,
        own: _Laws = None,
        elimination: int = 0,
    ) -> None: ...

class Eased(_Equations):
    def __init__(
        self,
        sector: SectorEquations,
        omega: float,
        ramp: NDArray[np.float64],
        support: NDArray[np.float64] | None = None,
    ) -> None: ...

class Modes(_Equations):
    def __init__(
        self,
        sector: SectorEquations,
        re: NDArray[np.float64],
        im: NDArray[np.float64],
        weight: float,
        row_scale: NDArray[np.float64] | None = None,
    ) -> None: ...

class Wheel(_Equations):
    def __init__(
        self,
        n_sector: int,
        n_harm: int,
        n_blade: int,
        n_damper: int,
        n_root: int,
        n_kept: int,
        n_point: int,
        next: NDArray[np.bool_],
        rows: NDArray[np.float64],
        active: NDArray[np.bool_],
        pinned: NDArray[np.bool_],
        stiffness: NDArray[np.float64],
        mass: NDArray[np.float64],
        disk_stiffness: NDArray[np.complex128],
        disk_mass: NDArray[np.complex128],
        damping: NDArray[np.complex128],
        damper_stiffness: NDArray[np.float64],
        damper_mass: NDArray[np.float64],
        damper_damping: NDArray[np.float64],
        springs: NDArray[np.float64],
        neutral: NDArray[np.float64],
        home: NDArray[np.float64],
        kt: NDArray[np.float64],
        kn: NDArray[np.float64],
        mu: NDArray[np.float64],
        n0: NDArray[np.float64],
        w: NDArray[np.float64],
        law: NDArray[np.intc],
        load: NDArray[np.float64],
        shift: NDArray[np.float64],
        force: NDArray[np.float64],
        row_scale: NDArray[np.float64],
        evaluation: int = 0,
        n_time: int = 0,
    ) -> None: ...

def kernels() -> tuple[str, ...]: ...
def check_laws(own: _Laws) -> None: ...
def step_laws(
    own: _Laws,
    x: NDArray[np.float64],
    memory: NDArray[np.float64],
    after: NDArray[np.float64],
    F: NDArray[np.float64],
    D: NDArray[np.float64],
) -> None: ...
def kernel() -> str: ...
def evaluate_contact(
    x: NDArray[np.float64],
    kt: NDArray[np.float64],
    kn: float,
    mu: float,
    n0: float,
    w: NDArray[np.float64],
    F: NDArray[np.float64],
    J: NDArray[np.float64],
    law: int = 0,
    evaluation: int = 0,
    n_time: int = 0,
    load: float = ...,
    own: _Laws = None,
) -> tuple[tuple[float, float, float, float, float], tuple[_Parts, _Parts]]: ...

class TimeIntegration:
    def __init__(
        self,
        n_sector: int,
        n_mode: NDArray[np.intc],
        diameter: NDArray[np.intc],
        stiffness: NDArray[np.float64],
        mass: NDArray[np.float64],
        damping: NDArray[np.float64],
        G: NDArray[np.complex128],
        kt: NDArray[np.float64],
        kn: NDArray[np.float64],
        mu: NDArray[np.float64],
        n0: NDArray[np.float64],
        load: NDArray[np.float64],
        shift: NDArray[np.float64],
        law: NDArray[np.intc],
        held: NDArray[np.intc],
        order: NDArray[np.intc],
        force: NDArray[np.float64],
        row: NDArray[np.float64],
        own: _Laws = None,
    ) -> None: ...
    def integrate(
        self,
        q: NDArray[np.float64],
        v: NDArray[np.float64],
        a: NDArray[np.float64],
        w: NDArray[np.float64],
        n_step: int,
        per_period: int,
        omega: float,
        omega_end: float,
        radius: float,
        tolerance: float,
        fresh: bool = False,
        harmonic: NDArray[np.complex128] | None = None,
        trace: NDArray[np.float64] | None = None,
        first: int = 0,
        energy: NDArray[np.float64] | None = None,
        seconds: float = 0.0,
        states: NDArray[np.int8] | None = None,
    ) -> tuple[int, int, int]: ...
    def follow(self, q: NDArray[np.float64], w: NDArray[np.float64]) -> None: ...
