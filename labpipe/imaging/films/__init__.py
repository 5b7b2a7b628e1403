"""Selection of the frames and rows of a film that need to be read."""

from labpipe.imaging.films._reading_plan import FilmReader, Place, frames_in_windows, plan_reading

__all__ = ["FilmReader", "Place", "frames_in_windows", "plan_reading"]
