#include "engine/report/report_style.h"

namespace patina {

// Greys are neutral, so that the page doesn't tint the pictures on it; hue is kept for before (amber), after
// (blue) and the mood of the verdict.
const char* const kReportStyle = R"css(
:root { color-scheme: light dark;
  --ground: #f4f4f3; --panel: #ffffff; --sunken: #ececeb; --line: #d9d9d7; --text: #1d1d1d; --dim: #626262;
  --before: #b8690f; --after: #1d66ad; --noise: #8a8a8a; --good: #2c7d46; --warn: #a8620a; --stop: #777777; }
@media (prefers-color-scheme: dark) { :root {
  --ground: #191919; --panel: #242424; --sunken: #1f1f1f; --line: #3a3a3a; --text: #e6e6e6; --dim: #a0a0a0;
  --before: #e2a548; --after: #62aae6; --noise: #8c8c8c; --good: #74c48a; --warn: #e2a548; --stop: #9a9a9a; } }
* { box-sizing: border-box; }
html { scroll-behavior: smooth; }
@media (prefers-reduced-motion: reduce) { html { scroll-behavior: auto; } }
body { margin: 0; background: var(--ground); color: var(--text);
  font: 16px/1.5 system-ui, "Segoe UI", Roboto, "Noto Sans", "Liberation Sans", sans-serif; }
.page { max-width: 1120px; margin: 0 auto; padding: 0 20px 64px; }
header { padding: 34px 0 8px; }
.eyebrow { color: var(--dim); font-size: 14px; margin: 0 0 10px; overflow-wrap: anywhere; }
h1 { font-size: clamp(23px, 3.4vw, 33px); line-height: 1.22; font-weight: 650; margin: 0 0 12px;
  padding-left: 16px; border-left: 5px solid var(--mood); text-wrap: balance; }
.mood-nothing { --mood: var(--good); } .mood-found { --mood: var(--after); }
.mood-unnamed { --mood: var(--warn); } .mood-stopped { --mood: var(--stop); }
header .detail { font-size: 17px; margin: 0 0 20px; max-width: 78ch; }
h2 { font-size: 21px; font-weight: 640; margin: 44px 0 6px; }
h3 { font-size: 17px; font-weight: 640; margin: 0; }
h4 { font-size: 14px; font-weight: 640; margin: 0 0 4px; }
.lead { color: var(--dim); margin: 0 0 14px; max-width: 82ch; }
p { margin: 0 0 10px; }
.panel { background: var(--panel); border: 1px solid var(--line); border-radius: 10px; padding: 16px 18px; }
nav { display: flex; flex-wrap: wrap; gap: 4px 18px; margin: 18px 0 0; font-size: 14px; }
a { color: var(--after); text-underline-offset: 3px; }
a:focus-visible, summary:focus-visible, input:focus-visible { outline: 2px solid var(--after);
  outline-offset: 3px; border-radius: 3px; }
.errors { display: grid; grid-template-columns: auto 1fr auto; gap: 7px 12px; align-items: center; }
.errors .name { font-size: 14px; color: var(--dim); white-space: nowrap; }
.track { position: relative; height: 16px; background: var(--sunken); border-radius: 3px; overflow: hidden; }
.track i { position: absolute; inset: 0 auto 0 0; border-radius: 3px; }
.fill-before { background: var(--before); } .fill-after { background: var(--after); }
.fill-noise { background: var(--noise); }
.track b { position: absolute; top: 0; bottom: 0; width: 2px; background: var(--text); opacity: .75; }
.number { font-variant-numeric: tabular-nums; font-size: 15px; white-space: nowrap; text-align: right; }
.cards { display: grid; gap: 16px; }
.card .head { display: flex; flex-wrap: wrap; gap: 4px 12px; align-items: baseline; margin-bottom: 8px; }
.card code, .tag { font: 12.5px/1.4 ui-monospace, "DejaVu Sans Mono", monospace; color: var(--dim); }
.tag { border: 1px solid var(--line); border-radius: 4px; padding: 0 5px; white-space: nowrap; }
.say { font-size: 17px; max-width: 82ch; }
.evidence { display: grid; grid-template-columns: minmax(110px, 220px) 1fr; gap: 3px 14px; align-items: center;
  margin: 12px 0; font-size: 14.5px; }
.evidence .track { height: 10px; }
.plots { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 330px), 1fr)); gap: 18px;
  margin-top: 14px; }
figure { margin: 0; min-width: 0; }
figcaption { font-size: 13.5px; color: var(--dim); margin-top: 5px; }
.plot { display: block; width: 100%; max-width: 520px; height: auto; }
.plot text { font-family: inherit; fill: var(--dim); }
.plot .tick { font-size: 11.5px; } .plot .label { font-size: 12px; }
.plot .grid { stroke: var(--line); stroke-width: 1; } .plot .zero { stroke: var(--noise); stroke-width: 1; }
.plot .axis { stroke: var(--dim); stroke-width: 1.2; }
.plot .level { stroke: var(--after); stroke-width: 3; }
.plot .expected { fill: none; stroke: var(--after); stroke-width: 2.2; stroke-linejoin: round; }
.plot .seen { fill: var(--before); } .plot .bar { stroke: var(--before); stroke-width: 1.2; opacity: .75; }
.plot .before { fill: var(--before); } .plot .after { fill: var(--after); }
.plot .noise { stroke: var(--text); stroke-width: 1.2; stroke-dasharray: 3 3; }
.key { display: flex; flex-wrap: wrap; gap: 4px 16px; font-size: 13.5px; color: var(--dim); margin: 4px 0 8px; }
.key span::before { content: ""; display: inline-block; width: 12px; height: 12px; border-radius: 3px;
  background: var(--swatch); margin-right: 6px; vertical-align: -1px; }
.k-before { --swatch: var(--before); } .k-after { --swatch: var(--after); } .k-noise { --swatch: var(--noise); }
.pictures { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 270px), 1fr)); gap: 16px; }
.pictures img { display: block; width: 100%; height: auto; image-rendering: pixelated; background: #595959; }
.wipe { position: relative; --at: 50%; line-height: 0; }
.wipe .over { position: absolute; inset: 0; clip-path: inset(0 0 0 var(--at)); }
.wipe .rule { position: absolute; top: 0; bottom: 0; left: var(--at); width: 2px; margin-left: -1px;
  background: #ffffff; box-shadow: 0 0 0 1px rgba(0,0,0,.55); pointer-events: none; }
.wipe .left, .wipe .right { position: absolute; top: 8px; font-size: 12px; line-height: 1.3; padding: 2px 7px;
  border-radius: 4px; background: rgba(0,0,0,.62); color: #ffffff; pointer-events: none; }
.wipe .left { left: 8px; } .wipe .right { right: 8px; }
.wipe-range { width: 100%; margin: 8px 0 0; accent-color: var(--after); }
.shot { margin-bottom: 22px; }
.shot h3 { margin-bottom: 10px; overflow-wrap: anywhere; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-size: 14.5px; }
th { text-align: left; font-weight: 600; color: var(--dim); font-size: 13px; }
th, td { padding: 6px 12px 6px 0; border-bottom: 1px solid var(--line); vertical-align: top; }
tbody tr:last-child td { border-bottom: 0; }
td.number, th.number { text-align: right; }
th.number { font-size: 13px; }
td.file { overflow-wrap: anywhere; min-width: 130px; }
td .track { width: 130px; height: 11px; margin-top: 5px; }
details { margin-top: 10px; } summary { cursor: pointer; color: var(--after); }
ul.plain { list-style: none; margin: 0; padding: 0; display: grid; gap: 10px; }
.map { max-width: 300px; } .map img { width: 100%; image-rendering: pixelated; display: block; }
footer { margin-top: 48px; padding-top: 14px; border-top: 1px solid var(--line); font-size: 13.5px;
  color: var(--dim); overflow-wrap: anywhere; }
@media print { nav, .wipe-range { display: none; } .panel { break-inside: avoid; } }
)css";

// Sliders stand where style sheets put them when nothing runs; the script moves them.
const char* const kReportScript = R"js(
document.querySelectorAll('.wipe-range').forEach(function (range) {
  var wipe = range.parentNode.querySelector('.wipe');
  function place() { wipe.style.setProperty('--at', range.value + '%'); }
  range.addEventListener('input', place);
  wipe.addEventListener('pointerdown', function (event) {
    event.preventDefault();
    function follow(e) {
      var box = wipe.getBoundingClientRect();
      range.value = String(Math.max(0, Math.min(100, 100 * (e.clientX - box.left) / box.width)));
      place();
    }
    function leave() {
      window.removeEventListener('pointermove', follow);
      window.removeEventListener('pointerup', leave);
    }
    follow(event);
    window.addEventListener('pointermove', follow);
    window.addEventListener('pointerup', leave);
  });
  place();
});
)js";

}  // namespace patina
