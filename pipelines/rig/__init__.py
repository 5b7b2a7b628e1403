"""The virtual rig: synthetic recordings with known true values."""

from typing import TYPE_CHECKING

from labpipe.lazy import lazily

if TYPE_CHECKING:
    from pipelines.rig._ahead import ahead
    from pipelines.rig._verbs import demo, record_demo, sample
    from pipelines.rig.samples import SAMPLES
else:
    __getattr__ = lazily(__name__)

__all__ = ["SAMPLES", "ahead", "demo", "record_demo", "sample"]
