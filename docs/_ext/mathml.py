"""Formulas as MathML, which browsers draw themselves: the site needs no network and no scripts for them.

Browsers know few of MathML's ``mathvariant``, so bold and sans-serif letters are replaced by Unicode's own.
"""

from __future__ import annotations

import html
import re
import unicodedata

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

STYLES = {"bold": "BOLD", "bold-italic": "BOLD ITALIC", "sans-serif": "SANS-SERIF"}
LETTER = re.compile(r'<mi mathvariant="(bold|bold-italic|sans-serif)">([^<]+)</mi>')


def styled(match: re.Match[str]) -> str:
    """A letter in bold or sans serif as a letter of its own."""
    style, letter = STYLES[match[1]], html.unescape(match[2])
    kind = "CAPITAL" if letter.isupper() else "SMALL"
    name = unicodedata.name(letter, "").rpartition(" ")[2]
    try:
        shown = unicodedata.lookup(f"MATHEMATICAL {style} {kind} {name}")
    except KeyError:
        try:  # digits
            shown = unicodedata.lookup(f"MATHEMATICAL {style} DIGIT {name}")
        except KeyError:
            shown = letter
    return f'<mi mathvariant="normal">{shown}</mi>'


def mathml(latex: str, display: str) -> str:
    """A formula; what the converter does not know is an error."""
    text = LETTER.sub(styled, convert(latex.strip(), display=display))
    if "\\" in text:
        raise ValueError(f"the formula cannot be converted: {latex}")
    return text


def visit_inline(self: HTML5Translator, node: nodes.math) -> None:
    """A formula in the text."""
    self.body.append(mathml(node.astext(), "inline"))
    raise nodes.SkipNode


def visit_display(self: HTML5Translator, node: nodes.math_block) -> None:
    """A formula of its own line."""
    self.body.append(f'<div class="math">{mathml(node.astext(), "block")}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_display, None))
    app.config.html_math_renderer = "mathml"
    return {"parallel_read_safe": True, "parallel_write_safe": True}
