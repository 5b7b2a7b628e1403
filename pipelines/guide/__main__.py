"""Build the guide's site, its pictures and the replies of its tutorial: ``python -m pipelines.guide SITE``.

Pictures and replies are made anew from what the program does. A picture of a page is its first screen, as a Chromium on
this computer shows it.
"""

import io
import itertools
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import click
import cv2
import numpy as np
from PIL import Image

from labpipe import files
from labpipe.errors import InputError, LabpipeError, SourceError, UsageError
from labpipe.imaging import contact_radius
from labpipe.workflow.plan import page_name
from pipelines.bench.contact_radius import surface_gap
from pipelines.guide import reference
from pipelines.guide.pages import FIRST, GUIDES, PARTS, PICTURES, linked, texts
from pipelines.session import reopen_session

_INDEX = (
    "# labpipe\n\nFrom a folder of raw contact-mechanics and polymer test files to calibrated quantities with "
    "uncertainties, the matching simulation, and a page that says whether the record can be believed and whether the "
    "model agrees.\n\n![The first page of a session](pictures/session.webp)\n\nAll data that these pages show are "
    "synthetic: a virtual rig made them.\n\n"
)
_README = Path(files.__file__).parents[1] / ".github"
_SHOWN = 6
"""First and last lines of a command's reply."""
#: Places of a report in the gallery, in the order of the numbered marks that its text explains.
_MARKED = (
    "#verdict > .notice:first-of-type",
    "#verdict > figure:first-of-type",
    "#summary > h2",
    "#what-the-verdict-rests-on > h2",
)
_MARKS = "".join(
    f"{place}{{position:relative}}{place}::after{{content:'{number}';position:absolute;left:-2.4em;top:0;width:1.7em;"
    "height:1.7em;border-radius:50%;background:#8a1c7c;color:#fff;font:700 17px/1.7 sans-serif;text-align:center}"
    for number, place in enumerate(_MARKED, 1)
)


def build(site: Path) -> Path:
    """Write the guide as a site, and return its first page; anything that Sphinx warns of is an error.

    Raises
    ------
    UsageError
        The extra ``guide`` is not installed.
    InputError
        Sphinx has warned; its words are in the message.
    """
    try:
        from sphinx.application import Sphinx
    except ImportError as error:
        raise UsageError("the guide is built by Sphinx; install it with: pip install 'labpipe[guide]'") from error
    with tempfile.TemporaryDirectory(prefix="labpipe-guide-") as folder:
        source = Path(folder) / "source"
        shutil.copytree(PICTURES, source / "pictures")
        written = texts()
        made = {f"{name}.md": linked(text, ".md", frozenset(written)) for name, text in written.items()}
        trees = (
            f"```{{toctree}}\n:caption: {part}\n\n" + "\n".join(names) + "\n```\n" for part, names in PARTS.items()
        )
        for name, text in (made | reference.python() | {"index.md": _INDEX + "\n".join(trees)}).items():
            files.write_text(source / name, text)
        warnings = io.StringIO()
        places = (str(source), str(Path(__file__).parent), str(site), str(Path(folder) / "doctrees"))
        app = Sphinx(*places, "html", status=None, warning=warnings)
        app.build()
        if (said := warnings.getvalue().strip()) or app.statuscode:
            raise InputError(f"Sphinx warns:\n{said}")
    return site / "index.html"


def same_words(now: str, kept: str) -> None:
    """Refuse a kept tutorial whose words are no longer those that the commands print; numbers may move.

    Raises
    ------
    SourceError
        A line differs; its number is named.
    """
    lines = itertools.zip_longest(now.splitlines(), kept.splitlines(), fillvalue="")
    for number, (new, old) in enumerate(lines, 1):
        if re.findall(r"[^\W\d_]+", new) != re.findall(r"[^\W\d_]+", old):
            text, hint = (
                f'the tutorial now says "{new.strip()}", not "{old.strip()}"',
                "python -m pipelines.guide SITE --keep",
            )
            raise SourceError(GUIDES / f"{FIRST}.md", text, line=number, hint=f"renew it: {hint}")


