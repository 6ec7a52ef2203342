"""Pages: one grid as Markdown and as HTML, and nothing in a text that becomes markup."""

from pathlib import Path

import pytest

from busybot.common.text import unlinked
from busybot.view.report.page import (
    Block,
    Entry,
    Fold,
    Grid,
    Heading,
    Items,
    Picture,
    Text,
    Tiles,
    document,
    inline,
    markdown,
    plain_grid,
    spread,
)
from busybot.view.report.results import InteractResult, Score, score_of

GRID = Grid(
    (("known", 2), ("", 1)),
    ("P", "R", "n"),
    (("ours", ()), ("`a`", (Entry("97.0", "± 0.5", "reached"), Entry("-"), Entry("3", tone="missed")))),
    "percent",
)


def test_a_grid_as_markdown() -> None:
    assert markdown([GRID]).splitlines() == [
        "| percent | known: P | known: R | n |",
        "|---|---|---|---|",
        "| *ours* |  |  |  |",
        "| `a` | 97.0 ± 0.5 ✓ | - | 3 ✗ |",
    ]


def test_a_grid_as_html() -> None:
    page = document("t", [GRID])
    assert (
        '<th colspan="2" class="group">known</th>' in page and '<tr class="section"><th colspan="4">ours</th>' in page
    )
    assert '<td class="reached">97.0 ✓ <small>± 0.5</small></td><td>-</td><td class="missed">3 ✗</td>' in page
    assert page.count("<tr>") == page.count("</tr>") - 1 and '<table class="dense">' not in page
    wide = plain_grid([str(n) for n in range(9)], [("a", ["x"] * 9)])
    assert '<table class="dense">' in document("t", [wide]), "many columns are set more densely"


def test_every_block_has_its_html(tmp_path: Path) -> None:
    picture = tmp_path / "a.png"
    picture.write_bytes(b"pixels")
    inner: tuple[Block, ...] = (Text("hidden"), Items(("one", "two")))
    blocks: list[Block] = [
        Heading("A title: `x`", 3),
        Text("see [it](#a-title-x)"),
        Tiles((("4", "words", "missed"),)),
        Picture(picture, "c"),
        Fold("more", inner),
    ]
    page = document("T", blocks)
    assert '<h3 id="a-title-x">A title: <code>x</code></h3>' in page and '<a href="#a-title-x">it</a>' in page
    assert '<div class="tile missed"><b>4</b><span>words</span></div>' in page
    assert 'src="data:image/png;base64,cGl4ZWxz"' in page
    assert "<summary>more</summary>" in page and "<li>one</li><li>two</li>" in page
    text = markdown(blocks, tmp_path)
    assert "### A title: `x`" in text and "![c](a.png)\n\n*c*" in text and "- **4** words" in text
    assert "<details><summary>more</summary>\n\nhidden\n\n- one\n- two\n\n</details>" in text


EVIL = "<script>alert('&')</script>"


@pytest.mark.parametrize(
    "block",
    [
        Heading(EVIL),
        Text(EVIL),
        Tiles(((EVIL, EVIL, ""),)),
        plain_grid((EVIL,), [(EVIL, (EVIL,))], EVIL),
        Grid(((EVIL, 1),), ("h",), ((EVIL, ()),)),
        Items((EVIL,)),
        Fold(EVIL, (Text(EVIL),)),
    ],
    ids=lambda block: type(block).__name__,
)
def test_text_is_escaped(block: Block) -> None:
    page = document(EVIL, [block])
    assert "<script" not in page and "&lt;script&gt;alert(&#39;&amp;&#39;)" in page
    assert "<script" not in markdown([block])


def test_simple_markup_within_escaped_text() -> None:
    assert inline('**a `b<c`** [x](javascript:alert) "') == "<b>a <code>b&lt;c</code></b> [x](javascript:alert) &#34;"
    assert inline("a \0" + "0\0 `b`") == "a \\x000\\x00 <code>b</code>", "nothing in a text stands for code"
    assert markdown([Text("`a<b` < c")]) == "`a<b` &lt; c\n"
    assert markdown([Text("``<b>`")]) == "``&lt;b>`\n", "two backticks begin code that does not end"
    assert markdown([plain_grid(("h",), [("a|b", ("c|d",))])]).count("\\|") == 2


@pytest.mark.parametrize("start", ["\\`", "`a`` `", "x`\\`", "a ` b\n`", "`x\\|", "``"])
def test_backticks_that_markdown_pairs_otherwise_hide_no_tag(start: str) -> None:
    text = f"{start}<img src=x>`"
    for blocks in ([Text(text)], [Items((f"`{text}`",))], [plain_grid(("h",), [("n", (text,))])]):
        assert "<img" not in markdown(blocks)


def test_spreads() -> None:
    assert (spread(97, 96.0, 98.0), spread(0, None, 1.0), spread(1, 1.0, 1.01, several=True)) == ("± 1.0", "", "")
    assert spread(1.5, 1.0, 2.0, several=True) == "(1.0 to 2.0)"
    assert (spread(100, 96.4, 100), spread(0, 0, 3.6)) == ("(96.4 to 100.0)", "(0.0 to 3.6)")


def test_intervals_over_objects_stand_in_square_brackets() -> None:
    result = {
        "kind": "interact",
        "precision": 0.9,
        "recall": None,
        "boards": 2,
        "dataset": {},
        "intervals": {"precision": (0.8, 1.0)},
    }
    told = InteractResult.model_validate(result | {"object_intervals": {"precision": (0.5, 0.995)}})
    assert (found := score_of(told, "precision")) is not None and found.spread == "± 10.0 [50.0-99.5]"
    assert score_of(told, "recall") is None
    only = InteractResult.model_validate(result | {"intervals": {}})
    assert (found := score_of(only, "precision")) is not None and not found.spread and found.objects is None
    assert Score(90.0, objects=(50.0, 99.5)).spread == "[50.0-99.5]"


def test_text_of_results_is_one_line_without_links() -> None:
    text = "p\n\n# heading\n![x][y]\n[y]: https://example.org [a](b)"
    assert unlinked({text: [text]}) == {
        one: [one] for one in ["p # heading ![x] [y] [y] : https://example.org [a] (b)"]
    }
