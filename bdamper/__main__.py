"""Command line interface ``bdamper``."""

from __future__ import annotations

import argparse
import re
import sys
import warnings
import webbrowser
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

import bdamper as bd
from bdamper.fatigue.criteria import Material
from bdamper.response.headline import known_in_time
from bdamper.response.linear_limits import peak_interval


def import_decks(given: argparse.Namespace) -> None:
    """Build a model from decks; write model, report and picture."""
    from bdamper import importers
    from bdamper.plot import save_figure
    from bdamper.util.storage import file_errors

    def body(text: str) -> importers.FEBody:
        deck, _, instance = (
            text.rpartition(":")
            if Path(text).suffix.lower() not in (".inp", ".cdb")
            else (text, "", "")
        )
        return importers.read_job(deck or text, instance or None)

    points = given.points[0] if len(given.points) == 1 else tuple(given.points)

    def contact(text: str) -> importers.ContactFaces:
        name, _, faces = text.partition("=")
        sides = [side.rpartition("/")[::2] for side in faces.split(",")]
        if not name or len(sides) != 2:
            raise bd.SettingError(f"--contact: expected NAME=SET,SET, found {text!r}")
        (body_a, a), (body_b, b) = sides
        body_a = body_a or ("damper" if given.damper else "blade")
        other = (None, "ground") if b == "ground" else (b, body_b or "blade")
        return importers.ContactFaces(name, a, other[0], body_a, other[1], points=points)

    def stop(text: str) -> importers.ContactFaces:
        try:
            name, side, gap = re.split("[=,]", text)
            distance = float(gap)
        except ValueError:
            raise bd.SettingError(f"--stop: expected NAME=SET,GAP, found {text!r}") from None
        body_a, _, a = side.rpartition("/")
        return importers.ContactFaces(
            name, a, None, body_a or "damper", "ground", (2, 2), "constraint", gap=distance
        )

    dampers = [text.rpartition("=")[::2] for text in given.damper]
    built = importers.build_model(
        body(given.blade), {name or "damper": body(deck) for name, deck in dampers} or None,
        contacts=[*map(contact, given.contact), *map(stop, given.stop)],
        sector=importers.Sector(given.sectors, given.faces, given.fixed, given.blade_nodes, given.stress),
        placement=importers.Placement(given.units, given.axis, given.radial),
        reduction=importers.Reduction(given.engine_order, given.harmonics, n_modes=given.modes),
        locations={"tip": int(given.tip[0]) if len(given.tip) == 1 else given.tip} if given.tip else None,
        progress=False if given.quiet else None,
    )  # fmt: skip
    print(built)
    stem = given.out or Path(given.blade.partition(":")[0]).stem
    built.save(f"{stem}.h5")
    with file_errors(f"{stem}.txt"):
        Path(f"{stem}.txt").write_text(f"{built}\n", encoding="utf-8")
    save_figure(built.plot(), f"{stem}.png")
    print(f"wrote {stem}.h5, {stem}.txt, {stem}.png", file=sys.stderr)


def frequency_response(study: bd.Study, given: argparse.Namespace) -> tuple[Any, bool]:
    """Return the response curve, and whether it spans the frequency interval."""
    band = peak_interval(
        study.problem.at(given.preload), given.band and tuple(given.band), given.mode
    )
    curve = study.frequency_response(given.preload, band, progress=not given.quiet)
    return curve, curve.complete


def optimum(study: bd.Study, given: argparse.Namespace) -> tuple[Any, bool]:
    """Return the optimal curve, and whether it has an optimum."""
    settings = {
        "mode": given.mode,
        "check": "time" if given.check else False,
        "progress": not given.quiet,
    }
    curve = study.optimal_curve(given.preloads, given.n, **settings)
    answered = bool(np.isfinite(curve.optimum.amplitude)) and not curve.interrupted
    return curve, answered


def resonance_crossings(study: bd.Study, given: argparse.Namespace) -> tuple[Any, bool]:
    """Return the crossings with engine orders, and whether there is any."""
    orders = given.orders or [study.settings.engine_order]
    found = study.resonance_crossings(
        rpm=given.speeds, engine_orders=orders, mode=given.mode, progress=not given.quiet
    )
    return found, "speed" in found.quantities and bool(np.isfinite(found.array("speed")).any())


def margin(study: bd.Study, given: argparse.Namespace) -> tuple[Any, bool]:
    """Return the fatigue margins at the highest peak of a preload, and whether there is a peak."""
    peak, response = study.peak(given.preload, given.band, mode=given.mode), None
    if not peak.converged:
        return peak, False
    try:
        response = study.time_response(peak, progress=not given.quiet) if given.check else None
    except bd.BdamperError as error:
        print(f"bdamper: no amplitude in time: {error}", file=sys.stderr)
    print(response or peak)
    strength = [1e6 * getattr(given, name) for name in ("endurance", "ultimate", "yield")]
    known = response if response is not None and known_in_time(response) else None
    return study.margin(peak, Material(*strength), time_response=known), True


