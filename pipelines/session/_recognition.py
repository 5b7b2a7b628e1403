"""The files of a folder: the instrument that wrote each, by its content, the copies, and why others are of no use."""

from __future__ import annotations

import hashlib
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Set
from datetime import UTC, datetime
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import instruments
from instruments import photron
from labpipe import files
from labpipe.errors import InputError, LabpipeError, SourceError
from labpipe.files import name_problem, printable, safe_join
from labpipe.workflow.document import parse, texts_in
from labpipe.workflow.session import FILE_NAME
from pipelines.experiments import KINDS, Found

UNKNOWN = "no instrument recognises the content"
COLUMNS = "columns = "
"""Begins the line to copy that the advice on an unknown table ends with."""
PICTURE = "a picture; one of a ruler in the plane of focus gives the image scale of a camera record"
_ZEROS = "it begins with zeros only, as a copy that broke off leaves it; copy it again from the instrument"
_UNUSED: dict[instruments.Content, str] = {
    "displacement": "the kind of experiment does not follow from it alone; add it by hand",
    "force": "it holds neither an oscillation nor a relaxation; add it by hand",
    "film": "neither its content nor its name tells the kind of experiment; add it by hand, exported images with "
    "frame_rate: labpipe init --template KIND writes its lines",
    "sweep": "it holds no moduli over frequency; add it by hand",
    "displacement_field": "no kind of experiment uses it",
}
_FRAMES = {".png", ".tif", ".tiff", ".bmp"}
_PICTURES = {".jpg", ".jpeg", ".png", ".bmp"}
_COPY = re.compile(r"kopie|cop(?:y|ie)|backup|sicherung|\bold\b|\balt\b|\(\d+\)", re.IGNORECASE)
_BEGIN = 1 << 20  # bytes in which most films differ


def recognise(folder: Path) -> Found:
    """Return the instrument and content of the files of a folder, and its calibration records.

    A folder that is one recording, such as a film in images, counts as that, and not the files in it.
    """
    found: dict[str, list[str]] = {}
    owners: dict[str, tuple[str, str]] = {}
    unknown, copies = list[str](), dict[str, str]()
    below = (p for p in folder.rglob("*") if p.is_dir() and not _is_ours(p, folder) and not _leads_out(p, folder))
    whole = {place: name for place in sorted(below) if (name := instrument_of(place)) is not None}
    for path in (path for path in _candidates(folder) if path.parent not in whole):
        name, sort = path.relative_to(folder).as_posix(), None
        if not (_leads_out(path, folder) or name_problem(name) or _is_loose_frame(folder, name)):
            sort = _sort_of(path)
        if sort is None:
            unknown.append(name)
        elif sort != "photron" or path.suffix.lower() == ".mraw" or photron.frames_of(path) is None:
            found.setdefault(sort, []).append(name)  # the frames of a Photron film stand for it
            owners[name] = (sort.replace("_", " "), "no experiment names it")
    for each in instruments.known():
        own = copies_among(folder, found.get(each.name, []))
        kept = [name for name in found.get(each.name, []) if name not in own]
        kept += [p.relative_to(folder).as_posix() for p, name in whole.items() if name == each.name]
        found |= {each.name: kept} if kept else {}
        if kept and not each.unproposed:
            found[each.content] = [*found.get(each.content, []), *kept]
        able = [f"{k.name} ({k.summary})" for k in KINDS.values() if k.proposal and each.content in k.proposal.contents]
        why_not = each.unproposed or _UNUSED[each.content]
        if able and (each.unproposed or each.content == "film"):
            why_not += f"; kinds that begin from it: {', '.join(able)}"
        owners |= {name: (each.title, f'a copy of "{first}"') for name, first in own.items()}
        owners |= dict.fromkeys(kept, (each.title, why_not))
        copies |= own
    return Found(folder, found, owners, unknown=tuple(unknown), copies=copies)


