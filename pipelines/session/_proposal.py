"""From a folder of instrument files to a first session.toml, commented, with gaps to fill in.

Instruments are recognised by content. Every kind of experiment is offered the files of the
instruments that it knows; those of other distributions first, then ours from the special to the
general. What no file tells is asked for, or written as a gap; an experiment waits until its gaps
are filled. A calibration record that is missing is proposed as a file of its own.
"""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Set
from dataclasses import dataclass, replace
from pathlib import Path

import instruments
from labpipe import files
from labpipe.errors import LabpipeError, SourceError, UsageError
from labpipe.names import name_problem, printable
from labpipe.notebook import html_table, text_table
from labpipe.workflow.session import FILE_NAME, VERSION
from pipelines.experiments import KINDS, Found, Proposal, Proposed, function
from pipelines.experiments.shared.proposals import GAP, identifier, quoted
from pipelines.session._gaps import Gap, filled


@dataclass(frozen=True, slots=True)
class Scan:
    """What :func:`init` wrote: the file, its experiments, and what is to fill in.

    ``records`` are calibration records that were proposed; ``unused`` names files of a known
    instrument that no proposed experiment takes.
    """

    path: Path
    experiments: list[str]
    gaps: list[str]
    records: list[Path]
    unused: list[str]

    def __repr__(self) -> str:
        return text_table(self._caption, [(name,) for name in self.experiments])

    def _repr_html_(self) -> str:
        rows = [("experiment", name) for name in self.experiments]
        rows += [("to fill in", line) for line in self.gaps]
        rows += [("not used", line) for line in self.unused]
        return html_table(self._caption, ("", ""), rows)

    @property
    def _caption(self) -> str:
        n, missing = len(self.experiments), len(self.gaps)
        return f"{self.path}: {n} experiment{'s' * (n != 1)}, {missing} value{'s' * (missing != 1)} to fill in"


def init(
    folder: str | Path,
    *,
    replace: bool = False,
    ask: Callable[[Gap], str | None] | None = None,
    template: Iterable[str] = (),
) -> Scan:
    """Scan a folder of instrument files and write a commented session.toml.

    Parameters
    ----------
    folder : path-like
        The session folder.
    replace : bool
        Replace a session.toml that is already there.
    ask : callable, optional
        Returns the answer to a question that no file answers, or None to leave it open.
    template : iterable of str
        Kinds of experiment to write down with every value still to come, instead of a scan; for a
        session that is to be recorded, whose folder is made where it is not there.

    Returns
    -------
    Scan
        The file, its experiments, and what is to fill in.

    Raises
    ------
    UsageError
        There is a session.toml, there is no such folder or it holds no file of a known instrument, or there
        is no such kind.

    Examples
    --------
    >>> init("my-session")  # doctest: +SKIP
    my-session/session.toml: 2 experiments, 3 values to fill in
      acrylic_7mm
      nbr_hold
    """
    folder = Path(folder)
    path = folder / FILE_NAME
    if path.exists() and not replace:
        raise UsageError(f"{path} exists already; edit it, or use --force to replace it")
    if kinds := list(template):
        return _from_template(path, kinds, ask)
    if not folder.is_dir():
        raise UsageError(f"{folder}: there is no such folder; with --template one is made for a session to be recorded")
    found = _with_folders(recognise(folder))
    begun = {n: (folder / n).read_text("utf-8") for n in _records(found)}
    records, completed = _with_missing_records(found)
    text, names = propose(completed)
    if not names:
        raise UsageError(_nothing_proposed(found))
    texts = {FILE_NAME: text, **records, **{n: t for n, t in begun.items() if GAP in t}}
    if ask is not None:
        texts = {name: filled(content, ask, _owner(name)) for name, content in texts.items()}
    for name in reversed(texts):  # session.toml last: with it, the folder is a session
        if texts[name] != begun.get(name):
            files.write_text(folder / name, texts[name])
    return Scan(path, names, _gaps_in(texts), [folder / name for name in records], _unused_files(found, text))


def _from_template(path: Path, kinds: list[str], ask: Callable[[Gap], str | None] | None) -> Scan:
    """Write the tables of some kinds, without looking at any file."""
    from pipelines.session._template import template

    sections, names = template(kinds)
    text = "\n\n".join([_head(path.parent), *sections]) + "\n"
    text = text if ask is None else filled(text, ask)
    files.write_text(path, text)
    return Scan(path, names, _gaps_in({FILE_NAME: text}), [], [])


def _gaps_in(texts: Mapping[str, str]) -> list[str]:
    return [
        f"{name}:{number}: {line.strip()}"
        for name, content in texts.items()
        for number, line in enumerate(content.splitlines(), 1)
        if GAP in line and not line.lstrip().startswith("#")
    ]


