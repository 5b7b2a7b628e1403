"""Build the guide's site: ``python -m pipelines.guide SITE``."""

import io
import itertools
import re
import shutil
import sys
import tempfile
from pathlib import Path

import click

from labpipe import files
from labpipe.errors import InputError, LabpipeError, SourceError, UsageError
from pipelines.guide import pictures, reference
from pipelines.guide.pages import FIRST, GUIDES, PARTS, PICTURES, linked, texts

_INDEX = (
    "# labpipe\n\nFrom a folder of raw contact-mechanics and polymer test files to calibrated quantities with "
    "uncertainties, the matching simulation, and a page that says whether the record can be believed and whether the "
    "model agrees.\n\n![The first page of a session](pictures/session.webp)\n\nAll data that these pages show are "
    "synthetic: a virtual rig made them.\n\n"
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

    A tutorial whose replies have other words than the text is an error, or is renewed with --keep, which needs a
    Chromium for the pictures.
    """
    try:
        with tempfile.TemporaryDirectory(prefix="labpipe-tutorial-") as folder:
            path = GUIDES / f"{FIRST}.md"
            kept = path.read_text("utf-8")
            now = pictures.replay(kept, Path(folder))
            if keep:
                pictures.of_tutorial(Path(folder), PICTURES)
                pictures.of_films(PICTURES)
                files.write_text(path, now)
            else:
                same_words(now, kept)
        for session in gallery:
            pictures.of_reports(session, PICTURES)
        click.echo(build(site))
    except LabpipeError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(error.exit_code)


if __name__ == "__main__":
    main()
