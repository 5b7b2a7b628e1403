"""Pictures of pages, by a Chromium on this computer."""

import io
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

from PIL import Image

from labpipe import files

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
_WIDTH, _HEIGHT = 1400, 900  # px
_COLUMN = 1050
"""Width [px] of what is kept: letters of 16 px are 12 px high, still read without a magnifier."""
_QUALITY = 80


@cache
def browser() -> str | None:
    """Return the browser's path; None where there is none."""
    return next(filter(None, map(shutil.which, _NAMES)), None)


def picture(page: Path, target: Path, *, style: str = "", height: int = _HEIGHT) -> bool:
    """Draw the first screen of an HTML page as WebP, small enough to travel with the package.

    The page gets further rules of CSS, such as marks; ``height`` is the screen's [px]. It tells whether there is a
    browser to draw it.
    """
    if (path := browser()) is None:
        return False
    with tempfile.TemporaryDirectory(prefix="labpipe-browser-") as folder:
        shown, drawn = Path(folder) / page.name, Path(folder) / "screen.png"
        text = page.read_text("utf-8")
        files.write_text(shown, text.replace("</head>", f"<style>{style}</style></head>", 1))
        where = (f"--user-data-dir={folder}/profile", f"--screenshot={drawn}", f"--window-size={_WIDTH},{height}")
        line = (path, *_SWITCHES, *where, shown.resolve().as_uri())
        subprocess.run(line, check=True, capture_output=True, timeout=_PATIENCE)
        shrink(drawn, target)
    return True


def shrink(drawn: Path, target: Path) -> None:
    """Write a picture as wide as a column of text needs it, as WebP."""
    with Image.open(drawn) as image:
        size = (_COLUMN, round(image.height * _COLUMN / image.width))
        small = image.convert("RGB").resize(size, Image.Resampling.LANCZOS) if image.width > _COLUMN else image
        held = io.BytesIO()
        small.convert("RGB").save(held, "WEBP", quality=_QUALITY, method=6)
    target.parent.mkdir(parents=True, exist_ok=True)
    files.write_bytes(target, held.getvalue())


def shown(source: Path, name: str, text: str, page: Path | None, *, style: str = "", height: int = _HEIGHT) -> str:
    """Return Markdown that shows a page's first screen.

    Without the page, or without a browser that draws it, the picture that the package holds is shown.
    """
    target = source / "pictures" / f"{name}.webp"
    if page is not None:
        picture(page, target, style=style, height=height)
    return f"![{text}](pictures/{name}.webp)\n\n" if target.is_file() else ""
