"""The gallery: a report of each kind as a picture of its first screen, marked and explained."""

import shutil
from collections.abc import Iterable
from pathlib import Path

from labpipe import files
from labpipe.workflow.plan import page_name
from pipelines.experiments import KINDS
from pipelines.guide._screens import shown
from pipelines.guide._texts import GUIDES
from pipelines.session import reopen_session

_HEIGHT = 1500
_MARKED = (
    (
        "#verdict > .notice",
        "the verdict: whether the record can be believed and whether the model agrees, and the reason",
    ),
    ("#verdict > figure", "the one chart on which that rests"),
    ("#summary > h2", "the key numbers, each with its standard uncertainty"),
    ("#what-the-verdict-rests-on > h2", "how large an error would have shown, and the checks that were made (folded)"),
)
"""Places of a report, and what stands there."""
_BEGINNING = (
    "# Gallery of reports\n\nReports as `labpipe process` wrote them, of synthetic data, one of each kind. The marks "
    "were put on for this page; below what is seen here follow the detail, calibrations and budgets (folded), the "
    "methods text, and the provenance.\n\n"
)
_IMPOSSIBLE = "impossible"


def write(source: Path, sessions: Iterable[Path]) -> None:
    """Write the page of the gallery, with its pictures, into the site's sources, and copy the reports that it shows.

    Of each kind the first report that is in one of the processed sessions is drawn anew.
    """
    pages: dict[str, Path] = {}
    for folder in sessions:
        session = reopen_session(folder)
        for name, experiment in session.experiments.items():
            page = session.folder / page_name(name)
            if page.is_file():
                pages.setdefault(experiment.kind, page)
    (source / "reports").mkdir()
    for kind, page in pages.items():
        shutil.copyfile(page, source / "reports" / f"{kind}.html")
    files.write_text(source / "gallery.md", text(source, pages))


def text(source: Path = GUIDES, pages: dict[str, Path] | None = None) -> str:
    """Return the gallery as Markdown, with the ``pictures`` of a folder.

    Of kinds without a report that is drawn anew the picture that is there is shown.
    """
    pages = pages or {}
    parts = [_BEGINNING, *(f"{number}. {what}\n" for number, (_, what) in enumerate(_MARKED, 1)), "\n"]
    for name, kind in KINDS.items():
        drawn = shown(
            source, f"gallery-{name}", f"A report: {kind.title}", pages.get(name), style=_style(), height=_HEIGHT
        )
        if not drawn:
            continue
        parts += [f"## {kind.title}\n\n{kind.summary[:1].upper()}{kind.summary[1:]}.\n\n", drawn]
        if name in pages:
            parts.append(f"{{download}}`The whole report <reports/{name}.html>`\n\n")
    drawn = shown(source, _IMPOSSIBLE, "A report that says impossible", None)
    if drawn:
        parts += [
            "## A record that cannot be believed\n\nThe fall height was typed as 15 mm in place of 1.5 mm (the mistake "
            "of the [tutorial](tutorial.md)). The numbers are still computed and shown; the verdict names what is "
            "impossible and the likely cause, and the command ends with exit code 1.\n\n",
            drawn,
        ]
    return "".join(parts)


def _style() -> str:
    """Return rules of CSS that put a numbered mark at each place."""
    return "".join(
        f"{place}{'' if 'h2' in place else ':first-of-type'}{{position:relative}}"
        f"{place}{'' if 'h2' in place else ':first-of-type'}::after{{content:'{number}';position:absolute;left:-2.4em;"
        "top:0;width:1.7em;height:1.7em;border-radius:50%;background:#8a1c7c;color:#fff;font:700 17px/1.7 sans-serif;"
        "text-align:center}"
        for number, (place, _) in enumerate(_MARKED, 1)
    )
