"""What only the session as a whole can tell: files under two names, records, bodies, names.

Every check holds what one experiment states against the others, or against the names that the
laboratory gave its files. None opens a recording: digests are those of the run.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe.errors import LabpipeError
from labpipe.units import Quantity
from labpipe.workflow.fields import POSITIVE, FileMark, Range, every_setting, mark, options_of
from labpipe.workflow.session import Experiment, Session
from labpipe.workflow.store import Store
from pipelines.session._gaps import library_names
from pipelines.session._stated_alike import bodies, finding, plates, written

if TYPE_CHECKING:
    from calibration.record import Record
    from labpipe.judging import Finding

_CONFIGURATION = ".toml"
"""Ending of records and materials: those are meant to serve several experiments."""
_UNKNOWN = 0.5  # of a value, beyond which its uncertainty is no uncertainty
_KELVIN, _IN_KELVIN, _COLD = 273.15, (250.0, 400.0), -150.0
"""Degrees that are a laboratory's temperatures in K, and below which K was written for degrees."""
_OF_RECORD = {
    "it expired": "valid_until",
    "was not yet valid": "valid_from",
    "belongs to": "view",
    "expected a record": "kind",
    "the readings come from": "instrument",
}
"""What the refusal of a calibration record says, and the line of the record that it speaks of."""
Found = dict[str, list["Finding"]]
"""Findings by the experiment that they concern."""


@dataclass(frozen=True, slots=True)
class Named:
    """A file that an experiment names: the setting, the name as written, and the file."""

    experiment: str
    kind: str
    setting: str
    name: str
    path: Path


def session_findings(session: Session) -> Found:
    """Check a session as a whole; findings have file and setting."""
    found: Found = {}
    for check in _CHECKS:
        for owner, told in check(session):
            found.setdefault(owner, []).append(told)
    return found


def named_files(session: Session) -> list[Named]:
    """Return every file and folder that the settings name, in the order of the session."""
    return [
        Named(e.name, e.kind, setting, name, session.root / name)
        for e in session.experiments.values()
        for setting, name in _files(e.settings)
    ]


def _files(settings: Any) -> Iterator[tuple[str, str]]:
    return (
        (place, value)
        for place, value, kind in every_setting(settings)
        if isinstance(value, str) and any(mark(marks, FileMark) for _, marks in options_of(kind))
    )


def _twice(session: Session) -> Iterator[tuple[str, Finding]]:
    """Find recordings that are used twice: one file, or the same bytes in two."""
    index = Store(session.folder).index
    owners: dict[str, list[Named]] = {}
    for named in named_files(session):
        if named.path.exists() and named.path.suffix != _CONFIGURATION:
            digest = index.digest(named.path)  # known from the run, by size and time
            owners.setdefault(digest, []).append(named)
    for places in owners.values():
        for number, later in enumerate(places[1:], 1):
            first = _rival(places[:number], later)
            if first is not None:
                # of two experiments nothing tells which one it belongs to
                for owner in dict.fromkeys((later.experiment, first.experiment)):
                    yield owner, _copy(first, later)


def _rival(before: Sequence[Named], later: Named) -> Named | None:
    """Return what already stands for a recording: other kinds may look at the same file."""
    for first in before:
        is_same_file = first.path.samefile(later.path)
        is_same_use = first.kind == later.kind and _field(first.setting) == _field(later.setting)
        if not is_same_file or is_same_use or first.experiment == later.experiment:
            return first
    return None


def _field(setting: str) -> str:
    return re.sub(r"\[\d+\]", "", setting)


def _copy(first: Named, later: Named) -> Finding:
    of_other = f" of {first.experiment}" if first.experiment != later.experiment else ""
    if first.name == later.name:
        text = f"{later.name} is listed again" if not of_other else f"{later.name} is also a recording{of_other}"
        cause = "one recording was taken for two"
    elif first.path.samefile(later.path):
        text = f"{later.name} and {first.name}{of_other} are one file, the same bytes under two names"
        cause = "one recording was taken for two"
    else:
        text = f"{later.name} holds the same bytes as {first.name}{of_other}"
        cause = "a copy was taken for a repeat"
    return finding("same bytes twice", "doubtful", text, cause, later.name)


def _records(session: Session) -> Iterator[tuple[str, Finding]]:
    """Hold calibration records against each other, and their day against their period.

    Whether a record was valid on the day of a recording, and is of its sensor, is asked where it
    is applied.
    """
    users: dict[str, list[str]] = {}
    for named in named_files(session):
        if named.path.suffix == _CONFIGURATION:
            users.setdefault(named.path.resolve().relative_to(session.root).as_posix(), []).append(named.experiment)
    records = {name: record for name in users if (record := _record(session.root / name)) is not None}
    for name, record in records.items():
        if record.when > record.valid_until:
            text = f"{name}: calibrated on {record.when}, after the record ended ({record.valid_until})"
            for owner in dict.fromkeys(users[name]):
                cause = "a day of the record is mistyped, or an older record was copied"
                yield owner, finding("calibration record", "doubtful", text, cause, name, "when")
    for (name, record), (other, twin) in combinations(records.items(), 2):
        if record.id == twin.id and record != twin:
            text = f'{name} and {other} have the same id, "{record.id}", but differ'
            cause = "one of the two records is out of date"
            for owner in dict.fromkeys(users[other]):
                yield owner, finding("calibration record", "doubtful", text, cause, other, "id")


