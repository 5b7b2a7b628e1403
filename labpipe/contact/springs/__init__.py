"""Nested contact as a bed of independent springs, and its integration over a load history."""

from labpipe.contact.springs._bed import EDGE_OFFSET, Answer, NotNestedError, SpringBed, sphere_bed
from labpipe.contact.springs._march import Control, March, State

__all__ = ["EDGE_OFFSET", "Answer", "Control", "March", "NotNestedError", "SpringBed", "State", "sphere_bed"]
