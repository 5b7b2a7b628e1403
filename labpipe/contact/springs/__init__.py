"""Nested contact as a bed of independent springs, and its integration over a load history."""

from labpipe.contact.springs._bed import (
    EDGE_OFFSET as EDGE_OFFSET,
    Answer as Answer,
    NotNestedError as NotNestedError,
    SpringBed as SpringBed,
    sphere_bed as sphere_bed,
)
from labpipe.contact.springs._march import Control as Control, March as March, State as State
