"""Charts of a page as SVG: lines, areas and points over two axes, sharp in print and in the colours of the page."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from runout.hazard.round_numbers import round_ticks
from runout.report.vector_map import text

WIDTH, LEFT, RIGHT, TOP, BOTTOM = 440.0, 46.0, 12.0, 10.0, 38.0  # of the picture, and room around the axes [units of the picture]
MOST_PLACES = 120  # of a line; longer ones are thinned out


@dataclass
class Chart:
    """A chart to which lines, areas and points are added in the order of drawing."""

    # across, up: labels of the axes, with units
    across: str
    up: str
    # x, y: ranges of the axes
    x: tuple[float, float]
    y: tuple[float, float]
    height: float = 250.0  # of the picture, which is 440 wide
    names: Sequence[tuple[float, str]] = ()  # ticks of the horizontal axis in place of round numbers
    parts: list[str] = field(default_factory=list)
    legend: list[tuple[str, str]] = field(default_factory=list)

    def line(self, x: Any, y: Any, colour: str, label: str = "", width: float = 1.6, more: str = "") -> None:
        """Add a line; ``more`` are further attributes of the path."""
        self.parts.append(f'<path d="{self._path(x, y)}" class="v-line" stroke="{colour}" stroke-width="{width}" {more}/>')
        self._name(colour, label)

    def area(self, x: Any, low: Any, high: Any, colour: str, label: str = "") -> None:
        """Add the area between two lines."""
        x = np.asarray(x)
        edge = self._path(np.concatenate([x, x[::-1]]), np.concatenate([np.asarray(low), np.asarray(high)[::-1]]), whole=True)
        self.parts.append(f'<path d="{edge}Z" fill="{colour}"/>')
        self._name(colour, label)

    def points(self, x: Any, y: Any, colour: str, label: str = "") -> None:
        """Add points."""
        places = zip(*self.place(np.asarray(x, float), np.asarray(y, float)), strict=True)
        circles = (f'<circle cx="{a:.1f}" cy="{b:.1f}" r="3.4"/>' for a, b in places if math.isfinite(a + b))
        self.parts.append(f'<g fill="{colour}" class="v-points">{"".join(circles)}</g>')
        self._name(colour, label)

    def svg(self, alt: str) -> Markup:
        """The chart, with the legend below it."""
        entries = "".join(f'<li><i style="background:{colour}"></i>{escape(label)}</li>' for colour, label in self.legend)
        legend = f'<ul class="key">{entries}</ul>' if entries else ""
        return Markup(
            f'<svg class="chart" viewBox="0 0 {WIDTH:g} {self.height:g}" role="img" aria-label="{escape(alt)}">{self._axes()}'
            f"{''.join(self.parts)}</svg>{legend}"
        )

    def _name(self, colour: str, label: str) -> None:
        if label:
            self.legend.append((colour, label))

    def place(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Place in the picture of values."""
        (west, east), (low, high) = self.x, self.y
        across = LEFT + (x - west) / ((east - west) or 1.0) * (WIDTH - LEFT - RIGHT)
        return across, self.height - BOTTOM - (y - low) / ((high - low) or 1.0) * (self.height - TOP - BOTTOM)

    def _path(self, x: Any, y: Any, whole: bool = False) -> str:
        step = 1 if whole else max(1, math.ceil(len(x) / MOST_PLACES))
        known = np.isfinite(np.asarray(x, float)) & np.isfinite(np.asarray(y, float))
        a, b = self.place(np.asarray(x, float)[known][::step], np.asarray(y, float)[known][::step])
        return "M" + "L".join(f"{i:.1f} {j:.1f}" for i, j in zip(a, b, strict=True)) if len(a) else ""

    def _axes(self) -> str:
        """Grid, numbers and labels."""
        parts, foot, right = [], self.height - BOTTOM, WIDTH - RIGHT
        for value in round_ticks(*self.y, 4):
            y = float(self.place(np.array(self.x[0]), np.array(value))[1])
            parts += [f'<path d="M{LEFT} {y:.1f}H{right}" class="v-grid"/>', text(LEFT - 5, y, _number(value), "end")]
        for value, name in self.names or [(value, _number(value)) for value in round_ticks(*self.x, 5)]:
            x = float(self.place(np.array(value), np.array(self.y[0]))[0])
            parts += [f'<path d="M{x:.1f} {foot}v4" class="v-frame"/>', text(x, foot + 12, name)]
        middle = (TOP + foot) / 2
        turned = f' transform="rotate(-90 9 {middle})"'
        labels = text((LEFT + right) / 2, self.height - 8, self.across), text(9, middle, self.up, more=turned)
        return "".join([*parts, f'<path d="M{LEFT} {TOP}V{foot}H{right}" class="v-frame"/>', *labels])


def _number(value: float) -> str:
    return f"{value:,.6g}".replace(",", "\u202f").replace("-", "\u2212")