def recognised_below(folder: Path, used: Set[Path]) -> Iterator[tuple[str, str]]:
    """Yield name and title of each record and file of a known instrument that is not among some paths, nor below.

    Those of a session within the folder, as of a copy, are its own.
    """
    titles = {each.name: each.title for each in instruments.known()}
    paths = list(_candidates(folder))
    others = {path.parent for path in paths if path.name == FILE_NAME}
    for path in paths:
        name, whole = path.relative_to(folder).as_posix(), path.resolve()
        is_used = not used.isdisjoint((whole, *whole.parents)) or not others.isdisjoint(path.parents)
        if is_used or _leads_out(path, folder) or name_problem(name):
            continue
        if (sort := _sort_of(path)) is not None:
            yield name, titles.get(sort, sort.replace("_", " "))


def copies_among(folder: Path, names: Iterable[str]) -> dict[str, str]:
    """Find files of a folder with equal content: every copy to the file that counts as the first.

    That is the one whose name does not speak of a copy, then the one with the shorter path.
    """

    def begin(name: str) -> str:
        with (folder / name).open("rb") as stream:
            return hashlib.sha256(stream.read(_BEGIN)).hexdigest()

    traits: tuple[Callable[[str], Any], ...]
    traits = lambda n: (folder / n).stat().st_size, begin, lambda n: files.digest(folder / n)
    groups = [sorted(names, key=lambda n: (bool(_COPY.search(n)), n.count("/"), len(n), n))]
    for trait in traits:  # each is asked only of files that are alike so far
        known = [sorted((trait(n), i, n) for i, n in enumerate(group)) for group in groups if len(group) > 1]
        groups = [[n for *_, n in alike] for one in known for _, alike in groupby(one, key=lambda row: row[0])]
    return {copy: first for first, *copies in groups for copy in copies}


def alike_unknown(found: Found) -> dict[tuple[str, str, str], list[str]]:
    """Gather files of which nothing is known by folder, ending and reason (:func:`why_unknown`)."""
    alike: dict[tuple[str, str, str], list[str]] = {}
    for name in found.unknown:
        key = (Path(name).parent.as_posix(), Path(name).suffix.lower(), why_unknown(found.folder, name))
        alike.setdefault(key, []).append(name)
    return alike


def why_unknown(folder: Path, name: str) -> str:
    """Say why nothing is known of a file: its name, a link, a loose frame, a picture, no content, or no instrument."""
    path, suffix = folder / name, Path(name).suffix.lower()
    if (problem := name_problem(name)) is not None:
        return f"{problem}; rename it"
    if _leads_out(path, folder):
        return "a link that leads out of the folder"
    if _is_loose_frame(folder, name):
        return "images of a film directly in the session folder: move them into a folder of their own, then init again"
    if suffix in _PICTURES:
        return PICTURE
    try:
        with path.open("rb") as stream:
            head = stream.read(instruments.HEAD_BYTES) if path.is_file() else b"?"
    except OSError:
        return UNKNOWN
    if not head.strip(b"\0"):
        return _ZEROS if head else "the file is empty"
    advice = remedy(path)
    if b"\0" not in head:  # a text without rows of numbers needs no advice
        advice = advice[advice.find("Name its columns") :] if COLUMNS in advice else ""
    return f"{UNKNOWN}. {advice}".removesuffix(". ")


def unreadable(path: Path) -> str:
    """Say why a table cannot be read as it is; "" of others, whose films may take long."""
    name = instrument_of(path)
    try:
        if name is not None and instruments.by_name(name).content in {"sweep", "displacement", "force"}:
            instruments.read(path)
    except LabpipeError as error:
        if isinstance(error, SourceError):
            return f"{f'line {error.line}: ' if error.line else ''}{error.message}. {error.hint or ''}".strip()
        return str(error)
    return ""


def remedy(path: Path) -> str:
    """Say how a file that no instrument recognises may be used all the same."""
    try:
        instruments.identify(path)
    except SourceError as error:
        return error.hint or ""
    return ""


def instrument_of(path: Path) -> str | None:
    """Name the instrument that wrote a file or folder; None where no one is recognised."""
    try:
        return instruments.identify(path)
    except (LabpipeError, OSError):
        return None


