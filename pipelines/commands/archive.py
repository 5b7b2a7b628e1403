"""Commands on a data package: publish, verify, cite."""

from pathlib import Path
from typing import Any

import click

from pipelines.commands.options import FOLDER, NEW_FOLDER, emit, jobs_option, json_option, session_argument


@click.command()
@session_argument
@click.option("--out", required=True, type=NEW_FOLDER, help="Folder to be made, not in SESSION.")
@click.option("--anonymous", is_flag=True, help="Leave out operator, creators and paths of this machine.")
@click.option("--figures", type=FOLDER, help="Include this folder of `labpipe figures --data`.")
@jobs_option
@json_option
def publish(session: Path, out: Path, **options: Any) -> None:
    r"""Write SESSION as a data package for a journal or repository (RO-Crate).

    Raw files with SHA-256, session.toml, calibration records, results as netCDF (CF), pages, methods,
    references and versions. session.toml states `licence` in [session], and [[creators]] with
    name, orcid and affiliation. Missing results are processed first. Exit code 1: an experiment
    failed or waits, and is left out.

    \b
    Example:
      labpipe publish my-session --out my-package
      labpipe publish my-session --out for-review --anonymous
    """
    from pipelines.commands.progress import watching
    from pipelines.session import publish as verb

    with watching() as progress:
        done = verb(session, out, progress=progress, **options)
    document = {
        "folder": str(done.folder),
        "files": done.sizes,
        "left_out": list(done.left_out),
        "struck": list(done.struck),
    }
    emit(document, [repr(done), f"then: labpipe verify {out}"], code=1 if done.left_out else 0)


@click.command()
@click.argument("folder", type=FOLDER)
@click.option("--tolerance", default=1e-6, type=click.FloatRange(min=0), help="Of the largest value of a variable.")
@jobs_option
@json_option
def verify(folder: Path, **options: Any) -> None:
    r"""Check a package that `publish` made: its checksums, then its numbers.

    The raw files are processed again in a temporary folder, and every result is compared. Exit code 1:
    a number differs; 4: a file is missing or was changed.

    \b
    Example:
      labpipe verify my-package
      labpipe verify my-package --tolerance 1e-9 --json
    """
    from pipelines.commands.progress import watching
    from pipelines.session import verify as verb

    with watching() as progress:
        done = verb(folder, progress=progress, **options)
    rows = [{"name": r.name, "deviation": r.deviation, "differs": list(r.differs)} for r in done.results]
    document = {"folder": str(done.folder), "files": done.files, "tolerance": done.tolerance, "results": rows}
    emit(document, [repr(done)], code=1 if done.differing else 0)


@click.command()
@click.argument("session", required=False, type=FOLDER)
@json_option
def cite(session: Path | None) -> None:
    r"""Print the sources to be cited as BibTeX: labpipe, standards, and the methods used in SESSION.

    \b
    Example:
      labpipe cite
      labpipe cite my-session > references.bib
    """
    from pipelines.session import cite as verb

    text = verb(session)
    emit({"bibtex": text}, [text.rstrip()])
