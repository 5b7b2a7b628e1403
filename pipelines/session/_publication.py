"""A processed session as a data package for a journal or a repository, an RO-Crate with checksums; or as one zip file.

The package holds ``data`` (``session.toml`` and every file that it names), ``results`` (netCDF of the CF conventions,
and a table of all quantities), ``pages``, ``methods.md``, ``references.bib``, ``requirements.txt`` (a lock of the
environment), ``ro-crate-metadata.json``, and ``SHA256SUMS``, which ``sha256sum --check`` reads.
S. Soiland-Reyes et al., Data Science 5 (2022) 97, https://doi.org/10.3233/DS-210053.
"""

from __future__ import annotations

import contextlib
import html
import importlib.metadata
import importlib.util
import mimetypes
import mmap
import platform
import re
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from labpipe import files, installation
from labpipe.errors import ConfigError, InputError, SourceError, StoreError, UsageError
from labpipe.installation import __version__
from labpipe.workflow.document import LABORATORY, parse
from labpipe.workflow.plan import page_name
from labpipe.workflow.session import FILE_NAME, Session
from pipelines.experiments.shared.pages import LIMITS
from pipelines.session._export import Writer, export, export_results, export_table
from pipelines.session._overview import COMPARISON_PAGE, PAGE
from pipelines.session._processing import process
from pipelines.session._results import STAGES, opened, reopen_session
from pipelines.session._session_checks import named_files

if TYPE_CHECKING:
    from labpipe.workflow.results import Event

DATA, RESULTS, SUMS = "data", "results", "SHA256SUMS"
"""Folders of the session and of its results in a package, and the file of its checksums."""
_CRATE = "1.1"  # version of RO-Crate that repositories take
_CONTENT = {
    DATA: "raw files, calibration records, session.toml",
    RESULTS: "results in SI; u_x is the standard uncertainty of x",
    "pages": "reports",
}
_CODES = ("utf-8", "latin-1", "utf-16-le")
_TYPES = {".nc": "application/netcdf", ".md": "text/markdown", ".bib": "application/x-bibtex", ".toml": "text/toml"}


@dataclass(frozen=True, slots=True, repr=False)
class Published:
    """A package: folder, size of each file by name, missing results, and the files in which a name was struck."""

    folder: Path
    sizes: dict[str, int]
    left_out: tuple[str, ...]
    struck: tuple[str, ...] = ()

    def __repr__(self) -> str:
        head = f"{self.folder}: {len(self.sizes)} files, {sum(self.sizes.values()) / 1e6:.1f} MB"
        lines = [f"left out: {line}" for line in self.left_out] + [f"name struck: {name}" for name in self.struck]
        return "\n".join([head, *lines])


def publish(
    session: str | Path,
    out: str | Path,
    *,
    anonymous: bool = False,
    jobs: int = 1,
    progress: Callable[[Event], None] | None = None,
) -> Published:
    """Write a data package of a session, as an RO-Crate; results that are missing are processed first.

    Parameters
    ----------
    session : path-like
        A session folder whose ``session.toml`` states ``licence`` and ``[[creators]]``.
    out : path-like
        Folder to be made, outside the session.
    anonymous : bool
        For a blind review: leave out operator, creators and paths of this machine. They are struck from the copies
        of raw files too, from which all is processed again.
    jobs, progress
        As of :func:`labpipe.process`.

    Returns
    -------
    Published

    Examples
    --------
    >>> publish("my-session", "my-package", anonymous=True)  # doctest: +SKIP
    """
    found, place = reopen_session(session), Path(out).absolute()
    _require_statements(found, anonymous)
    struck: list[str] = []
    if importlib.util.find_spec("rocrate") is None:
        raise UsageError("publishing needs the library rocrate; run: pip install 'labpipe[publish]'")
    if place.exists() or place.resolve().is_relative_to(found.root):
        raise UsageError(f"{out} exists already, or is inside the session; name a folder that is to be made elsewhere")
    place.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".publish-", dir=place.parent) as scratch:
        folder = Path(scratch) / "package"
        _copy(found, folder / DATA)
        if anonymous:
            struck = _strike(found, folder)
            found = reopen_session(folder / DATA)
        run = process(found.root, jobs=jobs, progress=progress)
        writer = Writer(folder / RESULTS, "nc", may_replace=True)
        export_results(opened(found.root), (), (), writer)
        with contextlib.suppress(InputError):  # a session may have curves alone
            export_table(opened(found.root), (), Writer(folder / RESULTS, "csv", may_replace=True))
        for page in (PAGE, COMPARISON_PAGE, f"reports/{LIMITS}", *map(page_name, found.experiments)):
            if (found.folder / page).is_file():
                files.write_bytes(folder / "pages" / page, (found.folder / page).read_bytes())
        if anonymous:
            shutil.rmtree(found.folder)
        _describe(found, folder)
        held = {p.relative_to(folder).as_posix(): p for p in files.files_below(folder)}
        files.write_text(folder / SUMS, "".join(f"{files.digest(p)}  {name}\n" for name, p in held.items()))
        sizes = {name: (folder / name).stat().st_size for name in (*held, SUMS)}
        folder.rename(place)
    left_out = [f"{one.task}: {one.message}" for one in run.failures] + writer.left_out
    left_out += [f"{name} waits: {lines[0]}" for name, lines in found.waiting.items()]
    return Published(Path(out), sizes, tuple(left_out), tuple(struck))


