"""The gallery: a report of each kind, as a picture of its first screen and whole."""

import shutil
from collections.abc import Iterable
from pathlib import Path

from labpipe import files
from labpipe.workflow.plan import page_name
from pipelines.experiments import KINDS
from pipelines.guide._screens import shown
from pipelines.session import reopen_session


def write(source: Path, sessions: Iterable[Path]) -> None:
    """Write the page of the gallery, and copy the reports that it shows.

    Parameters
    ----------
    source : Path
        Folder of the site's sources.
    sessions : iterable of Path
        Processed sessions; of each kind the first report that is there is taken.
    """
    pages: dict[str, tuple[str, Path]] = {}
    for folder in sessions:
        session = reopen_session(folder)
        for name, experiment in session.experiments.items():
            page = session.folder / page_name(name)
            if page.is_file():
                pages.setdefault(experiment.kind, (name, page))
    parts = [
        "# Gallery of reports\n\nReports as `labpipe process` wrote them, of synthetic data, one of each kind that was "
        "at hand when these pages were built. Each says first whether the record can be believed and whether the model "
        "agrees, then shows the chart on which that rests, then the numbers.\n\n"
    ]
    (source / "reports").mkdir()
    for kind, (name, page) in pages.items():
        shutil.copyfile(page, source / "reports" / f"{kind}.html")
        parts.append(f"## {KINDS[kind].title}\n\n{KINDS[kind].summary[:1].upper()}{KINDS[kind].summary[1:]}.\n\n")
        parts.append(shown(source, page, f"gallery-{kind}", f"The report on {name}"))
        parts.append(f"{{download}}`The whole report <reports/{kind}.html>`\n\n")
    if not pages:
        parts.append("No session was given: `python -m pipelines.guide SITE SESSION` shows the reports of one.\n")
    files.write_text(source / "gallery.md", "".join(parts))
