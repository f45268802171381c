"""Formulas as MathML, which browsers set themselves: pages need no network and no LaTeX."""

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml


def inline(self, node) -> None:
    """Write a formula of a line."""
    self.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def block(self, node) -> None:
    """Write a formula that stands alone."""
    self.body.append(f'<div class="math">{tex2mathml(node.astext(), as_block=True)}</div>')
    raise nodes.SkipNode


def setup(app) -> dict:
    """Register with Sphinx."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    app.config.html_math_renderer = "mathml"
    return {"parallel_read_safe": True, "parallel_write_safe": True}
