"""Digests of the code of every stage, so that a changed answer cannot keep its old version.

``python -m tests.pipelines.stage_digests`` records the present code. The digest is that of the
module that holds the stage's function, without docstrings and comments, because a stage calls the
helpers beside it.
"""

import ast
import hashlib
import importlib.util
import json
from pathlib import Path

from pipelines.experiments import KINDS

RECORD = Path(__file__).parent / "stage_digests.json"


def module_digest(name: str) -> str:
    spec = importlib.util.find_spec(name)
    assert spec is not None
    assert spec.origin is not None
    tree = ast.parse(Path(spec.origin).read_text("utf-8"))
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list) and body and isinstance(body[0], ast.Expr):
            value = body[0].value
            if isinstance(value, ast.Constant) and isinstance(value.value, str):
                body[0] = ast.Expr(ast.Constant(...))
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()[:16]


def present() -> dict[str, dict[str, str | int]]:
    return {
        f"{kind}/{stage.name}": {
            "version": stage.version,
            "code": module_digest(stage.function.split(":")[0]),
        }
        for kind, entry in KINDS.items()
        for stage in entry.stages
    }


def recorded() -> dict[str, dict[str, str | int]]:
    found: dict[str, dict[str, str | int]] = json.loads(RECORD.read_text("utf-8"))
    return found


if __name__ == "__main__":
    RECORD.write_text(json.dumps(present(), indent=1, sort_keys=True) + "\n", "utf-8")
