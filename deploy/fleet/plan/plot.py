"""The plot of what breaks first: used shares of limits over robots, as an SVG file."""

import math
from collections.abc import Sequence

from report import percent
from search import Sweep

WIDTH, HEIGHT, LEFT, TOP, RIGHT, BOTTOM = 780, 400, 60, 40, 205, 50
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")


def text(x: float, y: float, words: str, more: str = "") -> str:
    return f'<text x="{x:.0f}" y="{y:.0f}" {more}>{words}</text>'


def line(points: Sequence[tuple[float, float]], color: str, more: str = "") -> str:
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polyline points="{path}" fill="none" stroke="{color}" {more}/>'


def svg(one: Sweep, title: str) -> str:
    """Robots are in powers of ten."""
    most = max(one.rows)

    def x(robots: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * math.log10(robots) / math.log10(most)

    def y(share: float) -> float:
        return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * min(1.1, share) / 1.1

    def level(share: float, color: str, more: str = "") -> str:
        return line([(x(1), y(share)), (x(most), y(share))], color, more)

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        'font-family="sans-serif" font-size="12">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
        text(LEFT, 22, title, 'font-size="15"'),
        text((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 12, "robots", 'text-anchor="middle"'),
    ]
    for share in (0, 0.25, 0.5, 0.75, 1):
        parts.append(level(share, "#dddddd"))
        parts.append(text(LEFT - 8, y(share) + 4, percent(share), 'text-anchor="end"'))
    marks = [robots for robots in one.rows if math.log10(robots).is_integer()]
    parts += [text(x(at), HEIGHT - BOTTOM + 18, f"{at:,}", 'text-anchor="middle"') for at in marks]
    parts.append(level(one.limit, "#444444", 'stroke-dasharray="5 4"'))
    key = WIDTH - RIGHT + 15
    for number, (name, color) in enumerate(zip(one.rows[most], COLORS, strict=True)):
        points = [(x(robots), y(row[name])) for robots, row in one.rows.items()]
        parts.append(line(points, color, 'stroke-width="2"'))
        at = TOP + 20 + 22 * number
        parts.append(line([(key, at - 4), (key + 20, at - 4)], color, 'stroke-width="3"'))
        parts.append(text(key + 26, at, name))
    return "\n".join([*parts, "</svg>\n"])
