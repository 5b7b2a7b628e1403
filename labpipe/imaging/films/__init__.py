"""Which frames and rows of a film are worth reading."""

from labpipe.imaging.films._reading_plan import (
    FilmReader,
    Place,
    frames_in_windows,
    last_moving_frame,
    plan_reading,
)

__all__ = ["FilmReader", "Place", "frames_in_windows", "last_moving_frame", "plan_reading"]