def _unused_files(found: Found, text: str) -> list[str]:
    """Name every file that the text does not, with the reason; what is alike in one line."""
    lines: list[str] = []
    copies: dict[tuple[str, str, Path], list[str]] = {}
    for name, (title, reason) in found.owners.items():
        if f'"{quoted(name)}"' in text:
            continue
        if name in found.copies:
            first = Path(found.copies[name])
            copies.setdefault((title, Path(name).parent.as_posix(), first.parent), []).append(name)
        else:
            told = _unreadable(found.folder / name) or reason
            lines.append(f"{_shown(found.folder, name)} ({title}): {told}")
    for (title, place, first_place), names in copies.items():
        if len(names) == 1:
            lines.append(f"{names[0]} ({title}): {found.owners[names[0]][1]}")
        else:
            kept = f"{first_place.as_posix()}/" if first_place != Path() else "the session folder"
            lines.append(f"{len(names)} files in {place}/ ({title}): copies of those in {kept}")
    alike: dict[tuple[Path, str, str], list[str]] = {}
    for name in found.unknown:
        why = why_unknown(found.folder, name)
        alike.setdefault((Path(name).parent, Path(name).suffix.lower(), why), []).append(name)
    for (_, _, why), names in alike.items():
        more = f" and {len(names) - 1} more beside it" if len(names) > 1 else ""
        lines.append(f"{printable(names[0])}{more}: {why}")
    return lines


def _shown(folder: Path, name: str) -> str:
    return f"{name}/" if (folder / name).is_dir() else name


UNKNOWN = "no instrument recognises the content"
_ZEROS = "it begins with zeros only, as a copy that broke off leaves it; copy it again from the instrument"
LINK = "a link that leads out of the folder"
PICTURE = "a picture; one of a ruler in the plane of focus gives the image scale of a camera record"
_PICTURES = {".jpg", ".jpeg", ".png", ".bmp"}


def why_unknown(folder: Path, name: str) -> str:
    """Say why nothing is known of a file: its name, :data:`LINK`, :data:`PICTURE`, no content, or :data:`UNKNOWN`."""
    if (problem := name_problem(name)) is not None:
        return f"{problem}; rename it"
    if _leads_out(folder / name, folder):
        return LINK
    if Path(name).suffix.lower() in _PICTURES:
        return PICTURE
    return _nothing_in(folder / name) or UNKNOWN


def _nothing_in(path: Path) -> str:
    """Say so of a file without a byte, or with zeros where every instrument writes its head."""
    try:
        with path.open("rb") as stream:
            head = stream.read(instruments.HEAD_BYTES) if path.is_file() else b"?"
    except OSError:
        return ""
    return "the file is empty" if not head else "" if head.strip(b"\0") else _ZEROS


def _leads_out(path: Path, folder: Path) -> bool:
    try:
        return not path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError):  # links in a circle
        return True


def wholes(folder: Path) -> dict[Path, instruments.Instrument]:
    """Return folders that are one recording, such as a film in images."""
    below = (p for p in folder.rglob("*") if p.is_dir() and not _is_ours(p, folder) and not _leads_out(p, folder))
    places = [folder, *sorted(below)]
    names = {place: _instrument(place) for place in places}
    return {place: instruments.by_name(name) for place, name in names.items() if name is not None}


def _with_folders(found: Found) -> Found:
    """Take a folder that is one recording as that, and not the files in it."""
    whole = {p.relative_to(found.folder).as_posix(): each for p, each in wholes(found.folder).items()}

    def alone(names: Iterable[str]) -> list[str]:
        return [name for name in names if Path(name).parent.as_posix() not in whole]

    names = {sort: alone(own) for sort, own in found.names.items()}
    for name, each in whole.items():
        for sort in (each.name, *(() if each.unproposed else (each.content,))):
            names.setdefault(sort, []).append(name)
    owners = {name: found.owners[name] for name in alone(found.owners)}
    owners |= {name: (each.title, _why_not(each)) for name, each in whole.items()}
    return replace(found, names=names, owners=owners, unknown=tuple(alone(found.unknown)))


def _owner(name: str) -> str:
    """Name a calibration record in questions; session.toml's tables are named already."""
    return "" if name == FILE_NAME else f"calibration of {Path(name).stem.replace('_', ' ')}"


def _records(found: Found) -> list[str]:
    return [n for kind, names in found.names.items() if kind.startswith("record:") for n in names]


def _proposals() -> list[Proposal]:
    return [kind.proposal for kind in KINDS.values() if kind.proposal is not None]


