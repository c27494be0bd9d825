"""Command line interface ``bdamper``."""

from __future__ import annotations

import argparse
import re
import sys
import warnings
import webbrowser
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

import bdamper as bd
from bdamper.fatigue.criteria import Material
from bdamper.response.linear_limits import peak_interval
from bdamper.response.optimum_checks import known_in_time
from bdamper.util.display import SUMMARY_CALL

OPTION_FOR_ALL_VALUES = "--details"
"""The same remark for the command line."""


def import_decks(given: argparse.Namespace) -> None:
    """Build a model from decks; write model, report and picture."""
    from bdamper import importers
    from bdamper.plot import save_figure
    from bdamper.util.storage import file_errors

    def body(text: str) -> importers.FEBody:
        """Read DECK or DECK:INSTANCE; a colon before the ending belongs to the path."""
        deck, instance = text, ""
        if Path(text).suffix.lower() not in (".inp", ".cdb"):
            deck, _, instance = text.rpartition(":")
        return importers.read_job(deck or text, instance or None)

    gaps = dict(given.gap)
    points_of: dict[str, Any] = dict(item for item in given.points if isinstance(item, tuple))
    shared = [item for item in given.points if not isinstance(item, tuple)]
    # one number is a maximum, two are the numbers along t1 and t2
    points: Any = shared[0] if len(shared) == 1 else tuple(shared) or DEFAULT_POINTS

    def contact(text: str) -> importers.ContactFaces:
        """Read NAME=SET,SET, each set as SET or BODY/SET."""
        name, _, faces = text.partition("=")
        sides = faces.split(",")
        if not name or len(sides) != 2:
            raise bd.SettingError(f"--contact: expected NAME=SET,SET, found {text!r}")
        body_a, _, set_a = sides[0].rpartition("/")
        if not body_a:
            body_a = "damper" if given.damper else "blade"
        body_b, _, set_b = sides[1].rpartition("/")
        on_ground = set_b == "ground"
        return importers.ContactFaces(
            name,
            faces_a=set_a,
            # the ground has no mesh
            faces_b=None if on_ground else set_b,
            body_a=body_a,
            body_b="ground" if on_ground else body_b or "blade",
            points=points_of.get(name, points),
            gap=gaps.get(name, 0.0),
        )

    def stop(text: str) -> importers.ContactFaces:
        """Read NAME=SET,GAP, the set as SET or BODY/SET."""
        try:
            name, side, gap = re.split("[=,]", text)
            distance = float(gap)
        except ValueError:
            raise bd.SettingError(f"--stop: expected NAME=SET,GAP, found {text!r}") from None
        body_a, _, set_a = side.rpartition("/")
        return importers.ContactFaces(
            name,
            faces_a=set_a,
            faces_b=None,
            body_a=body_a or "damper",
            body_b="ground",
            points=(2, 2),
            kind="constraint",
            gap=distance,
        )

    blade = body(given.blade)
    dampers = {}
    for text in given.damper:
        name, _, deck = text.rpartition("=")
        dampers[name or "damper"] = body(deck)
    contacts = [contact(text) for text in given.contact]
    names = [face.name for face in contacts]
    for flag, items in (("--gap", gaps), ("--points", points_of)):
        unknown = [name for name in items if name not in names]
        if unknown:
            listed = ", ".join(names)
            raise bd.SettingError(f"{flag}: expected contacts out of {listed}, found {unknown[0]}")
    stops = [stop(text) for text in given.stop]
    locations = None
    if given.tip:
        # one number is a node, three are a position
        locations = {"tip": int(given.tip[0]) if len(given.tip) == 1 else given.tip}

    built = importers.build_model(
        blade,
        dampers or None,
        contacts=contacts + stops,
        sector=importers.Sector(
            n_blades=given.sectors,
            faces=given.faces,
            fixed=given.fixed,
            blade_nodes=given.blade_nodes,
            stress=given.stress,
        ),
        placement=importers.Placement(units=given.units, axis=given.axis, radial=given.radial),
        reduction=importers.Reduction(
            engine_order=given.engine_order, harmonics=given.harmonics, n_modes=given.modes
        ),
        locations=locations,
        progress=False if given.quiet else None,
    )
    print(built.summary())
    stem = given.out or Path(given.blade.partition(":")[0]).stem
    built.save(f"{stem}.h5")
    with file_errors(f"{stem}.txt"):
        Path(f"{stem}.txt").write_text(f"{built.summary()}\n", encoding="utf-8")
    save_figure(built.plot(), f"{stem}.png")
    print(f"wrote {stem}.h5, {stem}.txt, {stem}.png", file=sys.stderr)


