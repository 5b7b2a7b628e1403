"""Pictures of pages, by a Chromium on this computer."""

import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

_NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
_SWITCHES = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
)
_PATIENCE = 120  # seconds for a page


@cache
def browser() -> str | None:
    """Return the browser's path; None where there is none."""
    return next(filter(None, map(shutil.which, _NAMES)), None)


def picture(page: Path, target: Path, *, width: int = 1400, height: int = 900) -> bool:
    """Draw the first screen of a page.

    Returns
    -------
    bool
        Whether there is a browser to draw it.
    """
    if (path := browser()) is None:
        return False
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="labpipe-browser-") as profile:
        where = (f"--user-data-dir={profile}", f"--screenshot={target}", f"--window-size={width},{height}")
        line = (path, *_SWITCHES, *where, page.resolve().as_uri())
        subprocess.run(line, check=True, capture_output=True, timeout=_PATIENCE)
    return True


def shown(source: Path, page: Path, name: str, text: str) -> str:
    """Return Markdown that shows a page's first screen, or says that it could not be drawn."""
    if picture(page, source / "pictures" / f"{name}.png"):
        return f"![{text}](pictures/{name}.png)\n\n"
    return f"*({text}; no browser was there to draw it.)*\n\n"
