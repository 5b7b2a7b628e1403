"""The command ``labpipe``, and ``python -m labpipe``."""

import importlib
import json
import sys

from labpipe.errors import InstallationError
from labpipe.installation import foreign_package


def main() -> None:
    """Run the command line, if the package that holds it is ours."""
    if (clash := foreign_package(["pipelines"])) is not None:
        code = InstallationError.exit_code
        error = {"type": InstallationError.__name__, "message": clash}
        if "--json" in sys.argv:
            sys.stdout.write(json.dumps({"error": error, "exit_code": code}, indent=2) + "\n")
        else:
            sys.stderr.write(f"error: {clash}\n")
        sys.exit(code)
    # Named, not imported: labpipe stands below pipelines and knows nothing of it.
    importlib.import_module("pipelines.cli").main()


if __name__ == "__main__":
    main()
