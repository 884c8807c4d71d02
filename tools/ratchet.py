# SPDX-License-Identifier: Apache-2.0
"""The ratchet: no product and no room of it weighs more than `weights.txt` beside this file allows.

A weight is the number of statements, without docstrings. Whoever makes a room lighter lowers its
figure (`python tools/ratchet.py --lower`); whoever raises one says why in the commit. The products
are in pyproject.toml, read by `products.py`. The same holds for the tests' reads of private
attributes, which tie the package to how it is made today.
"""

from __future__ import annotations

import ast
import sys
from collections import Counter
from pathlib import Path

from products import PACKAGE, product_of, table

TESTS = PACKAGE.parent / "test"

WEIGHTS = Path(__file__).with_name("weights.txt")

PRIVATE_READS = "test:private_reads"
"""Name of the figure of `private_reads` in `weights.txt`."""

_UNITS = {PRIVATE_READS: "reads"}

_PUBLIC = ("_replace", "_asdict", "_fields", "_make", "_field_defaults")  # methods of a NamedTuple


def weights(package: Path) -> Counter[str]:
    """Return the statements of each product, and of each room as `product/room`.

    Files directly in the package are the room `.`. Raises ValueError for a file in no product.
    """
    found: Counter[str] = Counter()
    products = table()
    for file in sorted(package.rglob("*.py")):
        parts = file.relative_to(package).with_suffix("").parts
        if parts == ("__init__",):
            continue  # a docstring
        product = product_of(".".join(parts).removesuffix(".__init__"), products)
        weight = statements(file)
        found[product] += weight
        found[f"{product}/{parts[0] if parts[1:] else '.'}"] += weight
    return found


def statements(file: Path) -> int:
    """Return the number of statements of a file, without docstrings."""
    return sum(map(_counts, ast.walk(ast.parse(file.read_text("utf-8"), str(file)))))


def _counts(node: ast.AST) -> bool:
    """Return whether a node is a statement other than a docstring."""
    if not isinstance(node, ast.stmt):
        return False
    text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    return not (text and isinstance(node.value.value, str))


def private_reads(tests: Path) -> int:
    """Return how often the tests below a folder use `x._name`, where x is neither self nor cls."""
    return sum(
        _is_private(node)
        for file in sorted(tests.rglob("*.py"))
        for node in ast.walk(ast.parse(file.read_text("utf-8"), str(file)))
    )


def _is_private(node: ast.AST) -> bool:
    if not isinstance(node, ast.Attribute) or node.attr in _PUBLIC:
        return False
    own = isinstance(node.value, ast.Name) and node.value.id in ("self", "cls")
    return node.attr.startswith("_") and not node.attr.startswith("__") and not own


def allowed(text: str) -> dict[str, int]:
    """Return the figures of `weights.txt`: a product or room, and its statements, in each line."""
    lines = [line.split() for line in text.splitlines() if line and not line.startswith("#")]
    return {room: int(figure) for room, figure in lines}


def too_heavy(found: Counter[str], limits: dict[str, int]) -> list[str]:
    """Return a sentence for each that is heavier than allowed, or not in the list."""
    return [
        f"{room} weighs {weight} {_UNITS.get(room, 'statements')}, {limits.get(room, 0)} are "
        f"allowed: make it lighter, or raise the figure in tools/{WEIGHTS.name} and say why in "
        "the commit"
        for room, weight in sorted(found.items())
        if weight > limits.get(room, 0)
    ]


def main() -> int:
    """Check the package beside this folder; `--lower` writes smaller figures. Return the code."""
    found, text = weights(PACKAGE), WEIGHTS.read_text("utf-8")
    found[PRIVATE_READS] = private_reads(TESTS)
    limits = allowed(text)
    if "--lower" in sys.argv[1:]:
        head = [line for line in text.splitlines() if line.startswith("#")]
        kept = [f"{room} {min(n, limits.get(room, n))}" for room, n in sorted(found.items())]
        WEIGHTS.write_text("\n".join([*head, *kept]) + "\n", encoding="utf-8")
        return 0
    heavy = too_heavy(found, limits)
    print(*heavy or ["Ratchet: no product and no room has become heavier."], sep="\n")
    return 1 if heavy else 0


if __name__ == "__main__":
    sys.exit(main())
