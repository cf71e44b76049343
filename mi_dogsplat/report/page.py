"""The page around a report: one style sheet (light, dark, phone, print) and the skeleton of the document."""

from __future__ import annotations

from html import escape

from ..support.pictures import MAGMA

STYLE = """
:root { color-scheme: light dark; --page: #fafaf8; --card: #fff; --ink: #1b1d21; --muted: #5d6470;
  --line: #e3e3de; --mark: #1b1d21; --warn: #fff3d6; --warn-ink: #6b4a00; --bad: #fbdcd8; --bad-ink: #8a1208;
  --c1: #1f66c1; --c2: #c4511d; --c3: #00a886; --c4: #7200ff; --c5: #ed005b; --c6: #494474; --c7: #6a2a0f; }
@media (prefers-color-scheme: dark) { :root { --page: #14161a; --card: #1b1e24; --ink: #e8e9ec;
  --muted: #9ba3b1; --line: #2e333c; --mark: #e8e9ec; --warn: #3a2f14; --warn-ink: #ffdc8f; --bad: #4a1b17;
  --bad-ink: #ffb4a9; --c1: #6aa8ff; --c2: #ff9a62; --c3: #0bf3ac; --c4: #ff00c5; --c5: #ffd748; --c6: #a9ddf7;
  --c7: #4a9722; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--ink); -webkit-text-size-adjust: 100%;
  font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", "DejaVu Sans", sans-serif; }
main { max-width: 1120px; margin: 0 auto; padding: 40px 24px 64px; }
h1 { font-size: 32px; line-height: 1.2; letter-spacing: -.015em; margin: 0; overflow-wrap: anywhere; }
h1 small { font-weight: 400; color: var(--muted); font-size: inherit; }
h2 { font-size: 20px; letter-spacing: -.005em; margin: 48px 0 4px; }
h3 { font-size: 16px; margin: 0; }
p { margin: 6px 0; max-width: 72ch; }
.read, figcaption { color: var(--muted); font-size: 14px; text-wrap: pretty; }
.read { max-width: 96ch; }
code { font: .92em ui-monospace, "SF Mono", Menlo, Consolas, "DejaVu Sans Mono", monospace; }
.notice { background: var(--warn); color: var(--warn-ink); border-radius: 8px; padding: 10px 14px;
  margin: 16px 0 0; max-width: none; }
.tiles { display: grid; grid-template-columns: repeat(6, 1fr); gap: 12px; margin: 24px 0 0; }
.tile { background: var(--card); border: 1px solid var(--line); border-radius: 10px; padding: 12px 14px
  10px; }
.tile .name, .tile .more { color: var(--muted); font-size: 13px; line-height: 1.35; }
.tile .value { font-size: 23px; font-weight: 600; letter-spacing: -.02em; line-height: 1.35;
  font-variant-numeric: tabular-nums; white-space: nowrap; }
.tile .value small { font-size: 14px; font-weight: 400; color: var(--muted); letter-spacing: 0; }
.facts { display: flex; flex-wrap: wrap; gap: 4px 28px; margin: 16px 0 0; font-size: 14px; }
.facts div { display: flex; gap: 7px; } .facts dt { color: var(--muted); } .facts dd { margin: 0; }
.plots { display: grid; grid-template-columns: 1fr 1fr; gap: 16px; margin: 22px 0 8px; }
.plots svg { display: block; width: 100%; height: auto; background: var(--card);
  border: 1px solid var(--line); border-radius: 10px; padding: 10px 12px 6px; }
svg text { font-size: 12.5px; fill: var(--muted); font-variant-numeric: tabular-nums; }
svg .label { fill: var(--ink); }
svg path { fill: none; stroke-width: 1; } svg .grid { stroke: var(--line); } svg .axis { stroke:
  var(--muted); }
svg .event { stroke: var(--mark); stroke-width: 1.4; opacity: .75; }
svg .mark { stroke: var(--mark); stroke-dasharray: 3 3; opacity: .6; }
.c0, .k0 { --of: var(--ink); } .c1, .k1 { --of: var(--c1); } .c2, .k2 { --of: var(--c2); }
.c3, .k3 { --of: var(--c3); } .c4, .k4 { --of: var(--c4); } .c5, .k5 { --of: var(--c5); }
.c6, .k6 { --of: var(--c6); } .c7, .k7 { --of: var(--c7); }
svg .key { font-weight: 700; fill: var(--of); } svg .line, svg .faint, svg .dashed { stroke: var(--of); }
svg .line { stroke-width: 2; stroke-linejoin: round; } svg .faint { opacity: .38; }
svg .dashed { stroke-dasharray: 5 4; opacity: .6; } svg .points { fill: var(--of); stroke: var(--card); }
svg .ring { fill: none; stroke: var(--ink); stroke-width: 1.3; } svg .note { fill: var(--ink); font-size: 12px; }
.legend { display: flex; flex-wrap: wrap; gap: 4px 18px; list-style: none; margin: 14px 0 0; padding: 0;
  font-size: 14px; }
.legend li { display: flex; align-items: center; gap: 6px; } .swatch { width: 16px; height: 16px; }
.scroll { overflow-x: auto; margin: 14px 0 0; }
table { border-collapse: collapse; font-size: 14px; font-variant-numeric: tabular-nums; }
th, td { padding: 5px 22px 5px 0; text-align: left; border-bottom: 1px solid var(--line); vertical-align:
  top; }
th { color: var(--muted); font-weight: 500; } .n { text-align: right; white-space: nowrap; }
.plots + .read + h3, h3.scene { margin-top: 28px; }
tr.group th { color: var(--ink); font-weight: 600; padding-top: 14px; }
td.bad { background: var(--bad); color: var(--bad-ink); } td small { color: var(--muted); }
summary { cursor: pointer; font-size: 14px; color: var(--muted); }
td.value { overflow-wrap: anywhere; }
.bar { display: inline-block; width: 110px; height: 8px; border-radius: 4px; background: var(--line); }
.bar i { display: block; height: 8px; border-radius: 4px; background: var(--c1); }
.view { margin: 26px 0 0; } .view header { display: flex; flex-wrap: wrap; gap: 2px 18px; align-items:
  baseline;
  margin: 0 0 8px; } .view header span { color: var(--muted); font-size: 14px; font-variant-numeric:
  tabular-nums; }
.sheet { display: grid; gap: 14px; } .sheet.tall { grid-template-columns: 1fr 1fr; }
.triple { display: grid; grid-template-columns: repeat(3, 1fr); gap: 6px; }
.triple figure { margin: 0; min-width: 0; } .triple figcaption { font-size: 13px; margin-top: 3px;
  line-height: 1.35; }
.crops { display: grid; grid-template-columns: repeat(4, 1fr); gap: 10px 6px; margin: 12px 0; }
.crops figure { margin: 0; min-width: 0; } .crops img { image-rendering: pixelated; }
.frame { position: relative; display: block; overflow: hidden; border-radius: 4px; background:
  var(--line); }
.frame img { display: block; width: 100%; height: 100%; object-fit: cover; }
.frame b { position: absolute; border: 1.5px solid #fff; outline: 1.5px solid rgba(0, 0, 0, .65); }
.frame i { position: absolute; border-top: 1px solid #fff; outline: .5px solid rgba(0, 0, 0, .5); }
.range { white-space: nowrap; }
.scale { display: inline-block; vertical-align: -1px; width: 120px; height: 11px; border-radius: 3px;
  margin: 0 5px;
  background: linear-gradient(90deg, MAGMA); }
@media (max-width: 900px) { .tiles { grid-template-columns: repeat(3, 1fr); } .sheet.tall {
  grid-template-columns: 1fr; } }
@media (max-width: 640px) { .crops { grid-template-columns: 1fr 1fr; }
  main { padding: 24px 16px 48px; } h1 { font-size: 26px; } .plots {
  grid-template-columns: 1fr; }
  .tiles { grid-template-columns: 1fr 1fr; gap: 8px; } .plots svg { padding: 8px 4px 2px; } svg text {
  font-size: 14px; }
  .wide .full { grid-template-columns: 1fr; } th, td { padding-right: 14px; } .bar { width: 60px; }
  .prunes .share { display: none; } }
@media print { body { background: none; } .view, .plots svg { break-inside: avoid; } }
""".replace("MAGMA", ", ".join(MAGMA))


def page(title: str, body: str) -> str:
    """A complete HTML document that needs nothing but itself; ``body`` is HTML, ``title`` plain text."""
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(title)}</title>
<style>{STYLE}</style>
</head>
<body>
<main>
{body}
</main>
</body>
</html>
"""
