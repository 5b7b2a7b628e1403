"""Parts that several kinds of experiment share, one noun each: settings, readings, models, checks, and pages.

Half of the room are checks of lasers, films, falls and indentations with the causes of what they find: one for each
mistake that a laboratory is known to make, so that a page names the line to mend.
"""
