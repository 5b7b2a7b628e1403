"""Commands on files, results and data packages."""

import shutil
from pathlib import Path
from typing import Any

import click

from pipelines import session as verbs
from pipelines.commands.options import (
    FOLDER,
    NEW_FILE,
    NEW_FOLDER,
    as_typed,
    emit,
    jobs_option,
    json_option,
    keep_option,
    members,
    names_option,
    reading_options,
    session_argument,
)
from pipelines.commands.progress import is_shown, watching
from pipelines.experiments import KINDS

_LONGEST = 28  # characters of a text in a table of the terminal


@click.command()
@click.argument("source", metavar="FILE", type=click.Path(exists=True, path_type=Path))
@reading_options
@click.option("--out", type=NEW_FILE, help="Write a picture (.png): frames of a film, columns of a table.")
@json_option
def inspect(source: Path, reading: dict[str, Any], out: Path | None) -> None:
    r"""Describe FILE: instrument, columns, units, ranges, sampling, problems.

    Works on readings, films, calibration records, session.toml, results and pictures; of a folder
    it lists each file in a line. Nothing is written unless --out names a picture.

    \b
    Example:
      labpipe inspect my-session/laser/drop_1.csv
      labpipe inspect my-session/film/front.cine --out front.png
      labpipe inspect old/bare.csv --instrument keyence --cycle "50 us" --unit mm
      labpipe inspect run.csv --columns 'time = "Time (s)", displacement = "Position (m)"'
    """
    found = verbs.inspect(source, out=out, **reading)
    emit(found, (as_typed(line) if line.startswith("problem: ") else line for line in found.lines()))


@click.command()
@click.argument("source", type=click.Path(exists=True, path_type=Path))
@click.option("--format", "-f", "kind", type=click.Choice(verbs.FORMATS), default="csv", help="Format of the files.")
@names_option("--only", "--experiment", help="Only these experiments of a session.")
@names_option("--stage", "stages", help="Only these stages, such as bounces.")
@click.option("--out", type=NEW_FOLDER, help="Folder; default SESSION/labpipe/export, or here for a file.")
@click.option("--bulk", type=click.Choice(["constant", "relaxing", "incompressible"]),
              help="Bulk modulus for a simulation code; default: Poisson's ratio is constant.")  # fmt: skip
@click.option("--decimal", type=click.Choice([".", ","]), default=".", help="Of csv; with a comma, columns end at ;.")
@click.option("--force", is_flag=True, help="Replace files of the same name.")
@reading_options
@json_option
def export(source: Path, kind: str, stages: list[str] | None, force: bool, **options: Any) -> None:
    r"""Write results of a session, or a raw instrument file, for other programs.

    SOURCE is a session folder or a file of any known instrument. Values are in SI; a csv table
    has a row of units below its names, and remarks that begin with #. Of a session, xlsx and tex
    are one table with a row for each quantity: value, u, model, deviation, verdict; xlsx has the
    curves on further sheets. abaqus, ansys, comsol and lsdyna are the materials of a session as
    input of a simulation code.

    \b
    Example:
      labpipe export my-session --stage bounces --format csv
      labpipe export my-session --format xlsx
      labpipe export my-session --decimal ,
      labpipe export my-session --experiment nbr_dma --format abaqus --bulk constant
      labpipe export my-session/laser/drop_1.csv --format mat
    """
    done = verbs.export(source, kind, stages=stages or (), replace=force, **options)
    document = {"files": done.paths, "left_out": done.left_out}
    emit(document, map(str, done.paths), errors=(f"left out: {line}" for line in done.left_out))


@click.command()
@session_argument
@click.option("--out", type=NEW_FILE, help="Default SESSION/labpipe/NAME.zip.")
@click.option("--decimal", type=click.Choice([".", ","]), default=".", help="Of csv; with a comma, columns end at ;.")
@json_option
def bundle(session: Path, out: Path | None, decimal: str) -> None:
    r"""Pack pages, results, settings and calibration records of SESSION into one zip to be mailed.

    The pages hold all that they show and open without labpipe, from labpipe/index.html in the unpacked folder; a
    report prints as PDF from the browser. Nothing is processed.

    \b
    Example:
      labpipe bundle my-session
      labpipe bundle my-session --decimal , --out acrylic.zip
    """
    path = verbs.bundle(session, out, decimal=decimal)
    size = path.stat().st_size
    emit({"path": path, "bytes": size}, [f"{path}: {size / 1e6:.1f} MB"])


