"""Selection of the frames and rows of a film that need to be read, and hot pixels of its camera."""

from labpipe.imaging.films._grey_levels import in_grey_levels
from labpipe.imaging.films._reading_plan import LONGEST_REST, FilmReader, Place, plan_reading
from labpipe.imaging.films._stuck_pixels import StuckPixels, without_stuck_pixels

__all__ = [
    "LONGEST_REST",
    "FilmReader",
    "Place",
    "StuckPixels",
    "in_grey_levels",
    "plan_reading",
    "without_stuck_pixels",
]
