"""Every Python block of README and documentation runs as a reader pastes it, and what pages state of its results holds.

Each page starts in an empty folder without any name defined, and its blocks run in their order.
"""

import re
import time
from contextlib import nullcontext
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest

import bdamper as bd
from bdamper.util.formatting import percent
from tools.manual_results import TIMES, split

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
OWN = {"design", "fit", "import", "lumped"}  # pages whose tests run their blocks themselves


def blocks(page):
    return re.findall(r"```python\n(.*?)```", page.read_text(), re.S)


PAGES = [
    page
    for page in sorted(DOCS.rglob("*.md"))
    if "_build" not in page.parts and page.stem not in OWN and blocks(page)
]


LONG = {"in-time", "how-to", "accuracy", "speed", "wheel", "joints"}
"""Pages whose blocks take more than 15 s of the processor; the first page is tested each time."""


def pasted(page, folder, monkeypatch):
    """Run the blocks of a page; return the names after each block, and print the seconds of those above five."""
    monkeypatch.chdir(folder)
    space, seen = {"__name__": "__main__"}, []
    for k, block in enumerate(blocks(page)):
        begin = time.process_time()
        exec(compile(block, f"{page.name}, block {k + 1}", "exec"), space)
        plt.close("all")
        if (seconds := time.process_time() - begin) > 5.0:
            print(f"\n{page.name}, block {k + 1}: {seconds:.0f} s")
        seen.append(dict(space))
    return seen


def numbers(texts):
    """Numbers of a text, with commas between thousands."""
    return [float(text.replace(",", "")) for text in texts]


def how_to(seen, page, folder):
    assert len(seen) == 13 and max(len(block.splitlines()) for block in blocks(page)) <= 10
    chosen, robust, refined, _, compared, swept, resumed = seen[1:8]
    assert refined["finer"] is refined["refined"].study
    space = seen[-1]
    assert chosen["best"].ok and chosen["low"] < chosen["best"].preload < chosen["high"]
    assert (
        robust["robust"].amplitude < 1.1 * chosen["best"].amplitude
        and robust["robust"].status == "complete"
    )
    assert (
        compared["designs"].curves[1].peak.amplitude
        < 0.9 * compared["designs"].curves[0].peak.amplitude
    )
    inert = bd.compare(
        {"now": space["study"], "inert": {"damper_inertia_factor": 1.5}},
        lambda s: s.frequency_response(500.0, (280.0, 380.0)),
    )
    changes = compared["designs"].change("damper 50 % heavier"), inert.change("inert")
    assert (
        f"({percent(changes[1], True)} instead of {percent(changes[0], True)} here)"
        in page.read_text()
    )
    assert swept["result"].complete and swept["result"].shape == (3, 2)
    assert np.array_equal(resumed["result"].seconds, swept["result"].seconds), (
        "points were computed again"
    )
    assert not bd.load("curve.h5").diff(space["curve"])
    cycle = space["cycle"]
    assert abs(cycle.imbalance) < 1e-9 and cycle.lost > 0.5 * cycle.excitation
    assert {path.suffix for path in folder.iterdir()} >= {".png", ".csv", ".jsonl", ".h5"}
    shown = set(re.findall(r"\(images/(\w+\.png)\)", page.read_text())) - {
        "designs.png",
        "explorer.png",
    }
    assert len(shown) == 3 and shown <= {path.name for path in folder.glob("*.png")}


def joints(seen, page, folder):
    space = seen[-1]
    heights = {load: curve.amplitude for load, curve in space["curves"].items()}
    assert set(heights) == {20.0, 50.0} and all(
        np.isfinite(a).all() and (a > 0.0).all() for a in heights.values()
    )
    lowest = {load: a.min() for load, a in heights.items()}
    assert lowest[space["best"]] == min(lowest.values()) and lowest[20.0] != lowest[50.0]
    left = space["own"].static(40.0).normal_force["shroud"]
    assert 0.0 <= left < 40.0, "the dampers take load off the shroud"


def accuracy(seen, page, folder):
    """Effects whose errors the page shows."""
    assert seen[2]["curve"].complete
    cost, text = seen[3]["result"], page.read_text()
    (whole, parts) = re.search(
        r"most detailed settings: (\d+) % \((.*?); not estimated", " ".join(text.split())
    ).groups()
    assert float(whole) == pytest.approx(100.0 * cost.uncertainty, rel=0.05)
    size = {error.source: error.size for error in cost.sources}
    for source in ("modes", "residual flexibility", "harmonics"):
        (shown,) = re.findall(rf"(?:^|, ){source} ([\d.]+) %", parts)
        assert float(shown) == pytest.approx(100.0 * size[source], rel=0.05)
    assert not cost.reached and cost.forecast.settings in " ".join(text.lower().split())
    row = re.compile(r"^ *(translation X|contact points beyond 4|separation) +([+-][\d.]+) %", re.M)
    shown, found = (
        dict(row.findall(text)) for text in (page.read_text(), seen[-1]["advice"].summary())
    )
    assert len(shown) == 3
    assert [float(found[name]) for name in shown] == pytest.approx(
        [float(v) for v in shown.values()], rel=0.02
    )


def index(seen, page, folder):
    """README and first page show the printed result together (python -m tools.manual_results)."""
    printed = str(seen[0]["best"])
    # times decide where lines break
    for part, place in zip(split(printed), (ROOT / "README.md", page)):
        text = TIMES.sub("", " ".join(part.split()))
        assert f"``` {text} ```" in " ".join(place.read_text().split())


FITTING = re.compile(
    r"^\| (\d+) N \| ([\d,]+) rpm, ([\d.]+) Hz \| ([\d,]+) N \| ([\d,]+) N \|$", re.M
)
"""Row of the first page: excitation, crossing, preload there, and the optimum at speed."""


