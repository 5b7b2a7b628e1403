"""Build the guide's site, its pictures and the replies of its tutorial: ``python -m pipelines.guide SITE``.

With ``--keep`` the program makes pictures and replies anew. A picture of a page is its first screen, as a Chromium on
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
from pipelines.guide.pages import FIRST, GUIDES, PICTURES, SOURCE, linked, texts
from pipelines.rig import sample
from pipelines.session import process, reopen_session


def build(site: Path) -> Path:
    """Write the guide as a site, and return its first page; InputError where Sphinx is missing or warns."""
    with tempfile.TemporaryDirectory(prefix="labpipe-guide-") as folder:
        source, written = Path(folder) / "source", texts()
        shutil.copytree(SOURCE, source)
        shutil.copytree(PICTURES, source / "pictures")
        for name, text in written.items():
            files.write_text(source / f"{name}.md", linked(text, ".md", frozenset(written)))
        places = ("-d", f"{folder}/doctrees", str(source), str(site))
        done = subprocess.run([sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", *places], check=False)
        if done.returncode:
            raise InputError("the guide is built by Sphinx, of the extra labpipe[guide]; its words are above")
    return site / "index.html"


def replay(text: str, folder: Path) -> str:
    """Run the commands of a tutorial in a folder, and return it with their replies.

    A block ``sh`` is run as it is; of a block ``text`` that begins with ``$ `` the first line is run, and its reply
    takes the place of the others. A command that fails raises InputError with its reply.
    """

    def block(found: re.Match[str]) -> str:
        command = found["quiet"] or found["shown"]
        line = ["bash", "-e", "-c", f'labpipe() {{ "{sys.executable}" -m labpipe "$@"; }}\n{command}']
        surroundings = os.environ | {"COLUMNS": "100"}
        done = subprocess.run(line, cwd=folder, env=surroundings, capture_output=True, text=True, check=False)
        reply = done.stdout + done.stderr
        if done.returncode:
            raise InputError(f"the tutorial's command ended with {done.returncode}: {command}\n{reply}")
        said = reply.replace(f"{folder}/", "").splitlines()
        if len(said) > 12:
            said = [*said[:6], f"... ({len(said) - 12} lines)", *said[-6:]]
        return found[0] if found["quiet"] else "```text\n$ " + "\n".join([command, *said]) + "\n```"

    blocks = r"^```(?:sh\n(?P<quiet>.*?)|text\n\$ (?P<shown>[^\n]*)(?:\n.*?)?)\n```$"
    return re.sub(blocks, block, text, flags=re.MULTILINE | re.DOTALL)


def same_words(now: str, kept: str) -> None:
    """Raise SourceError at the first line of a kept tutorial that now differs in words or counts (``121 steps``)."""
    lines = itertools.zip_longest(now.splitlines(), kept.splitlines(), fillvalue="")
    parts = re.compile(r"[^\W\d_]+|(?<![\d.])\d+(?= [a-z]{3})")
    for number, (new, old) in enumerate(lines, 1):
        if parts.findall(new) != parts.findall(old):
            text = f'the tutorial, whose pictures are then stale too, now says "{new.strip()}", not "{old.strip()}"'
            hint = "renew it: python -m pipelines.guide SITE --keep"
            raise SourceError(GUIDES / f"{FIRST}.md", text, line=number, hint=hint)


def of_tutorial(folder: Path, target: Path) -> None:
    """Write the pictures of a session that :func:`replay` has made."""
    made = folder / "my-session/labpipe"
    of_page((made / "index.html").as_uri(), target / "session.webp")
    of_page((made / "compare.html").as_uri(), target / "compare.webp")
    of_page((made / page_name("acrylic_7mm")).as_uri(), target / "report.webp")
    of_page((folder / "impossible.html").as_uri(), target / "impossible.webp")
    served = serve(folder / "my-session")
    answering = threading.Thread(target=served.run)
    answering.start()
    of_page(served.address, target / "browser.webp")
    served.stop()
    answering.join()
    write_picture(folder / "figures/3.10.png", target / "figure.webp")


def of_reports(session: Path, target: Path) -> None:
    """Write the pictures of the gallery: of each kind the first report of a processed session, with marks."""
    opened, marks = reopen_session(session), (SOURCE / "marks.css").read_text("utf-8")
    first: dict[str, Path] = {}
    for name, experiment in opened.experiments.items():
        if (page := opened.folder / page_name(name)).is_file():
            first.setdefault(experiment.kind, page)
    for kind, page in first.items():
        with tempfile.TemporaryDirectory(prefix="labpipe-page-") as folder:
            marked = Path(folder) / page.name
            files.write_text(marked, page.read_text("utf-8").replace("</head>", f"<style>{marks}</style></head>", 1))
            of_page(marked.as_uri(), target / f"gallery-{kind}.webp", height=1500)


def of_page(address: str, target: Path, height: int = 900) -> None:
    """Draw the first screen of an address, ``height`` px high; without a Chromium raise UsageError."""
    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
    if browser is None:
        raise UsageError("the guide's pictures are drawn by Chromium, which is not installed")
    with tempfile.TemporaryDirectory(prefix="labpipe-browser-") as folder:
        screen = Path(folder) / "screen.png"
        switches = ("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--hide-scrollbars")
        where = (f"--user-data-dir={folder}/profile", f"--screenshot={screen}", f"--window-size=1400,{height}")
        line = (browser, *switches, "--disable-dev-shm-usage", "--virtual-time-budget=10000", *where, address)
        subprocess.run(line, check=True, capture_output=True, timeout=120)
        write_picture(screen, target)


def write_picture(source: Path, target: Path, width: int = 1050) -> None:
    """Write a picture as PNG or WebP, at most ``width`` px wide: of a page letters of 16 px are then 12 px high."""
    with Image.open(source) as image:
        small = image.convert("RGB")
    small.thumbnail((width, small.height), Image.Resampling.LANCZOS)
    held = io.BytesIO()
    (small.quantize(128) if target.suffix == ".png" else small).save(held, target.suffix[1:], quality=80, method=6)
    files.write_bytes(target, held.getvalue())


@click.command()
@click.argument("site", type=click.Path(file_okay=False, path_type=Path))
@click.option("--keep", is_flag=True, help="Renew replies and pictures in the package; a Chromium draws.")
def main(site: Path, keep: bool) -> None:
    """Write the guide into the folder SITE; the commands of its tutorial must reply as its text says."""
    try:
        with tempfile.TemporaryDirectory(prefix="labpipe-tutorial-") as folder:
            path, gallery = GUIDES / f"{FIRST}.md", Path(folder) / "gallery"
            kept = path.read_text("utf-8")
            now = replay(kept, Path(folder))
            if keep:
                of_tutorial(Path(folder), PICTURES)
                sample("thesis-small", gallery)
                process(gallery)
                of_reports(gallery, PICTURES)
                files.write_text(path, now)
            else:
                same_words(now, kept)
        click.echo(build(site))
    except LabpipeError as error:
        raise click.ClickException(str(error)) from error


if __name__ == "__main__":
    main()
