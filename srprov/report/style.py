"""How pages look: one sheet, without fonts, pictures or scripts; light, dark, narrow and printed. Text only.

Colours have a contrast of at least 4.5:1 to what is behind them in both schemes, and nothing is said by colour alone.
"""

from __future__ import annotations

import base64
import hashlib

RULES = """
:root{color-scheme:light dark;--bg:#f7f8f9;--panel:#fff;--text:#1a1e22;--soft:#545c65;--line:#d9dde2;--faint:#eef0f3;
--accent:#0b5fa5;--ok:#1a6b3c;--okbg:#e7f4ec;--warn:#7d4b00;--warnbg:#fdf2df;--bad:#a31d17;--badbg:#fcebe9;
--act:#2f6fab;--check:#a9c6e3;--wait:#b06a00;--path:#b3261e;
--h1:#eef5fb;--h2:#d8e8f6;--h3:#bcd8ef;--h4:#9bc4e6;--h5:#7fb2dc;--htext:#10202e}
@media(prefers-color-scheme:dark){:root{--bg:#121518;--panel:#1a1e22;--text:#e8eaed;--soft:#a8b0b8;--line:#363d45;
--faint:#23282e;--accent:#7ab8f2;--ok:#7fd6a2;--okbg:#15291e;--warn:#f2bd6b;--warnbg:#2e2412;--bad:#ff9a91;
--badbg:#351a18;--act:#6aaaf0;--check:#3c5878;--wait:#f0a63c;--path:#ff8a80;
--h1:#1b2530;--h2:#1e3146;--h3:#213f5d;--h4:#244d74;--h5:#285b8b;--htext:#f2f6fa}}
*{box-sizing:border-box}
body{margin:0;background:var(--bg);color:var(--text);font:15px/1.55 system-ui,-apple-system,"Segoe UI",Roboto,
"Noto Sans","Liberation Sans",sans-serif;overflow-wrap:break-word}
header,main,footer{max-width:74rem;margin:0 auto;padding:0 1.25rem}
header{padding-top:1.75rem}footer{padding-bottom:3rem;color:var(--soft);font-size:.87rem}
h1{font-size:1.6rem;line-height:1.25;margin:0 0 .25rem;font-weight:650;letter-spacing:-.01em}
h2{font-size:1.15rem;margin:0 0 .6rem;font-weight:650}
h3{font-size:.95rem;margin:1.1rem 0 .4rem;font-weight:600}
p{margin:.35rem 0}.soft,.about{color:var(--soft)}.about{margin:0 0 1rem;font-size:.93rem}
a{color:var(--accent)}
:focus-visible{outline:2px solid var(--accent);outline-offset:2px}
section{background:var(--panel);border:1px solid var(--line);border-radius:10px;padding:1.1rem 1.25rem;
margin:0 0 1rem}
nav ul{list-style:none;display:flex;flex-wrap:wrap;gap:.25rem 1.1rem;margin:0 0 1rem;padding:0;font-size:.93rem}
.verdict{border-radius:10px;padding:.85rem 1.1rem;margin:0 0 1rem;border:1px solid;font-size:1.02rem}
.verdict b{font-size:1.15rem;margin-right:.5rem}
.ok{color:var(--ok)}.warn{color:var(--warn)}.bad{color:var(--bad)}
.verdict.ok,.box.ok{background:var(--okbg);border-color:var(--ok)}
.verdict.warn,.box.warn{background:var(--warnbg);border-color:var(--warn)}
.verdict.bad,.box.bad{background:var(--badbg);border-color:var(--bad)}
.box{border:1px solid;border-radius:8px;padding:.6rem .9rem;margin:0 0 1rem}
.box ul{margin:.2rem 0;padding-left:1.2rem;color:var(--text)}
.tiles{display:flex;flex-wrap:wrap;gap:.6rem;margin:0 0 1rem}
.tiles div{flex:1 1 6.4rem;background:var(--panel);border:1px solid var(--line);border-radius:10px;padding:.55rem .8rem;
display:flex;flex-direction:column-reverse}
.tiles dt{color:var(--soft);font-size:.83rem}
.tiles dd{margin:0;font-size:1.35rem;font-weight:620;font-variant-numeric:tabular-nums;line-height:1.3}
.facts{display:grid;grid-template-columns:max-content minmax(0,1fr);gap:.15rem 1rem;margin:0}
.facts dt{color:var(--soft)}.facts dd{margin:0}
.scroll{overflow-x:auto;margin:.2rem 0 .6rem;container-type:inline-size}
table{border-collapse:collapse;font-size:.88rem;font-variant-numeric:tabular-nums;min-width:100%}
caption{text-align:left;color:var(--soft);padding:0 0 .4rem;font-size:.88rem}
caption span{position:sticky;left:0;display:inline-block;max-width:100cqw}
th,td{text-align:left;vertical-align:top;padding:.3rem .6rem;border-bottom:1px solid var(--line);unicode-bidi:isolate}
thead th{color:var(--soft);font-weight:550;border-bottom:1px solid var(--soft);white-space:nowrap}
tbody th{font-weight:550}tbody tr:last-child>*{border-bottom:0}
.num{text-align:right;white-space:nowrap}.tight{white-space:nowrap}
.long td{max-width:34rem}.long td:last-child:not(.num){min-width:12rem}
.grid{min-width:0}.grid th,.grid td{text-align:center;white-space:nowrap}
.grid tbody th,.grid thead th:first-child{text-align:left;position:sticky;left:0;background:var(--panel)}
.grid .here{background:var(--okbg);color:var(--ok);font-weight:650}
.grid .no{color:var(--soft)}
.heat td{border:2px solid var(--panel);border-radius:6px;color:var(--htext)}
.heat .h1{background:var(--h1)}.heat .h2{background:var(--h2)}.heat .h3{background:var(--h3)}
.heat .h4{background:var(--h4)}.heat .h5{background:var(--h5)}
.heat .x{background:var(--badbg);color:var(--bad);font-weight:650}.heat .none{color:var(--soft)}
.key{display:inline-flex;align-items:center;gap:.35rem;margin-right:1.1rem;color:var(--soft);font-size:.88rem}
.key span{padding:0 .5rem;border-radius:4px;color:var(--htext)}
.key span.h1{background:var(--h1)}.key span.h2{background:var(--h2)}.key span.h3{background:var(--h3)}
.key span.h4{background:var(--h4)}.key span.h5{background:var(--h5)}
details{margin:.15rem 0}
details>summary{cursor:pointer;padding:.25rem .1rem;border-radius:6px}
details>summary:hover{background:var(--faint)}
details[open]>summary{margin-bottom:.35rem}
summary b{font-weight:600}
pre{white-space:pre-wrap;background:var(--faint);border-radius:6px;padding:.5rem .7rem;margin:.35rem 0;
font:.84rem/1.45 ui-monospace,"SFMono-Regular",Menlo,Consolas,"Liberation Mono",monospace;
max-height:22rem;overflow:auto}
code{font:.9em ui-monospace,"SFMono-Regular",Menlo,Consolas,"Liberation Mono",monospace;unicode-bidi:isolate}
.mark{font-weight:650;white-space:nowrap}
.lanes{list-style:none;margin:0;padding:0;font-size:.88rem}
.lanes li{display:grid;grid-template-columns:minmax(5rem,9rem) 1fr 4.6rem;gap:.7rem;align-items:center;
padding:.12rem 0;border-bottom:1px solid var(--line)}
.lanes li:last-child{border:0}
.lanes svg{display:block;width:100%;height:20px}
.lanes .who{white-space:nowrap;overflow:hidden;text-overflow:ellipsis}
.axis{display:flex;justify-content:space-between;color:var(--soft);font-size:.8rem;margin:0 5.3rem 0 9.7rem}
.act{stroke:var(--act);stroke-width:11}.check{stroke:var(--check);stroke-width:11}
.await{stroke:var(--wait);stroke-width:5}.rest{stroke:var(--line);stroke-width:1.5}
.path{stroke:var(--path);stroke-width:3}
.key svg{width:1.6rem;height:14px}
.plots{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,19rem),1fr));gap:1rem;margin:.4rem 0}
.plots svg{width:100%;height:auto;display:block}
svg text{font:12px system-ui,sans-serif;fill:var(--soft)}
.plots svg text{font-size:14px}
.plot line{stroke:var(--line)}.plot circle{fill:var(--act);fill-opacity:.65}
.plot polyline{stroke:var(--wait);fill:none;stroke-width:1.5}
@media(max-width:600px){body{font-size:14.5px}header,main,footer{padding-left:.8rem;padding-right:.8rem}
section{padding:.9rem .85rem}h1{font-size:1.35rem}.tiles div{flex-basis:5.4rem}
.facts{grid-template-columns:minmax(0,1fr)}.facts dd{margin-bottom:.35rem}
.lanes li{grid-template-columns:4.6rem 1fr 4rem;gap:.45rem}
.axis{margin:0 4.45rem 0 5.05rem}.axis span:nth-child(even){display:none}
th,td{padding:.3rem .45rem}}
@media print{:root{--bg:#fff;--panel:#fff;--text:#000;--soft:#444;--line:#bbb}body{font-size:10.5pt}nav{display:none}
header,main,footer{max-width:none;padding:0}section,.verdict{break-inside:auto;border-radius:0}
h2,h3,summary{break-after:avoid}tr,.lanes li,.verdict,.tiles{break-inside:avoid}
.scroll,pre{overflow:visible;max-height:none}
.grid td,.grid th,table{white-space:normal;font-size:8.5pt}
details::details-content{display:block;content-visibility:visible;height:auto}
*{print-color-adjust:exact;-webkit-print-color-adjust:exact}}
""".strip().replace("\n", "")


def policy() -> str:
    """Return the Content-Security-Policy of a page: nothing is loaded, and this one sheet alone is its style."""
    digest = base64.b64encode(hashlib.sha256(RULES.encode()).digest()).decode()
    return f"default-src 'none'; style-src 'sha256-{digest}'; img-src data:; base-uri 'none'; form-action 'none'"
