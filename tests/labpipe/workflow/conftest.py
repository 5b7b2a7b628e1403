"""Makes the toy laboratory importable here and, by the same path, in the workers."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
