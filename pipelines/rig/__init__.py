"""The virtual rig: synthetic recordings with known true values."""

from typing import TYPE_CHECKING

from labpipe.installation import lazily

DEMO_TITLE = "Demonstration"

if TYPE_CHECKING:
    from pipelines.rig._verbs import demo as demo, record_demo as record_demo, sample as sample
    from pipelines.rig.samples import SAMPLES as SAMPLES
else:
    __getattr__ = lazily(__name__)
