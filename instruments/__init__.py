"""One module per instrument: bytes to Dataset, and back."""
