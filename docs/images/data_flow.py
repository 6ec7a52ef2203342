"""Draw data-flow.svg, the picture of docs/index.md.

python docs/images/data_flow.py
"""

from pathlib import Path

PAPER, INK, MUTED, LINE = "#ffffff", "#242933", "#6b7482", "#b9c0cb"
DATA, ACT, LOOK = "#f0960f", "#2d87f0", "#19a06c"
WIDTH, HEIGHT = 1000, 452
BOX_WIDTH, BOX_HEIGHT = 176, 92
COLUMNS = (24, 284, 544, 800)
"""Left edges."""
ROWS = (68, 208, 348)

BOXES = (
    (0, 0, DATA, "objects", ("switches, lamps,", "doors, track toys")),
    (1, 0, DATA, "boards", ("places, colours,", "hidden relations")),
    (2, 0, ACT, "sim", ("a physical board:", "act and render")),
    (3, 0, DATA, "episodes", ("MCAP and Parquet,", "the truth kept apart")),
    (2, 1, ACT, "interact", ("where and how to act,", "from depth pictures")),
    (1, 1, ACT, "reason", ("what controls what,", "what happens next")),
    (0, 1, ACT, "plan", ("which action", "leads to a goal")),
    (1, 2, LOOK, "view", ("Rerun, figures,", "the report")),
)
ARROWS = (
    ("objects", "boards", "generate"),
    ("boards", "sim", ""),
    ("sim", "episodes", "collect"),
    ("interact", "sim", "chooses actions"),
    ("episodes", "interact", "train"),
    ("episodes", "reason", ""),
    ("reason", "plan", ""),
    ("interact", "view", ""),
    ("reason", "view", "eval, report"),
    ("plan", "view", ""),
)


def main() -> None:
    places = {name: (COLUMNS[column], ROWS[row]) for column, row, _, name, _ in BOXES}
    style = 'font-family="system-ui, Segoe UI, Helvetica, Arial, sans-serif"'
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" {style} role="img">',
        "<title>Objects become boards, boards are simulated, recordings become three skills, all can be viewed</title>",
        f'<rect width="{WIDTH}" height="{HEIGHT}" rx="14" fill="{PAPER}"/>',
        f'<defs><marker id="tip" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="8" markerHeight="8" orient="auto">'
        f'<path d="M0,1 L9,5 L0,9 z" fill="{MUTED}"/></marker></defs>',
        text(24, 40, "data flows one way; every station is a folder of busybot/", 15, MUTED),
    ]
    parts += [arrow(places[start], places[end], words) for start, end, words in ARROWS]
    parts += [box(places[name], color, name, lines) for _, _, color, name, lines in BOXES]
    parts += legend()
    Path(__file__).with_name("data-flow.svg").write_text("\n".join([*parts, "</svg>"]) + "\n", encoding="utf-8")


def text(x: float, y: float, words: str, size: int, color: str, more: str = "") -> str:
    return f'<text x="{x:g}" y="{y:g}" font-size="{size}" fill="{color}"{more}>{words}</text>'


def box(place: tuple[int, int], color: str, name: str, lines: tuple[str, ...]) -> str:
    x, y = place
    size = f'width="{BOX_WIDTH}" height="{BOX_HEIGHT}"'
    parts = [
        f'<rect x="{x}" y="{y}" {size} rx="10" fill="{PAPER}" stroke="{LINE}" stroke-width="1.5"/>',
        f'<rect x="{x}" y="{y + 12}" width="5" height="{BOX_HEIGHT - 24}" rx="2.5" fill="{color}"/>',
        text(x + 20, y + 31, name, 18, INK, ' font-weight="600"'),
    ]
    return "\n".join([*parts, *(text(x + 20, y + 54 + 19 * n, words, 13, MUTED) for n, words in enumerate(lines))])


def arrow(start: tuple[int, int], end: tuple[int, int], words: str) -> str:
    """Straight along a row or a column; between both a bend that leaves downwards."""
    (x0, y0), (x1, y1) = start, end
    middle = BOX_WIDTH / 2
    if y0 == y1:
        forward = x1 > x0
        points = (x0 + (BOX_WIDTH if forward else 0), y0 + BOX_HEIGHT / 2, x1 + (0 if forward else BOX_WIDTH))
        path = f"M{points[0]},{points[1]} L{points[2] + (-3 if forward else 3)},{points[1]}"
        label = ((points[0] + points[2]) / 2, points[1] - 9)
    elif x0 == x1:
        down = y1 > y0
        ends = (y0 + (BOX_HEIGHT if down else 0), y1 + (-3 if down else BOX_HEIGHT + 3))
        path, label = (
            f"M{x0 + middle},{ends[0]} L{x1 + middle},{ends[1]}",
            (x0 + middle + 52, sum(ends) / 2 + (5 if down else 17)),
        )
    else:
        path, label = bend(x0, y0, x1, y1)
    line = f'<path d="{path}" fill="none" stroke="{MUTED}" stroke-width="1.6" marker-end="url(#tip)"/>'
    return line + (text(*label, words, 12, MUTED, ' text-anchor="middle"') if words else "")


def bend(x0: int, y0: int, x1: int, y1: int) -> tuple[str, tuple[float, float]]:
    """From the bottom of one box to the nearer side of another, or along the gap above its row."""
    centre, side = x0 + BOX_WIDTH / 2, y1 + BOX_HEIGHT / 2
    left = x1 < x0
    target = x1 + (BOX_WIDTH + 3 if left else -3)
    if x0 == COLUMNS[3] and x1 == COLUMNS[1]:  # past the box between them
        gap, over = y1 - 22, x1 + BOX_WIDTH / 2
        turn = f"Q{centre - 40},{gap} {centre - 52},{gap}"
        path = f"M{centre - 40},{y0 + BOX_HEIGHT} L{centre - 40},{gap - 12} {turn} L{over + 12},{gap}"
        return f"{path} Q{over},{gap} {over},{gap + 12} L{over},{y1 - 3}", (over + 90, gap - 8)
    turn = f"Q{centre},{side} {centre + (-14 if left else 14)},{side}"
    return f"M{centre},{y0 + BOX_HEIGHT} L{centre},{side - 14} {turn} L{target},{side}", (
        (centre + target) / 2,
        side - 9,
    )


def legend() -> list[str]:
    parts, x = [], 520
    for color, words in ((DATA, "plain data"), (ACT, "what acts and learns"), (LOOK, "what people look at")):
        parts.append(f'<rect x="{x}" y="412" width="5" height="16" rx="2.5" fill="{color}"/>')
        parts.append(text(x + 12, 425, words, 13, MUTED))
        x += 40 + 7 * len(words)
    return parts


if __name__ == "__main__":
    main()