def replay(text: str, folder: Path) -> str:
    """Run the commands of a tutorial in a folder, and return it with their replies.

    A block ``sh`` is run as it is; of a block ``text`` that begins with ``$ `` the first line is run, and its reply
    takes the place of the others.

    Raises
    ------
    InputError
        A command has failed; its reply is in the message.
    """
    begin = f'labpipe() {{ "{sys.executable}" -m labpipe "$@"; }}\n'
    surroundings = os.environ | {"COLUMNS": "100"}

    def ran(command: str) -> list[str]:
        line = ["bash", "-e", "-c", begin + command]
        done = subprocess.run(line, cwd=folder, env=surroundings, capture_output=True, text=True, check=False)
        if done.returncode:
            raise InputError(
                f"the tutorial's command ended with {done.returncode}: {command}\n{done.stdout}{done.stderr}"
            )
        return (done.stdout + done.stderr).replace(f"{folder}/", "").splitlines()

    def block(found: re.Match[str]) -> str:
        kind, body = found.groups()
        command = body.partition("\n")[0].removeprefix("$ ")
        if kind == "sh":
            ran(body)
        if kind != "text" or not body.startswith("$ "):
            return found[0]
        said = ran(command)
        if len(said) > 2 * _SHOWN:
            said = [*said[:_SHOWN], f"... ({len(said) - 2 * _SHOWN} lines)", *said[-_SHOWN:]]
        return "```text\n$ " + "\n".join([command, *said]) + "\n```"

    return re.sub(r"^```(\w+)\n(.*?)\n```$", block, text, flags=re.MULTILINE | re.DOTALL)


def of_tutorial(folder: Path, target: Path) -> None:
    """Write the pictures of a session that :func:`replay` has made."""
    made = folder / "my-session/labpipe"
    for name, page in (("session", "index.html"), ("compare", "compare.html")):
        of_page(made / page, target / f"{name}.webp")
    of_page(made / page_name("acrylic_7mm"), target / "report.webp")
    of_page(folder / "impossible.html", target / "impossible.webp")
    of_browser(folder / "my-session", target / "browser.webp")
    if _README.is_dir():
        of_page(made / page_name("acrylic_1p5mm"), _README / "report.png", height=1500)
    with Image.open(folder / "figures/3.10.png") as figure:
        _write(figure, target / "figure.webp")


def of_reports(session: Path, target: Path) -> None:
    """Write the pictures of the gallery: of each kind the first report of a processed session, with marks."""
    drawn: set[str] = set()
    opened = reopen_session(session)
    for name, experiment in opened.experiments.items():
        page = opened.folder / page_name(name)
        if page.is_file() and experiment.kind not in drawn:
            drawn.add(experiment.kind)
            of_page(page, target / f"gallery-{experiment.kind}.webp", _MARKS, 1500)


def of_page(page: Path, target: Path, style: str = "", height: int = 900) -> None:
    """Draw the first screen [px] of a page, with further rules of CSS."""
    with tempfile.TemporaryDirectory(prefix="labpipe-page-") as name:
        shown = Path(name) / page.name
        files.write_text(shown, page.read_text("utf-8").replace("</head>", f"<style>{style}</style></head>", 1))
        _screen(shown.as_uri(), target, height)


def of_browser(session: Path, target: Path) -> None:
    """Draw the page of a folder, as ``labpipe open`` shows it."""
    line = [sys.executable, "-m", "labpipe", "open", str(session), "--no-browser", "--json"]
    with subprocess.Popen(line, stdout=subprocess.PIPE, env=os.environ | {"PYTHONUNBUFFERED": "1"}) as served:
        printed: Any = served.stdout
        said = b"".join(iter(printed.readline, b"}\n")) + b"}"
        _screen(json.loads(said)["address"], target, 900)
        served.terminate()


def _screen(address: str, target: Path, height: int) -> None:
    """Draw the first screen of an address.

    Raises
    ------
    UsageError
        There is no Chromium.
    """
    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
    if browser is None:
        raise UsageError("the guide's pictures are drawn by Chromium, which is not installed")
    with tempfile.TemporaryDirectory(prefix="labpipe-browser-") as folder:
        screen = Path(folder) / "screen.png"
        switches = ("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--hide-scrollbars")
        where = (f"--user-data-dir={folder}/profile", f"--screenshot={screen}", f"--window-size=1400,{height}")
        line = (browser, *switches, "--disable-dev-shm-usage", "--virtual-time-budget=10000", *where, address)
        subprocess.run(line, check=True, capture_output=True, timeout=120)
        with Image.open(screen) as image:
            _write(image, target)