def _require_statements(session: Session, anonymous: bool) -> None:
    """Raise ConfigError with the lines to add where licence, creators or an ORCID are not stated."""
    document = parse(session.root / FILE_NAME)
    if not session.licence:
        text = 'no licence is stated for the data; add to [session] the line: licence = "CC-BY-4.0"'
        document.report(("session",), text)
    if not anonymous and not session.creators:
        lines = '[[creators]]\nname = "Given Family"\norcid = "0000-0002-1825-0097"\naffiliation = "Institute, Town"'
        document.report((), f"no creators are stated; add at the end, once for each:\n{lines}")
    for i, creator in enumerate(() if anonymous else session.creators):
        if creator.orcid is None:
            message = f'{creator.name} has no ORCID; add the line: orcid = "0000-0002-1825-0097" ("" for none)'
            document.report(("creators", i), message)
    if session.archive is not None:
        document.report(("session", "files"), "the raw files are in another folder; publish a copy that holds them")
    laboratory = session.root / document.tree.get("laboratory", LABORATORY)
    if laboratory.parent.resolve() != session.root:
        text = f'is outside the session; copy it and its records here, and write laboratory = "{LABORATORY}"'
        document.report(("laboratory",), f"{LABORATORY} {text}")
    document.finish()


def _copy(session: Session, data: Path) -> None:
    """Copy session.toml and the files that it names, with the workbook of its values."""
    workbook = parse(session.root / FILE_NAME).tree.get("session", {}).get("stated", {}).get("file", FILE_NAME)
    held = [session.root / name for name in (FILE_NAME, LABORATORY, workbook) if (session.root / name).is_file()]
    for named in named_files(session):
        held += files.files_below(named.path) if named.path.is_dir() else [named.path] * named.path.is_file()
    files.require_space(data, 2 * sum(path.stat().st_size for path in held))
    for path in dict.fromkeys(held):
        target = data / path.relative_to(session.root)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, target)


