"""The problems of :mod:`benchmarks.peers` with pyHarm, in its own environment: ``python run_pyharm.py < problem.json``.

Prints, as JSON, processor seconds of the first run (with compilation) and of the best of two more, and the response.
"""

import json
import logging
import sys
import time
from importlib.metadata import version

logging.disable(logging.CRITICAL)


def curve(problem):
    """Frequencies (rad/s) and complex amplitudes of the first harmonic at the response."""
    import numpy as np
    from pyHarm.Maestro import Maestro

    matrices = {name: np.array(problem[name], float) for name in ("M", "C", "K")}
    connectors = {"force": {"type": "GOForcing", "connect": {"body": [problem["forced"]]}, "dirs": [0], "ho": 1, "dto": 0,
                            "amp": problem["force"]}}  # fmt: skip
    for i, jenkins in enumerate(problem["jenkins"]):
        connect = {"body": [jenkins["nodes"][0]]}
        if len(jenkins["nodes"]) == 2:
            connect["INTERNAL"] = [jenkins["nodes"][1]]
        connectors[f"jenkins{i}"] = {"type": "Jenkins", "connect": connect, "dirs": [0], "k": jenkins["kt"],
                                     "mu": 1.0, "N0": jenkins["limit"]}  # fmt: skip
    low, high = problem["band"]
    maestro = Maestro({
        "analysis": {"curve": {
            "study": "frf", "puls_inf": low, "puls_sup": high, "ds_max": problem["step"], "ds0": 0.1 * problem["step"],
            "ds_min": 1e-6, "verbose": False, "solver": "scipyroot",
            "solver_options": {"root": {"method": "hybr", "options": {"xtol": problem["tolerance"]}}},
        }},
        "system": {"type": "Base", "nh": problem["harmonics"], "nti": problem["samples"]},
        "substructures": {"body": {"matrix": matrices, "ndofs": 1}},
        "connectors": connectors,
    })  # fmt: skip
    maestro.operate()
    study = maestro.nls["curve"]
    dofs = study.system.expl_dofs
    rows = dofs[(dofs["node_num"] == problem["response"]) & (dofs["harm"] == 1)]
    c, s = (int(rows[rows["cs"] == part].index[0]) for part in "cs")
    points = [sol.x for sol in study.SolList if sol.flag_accepted]
    return [(float(x[-1]), float(x[c]), float(x[s])) for x in points]


def main():
    """Reads a problem and prints what it cost."""
    problem = json.load(sys.stdin)
    seconds = []
    for _ in range(3):
        started = time.process_time()
        points = curve(problem)
        seconds.append(time.process_time() - started)
    print(
        json.dumps(
            {
                "version": version("pyHarm-os"),
                "first": seconds[0],
                "seconds": min(seconds[1:]),
                "points": points,
            }
        )
    )


if __name__ == "__main__":
    main()