def frequency_response(study: bd.Study, given: argparse.Namespace) -> tuple[Any, bool]:
    """Return the response curve, and whether it spans the frequency interval."""
    asked_band = tuple(given.band) if given.band else None
    band = peak_interval(study.problem.at(given.preload), asked_band, given.mode)
    curve = study.frequency_response(given.preload, band, progress=not given.quiet)
    return curve, curve.complete


def optimum(study: bd.Study, given: argparse.Namespace) -> tuple[Any, bool]:
    """Return the optimal curve, and whether it has an optimum."""
    curve = study.optimal_curve(
        given.preloads,
        given.n,
        mode=given.mode,
        check="time" if given.check else False,
        progress=not given.quiet,
    )
    answered = bool(np.isfinite(curve.optimum.amplitude)) and not curve.interrupted
    return curve, answered


def resonance_crossings(study: bd.Study, given: argparse.Namespace) -> tuple[Any, bool]:
    """Return the crossings with engine orders, and whether there are any."""
    orders = given.orders or [study.settings.engine_order]
    crossings = study.resonance_crossings(
        rpm=given.speeds, engine_orders=orders, mode=given.mode, progress=not given.quiet
    )
    # without the quantity all computations failed
    if "speed" not in crossings.quantities:
        return crossings, False
    return crossings, bool(np.isfinite(crossings.array("speed")).any())


def margin(study: bd.Study, given: argparse.Namespace) -> tuple[Any, bool]:
    """Return the fatigue margins at the highest peak at a preload, and whether there is a peak."""
    peak = study.peak(given.preload, given.band, mode=given.mode)
    if not peak.ok:
        return peak, False
    response = None
    if given.check:
        # the harmonic balance alone also gives a margin
        try:
            response = study.time_response(peak, progress=not given.quiet)
        except bd.BdamperError as error:
            print(f"bdamper: no amplitude by time integration: {error}", file=sys.stderr)
    print(response or peak)
    if response is not None and not known_in_time(response):
        response = None
    # MPa to Pa; "yield" is a keyword of Python
    material = Material(1e6 * given.endurance, 1e6 * given.ultimate, 1e6 * vars(given)["yield"])
    return study.margin(peak, material, time_response=response), True


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
    """Return the name of an output file.

    It is rejected before the computation if the file cannot be written.
    """
    path = Path(name)
    if path.suffix.lower() not in endings or not path.absolute().parent.is_dir():
        raise argparse.ArgumentTypeError(
            f"expected {' or '.join(endings)} in an existing folder, found {name!r}"
        )
    return name


DEFAULT_POINTS = 24
"""Largest number of contact points of a pair of faces."""


def of_face(kind: str, read: Callable[[str], Any]) -> Callable[[str], tuple[str, Any]]:
    """Return the function that reads NAME=VALUE of one face; ``kind`` describes the value."""

    def item(text: str) -> tuple[str, Any]:
        name, _, value = text.partition("=")
        try:
            if name:
                return name, read(value)
        except ValueError:
            pass
        raise argparse.ArgumentTypeError(f"expected NAME={kind}, found {text!r}")

    return item


def gap_of(text: str) -> float | str:
    """Read a distance, or "measured"."""
    return text if text == "measured" else float(text)


def counts_of(text: str) -> int | tuple[int, ...]:
    """Read a number of contact points, or two along t1 and t2."""
    counts = tuple(int(number) for number in text.split(","))
    return counts[0] if len(counts) == 1 else counts


def points_of_face_or_all(text: str) -> int | tuple[str, Any]:
    """Read a number of contact points for all faces, or NAME=N or NAME=N,N for one."""
    return of_face("N or NAME=N,N", counts_of)(text) if "=" in text else int(text)


