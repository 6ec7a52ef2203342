"""How the report looks in a browser; nothing is loaded from elsewhere."""

STYLE = """\
:root {
  --ink: #242933; --muted: #6b7482; --faint: #e6e9ee; --ground: #f6f7f9; --paper: #ffffff;
  --good: #12805a; --bad: #c2272d; --link: #1f6fd0; color-scheme: light;
}
* { box-sizing: border-box; }
body { margin: 0; background: var(--ground); color: var(--ink); }
body { font: 16px/1.55 system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
main { max-width: 1240px; margin: 0 auto; padding: 40px 32px 80px; }
h1 { font-size: 34px; line-height: 1.2; margin: 0 0 8px; letter-spacing: -0.02em; }
h2 { font-size: 24px; margin: 56px 0 8px; padding-top: 20px; border-top: 1px solid var(--faint); }
h3 { font-size: 18px; margin: 32px 0 6px; }
p, ul { max-width: 76ch; margin: 8px 0 14px; }
li { margin: 3px 0; }
a { color: var(--link); }
code { font: 0.88em ui-monospace, "SF Mono", Menlo, Consolas, monospace; background: #eef0f4; }
code { padding: 1px 5px; border-radius: 4px; overflow-wrap: anywhere; white-space: normal; }
.tiles { display: flex; flex-wrap: wrap; gap: 14px; margin: 24px 0; }
.tile { flex: 1 1 180px; padding: 16px 20px; }
.tile, .wide, figure { background: var(--paper); border: 1px solid var(--faint); border-radius: 10px; }
.tile b { display: block; font-size: 32px; line-height: 1.15; font-variant-numeric: tabular-nums; }
.tile span { color: var(--muted); font-size: 14px; }
.tile.reached b { color: var(--good); }
.tile.missed b { color: var(--bad); }
.tile.missing b { color: var(--muted); }
.wide { overflow-x: auto; margin: 16px 0; }
table { border-collapse: collapse; width: 100%; font-size: 14px; font-variant-numeric: tabular-nums; }
th, td { padding: 7px 10px; text-align: right; white-space: nowrap; border-top: 1px solid var(--faint); }
th { font-weight: 400; }
thead th { color: var(--muted); border-top: 0; }
thead th.group { text-align: center; color: var(--ink); font-weight: 600; }
tbody th, thead th:first-child { text-align: left; white-space: normal; min-width: 170px; }
td small { color: var(--muted); }
td.text { text-align: left; white-space: normal; }
tr.section th { background: #fafbfc; color: var(--muted); font-size: 12px; padding: 5px 10px; }
tr.section th { letter-spacing: 0.05em; text-transform: uppercase; }
td.reached { color: var(--good); }
td.missed { color: var(--bad); font-weight: 600; }
table.dense { font-size: 13px; }
table.dense th, table.dense td { padding: 5px 6px; }
table.dense tbody th, table.dense thead th:first-child { min-width: 120px; }
table.dense td small { display: block; font-size: 11px; }
td.missing { color: #a2a9b4; font-style: italic; }
td.reference { color: var(--muted); }
figure { margin: 18px 0; padding: 14px; }
figure img { display: block; max-width: 100%; height: auto; margin: 0 auto; }
figcaption { color: var(--muted); font-size: 14px; margin-top: 8px; }
details { margin: 12px 0; }
summary { cursor: pointer; color: var(--muted); font-size: 14px; }
@media print {
  body { background: var(--paper); }
  main { max-width: none; padding: 0; }
  figure, .wide { break-inside: avoid; }
}
"""
