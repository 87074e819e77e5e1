"""Formulas as MathML, which browsers show by themselves: the pages need no network and no script."""

import html
import re

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util.math import get_node_equation_number
from sphinx.writers.html5 import HTML5Translator

BOLD_GREEK = re.compile(r"\\boldsymbol\s*(\\\w+|\{[^}]*\})")  # docutils knows \mathbfit only


def markup(formula: str, block: bool) -> str:
    """MathML of a formula in LaTeX."""
    formula = BOLD_GREEK.sub(r"\\mathbfit{\1}", formula)
    return "".join(tex2mathml(formula, as_block=block))


def visit_inline(translator: HTML5Translator, node: nodes.math) -> None:
    """Formula within a line."""
    translator.body.append(markup(node.astext(), block=False))
    raise nodes.SkipNode


def visit_block(translator: HTML5Translator, node: nodes.math_block) -> None:
    """Formula in a line of its own, with its number."""
    translator.body.append(translator.starttag(node, "div", CLASS="math"))
    if node["number"]:
        number = get_node_equation_number(translator, node)
        translator.body.append(f'<span class="eqno">({html.escape(number)})</span>')
    translator.body.append(markup(node.astext(), block=True) + "</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True}