TWO_NUMBERS: dict[str, Any] = {"nargs": 2, "type": float, "metavar": ("LOW", "HIGH")}
SOME: dict[str, Any] = {"nargs": "+", "metavar": "N"}


def parser() -> argparse.ArgumentParser:
    """Return the parser of all commands, with units and defaults in the help."""
    model = _model_options()
    picture = Parser(add_help=False)
    _add_file(picture, "--png", (".png", ".pdf", ".svg"), "write the figure")
    asked = _study_options()
    out = _result_options()

    main = Parser("bdamper", description="Forced response of bladed disks with friction dampers.")
    main.add_argument("--version", action="version", version=bd.__version__)
    commands = main.add_subparsers(dest="command", required=True)
    commands.add_parser("info", parents=[model, picture], help="content of a model file")
    commands.add_parser(
        "explore", parents=[model, asked], help="interactive page in a browser on this computer"
    )
    questions = {}
    for name, (_, text) in QUESTIONS.items():
        questions[name] = commands.add_parser(name, parents=[model, asked, picture, out], help=text)
    _add_question_options(questions)
    decks = commands.add_parser("decks", help="write the files of an import example to this folder")
    decks.add_argument("name", help="abaqus, ansys, calculix, ring, shroud or turbine")
    _add_import_options(
        commands.add_parser(
            "import", help="model, report and picture from decks and their matrices"
        )
    )
    return main


def _add_file(
    command: argparse.ArgumentParser, name: str, endings: Sequence[str], text: str
) -> None:
    command.add_argument(name, metavar="FILE", type=partial(file_to_write, endings), help=text)


def _model_options() -> Parser:
    model = Parser(add_help=False)
    file_or_demo = model.add_mutually_exclusive_group(required=True)
    file_or_demo.add_argument("model", nargs="?", help="model file (HDF5)")
    file_or_demo.add_argument(
        "--demo", action="store_true", help="reference model of a turbine blade"
    )
    return model


def _result_options() -> Parser:
    out = Parser(add_help=False)
    _add_file(out, "--csv", (".csv",), "write the table")
    _add_file(out, "--h5", (".h5", ".hdf5"), "write the whole result, for bdamper.load")
    out.add_argument("--details", action="store_true", help="print all values of the result")
    out.add_argument("--quiet", action="store_true", help="do not show progress")
    out.add_argument("--mode", type=int, default=1, help="mode number, default %(default)s")
    return out


def _study_options() -> Parser:
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
        "--friction-coefficient",
        type=float,
        default=0.3,
        metavar="MU",
        help="friction coefficient, default %(default)s",
    )
    add(
        "--amplitude",
        type=float,
        default=1.0,
        metavar="N",
        help="amplitude of the excitation in N, default %(default)s",
    )
    add(
        "--location", default="tip", help="location of excitation and response, default %(default)s"
    )
    add(
        "--direction",
        default="tangential",
        help="direction of the excitation: tangential, radial or axial, default %(default)s",
    )
    add(
        "--load",
        nargs="+",
        default=(),
        type=of_face("N", float),
        metavar="NAME=N",
        help="constant normal loads of faces in N, for example of a shroud, default 0",
    )
    return asked