def _write(image: Image.Image, target: Path) -> None:
    """Write a picture as PNG or WebP, at most 1050 px wide: letters of 16 px are then 12 px high."""
    width = min(image.width, 1050)
    small = image.convert("RGB").resize((width, round(image.height * width / image.width)), Image.Resampling.LANCZOS)
    small = small.quantize(128) if target.suffix == ".png" else small
    held = io.BytesIO()
    small.save(held, target.suffix[1:], quality=80, method=6)
    files.write_bytes(target, held.getvalue())


def of_films(target: Path) -> None:
    """Draw contacts that are measured and frames that are refused, for the guide to films."""
    pixel, sphere, wavelength = 4.34e-6, 9.525e-3, 633e-9
    y, x = np.mgrid[:200, :280]
    distance = pixel * np.hypot(x - 140.3, y - 99.6)
    rng = np.random.default_rng(1)
    contacts = [(radius, 0.0) for radius in (180e-6, 220e-6, 250e-6)]
    hovering = [(0.0, 0.16e-6), (0.0, 1.3e-6)]
    for name, cases in (("contact-measured", contacts), ("contact-refused", hovering)):
        gaps = [surface_gap(distance.ravel(), radius, sphere).reshape(x.shape) + gap for radius, gap in cases]
        scenes = [120.0 * (1.0 - 0.8 * np.cos(4.0 * np.pi * gap / wavelength)) for gap in gaps]
        if name == "contact-refused":
            scenes.append(120.0 - 90.0 * (distance < 200e-6))  # a dark disc without fringes
        panels = []
        for light in scenes:
            frame = np.clip(np.rint(light + 2.0 * rng.standard_normal(light.shape)), 0, 255).astype(np.uint8)
            found = contact_radius(frame[None], pixel, sphere, wavelength)
            panel = cv2.cvtColor(cv2.resize(frame, None, fx=2, fy=2), cv2.COLOR_GRAY2RGB)
            text, colour = "no contact", (230, 60, 60)
            if bool(found.in_contact[0]):
                radius, u = float(found.radius[0]), float(found.u_radius[0])
                text, colour = f"{1e6 * radius:.3f} um, u {1e9 * u:.0f} nm", (60, 200, 60)
                centre = [round(2 * float(found[axis][0])) for axis in ("centre_x", "centre_y")]
                cv2.circle(panel, centre, round(2 * radius / pixel), colour, 2, cv2.LINE_AA)
            cv2.putText(panel, text, (12, 28), cv2.FONT_HERSHEY_SIMPLEX, 0.8, colour, 2, cv2.LINE_AA)
            panels.append(panel)
        _write(Image.fromarray(np.hstack(panels)), target / f"{name}.webp")


@click.command()
@click.argument("site", type=click.Path(file_okay=False, path_type=Path))
@click.option("--keep", is_flag=True, help="Renew the tutorial's replies and the pictures in the package.")
@click.option(
    "--gallery",
    multiple=True,
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="Renew the gallery's pictures from a processed session; may be repeated.",
)
def main(site: Path, keep: bool, gallery: tuple[Path, ...]) -> None:
    """Write the guide into the folder SITE, after running its tutorial in a temporary folder.

    A tutorial whose replies have other words than the text is an error, or is renewed with --keep, which draws the
    pictures with a Chromium.
    """
    try:
        with tempfile.TemporaryDirectory(prefix="labpipe-tutorial-") as folder:
            path = GUIDES / f"{FIRST}.md"
            kept = path.read_text("utf-8")
            now = replay(kept, Path(folder))
            if keep:
                of_tutorial(Path(folder), PICTURES)
                of_films(PICTURES)
                files.write_text(path, now)
            else:
                same_words(now, kept)
        for session in gallery:
            of_reports(session, PICTURES)
        click.echo(build(site))
    except LabpipeError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(error.exit_code)


if __name__ == "__main__":
    main()
