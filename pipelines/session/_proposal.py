"""From a folder of instrument files to a first session.toml, commented, with gaps to fill in.

Every kind of experiment is offered the files of the instruments that it knows; those of other
distributions first, then ours from the special to the general. A value that no file holds is asked
for, or written as a gap; an experiment waits until its gaps are filled. A calibration record that
is missing is proposed as a file of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace as with_fields
from pathlib import Path

import instruments
from labpipe import files
from labpipe.errors import UsageError
from labpipe.files import printable
from labpipe.notebook import Shown, ShownAsTable
from labpipe.workflow.session import FILE_NAME, VERSION
from pipelines.experiments import KINDS, Found, Proposal, Proposed, function
from pipelines.experiments.shared.proposals import GAP, identifier, quoted
from pipelines.experiments.shared.record_templates import with_missing_records
from pipelines.session._gaps import Gap, filled, template_of
from pipelines.session._recognition import alike_unknown, recognise, unreadable

_MOST_LINES = 20  # of an error, on files of a folder


@dataclass(frozen=True, slots=True, repr=False)
class Scan(ShownAsTable):
    """The file that :func:`init` wrote, its experiments, and the values to fill in.

    ``records`` are calibration records that were proposed; ``unused`` names files that no proposed experiment takes.
    """

    path: Path
    experiments: list[str]
    gaps: list[str]
    records: list[Path]
    unused: list[str]

    def _shown(self) -> Shown:
        parts = {"experiment": self.experiments, "to fill in": self.gaps, "not used": self.unused}
        rows = [(title, text) for title, texts in parts.items() for text in texts]
        n, missing = len(self.experiments), len(self.gaps)
        caption = f"{self.path}: {n} experiment{'s' * (n != 1)}, {missing} value{'s' * (missing != 1)} to fill in"
        return Shown(caption, ("", ""), rows)


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
        Kinds of experiment to write down with every value still to come, instead of a scan; FOLDER is made if need be.

    Returns
    -------
    Scan
        The file, its experiments, and the values to fill in.

    Examples
    --------
    >>> init("my-session").experiments  # doctest: +SKIP
    ['acrylic_7mm', 'nbr_hold']
    """
    folder = Path(folder)
    path = folder / FILE_NAME
    if path.exists() and not replace:
        raise UsageError(f"{path} exists already; edit it, or use --force to replace it")
    made = draft(folder, template)
    texts = made.texts if ask is None else filled(made.texts, ask)
    for name in reversed(texts):  # session.toml last: with it, the folder is a session
        if name in made.written or texts[name] != made.texts[name]:
            files.write_text(folder / name, texts[name])
    gaps = [
        f"{name}:{number}: {line.strip()}"
        for name, content in texts.items()
        for number, line in enumerate(content.splitlines(), 1)
        if GAP in line and not line.lstrip().startswith("#")
    ]
    unused = _left_over(made.found, made.texts[FILE_NAME])
    return Scan(path, made.experiments, gaps, [folder / name for name in made.written[1:]], unused)


@dataclass(frozen=True, slots=True)
class Draft:
    """Proposed texts by file, session.toml first, and begun records; those to be written, experiments, the scan."""

    texts: dict[str, str]
    written: list[str]
    experiments: list[str]
    found: Found


def draft(folder: Path, template: Iterable[str] = ()) -> Draft:
    """Return the files that :func:`init` would write; nothing is written."""
    if kinds := list(template):
        sections, names = template_of(kinds)
        text = "\n\n".join([_head(folder), *sections]) + "\n"
        return Draft({FILE_NAME: text}, [FILE_NAME], names, Found(folder, {}))
    if not folder.is_dir():
        message = f"{folder}: there is no such folder; with --template one is made for a session to be recorded"
        raise UsageError(message)
    found = recognise(folder)
    there = [n for kind, own in found.names.items() if kind.startswith("record:") for n in own]
    begun = {n: text for n in there if GAP in (text := (folder / n).read_text("utf-8"))}
    completed = with_missing_records(found)
    text, names = propose(completed)
    if not names:
        said = f"{folder}: no experiment is proposed"
        if not found.owners:
            known = ", ".join(each.name for each in instruments.known())
            said = f"{folder}: no file of a known instrument was found; known are {known}. Is it the right folder?"
        lines = _left_over(with_fields(found, unknown=()) if found.owners else found)
        raise UsageError("\n  ".join([said, *lines[:_MOST_LINES]]))
    return Draft({FILE_NAME: text, **completed.texts, **begun}, [FILE_NAME, *completed.texts], names, found)


def _proposals() -> list[Proposal]:
    return [kind.proposal for kind in KINDS.values() if kind.proposal is not None]


def propose(found: Found) -> tuple[str, list[str]]:
    """Return the text of session.toml and the names of the proposed experiments."""
    names: list[str] = []
    sections = [_head(found.folder)]
    for content in dict.fromkeys(name for p in _proposals() for name in p.contents):
        for each in instruments.known():
            if each.content != content or each.unproposed:
                continue
            left, made = found.of(each.name), list[Proposed]()
            for proposal in (p for p in reversed(_proposals()) if content in p.contents):  # one after the other
                for proposed in function(proposal.function)(found, left):
                    left = [name for name in left if name not in proposed.files]
                    made.append(proposed)
            for proposed in sorted(made, key=lambda one: one.stem):
                wanted = name = identifier(proposed.stem)
                number = 2
                while name in names:
                    name, number = f"{wanted}_{number}", number + 1
                names.append(name)
                sections += ["", proposed.text(name)]
    return "\n".join(sections) + "\n", names


def _head(folder: Path) -> str:
    title = f'title = "{quoted(folder.resolve().name)}"'
    return f'labpipe = {VERSION}  # version of this file\'s format\n\n[session]\n{title}\noperator = ""\nnotes = ""'


def _left_over(found: Found, text: str = "") -> list[str]:
    """Name every file that a text does not, with the reason; files of one folder, sort and reason in one line."""
    alike: dict[tuple[str, ...], list[str]] = {}
    for name, (title, reason) in found.owners.items():
        if f'"{quoted(name)}"' not in text:
            first = found.copies.get(name)
            why = f"copies of those in {_shown(found.folder, Path(first).parent.as_posix())}" if first else ""
            key = (Path(name).parent.as_posix(), "", title, why or unreadable(found.folder / name) or reason)
            alike.setdefault(key, []).append(name)
    alike |= {(folder, ending, "", why): names for (folder, ending, why), names in alike_unknown(found).items()}
    lines = []
    for (*_, title, why), names in alike.items():
        said = found.owners[names[0]][1] if names[0] in found.copies and len(names) == 1 else why
        more = f" and {len(names) - 1} more beside it" if len(names) > 1 else ""
        lines.append(f"{printable(_shown(found.folder, names[0]))}{more}{f' ({title})' if title else ''}: {said}")
    return lines


def _shown(folder: Path, name: str) -> str:
    if name == ".":
        return "the session folder"
    return f"{name}/" if (folder / name).is_dir() else name