def _add_question_options(questions: Mapping[str, argparse.ArgumentParser]) -> None:
    """Add the options that only some of the questions have."""
    for name in ("response", "margin"):
        questions[name].add_argument(
            "--preload", type=float, default=100.0, metavar="N", help="in N, default %(default)s"
        )
        questions[name].add_argument(
            "--band",
            help="frequency interval in Hz, by default around the resonances of the mode",
            **TWO_NUMBERS,
        )
    for name in ("margin", "optimum"):
        text = (
            "check by time integration, and an optimum also in other ways, at several times the "
            "cost; on by default"
        )
        questions[name].add_argument(
            "--check", action=argparse.BooleanOptionalAction, default=True, help=text
        )
    for name in ("response", "margin", "optimum"):
        speed = "rotor speed of modes and stresses in rpm, by default at rest"
        questions[name].add_argument("--speed", type=float, metavar="RPM", help=speed)
    add = questions["optimum"].add_argument
    add(
        "--preloads",
        default=(20.0, 2000.0),
        help="range of preloads in N, default 20 2000",
        **TWO_NUMBERS,
    )
    add("-n", type=int, default=20, help="number of preloads, default %(default)s")
    _add_file(questions["optimum"], "--html", (".html",), "write a report for a review")
    questions["crossings"].add_argument(
        "--speeds", default=(5000.0, 10000.0), help="in rpm, default 5000 10000", **TWO_NUMBERS
    )
    questions["crossings"].add_argument(
        "--orders", type=int, help="engine orders, default --engine-order", **SOME
    )
    for name, text in (
        ("endurance", "endurance limit"),
        ("ultimate", "ultimate strength"),
        ("yield", "yield strength"),
    ):
        questions["margin"].add_argument(
            f"--{name}", type=float, required=True, metavar="MPA", help=f"{text} in MPa"
        )