def _sort_of(path: Path) -> str | None:
    """Name the instrument that wrote a file, or the kind that a record claims; an incomplete one has gaps."""
    from calibration import KINDS as RECORDS

    if path.suffix != ".toml":
        return instrument_of(path)
    try:
        kind = parse(path).tree.get("kind")
    except LabpipeError:
        return None
    return f"record:{kind}" if isinstance(kind, str) and kind in RECORDS else None


def _candidates(folder: Path) -> Iterator[Path]:
    return (path for path in files.files_below(folder) if not _is_ours(path, folder))


def _is_ours(path: Path, folder: Path) -> bool:
    """Whether a path is of labpipe itself, of the system, or a spreadsheet's mark of an open workbook (~$)."""
    parts = path.relative_to(folder).parts
    written = (at for at, part in enumerate(parts[:-1], 1) if part in {"labpipe", "truth"})
    is_written = any(folder.joinpath(*parts[: at - 1], FILE_NAME).is_file() for at in written)
    of_system = any(p.startswith((".", "~$")) or p.lower() in {"thumbs.db", "desktop.ini"} for p in parts)
    return of_system or parts[0] in {"labpipe", "truth", FILE_NAME} or is_written


def _leads_out(path: Path, folder: Path) -> bool:
    try:
        return not path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError):  # links in a circle
        return True


def _is_loose_frame(folder: Path, name: str) -> bool:
    """Whether a file is one of several numbered images that are in the session folder itself."""
    suffix = Path(name).suffix.lower()
    if "/" in name or suffix not in _FRAMES or not re.search(r"\d", Path(name).stem):
        return False
    return sum(p.suffix.lower() == suffix and bool(re.search(r"\d", p.stem)) for p in folder.iterdir()) > 1


class Surveyed(NamedTuple):
    """One file, or a folder that is one recording; "" takes the place of what is not known or not so.

    ``kind`` is the program or instrument that wrote it, ``content`` one of :data:`instruments.CONTENTS`, ``"record"``
    or ``"picture"``, ``reason`` why it is recognised or of no use, ``copy_of`` the file with the same bytes that
    counts as the first, ``used_by`` the experiments of session.toml that name it; ``modified`` is in UTC.
    """

    name: str
    kind: str
    content: str
    reason: str
    copy_of: str
    used_by: tuple[str, ...]
    size: int
    modified: str


def survey(folder: Path) -> list[Surveyed]:
    """List every file of a folder, in the order of their names.

    Hidden files, session.toml and the results of labpipe are left out.
    """
    found, used = recognise(folder), dict[str, list[str]]()  # experiments by each text in them, files among these
    try:
        experiments = tomllib.loads(safe_join(folder, FILE_NAME).read_text("utf-8-sig")).get("experiments", {})
    except (OSError, ValueError, RecursionError, InputError):
        experiments = {}
    for experiment, table in experiments.items() if isinstance(experiments, dict) else ():
        for text in set(texts_in(table)):
            used.setdefault(text, []).append(experiment)
    has_session = (folder / FILE_NAME).is_file()
    instrument = {name: each for each in instruments.known() for name in found.of(each.name)}
    listed = []
    for name in sorted([*found.owners, *found.unknown]):
        copy_of, status = found.copies.get(name, ""), (folder / name).lstat()
        if name in found.owners:
            (kind, reason), each = found.owners[name], instrument.get(copy_of or name)
            content: str = each.content if each else "record" if name.endswith(".toml") else ""
            if name in used or (not has_session and not copy_of and not (each and each.unproposed)):
                reason = "recognised by its content" + ("" if has_session else "; no session is proposed yet")
            kind = f"calibration record of a {kind.partition(':')[2]}" if kind.startswith("record:") else kind
        else:
            reason = why_unknown(folder, name)
            kind = content = "picture" if reason == PICTURE else ""
        when = datetime.fromtimestamp(status.st_mtime, UTC).strftime("%Y-%m-%d %H:%M")
        users = tuple(used.get(name, ()))
        listed.append(Surveyed(printable(name), kind, content, reason, copy_of, users, status.st_size, when))
    return listed