def _with_missing_records(found: Found) -> tuple[dict[str, str], Found]:
    """Return the records that the kinds propose, by name, and what was found with them."""
    records: dict[str, str] = {}
    names = dict(found.names)
    for text in dict.fromkeys(proposal.records for proposal in _proposals() if proposal.records):
        for sort, made in function(text)(found).items():
            names[sort] = [*names.get(sort, []), *made]
            records |= made
    return records, replace(found, names=names, texts=records)


def recognise(folder: Path) -> Found:
    """Return what the files of a folder are: of which instrument, what they hold, which records."""
    found: dict[str, list[str]] = {}
    owners: dict[str, tuple[str, str]] = {}
    copies: dict[str, str] = {}
    unknown: list[str] = []
    for path in _candidates(folder):
        name = path.relative_to(folder).as_posix()
        if _leads_out(path, folder) or name_problem(name):
            unknown.append(name)
        elif path.suffix == ".toml":
            if (kind := _record_kind(path)) is not None:
                found.setdefault(kind, []).append(name)
                owners[name] = (kind.replace("_", " "), "no experiment names it")
            else:
                unknown.append(name)
        elif (instrument := _instrument(path)) is not None:
            found.setdefault(instrument, []).append(name)
        else:
            unknown.append(name)
    for each in instruments.known():
        own = copies_among(folder, found.get(each.name, []))
        if each.name in found:
            found[each.name] = [name for name in found[each.name] if name not in own]
        owners |= {name: (each.title, f'a copy of "{first}"') for name, first in own.items()}
        copies |= own
        for name in found.get(each.name, []):
            owners[name] = (each.title, _why_not(each))
            if not each.unproposed:
                found.setdefault(each.content, []).append(name)
    return Found(folder, found, owners, unknown=tuple(unknown), copies=copies)


def recognised_below(folder: Path, used: Set[Path]) -> Iterator[tuple[str, str]]:
    """Yield name and title of each record and file of a known instrument that is not among some paths, nor below.

    Those of a session within the folder, as of a copy, are its own.
    """
    titles = {each.name: each.title for each in instruments.known()}
    is_session: dict[Path, bool] = {}
    for path in _candidates(folder):
        name, whole = path.relative_to(folder).as_posix(), path.resolve()
        between = path.parents[: len(path.relative_to(folder).parts) - 1]
        for place in between:
            if place not in is_session:
                is_session[place] = (place / FILE_NAME).is_file()
        if any(is_session[place] for place in between):  # what belongs to another session
            continue
        if not used.isdisjoint((whole, *whole.parents)) or _leads_out(path, folder) or name_problem(name):
            continue
        kind = _record_kind(path) if path.suffix == ".toml" else _instrument(path)
        if kind is not None:
            yield name, titles.get(kind, kind.replace("_", " "))


_COPY = re.compile(r"kopie|cop(?:y|ie)|backup|sicherung|\bold\b|\balt\b|\(\d+\)", re.IGNORECASE)


def copies_among(folder: Path, names: Iterable[str]) -> dict[str, str]:
    """Find files of a folder with equal content: every copy to the file that counts as the first.

    That is the one whose name does not speak of a copy, then the one in the folder with most different recordings,
    where its repeats lie, then the one with the shorter path.
    """
    names = list(names)
    groups = [
        equal
        for same_size in _alike(names, lambda name: (folder / name).stat().st_size)
        for begins_alike in _alike(same_size, lambda name: _begin(folder / name))
        for equal in _alike(begins_alike, lambda name: files.digest(folder / name))
    ]
    different = Counter(Path(name).parent for name in names)
    for equal in groups:
        here = Counter(Path(name).parent for name in equal)
        different -= here - Counter(here.keys())
    copies: dict[str, str] = {}
    for equal in groups:
        first, *others = sorted(
            equal, key=lambda n: (bool(_COPY.search(n)), -different[Path(n).parent], n.count("/"), len(n), n)
        )
        copies |= dict.fromkeys(others, first)
    return copies


def _alike(names: Iterable[str], trait: Callable[[str], object]) -> list[list[str]]:
    """Group names by a trait, and leave out those that stand alone."""
    groups: dict[object, list[str]] = {}
    for name in names:
        groups.setdefault(trait(name), []).append(name)
    return [group for group in groups.values() if len(group) > 1]


_BEGIN = 1 << 20  # bytes that tell most films apart