def _record(path: Path) -> Record | None:
    from calibration.record import load_record

    try:
        return load_record(path)
    except LabpipeError:  # a file of a material; or a record whose mistakes its experiment tells
        return None


def of_record(session: Session, finding: Finding) -> Finding:
    """Let a step that a calibration record stopped point at that record and its line."""
    if 'record "' not in finding.message:
        return finding
    for named in named_files(session):
        record = _record(named.path) if named.path.suffix == _CONFIGURATION else None
        if record is not None and f'record "{record.id}"' in finding.message:
            key = next((key for words, key in _OF_RECORD.items() if words in finding.message), "id")
            return replace(finding, file=named.name, setting=key)
    return finding


def _material_names(session: Session) -> Iterator[tuple[str, Finding]]:
    """Hold the material that is stated against the one that names of experiment and files tell."""
    known = set(library_names())
    for e in session.experiments.values():
        named = [("", e.name), *_files(e.settings)]
        # a table in a list that states a material of its own has files of its own
        tables = {setting.rpartition(".")[0] for setting, _ in _materials(e.settings) if "[" in setting}
        for table in sorted(tables):
            yield from _named_alike(e, [p for p in named if p[0].startswith(f"{table}.")], known, table)
        rest = [p for p in named if not any(p[0].startswith(f"{table}.") for table in tables)]
        yield from _named_alike(e, rest, known, "")


def _named_alike(
    e: Experiment, places: Sequence[tuple[str, str]], known: set[str], table: str
) -> Iterator[tuple[str, Finding]]:
    """Hold names, each with its setting, against the material of their table, else against each other."""
    names = [name for _, name in places]
    materials = [(setting, m) for setting, m in _materials(e.settings) if m in known]
    stated = [pair for pair in materials if ("[" not in pair[0] if not table else pair[0].startswith(f"{table}."))]
    for setting, material in stated:
        told = next((name for name in names if _words(name) & known), "")
        if told and not any(material in _words(name) for name in names):
            yield e.name, _misnamed(f'the material is "{material}"', told, known, setting)
    first = next((name for name in names if len(_words(name) & known) == 1), "")
    for setting, name in () if stated or not first else places:
        if _words(name) & known and not _words(name) & _words(first) & known:
            yield (
                e.name,
                _misnamed(f"{first} is named after {', '.join(_words(first) & known)}", name, known, setting),
            )
            break


def _misnamed(what: str, name: str, known: set[str], setting: str) -> Finding:
    other = " and ".join(sorted(_words(name) & known))
    cause = f"one of them is of another material, {other} probably, or the name is misleading"
    text = f"{what}, but {name} is named after {other}"
    return finding("name of the material", "doubtful", text, cause, setting=setting)


def _words(name: str) -> set[str]:
    return set(re.split(r"[^a-z]+", name.lower()))


def _materials(settings: Any) -> Iterator[tuple[str, str]]:
    found = ((where, v) for where, v, _ in every_setting(settings) if where.rpartition(".")[2] == "material")
    return ((where, value) for where, value in found if isinstance(value, str))


def _uncertainties(session: Session) -> Iterator[tuple[str, Finding]]:
    """Find positive quantities whose stated uncertainty says that nothing is known of them."""
    for e in session.experiments.values():
        for setting, value, kind in _quantities(e.settings):
            is_positive = any(mark(marks, Range) == POSITIVE for _, marks in options_of(kind))
            if is_positive and value.u > _UNKNOWN * value.value:
                name = setting.rpartition(".")[2].replace("_", " ")
                text = f"the {name} is {written(value)} with a standard uncertainty of {written(value, value.u)}"
                cause = "the unit or the decimal point of the uncertainty is wrong"
                yield e.name, finding("stated uncertainty", "doubtful", text, cause, setting=setting)


def _temperatures(session: Session) -> Iterator[tuple[str, Finding]]:
    """Find temperatures in another unit than is written, where no polymer is tested."""
    for e in session.experiments.values():
        for setting, value, _ in _quantities(e.settings):
            # a reference is held against the temperatures that were measured, by its kind
            if value.si != "degC" or setting.rpartition(".")[2] == "T_ref":
                continue
            T, meant = value.value, ""
            if _IN_KELVIN[0] <= T <= _IN_KELVIN[1]:
                meant = f"{T:g} K = {T - _KELVIN:.4g} °C"
            elif T < _COLD:
                meant = f"{T + _KELVIN:.4g} °C"
            if meant:
                text = f"{setting} is {T:.4g} °C"
                cause = f"{meant} is meant: its unit is wrong"
                yield e.name, finding("unit of the temperature", "doubtful", text, cause, setting=setting)


def _quantities(settings: Any) -> Iterator[tuple[str, Quantity, Any]]:
    return ((where, value, kind) for where, value, kind in every_setting(settings) if isinstance(value, Quantity))


def named_at(session: Session) -> Mapping[str, int]:
    """Return the line of session.toml that names each file, by the name as it is written."""
    found: dict[str, int] = {}
    for named in named_files(session):
        lines = session.experiments[named.experiment].lines
        line = lines.get(named.setting, lines.get(_field(named.setting)))
        if line is not None:
            found.setdefault(named.name, line)
    return found


_CHECKS = (_twice, _records, bodies, plates, _material_names, _uncertainties, _temperatures)
SESSION_CHECKS = len(_CHECKS)
"""How many checks a session as a whole is given, beside those of its experiments."""
