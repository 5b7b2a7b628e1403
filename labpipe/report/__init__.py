"""Self-contained HTML pages: document, charts, tables."""
