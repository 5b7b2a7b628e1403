"""The virtual rig: synthetic recordings with known true values."""

from typing import TYPE_CHECKING

from labpipe.lazy import lazily

if TYPE_CHECKING:
    from pipelines.rig._verbs import demo, record_demo, sample
    from pipelines.rig.samples import SAMPLES

__all__ = ["SAMPLES", "demo", "record_demo", "sample"]

_HOMES = {"SAMPLES": "samples", "demo": "_verbs", "record_demo": "_verbs", "sample": "_verbs"}

if not TYPE_CHECKING:
    __getattr__ = lazily(__name__, _HOMES)
