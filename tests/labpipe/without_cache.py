"""A Python that can keep compiled code nowhere."""

import os
import subprocess
import sys
from pathlib import Path


def printed_without_cache(program: str, folder: Path) -> str:
    """Run a program where numba finds no place for its code; return what it printed.

    The cache folder would have to be made below a file: impossible for any user.
    """
    (folder / "file").write_text("no folder")
    environment = os.environ | {
        "NUMBA_CACHE_DIR": str(folder / "file" / "cache"),
        "NUMBA_CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator",
        "PYTHONPATH": os.pathsep.join(sys.path),
    }
    run = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    return run.stdout
