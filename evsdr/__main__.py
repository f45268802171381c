"""`python -m evsdr`: list the commands. It needs nothing but Python."""

import ast
import re
from pathlib import Path

from evsdr import __version__


def listing() -> str:
    """Give a line for each command: what to type, and what it does."""
    told = (
        ast.get_docstring(ast.parse(path.read_text("utf-8"))) for path in Path(__file__).parent.glob("*.py")
    )
    lines = (re.match(r"`(python -m evsdr\.\w+)`: (.+); see", text or "") for text in told)
    return "\n".join(sorted(f"  {line[1]:28}{line[2]}" for line in lines if line))


if __name__ == "__main__":
    title = f"evsdr {__version__}: normals and absolute reflectance from an event camera and a ring of LEDs."
    print(f"{title}\n\n{listing()}\n\nEach tells more with --help.")