def _strike(session: Session, folder: Path) -> list[str]:
    """Overwrite names in the files of a package with as many x, and return the files that held one.

    Lines and places keep their numbers: operator and creators are blank lines of session.toml. Initials are not looked
    for elsewhere: a film holds any three bytes by chance.
    """
    of_persons = [text or "" for one in session.creators for text in (one.name, one.orcid, one.affiliation)]
    wanted = {session.operator, *of_persons, str(session.root), f"{Path.home()}/"}
    names = sorted((name for name in wanted if len(name) > 5), key=len, reverse=True)
    path = folder / DATA / FILE_NAME
    lines, places = path.read_text("utf-8-sig").splitlines(), parse(path).lines
    persons = {place for place in places if place[:1] == ("creators",) or place == ("session", "operator")}
    others = sorted(line for place, line in places.items() if place and place not in persons)
    for first in {places[place] for place in persons}:
        last = next((line for line in others if line > first), len(lines) + 1)
        lines[first - 1 : last - 1] = [""] * (last - first)
    files.write_text(path, "\n".join(lines) + "\n")
    held = {p.relative_to(folder).as_posix(): p for p in files.files_below(folder) if p.stat().st_size}
    if called := [f'{file} has "{name}" in its name; rename it' for file in held for name in names if name in file]:
        raise ConfigError([f"{text} in a copy of the session, and publish that" for text in called])
    struck = []
    for file, path in held.items():
        with path.open("r+b") as stream, mmap.mmap(stream.fileno(), 0) as data:
            for form, fill in ((n.encode(c, "replace"), "x".encode(c)) for n in names for c in _CODES):
                at = -1
                while (at := data.find(form, at + 1)) >= 0:
                    data[at : at + len(form)] = fill * (len(form) // len(fill))
                    struck.append(file)
    return list(dict.fromkeys(struck))


def _describe(session: Session, folder: Path) -> None:
    """Write methods, references, the lock of the environment, and an RO-Crate of every file, which is read back."""
    from rocrate.model import ContextEntity, Person, SoftwareApplication
    from rocrate.rocrate import ROCrate

    parts = [f"# Methods: {session.title}\n"]
    for name in session.experiments:
        page = folder / "pages" / page_name(name)
        text = page.read_text("utf-8") if page.is_file() else ""
        found = re.search(r'<div class="prose copyable">.*?<p>(.*?)</p>', text, re.S)
        parts += [f"## {name}\n\n{html.unescape(found[1])}\n"] if found else []
    files.write_text(folder / "methods.md", "\n".join(parts))
    files.write_text(folder / "references.bib", cite(session.root))
    head = f"# Python {platform.python_version()}, {platform.system()} {platform.machine()}\n"
    lock = sorted({f"{d.name}=={d.version}\n" for d in importlib.metadata.distributions()}, key=str.lower)
    files.write_text(folder / "requirements.txt", head + "".join(lock))

    def entity(identifier: str, kind: str, /, **properties: Any) -> Any:
        return crate.add(ContextEntity(crate, identifier, properties={"@type": kind, **properties}))

    crate = ROCrate(version=_CRATE)
    about = f"Raw files, results and reports of {len(session.experiments)} experiments, processed by labpipe."
    crate.name, crate.description = session.title, f"{about} {session.notes}".strip()
    crate.datePublished = date.today()
    address = session.licence if "://" in session.licence else f"https://spdx.org/licenses/{session.licence}"
    crate.license = entity(address, "CreativeWork", name=session.licence, description=f"licence {session.licence}")
    people = []
    for i, one in enumerate(session.creators):
        of = entity(f"#affiliation-{i}", "Organization", name=one.affiliation) if one.affiliation else None
        person = {"name": one.name} | ({"affiliation": {"@id": of.id}} if of is not None else {})
        name = f"https://orcid.org/{one.orcid}" if one.orcid else f"#creator-{i}"
        people.append(crate.add(Person(crate, name, properties=person)))
    for role in ("author", "creator") if people else ():  # repositories read either
        crate.root_dataset[role] = people if people[1:] else people[0]
    held: dict[str, list[Any]] = {}
    for path in files.files_below(folder):
        name = path.relative_to(folder).as_posix()
        top = name.partition("/")[0]
        kind = _TYPES.get(path.suffix) or mimetypes.guess_type(path.name)[0] or "application/octet-stream"
        properties = {"name": path.name, "encodingFormat": kind, "contentSize": str(path.stat().st_size)}
        properties |= {"sha256": files.digest(path), "description": _CONTENT.get(top, path.name)}
        held.setdefault(top, []).append(crate.add_file(path, name, properties=properties))
    program = crate.add(SoftwareApplication(crate, "#labpipe", properties={"name": "labpipe", "version": __version__}))
    made = {key: [{"@id": one.id} for one in held[top]] for key, top in (("object", DATA), ("result", RESULTS))}
    action = entity("#processing", "CreateAction", name="processing", instrument={"@id": program.id}, **made)
    crate.root_dataset["mentions"] = action
    crate.metadata.write(folder)
    read = {entity.id for entity in ROCrate(folder).data_entities}
    if lost := sorted(e.id for every in held.values() for e in every if e.id not in read):
        raise InputError(f"the library rocrate does not read back {', '.join(lost)}; rename the file")


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
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch) / name
        export(folder, "xlsx", out=place / RESULTS)
        export(folder, "csv", stages=whole, out=place / RESULTS, decimal=decimal)
        for inside, source in held.items():
            (place / inside).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, place / inside)
        path.parent.mkdir(parents=True, exist_ok=True)
        files.write_bytes(path, Path(shutil.make_archive(f"{scratch}/bundle", "zip", scratch, name)).read_bytes())
    return path


_SOURCES = Path(installation.__file__).parent / "documentation/references.bib"


def cite(session: str | Path | None = None) -> str:
    """Return as BibTeX the sources to be cited.

    Parameters
    ----------
    session : path-like, optional
        A session folder; the sources of the methods behind its kinds of experiment are added.

    Returns
    -------
    str
        BibTeX entries of labpipe in this version and of the guides to uncertainty, and of the session's methods.

    Examples
    --------
    >>> cite().count("@")
    3
    """
    wanted = {"always"} | ({e.kind for e in reopen_session(session).experiments.values()} if session else set())
    text = _SOURCES.read_text("utf-8").replace("{VERSION}", f"{{{installation.__version__}}}")
    entries = re.findall(r"^(@\w+\{.*?),\n  keywords = \{(.*?)\}\n\}$", text, re.M | re.S)
    return "\n\n".join(f"{entry}\n}}" for entry, words in entries if wanted & set(words.split(", "))) + "\n"


