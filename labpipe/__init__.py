"""The front door: every command as a verb, and every everyday object, under one name.

>>> import labpipe as lp
>>> fall = lp.drop("acrylic", radius="9.525 mm", mass="505 g", height="7 mm", duration="50 ms")

``lp.read`` and ``lp.inspect`` a file; ``lp.init``, ``lp.plan``, ``lp.process`` and ``lp.watch`` a
session, or ``lp.open`` it in a local page; look at it with ``lp.open_session``, ``lp.result``, ``lp.results``,
``lp.report``, ``lp.compare``, ``lp.verdict``, ``lp.sensitivity``, ``lp.identify``, ``lp.export`` and ``lp.bundle``,
at many with ``lp.catalogue`` and ``lp.trend``; archive it with ``lp.publish``, ``lp.verify`` and ``lp.cite``; make a
synthetic one with ``lp.sample`` or ``lp.demo``; simulate with ``lp.drop``, ``lp.indent`` and ``lp.sweep``.

Behind it stand, from the ground up, :mod:`labpipe.signals`, :mod:`labpipe.materials`,
:mod:`labpipe.contact`, :mod:`labpipe.imaging`, :mod:`labpipe.identification`; next to them
:mod:`labpipe.workflow`, :mod:`labpipe.judging` and :mod:`labpipe.report`, which know none of the
physics. They know no instrument, no calibration and no experiment; this file alone names the
packages above, and loads each when a name of it is first used. Importing labpipe imports none of
the numerical libraries.
"""

import sys
from types import ModuleType
from typing import TYPE_CHECKING

from labpipe.installation import BUILD as BUILD, __version__ as __version__, lazily

if TYPE_CHECKING:
    from instruments import read
    from labpipe.contact import drop, indent
    from labpipe.imaging import contact_radius, track
    from labpipe.materials import MasterCurve, Prony, master_curve, solid as material
    from labpipe.signals import velocity
    from pipelines.app import open
    from pipelines.figures import figures
    from pipelines.identify import identify
    from pipelines.rig import demo, sample
    from pipelines.session import (
        bundle,
        catalogue,
        cite,
        compare,
        doctor,
        export,
        init,
        inspect,
        note,
        open_lab_session as open_session,
        plan,
        process,
        publish,
        report,
        result,
        results,
        sensitivity,
        trend,
        verdict,
        verify,
        watch,
    )
    from pipelines.sweeps import sweep
else:
    __getattr__ = lazily(__name__, above=("pipelines", "instruments", "calibration"))

__all__ = [
    "MasterCurve",
    "Prony",
    "bundle",
    "catalogue",
    "cite",
    "compare",
    "contact_radius",
    "demo",
    "doctor",
    "drop",
    "export",
    "figures",
    "identify",
    "indent",
    "init",
    "inspect",
    "master_curve",
    "material",
    "note",
    "open",
    "open_session",
    "plan",
    "process",
    "publish",
    "read",
    "report",
    "result",
    "results",
    "sample",
    "sensitivity",
    "sweep",
    "track",
    "trend",
    "velocity",
    "verdict",
    "verify",
    "watch",
]


def __dir__() -> list[str]:
    return sorted(__all__)


class _Door(ModuleType):
    """Keeps the verb ``report`` in its place when the package of that name is imported."""

    def __setattr__(self, name: str, value: object) -> None:
        if name != "report" or not isinstance(value, ModuleType):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Door