def _add_import_options(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    add(
        "blade",
        metavar="DECK",
        help=(
            "deck of the sector (.inp or .cdb), in the same folder as its matrices; "
            "DECK:INSTANCE for a single instance"
        ),
    )
    add("--damper", nargs="+", default=(), metavar="[NAME=]DECK", help="decks of free bodies")
    contact = (
        "pairs of contact faces: a set of the damper and a set of the blade; BODY/SET for a set "
        "of another body, or ground"
    )
    add("--contact", nargs="+", required=True, metavar="NAME=SET,SET", help=contact)
    stop = (
        "damper faces with a frictionless stop on the ground, and their distance from it in the "
        "unit of the decks"
    )
    add("--stop", nargs="+", default=(), metavar="NAME=SET,GAP", help=stop)
    add(
        "--gap",
        nargs="+",
        default=(),
        type=of_face("DISTANCE or NAME=measured", gap_of),
        metavar="NAME=DISTANCE",
        help=(
            "distances of pairs of faces in the unit of the decks, or measured for that of the "
            "meshes, default 0"
        ),
    )
    add(
        "--points",
        nargs="+",
        default=(),
        type=points_of_face_or_all,
        metavar="[NAME=]N",
        help=(
            "maximum number of contact points of a pair, or the numbers along t1 and t2, default "
            f"{DEFAULT_POINTS}; NAME=N or NAME=N,N for a single pair"
        ),
    )
    add(
        "--units",
        default="m-kg-s",
        help="units of the decks: m-kg-s, mm-t-s, mm-kg-s or in-lbf-s, default %(default)s",
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
    add("--fixed", metavar="SET", help="fixed nodes")
    add("--blade-nodes", metavar="SET", help="nodes of the blade, for mistuned bladed disks")
    add("--stress", metavar="SET", help="nodes at which stresses are computed")
    add("--engine-order", default=(5,), type=int, help="engine orders, default 5", **SOME)
    add(
        "--harmonics",
        type=int,
        metavar="H",
        help="number of harmonics of the engine orders, by default enough for all studies",
    )
    add(
        "--modes",
        type=int,
        default=40,
        help="number of sector modes at each nodal diameter, default %(default)s",
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


def explore(study: bd.Study, given: argparse.Namespace) -> int:
    """Serve the explorer until Ctrl-C."""
    model = f"bd.load_model({given.model!r})"
    if given.demo:
        model = 'bd.reference_model("turbine_blade")'
    numbers = (
        f"{study.settings.engine_order}, {given.friction_coefficient}, harmonics={given.harmonics}"
    )
    if given.load:
        numbers += f", constant_loads={dict(given.load)}"
    driven = f"bd.Excitation({given.location!r}, {given.direction!r}, {given.amplitude})"
    source = f"import bdamper as bd\nstudy = bd.Study({model}, {driven}, {numbers})"
    page = bd.explore(study, source=source)
    print(page.address, flush=True)
    webbrowser.open(page.address)
    with suppress(KeyboardInterrupt):
        page.wait()
    page.close()
    return 0


def study_of(given: argparse.Namespace, model: bd.Model) -> bd.Study:
    """Return the study that the options describe."""
    options = vars(given)  # each command has only some of them
    orders = options.get("orders") or [given.engine_order]
    study = bd.Study(
        model,
        bd.Excitation(given.location, given.direction, given.amplitude),
        orders[0] if model.n_blades > 1 else 0,
        friction_coefficient=given.friction_coefficient,
        harmonics=given.harmonics,
        constant_loads=dict(given.load) or None,
    )
    rpm = options.get("speed")
    if rpm:
        study = study.at_speed(rpm * np.pi / 30.0)
    return study


def answer(given: argparse.Namespace) -> int:
    """Compute, print and write the result; return 1 if there is no result."""
    if given.command == "decks":
        print(*bd.importers.example_decks(given.name), sep="\n")
        return 0
    if given.command == "import":
        import_decks(given)
        return 0
    model = bd.reference_model("turbine_blade") if given.demo else bd.load_model(given.model)
    if given.command == "info":
        print(SUMMARY_CALL.sub(OPTION_FOR_ALL_VALUES, str(model)))
        _write_picture(model, given.png)
        return 0

    study = study_of(given, model)
    if given.command == "explore":
        return explore(study, given)
    compute, _ = QUESTIONS[given.command]
    result, answered = compute(study, given)
    if given.details:
        print(result.summary())
    else:
        print(SUMMARY_CALL.sub(OPTION_FOR_ALL_VALUES, str(result)))
    # files are written last, because the disk can be full
    if given.csv:
        result.to_csv(given.csv)
    if given.h5:
        result.save(given.h5)
    report = vars(given).get("html")
    if answered and report:
        result.report(report, study, model_file=given.model or "")
        print(f"wrote {report}", file=sys.stderr)
    _write_picture(result, given.png)
    return 0 if answered else 1


def _write_picture(result: Any, path: str | None) -> None:
    """Write the figure of a result, if a path is given."""
    if not path:
        return
    from bdamper.plot import save_figure

    save_figure(result.plot(), path)
    print(f"wrote {path}", file=sys.stderr)


FLAGS = {
    "frequency": "--band",
    "preload": "--preloads or --preload",
    "speeds": "--speeds",
    "rotor speed": "--speed",
    "engine_orders": "--orders",
    "engine_order": "--engine-order",
    "friction_coefficient": "--friction-coefficient",
    "harmonics": "--harmonics",
    "mode": "--mode",
    "n": "-n",
    "constant_loads": "--load",
    "excitation location": "--location",
    "excitation direction": "--direction",
    "excitation amplitude": "--amplitude",
    "n_blades": "--sectors",
    "n_modes": "--modes",
    "points": "--points",
    "gap": "--gap",
    "units (or Units(...))": "--units",
    "axis and radial": "--axis and --radial",
}
"""Flags of the items with which messages begin."""
BEGINNING = re.compile(
    r"^(?:contact '(?P<contact>[^']+)': )?"
    rf"(?P<item>{'|'.join(map(re.escape, sorted(FLAGS, key=len, reverse=True)))})"
    r"(?: of '(?P<part>[^']+)')?(?=: )"
)


def with_flag(message: str, command: str) -> str:
    """Return a message that names the flag of the command instead of the argument in Python."""
    found = BEGINNING.match(message)
    if not found:
        return message
    flag = FLAGS[found["item"]]
    if found["item"] == "preload":
        flag = "--preloads" if command == "optimum" else "--preload"
    face = found["contact"] or found["part"]
    return f"{flag} {face}{message[found.end() :]}" if face else flag + message[found.end() :]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return the exit code."""
    given = parser().parse_args(arguments)

    def say(message: object) -> None:
        print(f"bdamper: {with_flag(str(message), given.command)}", file=sys.stderr)

    def print_warning(message: Warning | str, *_: Any, **__: Any) -> None:
        """Print a warning in one line, as ``warnings.showwarning``."""
        say(message)

    try:
        with warnings.catch_warnings():
            warnings.showwarning = print_warning
            return answer(given)
    except bd.SettingError as error:
        say(error)
        return 2
    except (bd.BdamperError, OSError, KeyboardInterrupt) as error:
        say(str(error) or "interrupted")
        return 1


if __name__ == "__main__":
    sys.exit(main())
