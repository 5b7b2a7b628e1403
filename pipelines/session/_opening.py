"""From a folder to a session: its ``session.toml``, checked against the kinds of experiment."""

from collections.abc import Collection
from pathlib import Path

from labpipe.errors import SourceError
from labpipe.workflow import session as sessions
from labpipe.workflow.plan import page_name
from labpipe.workflow.session import Session
from pipelines.experiments import KINDS

SETTINGS = {name: kind.settings for name, kind in KINDS.items()}
STAGES = {name: kind.stages for name, kind in KINDS.items()}
SCHEMAS = {schema.name: schema for kind in KINDS.values() for schema in kind.schemas}


def open_session(folder: str | Path) -> Session:
    """Read and check the ``session.toml`` of a folder.

    Parameters
    ----------
    folder : path-like
        The session folder.

    Returns
    -------
    Session
        Title, operator, and the experiments with their typed settings.

    Raises
    ------
    SourceError
        The folder holds no session.toml.
    ConfigError
        No experiment can be processed; every mistake is listed with its line.
    """
    return _opened(Path(folder))


def reopen_session(folder: str | Path) -> Session:
    """Open a session as :func:`open_session`, but let experiments that have a page lack files.

    In an experiment that was never processed a file that is not there is a mistake, told with all
    others. Later it has been lost: its experiment fails and says so.
    """
    return _opened(Path(folder), {page.stem for page in Path(folder, "labpipe").glob(page_name("*"))})


def _opened(folder: Path, processed: Collection[str] = ()) -> Session:
    path = folder / sessions.FILE_NAME
    if not path.is_file():
        raise SourceError(path, "there is no such file", hint=f"Write one with `labpipe init {folder}`.")
    return sessions.load(path, SETTINGS, may_lack=processed)
