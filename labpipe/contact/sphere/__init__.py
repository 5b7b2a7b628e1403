"""A sphere on a half-space without inertia: Hertz's closed forms and static loading."""

from labpipe.contact.sphere import hertz as hertz
from labpipe.contact.sphere._counter_body import (
    CounterBody as CounterBody,
    Substrate as Substrate,
    counter_body as counter_body,
    counter_compliance as counter_compliance,
)
from labpipe.contact.sphere._static_loading import load_sphere as load_sphere, press_sphere as press_sphere
