"""The verb doctor: the installation, the disk, and a session: its results, recordings and settings, checked."""

from __future__ import annotations

import importlib.metadata
import platform
import re
import shutil
import tempfile
import warnings
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from labpipe import files
from labpipe.errors import InputError, LabpipeError
from labpipe.installation import __version__
from labpipe.notebook import Shown, ShownAsTable, html_table
from labpipe.plugins import PluginWarning

if TYPE_CHECKING:
    from labpipe.judging import Finding, Level

_OURS = ("calibration", "instruments", "labpipe", "pipelines")
_ROOM_WANTED = 2_000_000_000  # bytes; a session with films writes less than this


class Trouble(NamedTuple):
    """One row of an audit: the worst finding of those that one change would mend, and all that it spoils and fails."""

    level: Level
    experiments: tuple[str, ...]
    checks: tuple[str, ...]
    message: str
    cause: str
    file: str
    line: int | None
    value: str
    place: str


@dataclass(frozen=True, slots=True, repr=False)
class Audit(ShownAsTable):
    """All rows, the costliest first, the number of checks, and experiments by the values that they state as exact."""

    troubles: tuple[Trouble, ...]
    checks: int
    exact: dict[str, list[str]]

    @property
    def is_impossible(self) -> bool:
        """Whether any record contradicts itself, physics, or the session's statements."""
        return any(t.level == "impossible" for t in self.troubles)

    def _shown(self) -> Shown:
        count = Counter(t.level for t in self.troubles)
        found = ", ".join(f"{count[level]} {level}" for level in ("impossible", "doubtful", "note") if count[level])
        rows = [
            (t.level, t.place, ", ".join(t.experiments), f"{t.message}{f'; {t.cause}' if t.cause else ''}")
            for t in self.troubles
        ]
        caption = f"{self.checks} checks of the session: {found or 'nothing found'}"
        return Shown(caption, ("level", "to change", "experiments", "finding"), rows)


@dataclass(frozen=True, slots=True)
class Health:
    """Findings of the doctor: version of every library or ``"missing"``, state of every plug-in, room on the disk.

    ``problems`` are of the installation, ``session_problems`` of session.toml, ``damaged_results`` stored results that
    cannot be read; ``audit`` holds findings on the recordings and settings of a session that was named.
    """

    versions: dict[str, str]
    plugins: tuple[str, ...]
    free_bytes: int
    problems: tuple[str, ...]
    session_problems: tuple[str, ...]
    damaged_results: tuple[str, ...]
    audit: Audit | None = None

    def lines(self) -> list[str]:
        """Return the problems as lines of text."""
        found = [f"problem: {line}" for line in (*self.problems, *self.session_problems)]
        found += [f"damaged: {line}; the next `labpipe process` makes it again" for line in self.damaged_results]
        where = "the installation" if self.audit is None else "the installation and the stored results"
        return found or [f"no problem found in {where}"]

    def __repr__(self) -> str:
        head = [f"{name:24}{version}" for name, version in self.versions.items()]
        text = [*head, f"{'free space':24}{self.free_bytes / 1e9:.1f} GB", *self.plugins, "", *self.lines()]
        if self.audit is not None:
            exact = self.audit.exact.items()
            text += ["", repr(self.audit)]
            text += [f"counted as exact, since stated without ±: {v} ({', '.join(n)})" for v, n in exact]
        return "\n".join(text)

    def _repr_html_(self) -> str:
        shown = html_table("; ".join(self.lines()), ("library", "version"), self.versions.items())
        return shown if self.audit is None else shown + self.audit._repr_html_()


def doctor(folder: str | Path | None = None) -> Health:
    """Check the installation and the disk; of a session, its results, recordings and settings.

    Parameters
    ----------
    folder : path-like, optional
        A session to audit: every recording and setting is judged, and results that the verdicts need are
        processed first. Without it, the present folder is looked at and nothing is processed.

    Returns
    -------
    Health
        The audit is left out while no experiment is complete or stored results are damaged.

    Examples
    --------
    >>> doctor("my-session").problems  # doctest: +SKIP
    ()
    """
    import instruments
    from labpipe.workflow.session import FILE_NAME
    from labpipe.workflow.store import Store
    from pipelines.experiments import ADDED
    from pipelines.session._results import open_session

    place = Path(folder if folder is not None else ".")
    if not place.is_dir():
        raise InputError(f"{place} is no folder; name one that exists")
    (versions, problems), is_session = _installation(place), (place / FILE_NAME).is_file()
    damaged, mistakes = Store(place / "labpipe").check() if is_session else [], list[str]()
    is_sound = is_session and not damaged
    try:
        waiting = open_session(place).waiting if is_session else {}
        mistakes = [line for lines in waiting.values() for line in lines]
    except LabpipeError as error:
        mistakes, is_sound = str(error).splitlines(), False
    with warnings.catch_warnings(action="ignore", category=PluginWarning):  # they are listed here
        plugins = tuple(str(plugin) for plugin in (*instruments.added(), *ADDED))
    found = _audit(place) if folder is not None and is_sound else None
    free = shutil.disk_usage(place).free
    return Health(versions, plugins, free, tuple(problems), tuple(mistakes), tuple(damaged), found)


