"""Contact area: a film of the contact through the transparent disc."""