@click.command()
@session_argument
@jobs_option
@keep_option
@click.option("--beside", nargs=2, metavar="A B", help="Two experiments side by side, by what is processed.")
@json_option
def compare(session: Path, jobs: int, keep: bool, beside: tuple[str, str] | None) -> None:
    r"""Compare measurement and model of every experiment in SESSION, on one page.

    Missing results are processed first; results of earlier code that `process --keep` took are
    taken again, and marked. The page is SESSION/labpipe/compare.html. With --beside nothing is
    processed, and one page is written of two experiments.

    \b
    Example:
      labpipe compare my-session
      labpipe compare my-session --beside acrylic_7mm acrylic_10mm
    """
    from pipelines.experiments.shared.judgements import chance
    from pipelines.experiments.shared.pages import counted

    if beside:
        page = verbs.beside(session, *beside)
        emit({"page": page}, [f"page: {page}"])
        return
    with watching() as progress:
        found = verbs.compare(session, jobs=jobs, keep=keep or None, progress=progress)
    lines = []
    for whole in found.experiments:
        head = f"{whole['experiment']:24} {whole['model']}"
        if whole["p"] is not None:
            freedom = counted(whole["degrees_of_freedom"], "degree of freedom", "degrees of freedom")
            lines.append(f"{head}: chi square {whole['chi2']:.1f} with {freedom}, {chance(whole['p'])}")
        elif whole["suspects"]:
            lines.append(f"{head}: {'; '.join(whole['suspects'])}")
    lines += [f"{name}: {why}" for name, why in (found.failed | found.absent).items()]
    # As on the page: the largest deviation is read first, then the curves.
    for row in sorted(found.rows, key=lambda row: (row.is_curve, -abs(row.deviation or 0.0), -(row.nrmse or 0.0))):
        kept = f"  (earlier code: {', '.join(row.kept)})" if row.kept else ""
        where = f"{row.experiment:24} {row.condition:14} {row.quantity:32} n={row.n:<4}"
        lines.append(f"{where} {verbs.comparison_text(row)}{kept}")
    document = {"page": found.page, "rows": [row.document() for row in found.rows]}
    document |= members(found, "experiments", "failed", "absent")
    emit(document, [*lines, f"page: {found.page}"], code=1 if found.failed else 0)


_FOLDERS = click.argument("folders", nargs=-1, required=True, metavar="FOLDER...", type=FOLDER)
_DATABASE = click.option("--database", type=NEW_FILE, help="Default labpipe/catalogue.sqlite in the first FOLDER.")
_WHERE = click.option("--where", default="", show_default=False, help="Rows where this SQL expression is true; in SI.")


@click.command()
@_FOLDERS
@_DATABASE
@_WHERE
@names_option("--columns", help="Only these columns, in full.")
@click.option("--table", default="experiments", type=click.Choice(["experiments", "results", "sessions", "columns"]))
@json_option
def catalogue(folders: tuple[Path, ...], database: Path | None, columns: list[str] | None, **options: str) -> None:
    r"""List the experiments of all sessions below FOLDER: parameters and key numbers.

    `believable`, `model`, `checks`, `findings` and `cause` hold the verdict where results are processed.
    The table is brought up to date first; only sessions that changed are read again, and none is
    processed. The terminal shows verdicts and key numbers; --columns and --json show all. The page
    is FOLDER/catalogue.html. The table `results` has every short result, `columns` every column with its unit.

    \b
    Example:
      labpipe catalogue sessions
      labpipe catalogue sessions --where "material = 'acrylic' and height > 0.005"
      labpipe catalogue sessions --where "believable <> 'yes'" --columns session,experiment,findings,cause
      labpipe catalogue sessions --table results --where "variable = 'restitution' and item = 0"
    """
    done = verbs.catalogue(folders, database, columns=columns or (), **options)
    frame, units, n = done.table, done.table.attrs["units"], len(done.renewed)
    records = frame.astype(object).where(frame.notna(), None).to_dict("records")
    rows = [{str(name): value for name, value in row.items() if value is not None} for row in records]
    document = {"database": done.path, **members(done, "page", "renewed", "unchanged", "problems")}
    if not columns and options["table"] == "experiments":
        keys = tuple(key.title.replace(" ", "_") for kind in KINDS.values() for key in kind.key_numbers)
        usual = ["session", "experiment", "kind", "state", "believable", "model", "material", "height"]
        usual += [name for name in map(str, frame) if name.startswith(keys)]  # some end with a frequency
        frame = frame[[name for name in usual if name in frame and frame[name].notna().any()]]
    shown = frame.rename(columns={name: f"{name} [{u}]" for name, u in units.items()}).astype(object)
    width = shutil.get_terminal_size().columns
    style: dict[str, Any] = {} if columns else {"max_colwidth": _LONGEST, "line_width": width}
    text = shown.where(shown.notna(), "").to_string(index=False, float_format="{:.5g}".format, **style)
    lines = text.splitlines() if len(frame) else []
    counts = f"{n} session{'s' * (n != 1)} read, {len(done.unchanged)} unchanged"
    lines += [f"{len(frame)} rows; {counts}; {done.path}", f"page: {done.page}"]
    problems = [f"{name}: {problem}" for name, problem in done.problems.items()]
    emit(document | {"units": units, "rows": rows}, lines, errors=problems, code=bool(problems))