def _begin(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.sha256(stream.read(_BEGIN)).hexdigest()


_UNTOLD: dict[instruments.Content, str] = {
    "displacement": "the kind of experiment does not follow from it alone; add it by hand",
    "force": "it holds neither an oscillation nor a relaxation; add it by hand",
    "film": "neither its content nor its name tells the kind of experiment; add it by hand, exported images with "
    "frame_rate: labpipe init --template KIND writes its lines",
    "sweep": "it holds no moduli over frequency; add it by hand",
    "displacement_field": "no kind of experiment uses it",
}


def _why_not(instrument: instruments.Instrument) -> str:
    """Say why a file of an instrument is in no proposed experiment, and which kinds may begin from it."""
    able = [
        f"{k.name} ({k.summary})" for k in KINDS.values() if k.proposal and instrument.content in k.proposal.contents
    ]
    is_told = able and (instrument.unproposed or instrument.content == "film")
    kinds = f"; kinds that begin from it: {', '.join(able)}" * bool(is_told)
    return f"{instrument.unproposed or _UNTOLD[instrument.content]}{kinds}"


def _unreadable(path: Path) -> str:
    """Say why a table cannot be read as it stands; "" of others, whose films may take long."""
    name = _instrument(path)
    each = next((known for known in instruments.known() if known.name == name), None)
    if each is None or each.content not in {"sweep", "displacement", "force"}:
        return ""
    try:
        instruments.read(path)
    except SourceError as error:
        line = f"line {error.line}: " if error.line else ""
        return f"{line}{error.message}. {error.hint or ''}".strip()
    except LabpipeError:
        return ""
    return ""


def _remedy(path: Path) -> str:
    """Say what to do with a file that no instrument recognises."""
    try:
        instruments.identify(path)
    except SourceError as error:
        return error.hint or ""
    return ""


def _nothing_proposed(found: Found) -> str:
    """Say what was found and why no experiment begins from it; or that nothing is known."""
    folder = found.folder
    of_reason: dict[tuple[str, str], list[str]] = {}
    for name, why in found.owners.items():
        told = _unreadable(folder / name) or why[1]
        of_reason.setdefault((why[0], told), []).append(_shown(folder, name))
    if not of_reason:
        known = ", ".join(each.name for each in instruments.known())
        remedies = [f"{name}: {hint}" for name in found.unknown if (hint := _remedy(folder / name))]
        nothing = f"{folder}: no file of a known instrument was found; known are {known}. Is it the right folder?"
        return "\n  ".join([nothing, *remedies[:1]])
    lines = [f"{folder}: no experiment is proposed"]
    for (title, reason), names in of_reason.items():
        more = f" and {len(names) - 1} more" if len(names) > 1 else ""
        lines.append(f"{names[0]}{more} ({title}): {reason}")
    return "\n  ".join(lines)


def _candidates(folder: Path) -> Iterator[Path]:
    for path in files.files_below(folder):
        if not _is_ours(path, folder):
            yield path


def _is_ours(path: Path, folder: Path) -> bool:
    """Tell whether a path is hidden, or of labpipe itself."""
    parts = path.relative_to(folder).parts
    written = (at for at, part in enumerate(parts[:-1], 1) if part in {"labpipe", "truth"})
    is_written = any(folder.joinpath(*parts[: at - 1], FILE_NAME).is_file() for at in written)
    return any(p.startswith(".") for p in parts) or parts[0] in {"labpipe", "truth", FILE_NAME} or is_written


def _instrument(path: Path) -> str | None:
    try:
        return instruments.identify(path)
    except LabpipeError:
        return None


def _record_kind(path: Path) -> str | None:
    """Name the kind that a record claims; an incomplete one is a record that has gaps."""
    from calibration import KINDS
    from labpipe.workflow.document import parse

    try:
        kind = parse(path).tree.get("kind")
    except LabpipeError:
        return None
    return f"record:{kind}" if isinstance(kind, str) and kind in KINDS else None


def propose(found: Found) -> tuple[str, list[str]]:
    """Return the text of session.toml and the names of the proposed experiments."""
    names: list[str] = []
    sections = [_head(found.folder)]
    for content in dict.fromkeys(name for p in _proposals() for name in p.contents):
        for each in instruments.known():
            if each.content != content or each.unproposed:
                continue
            made = _of_instrument(found, each.name, content)
            for proposed in sorted(made, key=lambda made: made.stem):
                name = _unused(identifier(proposed.stem), names)
                names.append(name)
                sections += ["", proposed.text(name)]
    return "\n".join(sections) + "\n", names


def _head(folder: Path) -> str:
    title = f'title = "{quoted(folder.resolve().name)}"'
    return f'labpipe = {VERSION}  # version of this file\'s format\n\n[session]\n{title}\noperator = ""\nnotes = ""'


def _of_instrument(found: Found, instrument: str, content: str) -> Iterator[Proposed]:
    """Offer the files of an instrument to one kind after the other."""
    left = found.of(instrument)
    for proposal in reversed(_proposals()):
        if content in proposal.contents:
            for proposed in function(proposal.function)(found, left):
                left = [name for name in left if name not in proposed.files]
                yield proposed


def _unused(name: str, names: list[str]) -> str:
    number, wanted = 2, name
    while name in names:
        name, number = f"{wanted}_{number}", number + 1
    return name
