"""Build the guide's site, its pictures and the replies of its tutorial: ``python -m pipelines.guide SITE``.

Pictures and replies are made anew from what the program does. A picture of a page is its first screen, as a Chromium on
this computer shows it.
"""

import io
import itertools
import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import click
from PIL import Image

from labpipe import files
from labpipe.errors import InputError, LabpipeError, SourceError, UsageError
from labpipe.workflow.plan import page_name
from pipelines.app import open as serve
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
    pages = {
        target / "session.webp": made / "index.html",
        target / "compare.webp": made / "compare.html",
        target / "report.webp": made / page_name("acrylic_7mm"),
        target / "impossible.webp": folder / "impossible.html",
    }
    for picture, page in pages.items():
        of_page(page.as_uri(), picture)
    if _README.is_dir():
        of_page((made / page_name("acrylic_1p5mm")).as_uri(), _README / "report.png", height=1500)
    served = serve(folder / "my-session")
    answering = threading.Thread(target=served.run)
    answering.start()
    of_page(served.address, target / "browser.webp")
    served.stop()
    answering.join()
    with Image.open(folder / "figures/3.10.png") as figure:
        _write(figure, target / "figure.webp")


def of_reports(session: Path, target: Path) -> None:
    """Write the pictures of the gallery: of each kind the first report of a processed session, with marks."""
    opened = reopen_session(session)
    first: dict[str, Path] = {}
    for name, experiment in opened.experiments.items():
        if (page := opened.folder / page_name(name)).is_file():
            first.setdefault(experiment.kind, page)
    for kind, page in first.items():
        with tempfile.TemporaryDirectory(prefix="labpipe-page-") as folder:
            marked = Path(folder) / page.name
            files.write_text(marked, page.read_text("utf-8").replace("</head>", f"<style>{_MARKS}</style></head>", 1))
            of_page(marked.as_uri(), target / f"gallery-{kind}.webp", height=1500)


def of_page(address: str, target: Path, height: int = 900) -> None:
    """Draw the first screen of an address, ``height`` px high.

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
