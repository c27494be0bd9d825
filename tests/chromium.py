"""Chromium without a window on the screen, for tests of the explorer and pictures of the manual."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

MISSING = "no browser: Debian's chromium and chromium-driver are not installed"


def is_installed() -> bool:
    """Return whether browser and driver are found."""
    return bool(shutil.which("chromium") and shutil.which("chromedriver"))


@contextmanager
def headless(*arguments: str) -> Iterator[Any]:
    """Provide a browser with further command line arguments; its log is kept."""
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium")
    always = "headless=new", "no-sandbox", "disable-gpu", "disable-dev-shm-usage"
    for argument in (*always, *arguments):
        options.add_argument(f"--{argument}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    service = webdriver.ChromeService(shutil.which("chromedriver"))
    with webdriver.Chrome(options=options, service=service) as found:
        yield found
