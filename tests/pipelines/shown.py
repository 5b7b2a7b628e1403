"""The texts that a reader of a page sees, to hold them against what was done."""

import re


def texts_between(page: str, first: str, last: str) -> list[str]:
    """Return the texts from the section of one id to that of another."""
    part = page[page.index(f'id="{first}"') : page.index(f'id="{last}"')]
    shown = re.sub(r"<(script|style)\b.*?</\1>", "", part, flags=re.DOTALL)
    return [text.strip() for text in re.findall(r">([^<>]+)<", shown) if text.strip()]
