"""Periodic line contact (chapter 2): indentation, closed forms, dissipation."""

from typing import TYPE_CHECKING

from labpipe.contact.line import dissipation as dissipation, westergaard as westergaard
from labpipe.installation import lazily

if TYPE_CHECKING:
    from labpipe.contact.line._indentation import indent as indent
    from labpipe.contact.line._surface import line_kernel as line_kernel
    from labpipe.contact.line.dissipation import (
        dissipated_power as dissipated_power,
        dissipated_work as dissipated_work,
        dynamic_stiffness as dynamic_stiffness,
        tapping_amplitude as tapping_amplitude,
    )
else:
    __getattr__ = lazily(__name__)
