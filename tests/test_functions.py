"""Functions are short: 60 lines without their docstring, and two functions inside them at most."""

import ast

import pytest

from tests.conftest import REPOSITORY

LONGEST, MOST_NESTED = 60, 2
# Kernels, which can't be taken apart. The list only shrinks.
LONG = {"events/pixel_kernel.py": {"_run_pixel"}, "solve/shared/kernel.py": {"_run"}}
MODULES = sorted(
    path.relative_to(REPOSITORY / "evsdr").as_posix() for path in (REPOSITORY / "evsdr").rglob("*.py")
)


def size(function):
    """Number of lines without the docstring, and of functions inside."""
    text = ast.get_docstring(function, clean=False)
    lines = function.end_lineno - function.lineno + 1 - (text.count("\n") + 1 if text else 0)
    return lines, sum(isinstance(node, ast.FunctionDef) for node in ast.walk(function)) - 1


@pytest.mark.parametrize("module", MODULES)
def test_functions_are_short(module):
    tree = ast.parse((REPOSITORY / "evsdr" / module).read_text())
    sizes = {node.name: size(node) for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
    long = {name for name, (lines, nested) in sizes.items() if lines > LONGEST or nested > MOST_NESTED}
    assert long <= LONG.get(module, set())


def test_lines_are_counted_without_docstring():
    code = 'def f():\n    """A\n\n    b\n    """\n    x = 1\n\n    def g():\n        pass\n    return x'
    assert size(ast.parse(code).body[0]) == (6, 1)
