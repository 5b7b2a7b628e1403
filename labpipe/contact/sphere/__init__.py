"""A sphere on a half-space without inertia: Hertz's closed forms and static loading."""

from labpipe.contact.sphere import hertz
from labpipe.contact.sphere._static_loading import load_sphere, press_sphere

__all__ = ["hertz", "load_sphere", "press_sphere"]
