"""How deep a warm `study.track` goes, and `study.optimal_curve`: rooms entered, and Python frames above the core.

The study has tracked the same curve before, so that bases, stiffness and static state are there.  A profiler
(`sys.setprofile`) then looks at the stack at every call of a method of the core: frames of the package are counted from
`Study.track` on, what checks its keywords before aside, and a room is the folder of the package in which a function stands
(`study.py` counts as one).  A room is entered going down where a frame of it follows one of another room; each should be
entered once.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any

import bdamper as bd

PACKAGE = os.path.dirname(bd.__file__) + os.sep


def room(frame: FrameType) -> str:
    """Folder of the package in which the function of a frame stands; empty outside of it."""
    name = frame.f_code.co_filename
    return name.removeprefix(PACKAGE).split(os.sep)[0].removesuffix(".py") if name.startswith(PACKAGE) else ""


def measure(ask: Callable[[bd.Study], Any], most_rooms: int, most_frames: int) -> None:
    """Print the rooms and the deepest stack of one question, with the most of both that it may have."""
    study = bd.Study(
        bd.reference_model("bladed_disk", 9), engine_order=5, harmonics=3, excitation=bd.Excitation("tip", "tangential")
    )
    ask(study)
    rooms: dict[str, None] = {}
    deepest: list[tuple[str, str]] = []
    entered_twice: set[tuple[str, ...]] = set()

    def watch(frame: FrameType, event: str, called: Any) -> None:
        nonlocal deepest
        if event == "call" and room(frame):
            rooms.setdefault(room(frame))
        if event != "c_call" or type(getattr(called, "__self__", None)).__module__ != "bdamper._core":
            return
        stack = []
        at: FrameType | None = frame
        while at is not None:
            if room(at):
                stack.append((room(at), at.f_code.co_qualname if hasattr(at.f_code, "co_qualname") else at.f_code.co_name))
            at = at.f_back
        stack.reverse()
        stack = stack[len(stack) > 1 and stack[1][0] == "study" :]
        order = [name for i, (name, _) in enumerate(stack) if i == 0 or stack[i - 1][0] != name]
        if len(set(order)) < len(order):
            entered_twice.add(tuple(order))
        if len(stack) > len(deepest):
            deepest = stack

    threading.setprofile(watch)
    sys.setprofile(watch)
    ask(study)
    sys.setprofile(None)
    threading.setprofile(None)
    print(f"{len(rooms)} rooms (at most {most_rooms}): {', '.join(rooms)}")
    print(f"{len(deepest)} frames above the core (at most {most_frames}):")
    for where, function in deepest:
        print(f"  {where}: {function}")
    for order in sorted(entered_twice):
        print(f"entered twice going down: {' > '.join(order)}")


def main() -> None:
    """Both questions."""
    measure(lambda study: study.frequency_response(200.0, (250.0, 400.0)), 7, 9)
    print()
    measure(lambda study: study.optimal_curve((100.0, 5e3), 4, check=False), 8, 11)


if __name__ == "__main__":
    main()
