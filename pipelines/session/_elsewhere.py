"""Results outside the session: work folders of a read-only archive, and bundles to be mailed."""

from __future__ import annotations

import io
import json
import re
import tempfile
import zipfile
from pathlib import Path

from labpipe import files
from labpipe.errors import InputError, SourceError, UsageError
from labpipe.workflow.document import parse
from labpipe.workflow.session import FILE_NAME
from pipelines.session._export import export
from pipelines.session._results import STAGES, reopen_session
from pipelines.session._session_checks import named_files

_HEAD = re.compile(r"^[ \t]*\[[ \t]*session[ \t]*\][^\n]*\n", re.MULTILINE)
_DAY = (1980, 1, 1, 0, 0, 0)  # of every file in a bundle: two bundles of equal results are equal


def work_folder(session: str | Path, out: str | Path) -> Path:
    """Make a folder for the results of a session in which nothing may be written; return it.

    It holds a copy of ``session.toml`` that names the session (``files`` in ``[session]``), and is taken by every
    command and function in the session's place. A folder that is there already is used as it is: its copy may have
    been changed.
    """
    source, target = Path(session).resolve(), Path(out).resolve()
    original = source / FILE_NAME
    if not original.is_file():
        raise SourceError(original, "there is no such file", hint="Name the folder of a session.")
    if target.is_relative_to(source):
        raise UsageError(f"--out {out} lies in the session; name a folder outside it, or leave out --out")
    copy = target / FILE_NAME
    if copy.is_file():
        known = parse(copy).tree.get("session", {}).get("files", "")
        if not known or (target / known).resolve() != source:
            raise UsageError(f"--out {out}: its {FILE_NAME} is of {known or 'a session itself'}; name another folder")
        return target
    text = original.read_text("utf-8-sig")
    line = f"files = {json.dumps(source.as_posix(), ensure_ascii=False)}  # raw files and records: only read\n"
    changed, count = _HEAD.subn(lambda found: found[0] + line, text, count=1)
    files.write_text(copy, changed if count else f"{text.rstrip()}\n\n[session]\n{line}")
    return target


def bundle(folder: str | Path, out: str | Path | None = None, *, decimal: str = ".") -> Path:
    """Write pages, results, settings and calibration records of a session into one zip to be mailed.

    Results are one workbook of quantities and csv of the curves; those of single recordings (readings, displacement,
    ...) are left out for their size.

    Parameters
    ----------
    folder : path-like
        The session folder; nothing is processed.
    out : path-like, optional
        The file; default ``SESSION/labpipe/NAME.zip``.
    decimal : {".", ","}
        Decimal sign of the csv; with a comma, semicolons separate the columns.

    Returns
    -------
    Path

    Examples
    --------
    >>> bundle("my-session", decimal=",")  # doctest: +SKIP
    """
    session = reopen_session(folder)
    pages = [p for p in sorted(session.folder.rglob("*.html")) if "store" not in p.relative_to(session.folder).parts]
    if not pages:
        raise InputError(f"{session.root}: there is no page yet; run: labpipe process {session.root}")
    name = session.root.name
    path = session.folder / f"{name}.zip" if out is None else Path(out)
    stages = [s for one in session.experiments.values() for s in STAGES[one.kind]]
    whole = {s.name for s in stages if s.output == "dataset"} - {s.name for s in stages if s.per != "experiment"}
    held = {FILE_NAME: session.path(FILE_NAME)}
    for record in dict.fromkeys(one.name for one in named_files(session) if one.name.endswith(".toml")):
        if session.path(record).is_file():  # one may lie above the session
            held["/".join(part for part in Path(record).parts if part != "..")] = session.path(record)
    held |= {f"labpipe/{page.relative_to(session.folder).as_posix()}": page for page in pages}
    stream = io.BytesIO()
    with tempfile.TemporaryDirectory() as place, zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        written = export(folder, "xlsx", out=place).paths
        written += export(folder, "csv", stages=whole, out=place, decimal=decimal).paths
        for inside, source in (held | {f"results/{p.name}": p for p in written}).items():
            archive.writestr(zipfile.ZipInfo(f"{name}/{inside}", _DAY), source.read_bytes(), zipfile.ZIP_DEFLATED)
    path.parent.mkdir(parents=True, exist_ok=True)
    files.write_bytes(path, stream.getvalue())
    return path
