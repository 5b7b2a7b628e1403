"""Execute the example notebook with nothing but Python, and write what it shows into it.

``python -m tests.labpipe.documentation.notebook`` executes it anew. A cell is run as a notebook
runs it: the value of its last expression is shown, as HTML where it has such a form.
"""

import ast
import contextlib
import io
import json
import os
import tempfile
from pathlib import Path
from typing import Any

import labpipe

NOTEBOOK = Path(labpipe.__file__).parent / "documentation/example.ipynb"


def load() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(NOTEBOOK.read_text("utf-8"))
    return found


def execute(notebook: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Run all cells in a folder; return the notebook with their outputs."""
    space: dict[str, Any] = {"__name__": "__main__"}
    count = 0
    with contextlib.chdir(folder):
        for cell in notebook["cells"]:
            if cell["cell_type"] == "code":
                count += 1
                cell["execution_count"] = count
                cell["outputs"] = run("".join(cell["source"]), space, count)
    return notebook


def run(source: str, space: dict[str, Any], count: int) -> list[dict[str, Any]]:
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed, value = io.StringIO(), None
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, "cell", "exec"), space)  # noqa: S102
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), "cell", "eval"), space)  # noqa: S307
    outputs: list[dict[str, Any]] = []
    if printed.getvalue():
        lines = printed.getvalue().splitlines(keepends=True)
        outputs.append({"name": "stdout", "output_type": "stream", "text": lines})
    if value is not None:
        outputs.append(
            {"data": shown(value), "execution_count": count, "metadata": {}, "output_type": "execute_result"}
        )
    return outputs


def shown(value: Any) -> dict[str, Any]:
    """Forms of a value, as a notebook asks for them; addresses in memory are left out."""
    if type(value).__module__.startswith("matplotlib"):
        import base64

        stream = io.BytesIO()
        value.savefig(stream, format="png", dpi=80, metadata={"Software": None})
        return {"image/png": base64.b64encode(stream.getvalue()).decode(), "text/plain": "Figure"}
    if hasattr(value, "_repr_html_"):
        return {"text/html": value._repr_html_(), "text/plain": type(value).__name__}
    return {"text/plain": repr(value)}


def main() -> None:
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(os.path.realpath(scratch))
        made = execute(load(), folder)
    text = json.dumps(made, indent=1, ensure_ascii=False, sort_keys=True) + "\n"
    text = text.replace(f"{folder.as_posix()}/", "")  # where it was executed is of this machine
    NOTEBOOK.write_text(text, "utf-8")


if __name__ == "__main__":
    main()
