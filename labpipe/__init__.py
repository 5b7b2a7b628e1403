"""The front door: every command as a verb, and every everyday object, under one name.

>>> import labpipe as lp
>>> fall = lp.drop("acrylic", radius="9.525 mm", mass="505 g", height="7 mm", duration="50 ms")

``lp.read`` and ``lp.inspect`` a file; ``lp.init``, ``lp.plan``, ``lp.process`` and ``lp.watch`` a
session, or ``lp.open`` it in a local page; look at it with ``lp.open_session``, ``lp.result``, ``lp.results``,
``lp.report``, ``lp.compare``, ``lp.verdict``, ``lp.sensitivity``, ``lp.identify``, ``lp.export`` and ``lp.bundle``,
at many with ``lp.catalogue`` and ``lp.trend``; archive it with ``lp.publish``, ``lp.verify`` and ``lp.cite``; make a
synthetic one with ``lp.sample`` or ``lp.demo``; simulate with ``lp.drop``, ``lp.indent`` and ``lp.sweep``.

Behind it stand, from the ground up, :mod:`labpipe.signals`, :mod:`labpipe.materials`, :mod:`labpipe.contact`,
:mod:`labpipe.imaging`, :mod:`labpipe.identification`; next to them :mod:`labpipe.workflow`, :mod:`labpipe.judging` and
:mod:`labpipe.report`, which know none of the physics. They know no instrument, no calibration and no experiment; this
file alone names the packages above, and loads each when a name of it is first used. Importing labpipe imports none of
the numerical libraries. The modules beside this file hold what all packages share.
"""

import sys
from types import ModuleType
from typing import TYPE_CHECKING

from labpipe.installation import BUILD as BUILD, __version__ as __version__, lazily

if TYPE_CHECKING:
    from instruments import read as read
    from labpipe.contact import drop as drop, indent as indent
    from labpipe.imaging import contact_radius as contact_radius, track as track
    from labpipe.materials import MasterCurve as MasterCurve, Prony as Prony, master_curve as master_curve, solid
    from labpipe.signals import velocity as velocity
    from pipelines.app import open as open
    from pipelines.figures import figures as figures
    from pipelines.identify import identify as identify
    from pipelines.rig import demo as demo, sample as sample
    from pipelines.session import (
        bundle as bundle,
        catalogue as catalogue,
        cite as cite,
        compare as compare,
        doctor as doctor,
        export as export,
        init as init,
        inspect as inspect,
        note as note,
        open_lab_session,
        plan as plan,
        process as process,
        publish as publish,
        report as report,
        result as result,
        results as results,
        sensitivity as sensitivity,
        trend as trend,
        verdict as verdict,
        verify as verify,
        watch as watch,
    )
    from pipelines.sweeps import sweep as sweep

    material = solid
    open_session = open_lab_session
else:
    __getattr__ = lazily(__name__, above=("pipelines", "instruments", "calibration"))


class _Door(ModuleType):
    """Keeps the verb ``report`` in its place when the package of that name is imported."""

    def __setattr__(self, name: str, value: object) -> None:
        if name != "report" or not isinstance(value, ModuleType):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Door
