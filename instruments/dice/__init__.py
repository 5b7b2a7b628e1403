"""Results of the correlation program DICe: a folder of DICe_solution_*.txt, one file per frame."""

from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from instruments._instrument import Instrument
from labpipe.installation import lazily

if TYPE_CHECKING:
    from instruments.dice._solutions import read as read
else:
    __getattr__ = lazily(__name__)

_UNPROPOSED = "displacements that another program correlated are read, drawn and exported, but no kind of experiment "
_UNPROPOSED += "begins from them; name the film that they were made of instead"


class Options(TypedDict, total=False):
    """Options for a run of DICe; see :func:`read`."""

    fps: float | None


def _sniff(head: bytes, path: Path) -> bool:
    """Recognise results of DICe by the names in the folder, or by the fields of one file."""
    if path.is_dir():
        return any(path.glob("DICe_solution_*.txt"))
    return b"COORDINATE_X" in head and b"DISPLACEMENT_X" in head


INSTRUMENT = Instrument(
    name="dice",
    title="displacement field of DICe",
    content="displacement_field",
    sniff=_sniff,
    reader="instruments.dice:read",
    options=Options,
    unproposed=_UNPROPOSED,
)