_TOLERANCE, _PART_OF_U = 1e-6, 0.01
"""Differences that do not matter: of the largest value of a variable, as other processors and libraries round
differently, and of its standard uncertainty."""


class Compared(NamedTuple):
    """One published result and the same made again; ``differs`` names the variables that do not agree.

    ``deviation`` is the largest difference of a variable relative to its largest value.
    """

    name: str
    deviation: float
    differs: tuple[str, ...]


@dataclass(frozen=True, slots=True, repr=False)
class Verified:
    """A package whose checksums hold, and the comparison of its results with the same made again."""

    folder: Path
    files: int
    results: tuple[Compared, ...]
    tolerance: float = _TOLERANCE

    @property
    def differing(self) -> tuple[Compared, ...]:
        """Results of which at least one variable does not agree."""
        return tuple(one for one in self.results if one.differs)

    def __repr__(self) -> str:
        lines = [f"{self.files} files: all as their checksums say"]
        lines += [f"differs: {one.name}: {', '.join(one.differs)}" for one in self.differing]
        same, n = sum(not (one.deviation or one.differs) for one in self.results), len(self.results)
        agree = f"{n - len(self.differing)} of {n} results agree, {same} of them exactly"
        limit = f"tolerance: {self.tolerance:g} of the largest value of a variable, or {_PART_OF_U:g} of its u"
        return "\n".join([*lines, f"{agree} ({limit})"])


def verify(folder: str | Path, *, jobs: int = 1, progress: Callable[[Event], None] | None = None) -> Verified:
    """Check a published package: its checksums, and its numbers by processing its raw files again.

    StoreError names the files that are missing or were changed since.

    Parameters
    ----------
    folder : path-like
        A folder that :func:`publish` made; it is not changed.
    jobs, progress
        As of :func:`labpipe.process`.

    Returns
    -------
    Verified

    Examples
    --------
    >>> verify("my-package").differing  # doctest: +SKIP
    ()
    """
    place = Path(folder)
    if not (place / SUMS).is_file() or not (place / DATA).is_dir():
        hint = "name a folder that labpipe publish made"
        raise SourceError(place / SUMS, "there is no such file, so this is no published package", hint=hint)
    pairs = [line.split("  ", 1) for line in (place / SUMS).read_text("utf-8").splitlines()]
    stated = {name: (files.safe_join(place, name), digest) for digest, name in pairs}
    bad = [f"{name} is missing" for name, (path, _) in stated.items() if not path.is_file()]
    there = {name: pair for name, pair in stated.items() if pair[0].is_file()}
    bad += [f"{name} was changed" for name, (path, digest) in there.items() if files.digest(path) != digest]
    if bad:
        message = "; ".join(bad[:10]) + (f"; and {len(bad) - 10} more" if bad[10:] else "")
        raise StoreError(f"{place}: not as it was published: {message}; fetch it again from its source")
    with tempfile.TemporaryDirectory(prefix="labpipe-verify-") as scratch:
        session = Path(scratch) / "session"
        files.require_space(session, sum(path.stat().st_size for path in files.files_below(place)))
        shutil.copytree(place / DATA, session)
        process(session, jobs=jobs, progress=progress)
        made = Path(scratch) / RESULTS
        with contextlib.suppress(InputError):  # nothing came out: every result differs
            export(session, "nc", out=made)
        published = sorted((place / RESULTS).glob("*.nc"))
        found = tuple(_compare(path, made / path.name) for path in published)
    return Verified(place, len(stated), found)


def _compare(published: Path, made: Path) -> Compared:
    """Compare two results variable by variable; one that was not made again differs as a whole."""
    import numpy as np

    if not made.is_file():
        return Compared(published.name, float("inf"), ("not made again",))
    before, after = files.read_dataset(published), files.read_dataset(made)
    worst, differs = 0.0, [str(name) for name in {*before.variables} ^ {*after.variables}]
    for name in map(str, before.variables.keys() & after.variables.keys()):
        old, new = before[name].values, after[name].values
        if old.shape != new.shape or old.dtype.kind != "f":
            differs += [] if np.array_equal(old, new) else [name]
            continue
        largest = float(np.max(np.abs(old), initial=0.0, where=np.isfinite(old)))
        u = before[f"u_{name}"].values if f"u_{name}" in before else np.zeros(())
        allowed = np.fmax(_TOLERANCE * largest, _PART_OF_U * u if u.shape == old.shape else 0.0)
        differs += [] if np.isclose(new, old, rtol=0.0, atol=allowed, equal_nan=True).all() else [name]
        is_known = np.isfinite(old) & np.isfinite(new)
        worst = max(worst, float(np.max(np.abs(new - old), initial=0.0, where=is_known)) / (largest or 1.0))
    return Compared(published.name, worst, tuple(sorted(differs)))
