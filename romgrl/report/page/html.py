"""The page as one file: template, style, scripts, Plotly and data, nothing from a network."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from plotly.io import to_json
from plotly.offline import get_plotlyjs

from romgrl.report.page.charts import Chart

FOLDER = Path(__file__).parent
SHARED_SCRIPTS = ("player.js", "charts.js")
SCRIPTS = {"page": ("page.js",), "library": ("cells.js", "library.js"), "commands": ("cells.js", "commands.js")}
"""Of each page, after those that all of them have."""


def render_page(
    path: Path,
    *,
    scene: dict[str, Any],
    sections: Mapping[str, Sequence[Chart]],
    name: str = "page",
    **content: Any,
) -> None:
    """Write the page of NAME.html and its scripts.

    scene: what the player draws; sections: charts by place; content: the template's other values.
    """
    environment = Environment(loader=FileSystemLoader(FOLDER), autoescape=True, undefined=StrictUndefined)
    charts = [chart for section in sections.values() for chart in section]
    page = environment.get_template(f"{name}.html").render(
        **content,
        sections=sections,
        data=script_data({"scene": scene, "colors": content["colors"], "charts": [specification(c) for c in charts]}),
        style=Markup((FOLDER / "page.css").read_text("utf-8")),
        scripts=[Markup((FOLDER / script).read_text("utf-8")) for script in (*SHARED_SCRIPTS, *SCRIPTS[name])],
        plotly=Markup(get_plotlyjs()),
    )
    path.write_text(page, "utf-8")


def specification(chart: Chart) -> dict[str, Any]:
    """A chart as the page's script reads it."""
    return {"key": chart.key, "figure": json.loads(to_json(chart.figure, validate=False)), "cursor": chart.cursor}


def script_data(value: Any) -> Markup:
    """JSON that cannot end the script element around it."""
    return Markup(json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"))