@click.command()
@_FOLDERS
@_DATABASE
@_WHERE
@click.option("--out", type=NEW_FILE, help="The page; default FOLDER/trend.html.")
@json_option
def trend(folders: tuple[Path, ...], database: Path | None, where: str, out: Path | None) -> None:
    r"""Chart the quantities of all sessions below FOLDER over time: mean, limits, drift.

    Individuals charts of every key number and of the ratios observed/expected of every sensor, with limits from the
    moving range and from the stated uncertainties; comparison by calibration record, operator and specimen. From the
    catalogue, which is brought up to date first; nothing is processed.

    \b
    Example:
      labpipe trend sessions
      labpipe trend sessions --where "material = 'acrylic'" --out acrylic.html
    """
    found = verbs.trend(folders, database, where=where, out=out)
    lines = [f"{owner} drifts: {text}" for owner, texts in found.drifts.items() for text in texts]
    lines += [*repr(found).splitlines(), f"page: {found.page}"]
    document = members(found, "page", "drifts", "undated", "problems") | {"charts": found.documents()}
    problems = [f"{name}: {problem}" for name, problem in found.problems.items()]
    emit(document, lines, errors=problems, code=bool(problems))


@click.command()
@session_argument
@click.argument("which", required=False, metavar="[KIND|EXPERIMENT]")
@json_option
def sensitivity(session: Path, which: str | None) -> None:
    r"""Show which inputs limit the uncertainty of the main quantities in SESSION.

    Linear budget, Monte Carlo, Sobol indices, expanded uncertainty, and the input to measure better to
    halve it. One page per kind: SESSION/labpipe/sensitivity_KIND.html.

    \b
    Example:
      labpipe sensitivity my-session
      labpipe sensitivity my-session ball_drop
    """
    found = verbs.sensitivity(session, which)
    emit({"pages": found.pages, "quantities": found.documents()}, repr(found).splitlines())


@click.command()
@session_argument
@names_option("--experiments", "--only", "-e", help="Only these; by default all that can identify a material.")
@click.option("--prior", metavar="dma|NAME", help="Use the moduli of the session's rheometer experiment as prior.")
@click.option("--impacts", default=6, type=click.IntRange(min=1, max=100), help="Bounces of a drop that count.")
@jobs_option
@json_option
def identify(session: Path, experiments: list[str] | None, **options: Any) -> None:
    r"""Identify the viscoelastic materials of the experiments in SESSION, with credible intervals.

    Drops, contact films, relaxations and harmonic indentations of one material are fitted
    together. Missing results are processed first. One page and one netCDF file per material:
    SESSION/labpipe/identify_MATERIAL.html and .nc.

    \b
    Example:
      labpipe identify my-session
      labpipe identify my-session -e acrylic_5mm -e acrylic_10mm
      labpipe identify my-session -e nbr_relaxation --prior dma
    """
    from pipelines.identify import identify as verb

    def say(text: str) -> None:
        if is_shown():  # a file or a pipe gets nothing
            click.echo(text, err=True)

    found = verb(session, experiments or (), say=say, **options)
    emit(found.documents(), found.lines())


@click.command()
@session_argument
@click.option("--out", required=True, type=NEW_FOLDER, help="Folder to be made, not in SESSION.")
@click.option("--anonymous", is_flag=True, help="Leave out operator, creators and paths of this machine.")
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
    with watching() as progress:
        done = verbs.publish(session, out, progress=progress, **options)
    document = members(done, "folder", "left_out", "struck") | {"files": done.sizes}
    emit(document, [repr(done), f"then: labpipe verify {out}"], code=1 if done.left_out else 0)


@click.command()
@click.argument("folder", type=FOLDER)
@jobs_option
@json_option
def verify(folder: Path, **options: Any) -> None:
    r"""Check a package that `publish` made: its checksums, then its numbers.

    The raw files are processed again in a temporary folder, and every result is compared. Exit code 1:
    a number differs; 4: a file is missing or was changed.

    \b
    Example:
      labpipe verify my-package
    """
    with watching() as progress:
        done = verbs.verify(folder, progress=progress, **options)
    rows = [members(row, "name", "deviation", "differs") for row in done.results]
    document = members(done, "folder", "files", "tolerance") | {"results": rows}
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
    text = verbs.cite(session)
    emit({"bibtex": text}, [text.rstrip()])