def _installation(folder: Path) -> tuple[dict[str, str], list[str]]:
    """Return the version of every library, and problems: libraries, permission to write, names that clash, room."""
    versions, found = {"labpipe": __version__, "python": platform.python_version()}, list[str]()
    for line in importlib.metadata.requires("labpipe") or ():
        needed = re.match(r"([\w.-]+)(?:\[[^]]*\])?(?:>=([\d.]+))?(?!.*extra)", line)
        if needed is None:
            continue
        name, least = needed[1], needed[2] or ""
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            versions[name] = "missing"
            found.append(f"{name} is not installed; pip install {name}")
            continue
        if _numbers(versions[name]) < _numbers(least):
            found.append(f"{name} is {versions[name]}, needed is {least} or newer; pip install --upgrade {name}")
    try:
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            files.write_bytes(Path(scratch) / "test", b"labpipe")
    except (LabpipeError, OSError) as error:
        found.append(f"{folder}: cannot write here: {error}")
    owners = importlib.metadata.packages_distributions()
    for name in _OURS:  # the distribution that was installed last has won, and removing it removes our files
        for owner in sorted(set(owners.get(name, ())) - {"labpipe"}):
            text = f"the distribution {owner} also installs the package `{name}`; use a separate environment "
            found.append(f"{text}for labpipe (installing or removing {owner} breaks it)")
    free = shutil.disk_usage(folder).free
    if free < _ROOM_WANTED:
        found.append(f"{folder}: only {free / 1e9:.2f} GB are free; films need more: make room")
    return versions, found


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", version)[:4])


def _audit(folder: Path) -> Audit:
    """Judge every experiment of a session, and the session as a whole.

    Results that the verdicts need are processed first. The engine is loaded here, as the installation may lack it.
    """
    from labpipe.judging import FLAGS, Finding
    from pipelines.experiments import JUDGEMENT
    from pipelines.session._processing import process
    from pipelines.session._results import STAGES, open_session
    from pipelines.session._session_checks import SESSION_CHECKS, stated_as_exact, unused_files
    from pipelines.session._verdicts import WAITING, placed, verdicts_of

    session = open_session(folder)
    alike: dict[tuple[str, int | None, str], list[tuple[str, Finding]]] = {}

    def note(name: str, f: Finding) -> None:
        alike.setdefault((f.file, f.line, f.cause or f.message), []).append((name, f))

    for finding in unused_files(session):
        note("", finding)
    checks, rows = SESSION_CHECKS, []
    judged = [e.name for e in session.experiments.values() if any(s.name == JUDGEMENT for s in STAGES[e.kind])]
    verdicts = verdicts_of(process(folder, [f"{name}/{JUDGEMENT}" for name in judged])).experiments if judged else ()
    # the lines that experiments wait for are among the problems of session.toml
    for v in (v for v in verdicts if v.state != WAITING):
        checks += v.checks
        for finding in v.findings:
            note(v.experiment, finding)
        if v.model == "differs":
            differs = Finding("model", "note", "the model differs from the measurement", next(iter(v.suspects), ""))
            note(v.experiment, placed(session, session.experiments[v.experiment], differs))
    for pairs in alike.values():
        worst = max((f for _, f in pairs), key=lambda f: FLAGS.get(f.level, 0))
        names = tuple(dict.fromkeys(name for name, _ in pairs if name))
        titles = tuple(dict.fromkeys(f.check for _, f in pairs))
        place = (worst.file, worst.line, worst.value, worst.place)
        rows.append(Trouble(worst.level, names, titles, worst.message, worst.cause, *place))
    rows.sort(key=lambda t: (-FLAGS.get(t.level, 0), -len(t.experiments), -len(t.checks)))
    return Audit(tuple(rows), checks, stated_as_exact(session))