def first_study(excitation):
    """The study of the first page with another amplitude (N)."""
    wave = bd.Excitation("tip", direction="tangential", amplitude=excitation)
    return bd.Study(
        bd.reference_model("turbine_blade"), wave, engine_order=5, friction_coefficient=0.3
    )


@pytest.mark.slow
@pytest.mark.parametrize("number", [0, 1])
def test_damper_of_the_first_page_meets_its_engine_order(number):
    """At the speed of the crossing the preload follows from the mass, and the frequency from the engine order."""
    row = FITTING.findall((DOCS / "index.md").read_text())[number]
    excitation, rpm, hertz, preload, _ = numbers(row)
    study = first_study(excitation)
    found = study.resonance_crossings(rpm=(7000, 11000), engine_orders=[5])
    speed = found.array("speed").item()
    damper = study.model.bodies["damper"]
    load = damper.mass * np.hypot(*damper.centre[:2]) * speed**2
    computed = [60.0 * speed / (2.0 * np.pi), 5.0 * speed / (2.0 * np.pi), load]
    assert [rpm, hertz, preload] == pytest.approx(computed, rel=1e-3)
    assert preload == pytest.approx(found.array("preload").item(), rel=1e-3)


@pytest.mark.slow
def test_recipe_from_preload_to_mass():
    """Its numbers, and m r Omega^2 at the speed of the crossing."""
    page = DOCS / "how-to.md"
    (recipe,) = (block for block in blocks(page) if "resonance_crossings" in block)
    space = {}
    exec(blocks(page)[0] + recipe, space)
    found, lowest = space["found"], space["lowest"]
    millimetres, factor, grams, speed, preload = numbers(
        re.search(
            r"# ([\d.]+) mm, with ([\d.]+) times .*?# ([\d.]+) g, ([\d.]+) rad/s, ([\d,]+) N",
            recipe,
            re.S,
        ).groups()
    )
    assert 0 < lowest < len(found) - 1, "the mass with the lowest amplitude is between others"
    assert found.points["damper_mass_factor"][lowest] == factor
    shown = [1e-3 * millimetres, 1e-3 * grams, speed, preload]
    names = ("amplitude", "mass", "speed", "preload")
    assert shown == pytest.approx([found.array(name).flat[lowest] for name in names], rel=5e-3)
    damper = space["study"].model.bodies["damper"]
    load = (
        factor * damper.mass * np.hypot(*damper.centre[:2]) * found.array("speed").flat[lowest] ** 2
    )
    assert preload == pytest.approx(load, rel=1e-3)


@pytest.mark.nightly
@pytest.mark.slow
def test_optimal_preloads_of_the_first_page():
    """At the speed of the fitting damper; per newton they are the numbers below the table."""
    page = (DOCS / "index.md").read_text()
    per_newton = {}
    for row in FITTING.findall(page):
        excitation, *_, preload = numbers(row)
        # the page says that this damper fits 52 N and that other forces need another one
        fits = excitation == 52.0
        warns_of_mass = (
            nullcontext() if fits else pytest.warns(bd.PlausibilityWarning, match="mass")
        )
        with warns_of_mass:
            curve = (
                first_study(excitation)
                .at_speed(rpm=8860)
                .optimal_curve((1000, 10000), 8, check=False)
            )
        best = curve.optimum
        assert preload == pytest.approx(best.preload, rel=0.01)
        per_newton[excitation] = best.preload / excitation
    one = first_study(1.0).at_speed(rpm=8860)
    # this small load closes only a part of the faces
    with pytest.warns(bd.PlausibilityWarning, match="preload|contact at rest"):
        per_newton[1.0] = one.optimal_curve((90.0, 130.0), 3, check=False).optimum.preload
    shown = re.search(
        r"are (\d+) and (\d+) N of preload per newton of .* ratio is (\d+);", " ".join(page.split())
    ).groups()
    # the minimum at 1 N is flat
    assert numbers(shown) == pytest.approx(list(per_newton.values()), rel=0.02)


CHECKS = {"how-to": how_to, "joints": joints, "accuracy": accuracy, "index": index}


@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=pytest.mark.nightly if page.stem in LONG else (), id=page.stem)
        for page in PAGES
    ],
)
def test_blocks_run_as_pasted(page, tmp_path, monkeypatch):
    seen = pasted(page, tmp_path, monkeypatch)
    if check := CHECKS.get(page.stem):
        check(seen, page, tmp_path)


def test_the_readme_has_two_pictures_and_one_short_example():
    readme = ROOT / "README.md"
    assert readme.read_text().count("![") == 2
    (code,) = blocks(readme)
    assert len([line for line in code.splitlines() if line]) <= 6


def test_errors_of_contact_points_are_those_measured():
    page, measured = (
        (DOCS / "accuracy.md").read_text(),
        (DOCS / "evidence" / "measured.md").read_text(),
    )
    rows = {
        "contact_points": "unit tractions",
        "contact_points_residual": "six residual modes, points united",
    }
    for name, row in rows.items():
        table = re.search(rf"<!-- {name} -->.*?<!-- end -->", measured, re.S)[0]
        errors = {n: 100 * float(e) for n, e in re.findall(r"^\| (\d+) \| (\d\S+) \|", table, re.M)}
        shown = re.search(rf"^\| {row} \|.*192 points \| (.*) \|$", page, re.M)[1].split(" | ")
        assert [float(e) for e in shown] == pytest.approx(
            [errors[n] for n in ("9", "24", "48", "96")], rel=0.01
        )


def test_an_implausible_value_is_an_error_on_every_page():
    with pytest.raises(bd.PlausibilityWarning, match="possibly given in per cent"):
        first_study(1.0).replace(friction_coefficient=30.0)
