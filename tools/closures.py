# SPDX-License-Identifier: Apache-2.0
"""Closures: how much of the package one module brings along when it is imported.

What a reader of `nodes/encoder.py` may have to know, and what its process loads, is not that file
but all that it imports. A closure is the number of statements (`ratchet.py` counts them) in all
files of the package that importing a module loads: what is imported at the top of a file, not in
a function and not below `if TYPE_CHECKING`. `closures.txt` beside this file holds the figures.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from ratchet import PACKAGE, allowed, statements

FIGURES = Path(__file__).with_name("closures.txt")


def loaded(package: Path, module: str) -> dict[str, Path]:
    """Return the files that importing a module loads, by module name; module: without package."""
    found: dict[str, Path] = {}
    waiting = [f"{package.name}.{module}"]
    while waiting:
        name = waiting.pop()
        file = _file_of(package, name)
        if file is None or name in found:
            continue
        found[name] = file
        waiting.append(name.rpartition(".")[0])  # importing a module imports its folder first
        waiting += _imports(ast.parse(file.read_text("utf-8"), str(file)).body, name, file)
    return found


def closure(package: Path, module: str) -> int:
    """Return the statements in all files of the package that importing a module loads."""
    return sum(map(statements, loaded(package, module).values()))


def too_wide(package: Path, limits: dict[str, int]) -> list[str]:
    """Return a sentence for each module whose closure is larger than allowed."""
    found = {module: closure(package, module) for module in limits}
    return [
        f"importing {module} loads {weight} statements of the package, {limits[module]} are "
        "allowed: import less at the top of its files, or raise the figure in "
        f"tools/{FIGURES.name} and say why in the commit"
        for module, weight in found.items()
        if weight > limits[module]
    ]


def _file_of(package: Path, name: str) -> Path | None:
    first, *inner = name.split(".")
    if first != package.name:
        return None
    path = package.joinpath(*inner)
    return next(
        (file for file in (path / "__init__.py", path.with_suffix(".py")) if file.is_file()), None
    )


def _imports(body: Iterable[ast.stmt], name: str, file: Path) -> Iterator[str]:
    """Yield what statements import, at the top or below `if` and `try`, as full module names."""
    folder = name.split(".") if file.name == "__init__.py" else name.split(".")[:-1]
    for statement in body:
        if isinstance(statement, ast.Import):
            yield from (alias.name for alias in statement.names)
        elif isinstance(statement, ast.ImportFrom):
            above = folder[: len(folder) + 1 - statement.level] if statement.level else []
            source = ".".join([*above, *([statement.module] if statement.module else [])])
            yield source
            yield from (f"{source}.{alias.name}" for alias in statement.names)  # may be a module
        elif isinstance(statement, ast.If):
            if "TYPE_CHECKING" not in ast.unparse(statement.test):
                yield from _imports(statement.body, name, file)
            yield from _imports(statement.orelse, name, file)
        elif isinstance(statement, ast.Try):
            yield from _imports([*statement.body, *statement.orelse], name, file)


def main() -> int:
    """Check the closures with a figure, or list the files of one: NAME. Return the exit code."""
    if names := sys.argv[1:]:
        for name in names:
            files = loaded(PACKAGE, name)
            for module in sorted(files, key=lambda module: statements(files[module])):
                print(f"{statements(files[module]):5} {module}")
            print(f"{closure(PACKAGE, name):5} statements of {len(files)} files, by {name}")
        return 0
    wide = too_wide(PACKAGE, allowed(FIGURES.read_text("utf-8")))
    print(*wide or ["Closures: no module loads more of the package than before."], sep="\n")
    return 1 if wide else 0


if __name__ == "__main__":
    sys.exit(main())