QUESTIONS = {
    "response": (frequency_response, "response over a frequency interval at one preload"),
    "optimum": (optimum, "preload with the lowest resonance amplitude"),
    "crossings": (
        resonance_crossings,
        "resonance crossings with engine orders; the model must depend on rotor speed",
    ),
    "margin": (margin, "fatigue margins at one preload; the model must contain stresses"),
}


class Parser(argparse.ArgumentParser):
    """Argument parser that reports errors in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message} (see --help)\n")


def file_to_write(endings: Sequence[str], name: str) -> str:
    """Return the name of an output file; reject it before the computation if it cannot be written."""
    if Path(name).suffix.lower() not in endings or not Path(name).absolute().parent.is_dir():
        raise argparse.ArgumentTypeError(
            f"expected {' or '.join(endings)} in a folder that exists, found {name!r}"
        )
    return name


def parser() -> argparse.ArgumentParser:
    """Return the parser of all commands, with units and defaults in the help."""
    model = Parser(add_help=False)
    which = model.add_mutually_exclusive_group(required=True)
    which.add_argument("model", nargs="?", help="model file (HDF5)")
    which.add_argument("--demo", action="store_true", help="reference model of a turbine blade")
    picture, out = Parser(add_help=False), Parser(add_help=False)
    for place, name, endings, text in (
        (picture, "--png", (".png", ".pdf", ".svg"), "write the figure"),
        (out, "--csv", (".csv",), "write the table"),
        (out, "--h5", (".h5", ".hdf5"), "write the whole result, for bdamper.load"),
    ):
        place.add_argument(name, metavar="FILE", type=partial(file_to_write, endings), help=text)
    out.add_argument("--details", action="store_true", help="print all values of the result")
    out.add_argument("--quiet", action="store_true", help="do not show progress")
    out.add_argument("--mode", type=int, default=1, help="mode number, default %(default)s")
    asked = Parser(add_help=False)
    add = asked.add_argument
    add("--engine-order", type=int, default=5, metavar="N", help="default %(default)s")
    add(
        "--harmonics",
        type=int,
        default=3,
        metavar="H",
        help="harmonics of the engine order, default %(default)s",
    )
    add(
        "--friction",
        type=float,
        default=0.3,
        metavar="MU",
        help="friction coefficient, default %(default)s",
    )
    add(
        "--force",
        type=float,
        default=1.0,
        metavar="N",
        help="amplitude of the excitation in N, default %(default)s",
    )
    add("--at", default="tip", help="location of excitation and response, default %(default)s")
    add(
        "--direction",
        default="tangential",
        help="of the excitation: tangential, radial or axial, default %(default)s",
    )

    some: dict[str, Any] = {"nargs": "+", "metavar": "N"}
    main = Parser("bdamper", description="Forced response of bladed disks with friction dampers.")
    main.add_argument("--version", action="version", version=bd.__version__)
    commands = main.add_subparsers(dest="command", required=True)
    commands.add_parser("info", parents=[model, picture], help="content of a model file")
    commands.add_parser(
        "explore", parents=[model, asked], help="interactive page in the browser of this machine"
    )
    kinds = [model, asked, picture, out]
    own = {
        name: commands.add_parser(name, parents=kinds, help=text)
        for name, (_, text) in QUESTIONS.items()
    }
    two: dict[str, Any] = {"nargs": 2, "type": float, "metavar": ("LOW", "HIGH")}
    for name in ("response", "margin"):
        own[name].add_argument(
            "--preload", type=float, default=100.0, metavar="N", help="in N, default %(default)s"
        )
        own[name].add_argument(
            "--band",
            help="frequency interval in Hz, by default around the resonances of the mode",
            **two,
        )
    for name in ("margin", "optimum"):
        text = "check in time (an optimum: and more), at several times the cost; the default"
        own[name].add_argument(
            "--check", action=argparse.BooleanOptionalAction, default=True, help=text
        )
    for name in ("response", "margin", "optimum"):
        speed = "rotor speed in rpm of modes and stresses, default without rotation"
        own[name].add_argument("--speed", type=float, metavar="RPM", help=speed)
    add = own["optimum"].add_argument
    add("--preloads", default=(20.0, 2000.0), help="range of preloads in N, default 20 2000", **two)
    add("-n", type=int, default=20, help="number of preloads, default %(default)s")
    add(
        "--html",
        metavar="FILE",
        type=partial(file_to_write, (".html",)),
        help="write a report for a review",
    )
    own["crossings"].add_argument(
        "--speeds", default=(5000.0, 10000.0), help="in rpm, default 5000 10000", **two
    )
    own["crossings"].add_argument(
        "--orders", type=int, help="engine orders, default --engine-order", **some
    )
    decks = commands.add_parser(
        "decks", help="write the files of an example of an import to this folder"
    )
    decks.add_argument("name", help="abaqus, ansys, calculix or shroud")
    add = commands.add_parser(
        "import", help="model, report and picture from decks and their matrices"
    ).add_argument
    add(
        "blade",
        metavar="DECK",
        help="deck of the sector, .inp or .cdb, beside its matrices; DECK:INSTANCE for one",
    )
    add("--damper", nargs="+", default=(), metavar="[NAME=]DECK", help="decks of free bodies")
    contact = "pairs of faces: sets of a damper and of the blade, BODY/SET for those of another body, or ground"
    add("--contact", nargs="+", required=True, metavar="NAME=SET,SET", help=contact)
    stop = "faces of a damper that the ground stops without friction at a distance, in the unit of the decks"
    add("--stop", nargs="+", default=(), metavar="NAME=SET,GAP", help=stop)
    add(
        "--points",
        default=(24,),
        type=int,
        help="contact points of a pair, or along t1 and t2, default 24",
        **some,
    )
    add(
        "--units",
        default="m-kg-s",
        help="of the decks: m-kg-s, mm-t-s, mm-kg-s or in-lbf-s, default %(default)s",
    )
    for name, text, direction in (
        ("axis", "of rotation", (0.0, 0.0, 1.0)),
        ("radial", "to the blade", (0.0, 1.0, 0.0)),
    ):
        add(
            f"--{name}",
            nargs=3,
            type=float,
            default=direction,
            help=f"direction {text} in the decks, default {direction}",
        )
    add(
        "--sectors",
        type=int,
        metavar="N",
        help="number of sectors, by default from the sector faces",
    )
    add("--faces", nargs=2, metavar="SET", help="sector faces, by default found in the mesh")
    add("--fixed", metavar="SET", help="held nodes")
    add("--blade-nodes", metavar="SET", help="nodes of the blade, for mistuned bladed disks")
    add("--stress", metavar="SET", help="nodes with stress")
    add("--engine-order", default=(5,), type=int, help="engine orders, default 5", **some)
    add(
        "--harmonics",
        type=int,
        metavar="H",
        help="harmonics of the engine orders, by default for all studies",
    )
    add(
        "--modes",
        type=int,
        default=40,
        help="modes of the sector at each nodal diameter, default %(default)s",
    )
    add(
        "--tip",
        nargs="+",
        type=float,
        metavar="X",
        help="node number or position of the location 'tip'",
    )
    add("--out", metavar="NAME", help="name of the files, by default that of the deck")
    add("--quiet", action="store_true", help="do not show progress")
    for name, text in (
        ("endurance", "endurance limit"), ("ultimate", "ultimate strength"), ("yield", "yield strength"),
    ):  # fmt: skip
        own["margin"].add_argument(
            f"--{name}", type=float, required=True, metavar="MPA", help=f"{text} in MPa"
        )
    return main


def explore(study: bd.Study, given: argparse.Namespace) -> int:
    """Serve the explorer until Ctrl-C."""
    model = (
        'bd.reference_model("turbine_blade")' if given.demo else f"bd.load_model({given.model!r})"
    )
    numbers = f"{study.settings.engine_order}, {given.friction}, harmonics={given.harmonics}"
    driven = f"bd.Excitation({given.at!r}, {given.direction!r}, {given.force})"
    page = bd.explore(
        study, source=f"import bdamper as bd\nstudy = bd.Study({model}, {driven}, {numbers})"
    )
    print(page.address, flush=True)
    webbrowser.open(page.address)
    with suppress(KeyboardInterrupt):
        page.wait()
    page.close()
    return 0


def answer(given: argparse.Namespace) -> int:
    """Compute, print and write the result; return 1 if there is no result."""
    result: Any
    if given.command == "decks":
        print(*bd.importers.example_decks(given.name), sep="\n")
        return 0
    if given.command == "import":
        import_decks(given)
        return 0
    model = bd.reference_model("turbine_blade") if given.demo else bd.load_model(given.model)
    if given.command == "info":
        result, answered = model, True
    else:
        driven = bd.Excitation(given.at, given.direction, given.force)
        settings = {"friction_coefficient": given.friction, "harmonics": given.harmonics}
        order = (vars(given).get("orders") or [given.engine_order])[0]
        study = bd.Study(model, driven, order if model.n_blades > 1 else 0, **settings)
        if rpm := vars(given).get("speed"):
            study = study.at_speed(rpm * np.pi / 30.0)
        if given.command == "explore":
            return explore(study, given)
        result, answered = QUESTIONS[given.command][0](study, given)
    more = given.command != "info" and given.details
    print(result.summary() if more else str(result).replace("summary() has", "--details has"))
    files = vars(given)  # files are written last, because the disk can be full
    if path := files.get("csv"):
        result.to_csv(path)
    if path := files.get("h5"):
        result.save(path)
    if answered and (path := files.get("html")):
        result.report(path, study, model_file=given.model or "")
        print(f"wrote {path}", file=sys.stderr)
    if given.png:
        from bdamper.plot import save_figure

        save_figure(result.plot(), given.png)
        print(f"wrote {given.png}", file=sys.stderr)
    return int(not answered)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return the exit code."""
    given = parser().parse_args(arguments)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_, **__: print(
                f"bdamper: {message}", file=sys.stderr
            )
            return answer(given)
    except bd.SettingError as error:
        print(f"bdamper: {error}", file=sys.stderr)
        return 2
    except (bd.BdamperError, OSError, KeyboardInterrupt) as error:
        print(f"bdamper: {str(error) or 'interrupted'}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
