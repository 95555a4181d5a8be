"""From a matplotlib figure to SVG that can stand in the middle of a page: no links, no scripts, no ids that clash."""

from __future__ import annotations

import io
import re

from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

__all__ = ["inline_svg"]


def inline_svg(figure: Figure, prefix: str, description: str) -> str:
    """The figure as one `<svg>` element, the same bytes every time.

    Args:
        figure: drawn without pyplot.
        prefix: begins all ids; a letter first, its own for each figure of a page.
        description: what is seen, for those who do not see it; plain letters, no markup.
    """
    FigureCanvasSVG(figure)
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg")
    text = buffer.getvalue()
    text = text[text.index("<svg") :].strip()
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    # Within a page these two need no declaration.
    text = re.sub(r'\sxmlns(:xlink)?="[^"]*"', "", text).replace("xlink:href=", "href=")
    used = set(re.findall(r"(?:url\(#|href=\"#)([^)\"]+)", text))
    names = {old: f"{prefix}{number}" for number, old in enumerate(dict.fromkeys(re.findall(r'\bid="([^"]+)"', text)))}
    text = re.sub(r'\sid="([^"]+)"', lambda m: f' id="{names[m[1]]}"' if m[1] in used else "", text)
    text = re.sub(r"(url\(#|href=\"#)([^)\"]+)", lambda m: m[1] + names[m[2]], text)
    # Half a thousandth of a point is more than any eye asks for.
    text = re.sub(r"\d+\.\d{3,}", lambda m: f"{float(m[0]):.2f}" if float(m[0]) >= 1.0 else m[0], text)
    text = re.sub(r"\n\s*\n+", "\n", text)
    return text.replace("<svg", f'<svg role="img" aria-label="{description}"', 1)
