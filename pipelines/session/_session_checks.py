"""Checks of a session as a whole: recordings used twice, bodies, names, units, unused files.

Each holds the statements of one experiment against the others, or against the names that the
laboratory gave its files. None opens a recording: digests are those of the run.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import hypot, log
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe.errors import LabpipeError
from labpipe.units import ZERO_CELSIUS, Quantity
from labpipe.workflow.document import counted
from labpipe.workflow.exclusions import exclusions, files_of
from labpipe.workflow.fields import every_setting
from labpipe.workflow.session import FILE_NAME, Experiment, Session
from labpipe.workflow.store import Store
from pipelines.experiments.shared.exact_values import exact_values, usual_uncertainty
from pipelines.session._gaps import library_names
from pipelines.session._recognition import recognised_below

if TYPE_CHECKING:
    from labpipe.judging import Finding, Level

TWO_VALUES = "one body, two values"
CONFIGURATION = ".toml"
"""Ending of records and materials: those are meant to serve several experiments."""
NAMED, SEVERAL = 5, 3
"""Names that are read in a sentence, more are counted; and experiments that are not alike by chance."""
_SLIP = 0.01  # tolerance of the logarithm of a ratio that is a typing error's factor
_NEAR = 0.1  # relative difference of a value that is nearly that of others
_CONDITIONS = ("height", "temperature", "T_ref")
"""Endings of quantities that are chosen for each experiment, and differ by a misplaced decimal point alone."""
_OF_RECORD = {
    "it expired": "valid_until",
    "was not yet valid": "valid_from",
    "belongs to": "view",
    "expected a record": "kind",
    "the readings come from": "instrument",
}
"""Words in the refusal of a calibration record, and the line of the record that they concern."""
_Owned = Iterator[tuple[str, "Finding"]]
"""Findings, each with the experiment that it concerns."""


@dataclass(frozen=True, slots=True)
class Named:
    """A file that an experiment names: the setting, the name as written, the file, and the line of session.toml."""

    experiment: str
    kind: str
    setting: str
    name: str
    path: Path
    line: int | None


def session_findings(session: Session) -> dict[str, list[Finding]]:
    """Check a session as a whole; return findings, with file and setting, by the experiment that they concern."""
    session = session.without_variants()
    found: dict[str, list[Finding]] = {}
    for check in _CHECKS:
        for owner, one in check(session):
            found.setdefault(owner, []).append(one)
    return found


def named_files(session: Session) -> list[Named]:
    """Return every file and folder that the settings name, in the order of the session."""
    return [
        Named(e.name, e.kind, at, name, session.files / name, e.lines.get(at, e.lines.get(_field(at))))
        for e in session.experiments.values()
        for at, name in files_of(e.settings)
    ]


def stated_as_exact(session: Session) -> dict[str, list[str]]:
    """Return the experiments that state the same values without an uncertainty, by the names of these values."""
    found: dict[str, list[str]] = {}
    for e in session.experiments.values():
        if names := exact_values(e.settings):
            found.setdefault(", ".join(names), []).append(e.name)
    return found


def unused_files(session: Session) -> list[Finding]:
    """Find files of known instruments, and records, that no experiment names; one that waits may name any.

    They are notes, one for all files of one sort in one folder.
    """
    if session.waiting:
        return []
    index = Store(session.folder).index
    named = [one for one in named_files(session) if one.path.exists()]
    # a recording that is excluded is known, and serves nothing
    excluded = (one.file for e in session.experiments.values() for one in exclusions(e.settings))
    left_out = {(session.files / name).resolve() for name in excluded}
    groups: dict[tuple[str, str], list[str]] = {}
    for name, title in recognised_below(session.files, {n.path.resolve() for n in named} | left_out):
        groups.setdefault((title, Path(name).parent.as_posix()), []).append(name)
    found = []
    for (title, _), names in groups.items():
        n, pairs = len(names), ((name, o, session.files / name) for name in names for o in named if o.path.is_file())
        # files of another size are not read for it
        alike = ((name, o) for name, o, path in pairs if o.path.stat().st_size == path.stat().st_size)
        same = ((name, o.name) for name, o in alike if index.digest(o.path) == index.digest(session.files / name))
        twin = next((f"{name} holds the same bytes as {other}: a copy that can go" for name, other in same), "")
        shown = ", ".join(names[:NAMED]) + (f" and {n - NAMED} more" if n > NAMED else "")
        text = f"no experiment uses {shown} ({title}{f', {n} files' if n > 1 else ''})"
        cause = twin or "an experiment lacks a recording, or the file can go"
        found.append(_finding("files that no experiment uses", text, cause, names[0], level="note"))
    return found


def of_record(session: Session, finding: Finding) -> Finding:
    """Let a step that a calibration record stopped point at that record and its line."""
    from calibration.record import load_record

    for named in named_files(session) if 'record "' in finding.message else ():
        # a file of a material is none; mistakes of a record are named by its experiment
        with contextlib.suppress(LabpipeError):
            if named.path.suffix == CONFIGURATION and f'record "{load_record(named.path).id}"' in finding.message:
                key = next((key for words, key in _OF_RECORD.items() if words in finding.message), "id")
                return replace(finding, file=named.name, setting=key)
    return finding


def _finding(
    check: str, text: str, cause: str, file: str = "", setting: str = "", *, level: Level = "doubtful"
) -> Finding:
    from labpipe.judging import Finding

    return Finding(check, level, text, cause, file, None, setting)


def _field(setting: str) -> str:
    return re.sub(r"\[\d+\]", "", setting)


def _twice(session: Session) -> _Owned:
    """Find recordings that are used twice: one file, or the same bytes in two."""
    index = Store(session.folder).index
    owners: dict[str, list[Named]] = {}
    for named in named_files(session):
        if named.path.exists() and named.path.suffix != CONFIGURATION:
            owners.setdefault(index.digest(named.path), []).append(named)  # known from the run, by size and time
    for places in owners.values():
        for number, later in enumerate(places):
            for first in places[:number]:
                is_same_file, of_one = first.path.samefile(later.path), first.experiment == later.experiment
                is_same_use = first.kind == later.kind and _field(first.setting) == _field(later.setting)
                if is_same_file and not is_same_use and not of_one:  # other kinds may look at the same file
                    continue
                text = f"{later.name} holds the same bytes as {first.name}{'' if of_one else f' of {first.experiment}'}"
                text = f"{later.name} is also a recording of {first.experiment}" if first.name == later.name else text
                cause = "one recording was taken for two" if is_same_file else "a copy was taken for a repeat"
                # of two experiments nothing says which one it belongs to
                for owner in dict.fromkeys((later.experiment, first.experiment)):
                    yield owner, _finding("same bytes twice", text, cause, later.name)
                break


def _bodies(session: Session) -> _Owned:
    """Hold masses of bodies of one radius and material against each other, and radii of bodies of one mass."""
    found: list[tuple[Experiment, str, frozenset[str], dict[str, Quantity]]] = []
    for e in session.experiments.values():
        for place, table, _ in every_setting(e.settings):
            sizes = {n: v for n in ("radius", "mass") if isinstance(v := getattr(table, n, None), Quantity)}
            if len(sizes) == 2:
                # a body without a material of its own falls on, or with, each of the others of its experiment
                sources = frozenset(_sources(table)) or frozenset(_sources(e.settings))
                found.append((e, place, sources, sizes))
    for i, (e, place, sources, sizes) in enumerate(found):
        for name, same in (("mass", "radius"), ("radius", "mass")):
            others = [
                (j, other.name, theirs[name])
                for j, (other, _, materials, theirs) in enumerate(found)
                if other is not e and materials & sources and _is_same(theirs[same], sizes[same])
            ]
            own, usual = sizes[name], _usual(sizes[name], [pair for _, *pair in others])
            if usual is None or (len(others) == 1 and others[0][0] > i):  # of two the later one is named
                continue
            factor = _slip(own, usual[1])
            if not factor and name == "radius":  # a sphere of another size
                continue
            text = f"{name} is {_written(own)} here and {_written(usual[1])} in {usual[0]}, "
            text += f"for bodies of one {same} and material"
            cause = f"the {name} of this sphere is mistyped, or another one was used: then say so"
            if factor:
                is_diameter = name == "radius" and factor == 2.0 and own.value > usual[1].value
                why = "its diameter was typed" if is_diameter else "its unit or decimal point is wrong"
                cause = f"the {name} is probably {_written(usual[1])}, a factor {factor:g}: {why}"
            yield e.name, _finding(TWO_VALUES, text, cause, setting=f"{place}.{name}")


def unusual_values(session: Session, name: str) -> list[str]:
    """Say which quantities of an experiment most others state otherwise, with the line.

    Heights and temperatures differ on purpose, unless by a misplaced decimal point.
    """
    found, lines = [], session.experiments[name].lines
    for setting, own, usual, owners in _unusual(session.without_variants(), name):
        if setting.endswith(_CONDITIONS) and _slip(own, usual) < 10.0:
            continue
        where = owners[0] if len(owners) == 1 else f"{len(owners)} other experiments"
        here = f"{setting} is {_written(own)} here (line {lines[setting]} of {FILE_NAME})"
        found.append(f"{here} and {_written(usual)} in {where}")
    return found


def _unusual(session: Session, name: str) -> Iterator[tuple[str, Quantity, Quantity, list[str]]]:
    """Yield the quantities of an experiment that more than half of the others state alike and otherwise.

    Each is setting, own and usual value, and the experiments that state the usual one.
    """
    stated: list[tuple[str, str, Quantity]] = []
    for e in session.experiments.values():
        given = [(s, v) for s, v, _ in every_setting(e.settings) if s in e.lines]  # a default has no line
        tables = {s.rpartition(".")[0] for s, v in given if isinstance(v, Quantity)} - {""}
        for setting, value in given:
            if isinstance(value, Quantity):
                stated.append((e.name, setting, value))
            elif type(value) is int and setting.rpartition(".")[0] in tables:  # a count, such as of tips
                stated.append((e.name, setting, Quantity(float(value), 0.1, "1")))
    for setting, own in [(s, v) for n, s, v in stated if n == name]:
        place = _field(setting).split(".")[-2:]
        others = [(n, v) for n, s, v in stated if n != name and _field(s).split(".")[-2:] == place]
        if (usual := _usual(own, others)) is not None:
            yield setting, own, usual[1], list(dict.fromkeys(n for n, v in others if _is_same(usual[1], v)))


def _mistyped(session: Session) -> _Owned:
    """Find quantities that several other experiments state alike, and this one nearly so or with exchanged digits."""
    for name in session.experiments:
        for setting, own, usual, owners in _unusual(session, name):
            first, second = (f"{value.value:.3e}" for value in (own, usual))
            is_exchanged = sorted(first) == sorted(second) and first[-3:] == second[-3:]
            is_near = abs(own.value - usual.value) < _NEAR * abs(usual.value)
            if len(owners) < SEVERAL or setting.endswith(_CONDITIONS) or not (is_exchanged or is_near):
                continue
            text = f"{setting} is {_written(own)} here and {_written(usual)} in {len(owners)} other experiments"
            cause = f"{setting} is probably {_written(usual)}" + ": its digits are exchanged" * is_exchanged
            level: Level = "doubtful" if is_exchanged else "note"
            yield name, _finding("mistyped value", text, cause, setting=setting, level=level)


def _sources(settings: Any) -> Iterator[str]:
    """Yield the names, files and experiments that state materials of a table and all in it; the most exact of each."""
    for _, table, _ in every_setting(settings):
        given = [getattr(table, name, None) for name in ("material_from", "material_file", "material")]
        yield from [source for source in given if isinstance(source, str)][:1]


def _is_same(a: Quantity, b: Quantity, within: float = 2.0) -> bool:
    """Return whether two stated values are one within some of their standard uncertainties, or usual ones."""
    return abs(a.value - b.value) <= within * hypot(a.u or usual_uncertainty(a), b.u or usual_uncertainty(b))


def _usual(own: Quantity, values: Sequence[Sequence[Any]]) -> tuple[str, Quantity] | None:
    """Return the value, with its owner, with which more than half of some others agree; None where the own does too."""
    from labpipe.judging import DOUBTFUL

    for owner, usual in values:
        if 2 * sum(_is_same(usual, value) for _, value in values) > len(values):
            return None if _is_same(own, usual, DOUBTFUL) else (owner, usual)
    return None


def _slip(value: Quantity, expected: Quantity) -> float:
    """Return the factor of a typing error between two values; 0 for none."""
    from labpipe.judging import SLIPS

    ratio = value.value / expected.value
    return next((f for f in SLIPS["value"] if f > 1 and ratio > 0 and abs(abs(log(ratio)) - log(f)) < _SLIP), 0.0)


def _written(value: Quantity) -> str:
    from labpipe.report import quantity

    return f"{value.value:.4g}" if value.si == "1" else quantity(value.value, value.si, 4)


def _material_names(session: Session) -> _Owned:
    """Hold stated materials against the names of experiment and files; where none is stated, names against names."""
    known = set(library_names())
    for e in session.experiments.values():
        places = {v: s for s, v, _ in every_setting(e.settings) if s.rpartition(".")[2] == "material" and v in known}
        named = [
            (place, name, words)
            for place, name in (("", e.name), *files_of(e.settings))
            if (words := known.intersection(re.split(r"[^a-z]+", name.lower())))
        ]
        _, name, own = next((one for one in named if len(one[2]) == 1), ("", "", set[str]()))
        head, right = f"{name} is named after {' and '.join(own)}", own
        if places:
            head, right = f'the material is "{" and ".join(places)}"', set(places)
        wrong = [one for one in named if one[2].isdisjoint(right)] if right else []
        if wrong and (len(wrong) == len(named) or not places):
            place, name, words = wrong[0]
            other = " and ".join(sorted(words))
            text = f"{head}, but {name} is named after {other}"
            cause = f"one of them is of another material, {other} probably, or the name is misleading"
            setting = next(iter(places.values()), place)
            yield e.name, _finding("name of the material", text, cause, setting=setting)


def _temperatures(session: Session) -> _Owned:
    """Find kelvin under degrees; a reference is held against the temperatures that were measured, by its kind."""
    for e in session.experiments.values():
        for setting, value, _ in every_setting(e.settings):
            if not isinstance(value, Quantity) or value.si != "degC" or setting.rpartition(".")[2] == "T_ref":
                continue
            number = value.value
            if number < -150.0 or 250.0 <= number <= 400.0:
                off = -ZERO_CELSIUS if number > 0.0 else ZERO_CELSIUS
                meant = f"{number:g} K = " * (number > 0.0) + f"{number + off:.4g} °C"
                text, cause = f"{counted(setting)} is {number:.4g} °C", f"{meant} is meant: its unit is wrong"
                yield e.name, _finding("unit of the temperature", text, cause, setting=setting)


_CHECKS = (_twice, _bodies, _mistyped, _material_names, _temperatures)
SESSION_CHECKS = len((*_CHECKS, unused_files))
"""Number of checks of a session as a whole."""
