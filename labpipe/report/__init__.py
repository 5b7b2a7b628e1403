"""Self-contained HTML pages: documents made of texts, tables, charts and pictures.

The kit knows no physics, no instrument and no experiment; it is given arrays and texts. A page
holds everything it needs, asks for nothing over a network, and is complete without scripts.
Numerical libraries are imported only when something is drawn.
"""

from labpipe.report._blocks import (
    Bars,
    Block,
    Details,
    Deviations,
    Gallery,
    KeyValues,
    Link,
    Notice,
    Paragraph,
    Picture,
    Section,
)
from labpipe.report._budget import budget_table, difference_unit, share_bars, shown_source
from labpipe.report._charts import Band, LineChart, ScatterChart, Series
from labpipe.report._document import MAX_PAGE_BYTES, SURE, Document, amended
from labpipe.report._embedded import Report
from labpipe.report._index import IndexRow, IndexTable
from labpipe.report._media import Level
from labpipe.report._style import Role, figure_bytes, figure_style, line_arguments, save_figure
from labpipe.report._tables import (
    Cell,
    Column,
    DisplayUnit,
    Listed,
    Table,
    display_unit,
    listed,
    number,
    plus_minus,
    quantity,
    value_with_uncertainty,
)
from labpipe.report._thinning import kept_samples

__all__ = [
    "MAX_PAGE_BYTES",
    "SURE",
    "Band",
    "Bars",
    "Block",
    "Cell",
    "Column",
    "Details",
    "Deviations",
    "DisplayUnit",
    "Document",
    "Gallery",
    "IndexRow",
    "IndexTable",
    "KeyValues",
    "Level",
    "LineChart",
    "Link",
    "Listed",
    "Notice",
    "Paragraph",
    "Picture",
    "Report",
    "Role",
    "ScatterChart",
    "Section",
    "Series",
    "Table",
    "amended",
    "budget_table",
    "difference_unit",
    "display_unit",
    "figure_bytes",
    "figure_style",
    "kept_samples",
    "line_arguments",
    "listed",
    "number",
    "plus_minus",
    "quantity",
    "save_figure",
    "share_bars",
    "shown_source",
    "thumbnail",
    "value_with_uncertainty",
]


def thumbnail(chart: LineChart | ScatterChart, width_px: int = 240) -> bytes:
    """Draw a chart without axes as a small SVG file, for an index page.

    Parameters
    ----------
    chart : LineChart or ScatterChart
        What to draw.
    width_px : int
        Width of the picture; its height is half of it.
    """
    from labpipe.report import _pictures

    return _pictures.thumbnail(chart, width_px)
