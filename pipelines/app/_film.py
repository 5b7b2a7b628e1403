"""A film to watch in the page, frame by frame, with the results of its experiment drawn on it."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import TYPE_CHECKING

from labpipe.errors import LabpipeError
from labpipe.files import safe_join
from pipelines.experiments import KINDS, function
from pipelines.session import opened, reopen_session

if TYPE_CHECKING:
    from pipelines.experiments.shared.film_frames import DrawnFilm


def watched(folder: Path, path: Path) -> tuple[DrawnFilm, str]:
    """Open a film with the results of the first experiment that has any; return its name too, or ""."""
    from pipelines.experiments.shared.film_frames import DrawnFilm, open_film

    try:
        session = reopen_session(folder)
    except LabpipeError:  # there is none yet, or Set-up shows its errors
        return DrawnFilm(open_film(path)), ""
    without: DrawnFilm | None = None
    for name, experiment in session.experiments.items():
        kind, settings = KINDS[experiment.kind], experiment.settings
        if kind.film and safe_join(session.files, getattr(settings, "film", "")) == path:
            call, known = function(kind.film), opened(folder, [name])
            stages = inspect.signature(call).parameters.keys() & {stage.name for stage in kind.stages}
            film = call(path, settings=settings, **{stage: known.first(name, stage) for stage in stages})
            if film.drawn is not None:
                return film, name
            without = without or film
    return without or DrawnFilm(open_film(path)), ""
