"""Self-contained HTML pages: documents made of texts, tables, charts and pictures.

The kit knows no physics, no instrument and no experiment; it is given arrays and texts. A page
holds everything it needs, asks for nothing over a network, and is complete without scripts.
Numerical libraries are imported only when something is drawn.
"""

from typing import TYPE_CHECKING

from labpipe.installation import lazily
from labpipe.report._blocks import (
    SURE as SURE,
    Block as Block,
    Details as Details,
    Deviations as Deviations,
    Gallery as Gallery,
    KeyValues as KeyValues,
    Level as Level,
    Link as Link,
    Notice as Notice,
    Paragraph as Paragraph,
    Picture as Picture,
    Section as Section,
    budget_table as budget_table,
    difference_unit as difference_unit,
    shown_source as shown_source,
)
from labpipe.report._charts import Band as Band, LineChart as LineChart, ScatterChart as ScatterChart, Series as Series
from labpipe.report._document import (
    MAX_PAGE_BYTES as MAX_PAGE_BYTES,
    Document as Document,
    Report as Report,
    amended as amended,
)
from labpipe.report._style import (
    Role as Role,
    figure_bytes as figure_bytes,
    figure_style as figure_style,
    line_arguments as line_arguments,
    looks as looks,
    save_figure as save_figure,
)
from labpipe.report._tables import (
    Cell as Cell,
    Column as Column,
    DisplayUnit as DisplayUnit,
    Listed as Listed,
    Table as Table,
    display_unit as display_unit,
    listed as listed,
    number as number,
    plus_minus as plus_minus,
    quantity as quantity,
    value_with_uncertainty as value_with_uncertainty,
)
from labpipe.report._thinning import kept_samples as kept_samples

if TYPE_CHECKING:  # what draws loads numpy
    from labpipe.report._pictures import thumbnail as thumbnail
else:
    __getattr__ = lazily(__name__)
