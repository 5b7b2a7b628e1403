"""Selection of the frames and rows of a film that need to be read, and what its camera does to them."""

from labpipe.imaging.films._grey_levels import in_grey_levels
from labpipe.imaging.films._mosaic import MOSAIC, mosaic_of
from labpipe.imaging.films._reading_plan import FilmReader, Place, frames_in_windows, plan_reading
from labpipe.imaging.films._rows import PIECE, RowsSeen, is_inside, pieces_of, read_rows, row_sums
from labpipe.imaging.films._stuck_pixels import StuckPixels, without_stuck_pixels

__all__ = [
    "MOSAIC",
    "PIECE",
    "FilmReader",
    "Place",
    "RowsSeen",
    "StuckPixels",
    "frames_in_windows",
    "in_grey_levels",
    "is_inside",
    "mosaic_of",
    "pieces_of",
    "plan_reading",
    "read_rows",
    "row_sums",
    "without_stuck_pixels",
]
