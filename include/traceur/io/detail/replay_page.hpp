// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <string_view>

// The page of traceur/io/replay.hpp as text: style and controls, then the data, then the program. It is cut in pieces
// because a compiler need not take a string literal of more than 16 KB. Each piece of the program is a few functions,
// all inside one that the first piece opens and the last one closes.

namespace traceur::io::detail {

inline constexpr std::string_view replay_page_before_title = R"page(<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width,initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'">
<title>)page";

inline constexpr std::string_view replay_page_style = R"page(</title>
<style>
:root {
  color-scheme: light; --ink: #1d242b; --soft: #5b6772; --panel: rgba(255,255,255,.78); --edge: rgba(20,30,40,.13);
  --accent: #2f6fb0; --back: #dfe5ea;
}
:root[data-theme=dark] {
  color-scheme: dark; --ink: #e6ebf0; --soft: #98a4b0; --panel: rgba(24,29,36,.78); --edge: rgba(255,255,255,.13);
  --accent: #7fb4ea; --back: #1b2027;
}
* { box-sizing: border-box; }
html, body { margin: 0; height: 100%; overflow: hidden; background: var(--back); color: var(--ink);
  font: 13px/1.4 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", sans-serif; }
canvas { position: fixed; inset: 0; width: 100%; height: 100%; display: block; touch-action: none; cursor: grab; }
canvas:active { cursor: grabbing; }
.panel { background: var(--panel); border: 1px solid var(--edge); border-radius: 10px;
  backdrop-filter: blur(9px); -webkit-backdrop-filter: blur(9px); }
#head { position: fixed; top: 12px; left: 12px; right: 12px; display: flex; flex-wrap: wrap; gap: 8px;
  justify-content: space-between; align-items: flex-start; pointer-events: none; }
#head > * { pointer-events: auto; }
#about { padding: 9px 13px; max-width: min(340px, calc(100vw - 24px)); max-height: 55vh; overflow: auto; }
#about h1 { font-size: 15px; line-height: 1.3; font-weight: 650; margin: 0; overflow-wrap: anywhere; }
#about summary { cursor: pointer; color: var(--soft); margin-top: 3px; }
#about table { border-collapse: collapse; margin-top: 4px; width: 100%; }
#about td { padding: 2px 0; vertical-align: top; overflow-wrap: anywhere; }
#about td:first-child { color: var(--soft); padding-right: 14px; min-width: 76px; }
#about td:last-child { text-align: right; font-variant-numeric: tabular-nums; }
#legend { padding: 6px; display: flex; flex-direction: column; gap: 2px; max-width: 260px; max-height: 45vh; overflow: auto;
  margin-left: auto; }
#legend button { text-align: left; display: flex; gap: 8px; align-items: center; border-color: transparent; }
#legend button[aria-pressed=false] { opacity: .45; }
#legend i { width: 12px; height: 12px; border-radius: 4px; flex: none; }
#bar { position: fixed; left: 12px; right: 12px; bottom: 12px; padding: 7px 10px 8px; }
#row { display: flex; flex-wrap: wrap; gap: 6px 8px; align-items: center; }
#line { position: relative; }
#scrub { width: 100%; margin: 0 0 4px; display: block; }
#marks i { position: absolute; top: -3px; width: 3px; height: 5px; border-radius: 2px; background: #e0484d; pointer-events: none; }
input[type=range] { accent-color: var(--accent); }
#speed { width: 96px; }
button { font: inherit; color: inherit; background: transparent; border: 1px solid var(--edge); border-radius: 7px;
  padding: 3px 9px; cursor: pointer; min-height: 28px; }
button:hover { background: var(--edge); }
button:focus-visible, input:focus-visible, summary:focus-visible { outline: 2px solid var(--accent); outline-offset: 1px; }
button[aria-pressed=true]:not(#legend button) { border-color: var(--accent); color: var(--accent); }
#play { min-width: 40px; font-size: 14px; }
#time, #speed_text { font-variant-numeric: tabular-nums; white-space: nowrap; }
#time { min-width: 112px; }
#speed_text { min-width: 42px; color: var(--soft); }
.grow { flex: 1; }
#help { position: fixed; inset: 0; margin: auto; width: min(430px, calc(100vw - 24px)); height: fit-content; max-height: calc(100vh - 24px);
  overflow: auto; padding: 14px 18px; z-index: 3; }
#help h2 { margin: 0 0 6px; font-size: 14px; }
#help td { padding: 2px 14px 2px 0; vertical-align: top; }
kbd { font: 12px ui-monospace, monospace; border: 1px solid var(--edge); border-radius: 4px; padding: 0 5px; }
#tip { position: fixed; padding: 1px 7px; font-size: 12px; pointer-events: none; z-index: 2; }
[hidden] { display: none !important; }
@media (max-width: 640px) { #legend { flex-direction: row; flex-wrap: wrap; max-width: 100%; margin-left: 0; }
  #time { min-width: 0; } #speed { width: 70px; } }
</style>
</head>
<body>
<canvas id="view" role="img" aria-label="Animated figures; the controls are below"></canvas>
<div id="head">
<div id="about" class="panel"><h1 id="title"></h1><details id="facts" open><summary>Facts</summary><table><tbody id="fact_rows"></tbody></table></details></div>
<div id="legend" class="panel"></div>
</div>
<div id="bar" class="panel">
  <div id="line"><div id="marks"></div><input id="scrub" type="range" min="0" max="1" step="any" value="0" aria-label="Time"></div>
  <div id="row">
    <button id="play" aria-label="Play or pause" title="Play or pause (space)"></button>
    <span id="time"></span>
    <input id="speed" type="range" min="0.1" max="2" step="0.05" value="1" aria-label="Speed"><span id="speed_text"></span>
    <span class="grow"></span>
    <button id="follow" title="Camera follows the figure (F)">Follow</button>
    <button id="ghost" title="Ghosts: over the simulation, beside it, off (G)"></button>
    <button id="contacts" title="Contact points and forces (C)">Contacts</button>
    <button id="bones" title="Bones instead of solids (B)">Bones</button>
    <button id="theme" title="Light or dark (L)">Theme</button>
    <button id="help_open" aria-label="Help" title="Keys (H)">?</button>
  </div>
</div>
<div id="tip" class="panel" hidden></div>
<div id="help" class="panel" role="dialog" aria-label="Help" hidden>
  <h2>Mouse, touch and keys</h2>
  <table><tbody>
    <tr><td>drag</td><td>orbit</td></tr>
    <tr><td>right or shift + drag, two fingers</td><td>pan</td></tr>
    <tr><td>wheel, pinch</td><td>zoom</td></tr>
    <tr><td><kbd>space</kbd></td><td>play, pause</td></tr>
    <tr><td><kbd>&larr;</kbd> <kbd>&rarr;</kbd></td><td>one frame; with shift ten</td></tr>
    <tr><td><kbd>Home</kbd> <kbd>End</kbd></td><td>first, last moment</td></tr>
    <tr><td><kbd>-</kbd> <kbd>+</kbd></td><td>slower, faster</td></tr>
    <tr><td><kbd>F</kbd> <kbd>R</kbd></td><td>follow the figure, reset the camera</td></tr>
    <tr><td><kbd>G</kbd></td><td>ghosts: overlay, beside, off</td></tr>
    <tr><td><kbd>C</kbd> <kbd>B</kbd></td><td>contacts, bones</td></tr>
    <tr><td><kbd>I</kbd> <kbd>L</kbd> <kbd>H</kbd></td><td>facts, light or dark, this help</td></tr>
  </tbody></table>
  <p id="force_note" hidden></p>
  <button id="help_close">Close</button>
</div>
<noscript>This replay needs JavaScript.</noscript>
<script type="application/json" id="replay-data">)page";

inline constexpr std::string_view replay_page_motion = R"page(</script>
<script>
(() => {
"use strict";

const $ = id => document.getElementById(id);
const data = JSON.parse($("replay-data").textContent);
const query = new URLSearchParams(location.search);
const clamp = (x, low, high) => Math.min(high, Math.max(low, x));
const mix = (a, b, u) => a + (b - a) * u;
const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = a => Math.hypot(a[0], a[1], a[2]);
const unit = a => { const l = length(a) || 1; return [a[0] / l, a[1] / l, a[2] / l]; };
const turn = (q, v) => {
  const u = cross(q, v).map((x, k) => x + q[3] * v[k]);
  return add(v, cross(q, u), 2);
};
const compose = (a, b) => [
  a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1], a[3] * b[1] + a[1] * b[3] + a[2] * b[0] - a[0] * b[2],
  a[3] * b[2] + a[2] * b[3] + a[0] * b[1] - a[1] * b[0], a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2]];
const upright = [0, 0, 0, 1];
// The shortest turn that takes z to a direction.
const turn_z_to = direction => {
  const d = unit(direction);
  if (d[2] < -0.999999) return [1, 0, 0, 0];
  const q = [-d[1], d[0], 0, 1 + d[2]], l = Math.hypot(q[0], q[1], q[3]);
  return q.map(x => x / l);
};

const view_of = text => {
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; ++i) bytes[i] = raw.charCodeAt(i);
  return new DataView(bytes.buffer);
};
const floats = text => {
  const view = view_of(text), out = new Float32Array(view.byteLength / 4);
  for (let i = 0; i < out.length; ++i) out[i] = view.getFloat32(4 * i, true);
  return out;
};
const shorts = text => {
  const view = view_of(text), out = new Int16Array(view.byteLength / 2);
  for (let i = 0; i < out.length; ++i) out[i] = view.getInt16(2 * i, true);
  return out;
};
const numbers = (wide, text) => wide ? floats(text) : shorts(text);

function load(source) {
  const track = {...source, rig: data.characters[source.character], shown: true};
  track.bodies = track.rig.bodies.length;
  track.root = floats(source.roots);
  track.value = numbers(source.wide, source.poses);
  track.end = (source.frames - 1) / source.fps;
  track.pose = new Float64Array(7 * track.bodies);
  if (source.contacts) {
    const c = source.contacts, counts = view_of(c.counts);
    track.touch = {...c, value: numbers(c.wide, c.values), start: [0]};
    for (let f = 0; f < source.frames; ++f) track.touch.start.push(track.touch.start[f] + counts.getUint16(2 * f, true));
  }
  if (source.pushes) {
    track.push = floats(source.pushes);
    track.pushed = [];
    let last = -1, strongest = 0;
    for (let f = 0; f < source.frames; ++f) {
      const size = length(track.push.subarray(6 * f + 3, 6 * f + 6));
      if (size > 0) last = f;
      strongest = Math.max(strongest, size);
      track.pushed.push(last);
    }
    track.strongest = strongest || 1;
  }
  return track;
}

// Where a moment lies: the frame before, the frame after, and how far between.
function bracket(track, time) {
  const x = clamp(time * track.fps, 0, track.frames - 1);
  const i = Math.min(Math.floor(x + 1e-4), track.frames - 1), j = Math.min(i + 1, track.frames - 1);
  let u = clamp(x - i, 0, 1);
  // A reset to another place is a jump, not a flight.
  const r = track.root, jump = Math.hypot(r[3 * j] - r[3 * i], r[3 * j + 1] - r[3 * i + 1], r[3 * j + 2] - r[3 * i + 2]);
  if (jump * track.fps > 40) u = 0;
  return [i, j, u];
}

function pose_at(track, time) {
  const [i, j, u] = bracket(track, time), n = track.bodies, v = track.value, r = track.root, out = track.pose;
  const step = track.wide ? 1 : track.step;
  for (let b = 0; b < n; ++b) {
    const p = 7 * (i * n + b), q = 7 * (j * n + b), o = 7 * b;
    for (let k = 0; k < 3; ++k) out[o + k] = mix(r[3 * i + k] + step * v[p + k], r[3 * j + k] + step * v[q + k], u);
    let cosine = 0, l1 = 0, l2 = 0;
    for (let k = 3; k < 7; ++k) { cosine += v[p + k] * v[q + k]; l1 += v[p + k] ** 2; l2 += v[q + k] ** 2; }
    l1 = Math.sqrt(l1); l2 = Math.sqrt(l2);
    const side = cosine < 0 ? -1 : 1, angle = Math.acos(Math.min(1, side * cosine / (l1 * l2)));
    const s = Math.sin(angle), near = s < 1e-4;
    const a = near ? 1 - u : Math.sin((1 - u) * angle) / s, c = side * (near ? u : Math.sin(u * angle) / s);
    let l = 0;
    for (let k = 3; k < 7; ++k) { out[o + k] = a * v[p + k] / l1 + c * v[q + k] / l2; l += out[o + k] ** 2; }
    l = Math.sqrt(l);
    for (let k = 3; k < 7; ++k) out[o + k] /= l;
  }
  return out;
}

const tracks = data.tracks.map(load);
const main = tracks.find(t => !t.ghost) || tracks[0];
const duration = Math.max(...tracks.map(t => t.end));

// How far a figure reaches from its root, which sets the scale of cameras, arrows and distances.
const extent = (() => {
  let reach = 0.1;
  for (const track of tracks) {
    const pose = pose_at(track, 0);
    const at = b => [pose[7 * b], pose[7 * b + 1], pose[7 * b + 2]];
    for (let b = 0; b < track.bodies; ++b) reach = Math.max(reach, length(sub(at(b), at(0))));
    for (const s of track.rig.shapes) {
      reach = Math.max(reach, length(sub(at(s.body), at(0))) + Math.max(s.size[0], s.size[1], s.size[2]));
    }
  }
  return Math.min(reach, 50);
})();

// The root's path, smoothed so that the camera glides: a little across, more in height.
const path = (() => {
  const r = main.root, n = main.frames, out = new Float64Array(3 * n);
  for (let k = 0; k < 3; ++k) {
    const half = Math.round((k < 2 ? 0.2 : 0.6) * main.fps), sums = new Float64Array(n + 1);
    for (let f = 0; f < n; ++f) sums[f + 1] = sums[f] + r[3 * f + k];
    for (let f = 0; f < n; ++f) {
      const h = Math.min(half, f, n - 1 - f);
      out[3 * f + k] = (sums[f + h + 1] - sums[f - h]) / (2 * h + 1);
    }
  }
  return out;
})();
function path_at(time) {
  const [i, j, u] = bracket(main, time);
  return [0, 1, 2].map(k => mix(path[3 * i + k], path[3 * j + k], u));
}

// Ghosts shown beside stand to the left of the way the figure goes.
const heading = (() => {
  const n = 3 * (main.frames - 1), x = main.root[n] - main.root[0], y = main.root[n + 1] - main.root[1];
  return Math.hypot(x, y) > 0.5 * extent ? Math.atan2(y, x) : 0;
})();

const terrain = data.terrain && (() => {
  const t = {...data.terrain}, v = numbers(t.wide, t.heights);
  t.height = Float64Array.from(v, x => x * (t.wide ? 1 : t.step));
  t.low = Infinity; t.high = -Infinity;
  for (const h of t.height) { t.low = Math.min(t.low, h); t.high = Math.max(t.high, h); }
  t.left = t.x0 - t.dx / 2; t.right = t.left + t.nx * t.dx;
  t.bottom = t.y0 - t.dx / 2; t.top = t.bottom + t.ny * t.dx;
  t.at = (i, j) => i < 0 || j < 0 || i >= t.nx || j >= t.ny ? 0 : t.height[i + t.nx * j];
  return t;
})();
const ground_at = (x, y) =>
  terrain ? terrain.at(Math.floor((x - terrain.left) / terrain.dx), Math.floor((y - terrain.bottom) / terrain.dx)) : 0;

// An arrow of this many newtons is as long as the figure reaches; nearly the largest force, so that one spike at a
// landing does not shrink all others.
const force_scale = (() => {
  const sizes = [];
  for (const {touch} of tracks) {
    if (!touch) continue;
    const s = touch.wide ? 1 : touch.forceStep;
    for (let i = 0; i < touch.value.length; i += 6) sizes.push(s * length(touch.value.subarray(i + 3, i + 6)));
  }
  sizes.sort((a, b) => a - b);
  return sizes.length ? Math.max(1e-6, sizes[Math.floor(0.97 * (sizes.length - 1))]) : 1;
})();
)page";

inline constexpr std::string_view replay_page_scene = R"page(
const state = {
  time: 0, playing: false, speed: 1, follow: true, ghost: "overlay", contacts: true, bones: false, dark: false,
  azimuth: heading * 180 / Math.PI - 58, elevation: 17, distance: clamp(4.1 * extent, 0.4, 200), pan: [0, 0, 0],
  anchor: [0, 0, 0],
};

const linear = c => c.map(x => x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);
const hex = text => [1, 3, 5].map(i => parseInt(text.slice(i, i + 2), 16) / 255);
const palettes = {
  light: {horizon: "#e4e9ed", zenith: "#b4c6d8", low: "#ccd2d6", high: "#d9cfc0", odd: 0.9, wall: "#b6b1a8", line: "#8f9aa3"},
  dark: {horizon: "#1d232b", zenith: "#0b0e12", low: "#343c45", high: "#6b6256", odd: 0.86, wall: "#3d3f42", line: "#66727e"},
};
for (const palette of Object.values(palettes)) {
  for (const key of Object.keys(palette)) if (key !== "odd") palette[key] = hex(palette[key]);
}
const palette = () => palettes[state.dark ? "dark" : "light"];
const amber = hex("#f08c1e"), red = hex("#e0484d");
// The direction towards the sun.
const sun = unit([-0.35, -0.45, 1]);

// A solid is a box of half extents `core` swept by a ball of `radius`, turned and moved: sphere, capsule and box with
// soft edges alike. `taper` 1 makes the end at +z a point, `flat` squeezes along z.
const solid = (place, rotation, core, radius, color, more) =>
  ({place, rotation, core, radius, color, alpha: 1, taper: 0, flat: 1, glow: 0, weight: 1, ghost: false, label: "", ...more});

function rod(from, to, radius, color, more) {
  const along = sub(to, from);
  return solid(add(from, along, 0.5), turn_z_to(along), [0, 0, length(along) / 2], radius, color, more);
}

function arrow(out, from, to, radius, color, more) {
  const along = sub(to, from), l = length(along), head = Math.min(l * 0.5, radius * 6);
  if (l < radius) return;
  const neck = add(to, along, -head / l);
  out.push(rod(from, neck, radius, color, more));
  out.push(rod(neck, to, radius * 2.6, color, {...more, taper: 1}));
}

function add_body(out, track, shift, look) {
  const pose = track.pose, rig = track.rig;
  const at = b => [pose[7 * b] + shift[0], pose[7 * b + 1] + shift[1], pose[7 * b + 2] + shift[2]];
  const of = b => [pose[7 * b + 3], pose[7 * b + 4], pose[7 * b + 5], pose[7 * b + 6]];
  // The right side is a shade darker, so that legs which cross stay apart for the eye.
  const shade = rig.bodies.map(b => {
    const right = /^right|[_\-. ]right$|^r[_\-. ]|[_\-. ]r$/i.test(b.name) || /^[rR][A-Z][a-z]/.test(b.name);
    return track.color.map(c => c * (right ? 0.78 : 1));
  });
  const label = b => rig.bodies[b].name + " (" + track.name + ")";
  if (state.bones || !rig.shapes.length) {
    const r = 0.022 * extent;
    rig.bodies.forEach((body, b) => {
      out.push(solid(at(b), upright, [0, 0, 0], 1.5 * r, shade[b], {...look, label: label(b)}));
      if (body.parent >= 0) out.push(rod(at(body.parent), at(b), r, shade[b], {...look, label: label(b)}));
    });
    return;
  }
  for (const s of rig.shapes) {
    const q = of(s.body), place = add(at(s.body), turn(q, s.position)), rotation = compose(q, s.rotation);
    const more = {...look, label: label(s.body)};
    if (s.kind === "box") {
      const edge = Math.min(0.3 * Math.min(...s.size), 0.02 * extent);
      out.push(solid(place, rotation, s.size.map(x => x - edge), edge, shade[s.body], more));
    } else {
      out.push(solid(place, rotation, [0, 0, s.kind === "capsule" ? s.size[1] : 0], s.size[0], shade[s.body], more));
    }
  }
}

function add_contacts(out, track, shift) {
  const [i, j, u] = bracket(track, state.time), f = u < 0.5 ? i : j, t = track.touch, r = track.root;
  const point_step = t.wide ? 1 : t.pointStep, force_step = t.wide ? 1 : t.forceStep;
  for (let c = t.start[f]; c < t.start[f + 1]; ++c) {
    const v = t.value.subarray(6 * c, 6 * c + 6);
    const point = [0, 1, 2].map(k => r[3 * f + k] + point_step * v[k] + shift[k]);
    const force = [0, 1, 2].map(k => force_step * v[3 + k]), size = length(force);
    const up = size > 0 ? force : [0, 0, 1], look = {glow: 0.55, weight: 0, label: size.toFixed(0) + " N (" + track.name + ")"};
    out.push(solid(point, turn_z_to(up), [0, 0, 0], 0.042 * extent, amber, {...look, flat: 0.22}));
    arrow(out, point, add(point, up, size > 0 ? Math.min(size / force_scale, 1.3) * extent / size : 0), 0.0085 * extent, amber, look);
  }
}

// A push lasts a frame; its arrow stays for a third of a second and fades, or nobody would see it.
function add_push(out, track, shift) {
  const [i] = bracket(track, state.time), f = track.pushed[i];
  if (f < 0) return;
  const age = state.time - f / track.fps;
  if (age > 0.35) return;
  const v = track.push.subarray(6 * f, 6 * f + 6), impulse = v.subarray(3, 6), size = length(impulse);
  const tip = add(v, shift), tail = add(tip, impulse, -(0.3 + 0.5 * size / track.strongest) * extent / size);
  arrow(out, tail, tip, 0.017 * extent, red, {glow: 0.6, weight: 0, alpha: clamp(1.4 - age / 0.25, 0, 1), ghost: age > 0.1,
    label: size.toPrecision(3) + " N s (" + track.name + ")"});
}

// All that moves, at the moment `state.time`.
function collect() {
  const out = [];
  let beside = 0;
  for (const track of tracks) {
    if (!track.shown || (track.ghost && state.ghost === "off")) continue;
    pose_at(track, state.time);
    let shift = [0, 0, 0];
    const look = {ghost: track.ghost, alpha: 1, weight: 1};
    if (track.ghost) {
      const aside = state.ghost === "beside";
      if (aside) {
        const d = 1.35 * extent * ++beside;
        shift = [-Math.sin(heading) * d, Math.cos(heading) * d, 0];
      }
      look.alpha = aside ? 0.8 : 0.42;
      look.weight = aside ? 0.7 : 0;
    }
    add_body(out, track, shift, look);
    if (state.contacts && track.touch) add_contacts(out, track, shift);
    if (track.push) add_push(out, track, shift);
  }
  return out;
}

// A little below the root, so that the feet clear the controls.
const target = () => add(state.follow ? add(path_at(state.time), [0, 0, -0.16 * extent]) : state.anchor, state.pan);

function camera(aspect) {
  const a = state.azimuth * Math.PI / 180, e = state.elevation * Math.PI / 180, at = target();
  const back = [Math.cos(a) * Math.cos(e), Math.sin(a) * Math.cos(e), Math.sin(e)];
  const eye = add(at, back, state.distance);
  // The eye stays out of the ground.
  eye[2] = Math.max(eye[2], ground_at(eye[0], eye[1]) + 0.12);
  const z = unit(sub(eye, at)), x = unit(cross([0, 0, 1], z)), y = cross(z, x);
  // A tall narrow window must still show the figure's width.
  const height = Math.tan(0.3) * Math.max(1, 1 / aspect);
  return {eye, at, x, y, z, height, aspect, near: Math.max(0.01, 0.02 * state.distance), far: 400 + 20 * state.distance};
}

// Column-major, as WebGL takes them.
const product = (a, b) => {
  const out = new Float32Array(16);
  for (let c = 0; c < 4; ++c) for (let r = 0; r < 4; ++r) {
    let sum = 0;
    for (let k = 0; k < 4; ++k) sum += a[4 * k + r] * b[4 * c + k];
    out[4 * c + r] = sum;
  }
  return out;
};
const looking = (x, y, z, eye) =>
  [x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0, -dot(x, eye), -dot(y, eye), -dot(z, eye), 1];
const perspective = c => {
  const f = 1 / c.height, d = c.near - c.far;
  return [f / c.aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (c.far + c.near) / d, -1, 0, 0, 2 * c.far * c.near / d, 0];
};

// Canvas coordinates and depth of a point.
const project = (c, p, width, height) => {
  const d = sub(p, c.eye), depth = -dot(d, c.z), s = height / 2 / c.height / Math.max(depth, 1e-6);
  return [width / 2 + s * dot(d, c.x), height / 2 - s * dot(d, c.y), depth, s];
};
)page";

inline constexpr std::string_view replay_page_shaders = R"page(
const shader_light = `#version 300 es
precision highp float; precision highp sampler2DShadow;
uniform vec3 eye, sun, horizon, zenith; uniform float haze, dusk;
uniform mat4 shadow_matrix; uniform sampler2DShadow shadow_map; uniform float shadow_texel, shadow_bias;
float sunlit(vec3 p, vec3 n) {
  vec3 s = (shadow_matrix * vec4(p + n * shadow_bias, 1.0)).xyz;
  float rim = max(abs(s.x), abs(s.y));
  if (rim > 1.0 || abs(s.z) > 1.0) return 1.0;
  vec3 c = s * 0.5 + 0.5;
  float sum = 0.0;
  for (int j = -2; j <= 2; ++j) for (int i = -2; i <= 2; ++i)
    sum += texture(shadow_map, vec3(c.xy + vec2(i, j) * shadow_texel * 1.15, c.z - 0.0006));
  return mix(sum / 25.0, 1.0, smoothstep(0.8, 1.0, rim));
}
// From light as computed to light as shown, through the haze of the distance.
vec4 shown(vec3 color, vec3 p, float alpha) {
  float d = length(p - eye) / haze;
  color = mix(color, horizon, 1.0 - exp(-d * d));
  return vec4(pow(clamp(color, 0.0, 1.0), vec3(1.0 / 2.2)), alpha);
}
`;

const shader_solid_vertex = `#version 300 es
precision highp float;
layout(location = 0) in vec3 corner; layout(location = 1) in vec3 normal;
layout(location = 2) in vec4 place; layout(location = 3) in vec4 rotation; layout(location = 4) in vec4 core;
layout(location = 5) in vec4 tint; layout(location = 6) in vec2 finish;
uniform mat4 view_projection;
out vec3 at, outward; out vec4 color; out float glow;
vec3 turned(vec4 q, vec3 v) { return v + 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v); }
void main() {
  float slim = corner.z > 0.0 ? 1.0 - core.w : 1.0;
  vec3 local = corner * core.xyz + normal * place.w * slim * vec3(1.0, 1.0, 1.0 - core.w);
  local.z *= finish.x;
  vec3 facing = vec3(normal.xy, normal.z / finish.x);
  if (core.w > 0.5) facing = vec3(normal.xy, corner.z > 0.0 ? 0.35 : normal.z);
  outward = turned(rotation, normalize(facing));
  at = place.xyz + turned(rotation, local);
  color = tint; glow = finish.y;
  gl_Position = view_projection * vec4(at, 1.0);
}`;

const shader_solid = shader_light + `
in vec3 at, outward; in vec4 color; in float glow; out vec4 pixel;
void main() {
  vec3 n = normalize(outward), v = normalize(eye - at), h = normalize(v + sun);
  float lit = max(dot(n, sun), 0.0) * sunlit(at, n);
  float sky = 0.5 + 0.5 * n.z, rim = pow(1.0 - max(dot(n, v), 0.0), 3.0);
  // Light from a source at the viewer's shoulder rounds what the sun leaves in shade.
  float fill = max(dot(n, normalize(v + vec3(0.0, 0.0, 0.4))), 0.0);
  vec3 light = mix(vec3(0.24, 0.235, 0.23), vec3(0.44, 0.47, 0.52), sky) * mix(1.0, 0.62, dusk) + 0.17 * fill
    + vec3(1.0, 0.96, 0.88) * lit * 0.72;
  vec3 c = color.rgb * mix(light, vec3(1.0), glow) + 0.16 * lit * pow(max(dot(n, h), 0.0), 36.0) * (1.0 - glow)
    + rim * 0.22 * mix(horizon, vec3(0.5), 0.4) * (1.0 - glow);
  pixel = shown(c, at, color.a);
}`;

const shader_depth = `#version 300 es
precision mediump float;
void main() {}`;

const shader_ground_vertex = `#version 300 es
precision highp float;
layout(location = 0) in vec3 place; layout(location = 1) in vec4 facing;
uniform mat4 view_projection; uniform vec4 stretch;
out vec3 at, outward; out float open;
void main() {
  at = vec3(place.xy * stretch.zw + stretch.xy, place.z); outward = facing.xyz; open = facing.w;
  gl_Position = view_projection * vec4(at, 1.0);
}`;

const shader_ground = shader_light + `
in vec3 at, outward; in float open; out vec4 pixel;
uniform vec3 low, high, wall, line; uniform vec4 hole; uniform vec2 heights; uniform float odd;
uniform vec4 shade_from[48], shade_to[48], shade_ball; uniform int shades;
// How much of the sky the figures hide: each a ball at its axis' nearest point.
float sky_left(vec3 p, vec3 n) {
  float left = 1.0;
  if (length(p - shade_ball.xyz) > shade_ball.w) return left;
  for (int i = 0; i < shades; ++i) {
    vec3 a = shade_from[i].xyz, along = shade_to[i].xyz - a;
    vec3 d = a + along * clamp(dot(p - a, along) / max(dot(along, along), 1e-8), 0.0, 1.0) - p;
    float l = max(length(d), shade_from[i].w), share = shade_from[i].w / l;
    left *= 1.0 - 0.8 * shade_to[i].w * max(dot(n, d) / l, 0.0) * share * share;
  }
  return mix(1.0, left, 1.0 - smoothstep(0.7, 1.0, length(p - shade_ball.xyz) / shade_ball.w));
}
void main() {
  if (hole.z > hole.x && at.x > hole.x && at.y > hole.y && at.x < hole.z && at.y < hole.w && outward.z > 2.0) discard;
  vec3 n = normalize(outward);
  float up = step(0.5, n.z), rise = clamp((at.z - heights.x) / max(heights.y - heights.x, 0.5), 0.0, 1.0);
  vec3 base = mix(wall, mix(low, high, rise), up);
  vec2 width = fwidth(at.xy) + 1e-5, cell = mod(floor(at.xy), 2.0);
  float far = smoothstep(0.15, 0.7, max(width.x, width.y));
  base *= mix(1.0, mix(abs(cell.x - cell.y) > 0.5 ? odd : 1.0, 0.5 + 0.5 * odd, far), up);
  vec2 from_line = abs(fract(at.xy - 0.5) - 0.5), half_width = vec2(0.007);
  vec2 cover = clamp((half_width + width * 0.5 - from_line) / width, 0.0, 1.0) * min(vec2(1.0), 2.0 * half_width / width + 0.12);
  base = mix(base, line, up * max(cover.x, cover.y) * 0.75 * (1.0 - far));
  float lit = max(dot(n, sun), 0.0) * sunlit(at, n);
  float sky = sky_left(at, n) * open;
  vec3 light = vec3(0.5, 0.53, 0.57) * sky * mix(0.8, 1.0, 0.5 + 0.5 * n.z) + vec3(0.56, 0.53, 0.49) * lit * mix(1.0, sky, 0.3);
  pixel = shown(base * light, at, 1.0);
}`;

const shader_sky_vertex = `#version 300 es
precision highp float;
uniform mat4 ray_matrix; out vec3 ray;
void main() {
  vec2 p = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
  ray = (ray_matrix * vec4(p, 1.0, 0.0)).xyz; gl_Position = vec4(p, 1.0, 1.0);
}`;

const shader_sky = `#version 300 es
precision highp float;
uniform vec3 horizon, zenith; in vec3 ray; out vec4 pixel;
void main() {
  float z = max(normalize(ray).z, 0.0);
  pixel = vec4(pow(mix(horizon, zenith, 1.0 - exp(-3.0 * z)), vec3(1.0 / 2.2)), 1.0);
}`;
)page";

inline constexpr std::string_view replay_page_webgl = R"page(
// The ball's mesh, cut along the three planes through its centre: moved apart by `core` the eight pieces and what spans
// the cuts make a box with rounded edges.
function solid_mesh() {
  const corner = [], normal = [], index = [], arc = 7, columns = [], rows = [];
  for (let q = 0; q < 4; ++q) for (let i = 0; i <= arc; ++i) {
    columns.push([(q + i / arc) * Math.PI / 2, q === 0 || q === 3 ? 1 : -1, q < 2 ? 1 : -1]);
  }
  for (let h = 0; h < 2; ++h) for (let i = 0; i <= arc; ++i) rows.push([(h + i / arc) * Math.PI / 2, h ? -1 : 1]);
  for (const [theta, sz] of rows) for (const [phi, sx, sy] of columns) {
    corner.push(sx, sy, sz);
    normal.push(Math.sin(theta) * Math.cos(phi), Math.sin(theta) * Math.sin(phi), Math.cos(theta));
  }
  const w = columns.length, quad = (a, b, c, d) => index.push(a, b, c, a, c, d);
  for (let r = 0; r + 1 < rows.length; ++r) for (let c = 0; c < w; ++c) {
    const next = (c + 1) % w;
    quad(r * w + c, (r + 1) * w + c, (r + 1) * w + next, r * w + next);
  }
  const last = (rows.length - 1) * w, q = arc + 1;
  quad(0, q, 2 * q, 3 * q);
  quad(last + 3 * q, last + 2 * q, last + q, last);
  return {corner: new Float32Array(corner), normal: new Float32Array(normal), index: new Uint16Array(index)};
}

// Every column's top, and a wall wherever it stands above a neighbour. The fourth component of a normal is the share of
// the sky that the neighbours leave open.
function terrain_mesh() {
  const t = terrain, quads = [];
  const top_open = (i, j, si, sj, h) => {
    let higher = 0;
    for (const [a, b] of [[si, 0], [0, sj], [si, sj]]) higher += clamp((t.at(i + a, j + b) - h) / 0.15, 0, 1);
    return 1 - 0.17 * higher;
  };
  for (let j = 0; j < t.ny; ++j) for (let i = 0; i < t.nx; ++i) {
    const x = t.left + i * t.dx, y = t.bottom + j * t.dx, X = x + t.dx, Y = y + t.dx, h = t.at(i, j);
    quads.push([[x, y, h, top_open(i, j, -1, -1, h)], [X, y, h, top_open(i, j, 1, -1, h)],
      [X, Y, h, top_open(i, j, 1, 1, h)], [x, Y, h, top_open(i, j, -1, 1, h)], [0, 0, 1]]);
    for (const [di, dj, ax, ay, bx, by] of [[1, 0, X, y, X, Y], [-1, 0, x, Y, x, y], [0, 1, X, Y, x, Y], [0, -1, x, y, X, y]]) {
      const low = t.at(i + di, j + dj);
      if (low < h) quads.push([[ax, ay, low, 0.6], [bx, by, low, 0.6], [bx, by, h, 1], [ax, ay, h, 1], [di, dj, 0]]);
      // Seen from above a step has no wall; a dark rim shows where it ends.
      const rim = Math.min(0.014, t.dx / 4), lift = h + 0.0015;
      if (h - low > 0.01) quads.push([[ax, ay, lift, 0.35], [bx, by, lift, 0.35], [bx - di * rim, by - dj * rim, lift, 0.35],
        [ax - di * rim, ay - dj * rim, lift, 0.35], [0, 0, 1]]);
      // Where the terrain ends below the plane around it, the plane's edge shows.
      const outside = i + di < 0 || j + dj < 0 || i + di >= t.nx || j + dj >= t.ny;
      if (outside && low > h) quads.push([[bx, by, h, 0.6], [ax, ay, h, 0.6], [ax, ay, low, 1], [bx, by, low, 1], [-di, -dj, 0]]);
    }
  }
  const vertices = new Float32Array(quads.length * 28), index = new Uint32Array(quads.length * 6);
  quads.forEach((quad, n) => {
    for (let k = 0; k < 4; ++k) {
      const [x, y, z, open] = quad[k];
      vertices.set([x, y, z, quad[4][0], quad[4][1], quad[4][2], open], 28 * n + 7 * k);
    }
    index.set([0, 1, 2, 0, 2, 3].map(k => 4 * n + k), 6 * n);
  });
  return {vertices, index};
}

function webgl_painter(canvas) {
  const gl = canvas.getContext("webgl2", {antialias: true, alpha: false, preserveDrawingBuffer: true});
  if (!gl) throw new Error("this browser has no WebGL2");
  const program = (vertex, fragment) => {
    const p = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const s = gl.createShader(kind);
      gl.shaderSource(s, text);
      gl.compileShader(s);
      if (!gl.getShaderParameter(s, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(s) || "shader");
      gl.attachShader(p, s);
    }
    gl.linkProgram(p);
    if (!gl.getProgramParameter(p, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(p) || "program");
    const set = {};
    for (let i = 0; i < gl.getProgramParameter(p, gl.ACTIVE_UNIFORMS); ++i) {
      const {name, type} = gl.getActiveUniform(p, i), at = gl.getUniformLocation(p, name);
      set[name.replace("[0]", "")] = type === gl.FLOAT_MAT4 ? v => gl.uniformMatrix4fv(at, false, v)
        : type === gl.FLOAT_VEC4 ? v => gl.uniform4fv(at, v) : type === gl.FLOAT_VEC3 ? v => gl.uniform3fv(at, v)
        : type === gl.FLOAT_VEC2 ? v => gl.uniform2fv(at, v) : type === gl.FLOAT ? v => gl.uniform1f(at, v) : v => gl.uniform1i(at, v);
    }
    return values => {
      gl.useProgram(p);
      for (const key in values) if (set[key]) set[key](values[key]);
    };
  };
  const use_solid = program(shader_solid_vertex, shader_solid), use_solid_depth = program(shader_solid_vertex, shader_depth);
  const use_ground = program(shader_ground_vertex, shader_ground), use_ground_depth = program(shader_ground_vertex, shader_depth);
  const use_sky = program(shader_sky_vertex, shader_sky);

  const store = (target, content) => {
    const buffer = gl.createBuffer();
    gl.bindBuffer(target, buffer);
    gl.bufferData(target, content, gl.STATIC_DRAW);
    return buffer;
  };
  const attribute = (at, size, stride, offset, per_solid) => {
    gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, size, gl.FLOAT, false, 4 * stride, 4 * offset);
    if (per_solid) gl.vertexAttribDivisor(at, 1);
  };
  const ball = solid_mesh(), solid_array = gl.createVertexArray(), floats_per_solid = 18;
  gl.bindVertexArray(solid_array);
  store(gl.ARRAY_BUFFER, ball.corner); attribute(0, 3, 3, 0);
  store(gl.ARRAY_BUFFER, ball.normal); attribute(1, 3, 3, 0);
  store(gl.ELEMENT_ARRAY_BUFFER, ball.index);
  const solids_buffer = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, solids_buffer);
  [[2, 4, 0], [3, 4, 4], [4, 4, 8], [5, 4, 12], [6, 2, 16]].forEach(([at, size, offset]) => attribute(at, size, floats_per_solid, offset, true));

  const surface = (vertices, index) => {
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    store(gl.ARRAY_BUFFER, vertices); attribute(0, 3, 7, 0); attribute(1, 4, 7, 3);
    store(gl.ELEMENT_ARRAY_BUFFER, index);
    return () => { gl.bindVertexArray(array); gl.drawElements(gl.TRIANGLES, index.length, gl.UNSIGNED_INT, 0); };
  };
  // A normal longer than 2 marks the plane that leaves out the terrain's rectangle. It is cut in tiles, since one huge
  // quad loses the precision that the lines need.
  const tiles = 24, plane = [], plane_index = [];
  for (let j = 0; j <= tiles; ++j) for (let i = 0; i <= tiles; ++i) plane.push(2 * i / tiles - 1, 2 * j / tiles - 1, 0, 0, 0, 3, 1);
  for (let j = 0; j < tiles; ++j) for (let i = 0; i < tiles; ++i) {
    const a = j * (tiles + 1) + i, b = a + tiles + 1;
    plane_index.push(a, a + 1, b + 1, a, b + 1, b);
  }
  const draw_plane = surface(new Float32Array(plane), new Uint32Array(plane_index));
  const mesh = terrain && terrain_mesh(), draw_terrain = mesh ? surface(mesh.vertices, mesh.index) : () => {};
  gl.bindVertexArray(null);

  const shadow_size = Math.min(2048, gl.getParameter(gl.MAX_TEXTURE_SIZE));
  const shadow_map = gl.createTexture(), shadow_frame = gl.createFramebuffer();
  gl.bindTexture(gl.TEXTURE_2D, shadow_map);
  gl.texStorage2D(gl.TEXTURE_2D, 1, gl.DEPTH_COMPONENT24, shadow_size, shadow_size);
  for (const [key, value] of [[gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_MAG_FILTER, gl.LINEAR], [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE],
    [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE], [gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE], [gl.TEXTURE_COMPARE_FUNC, gl.LEQUAL]]) {
    gl.texParameteri(gl.TEXTURE_2D, key, value);
  }
  gl.bindFramebuffer(gl.FRAMEBUFFER, shadow_frame);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, shadow_map, 0);
  gl.drawBuffers([gl.NONE]);
  gl.readBuffer(gl.NONE);
  if (gl.checkFramebufferStatus(gl.FRAMEBUFFER) !== gl.FRAMEBUFFER_COMPLETE) throw new Error("no shadow map");
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
)page"
R"page(
  const draw_solids = solids => {
    if (!solids.length) return;
    const values = new Float32Array(solids.length * floats_per_solid);
    solids.forEach((s, i) => values.set([...s.place, s.radius, ...s.rotation, ...s.core, s.taper, ...linear(s.color), s.alpha, s.flat, s.glow],
      i * floats_per_solid));
    gl.bindVertexArray(solid_array);
    gl.bindBuffer(gl.ARRAY_BUFFER, solids_buffer);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
    gl.drawElementsInstanced(gl.TRIANGLES, ball.index.length, gl.UNSIGNED_SHORT, 0, solids.length);
  };

  // What darkens the ground under the figures: up to 48 axes with a radius, and a ball around all they reach.
  const shades_of = solids => {
    const from = new Float32Array(192), to = new Float32Array(192), casting = solids.filter(s => s.weight > 0).slice(0, 48);
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    casting.forEach((s, i) => {
      const axis = s.core.indexOf(Math.max(...s.core)), half = [0, 0, 0];
      half[axis] = s.core[axis];
      const others = s.core.reduce((a, b) => a + b, 0) - s.core[axis], along = turn(s.rotation, half);
      from.set([...add(s.place, along, -1), s.radius + others / 2], 4 * i);
      to.set([...add(s.place, along), s.weight], 4 * i);
      for (let k = 0; k < 3; ++k) { low[k] = Math.min(low[k], s.place[k]); high[k] = Math.max(high[k], s.place[k]); }
    });
    const middle = add(low, sub(high, low), 0.5);
    return {shade_from: from, shade_to: to, shades: casting.length,
      shade_ball: casting.length ? [...middle, length(sub(high, low)) / 2 + 1.6 * extent] : [0, 0, 0, 0]};
  };

  const sun_x = unit(cross([0, 0, 1], sun)), sun_y = cross(sun, sun_x);
  return () => {
    const width = canvas.width, height = canvas.height, c = camera(width / height), p = palette(), solids = collect();
    const firm = solids.filter(s => !s.ghost), faint = solids.filter(s => s.ghost), casting = solids.filter(s => s.weight > 0);
    const view_projection = product(perspective(c), looking(c.x, c.y, c.z, c.eye));

    // The shadow map moves in whole texels, or edges would crawl while the camera follows.
    const reach = Math.max(2.6 * extent, Math.min(0.8 * state.distance, 6 * extent)), texel = 2 * reach / shadow_size;
    const snap = v => Math.round(v / texel) * texel, deep = 12 * reach;
    const middle = [0, 1, 2].map(k => sun_x[k] * snap(dot(c.at, sun_x)) + sun_y[k] * snap(dot(c.at, sun_y)) + sun[k] * dot(c.at, sun));
    const shadow_matrix = product([1 / reach, 0, 0, 0, 0, 1 / reach, 0, 0, 0, 0, -1 / deep, 0, 0, 0, 0, 1], looking(sun_x, sun_y, sun, middle));
    gl.bindTexture(gl.TEXTURE_2D, null);
    gl.bindFramebuffer(gl.FRAMEBUFFER, shadow_frame);
    gl.viewport(0, 0, shadow_size, shadow_size);
    gl.enable(gl.DEPTH_TEST);
    gl.depthMask(true);
    gl.depthFunc(gl.LESS);
    gl.disable(gl.BLEND);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    use_solid_depth({view_projection: shadow_matrix});
    draw_solids(casting);
    use_ground_depth({view_projection: shadow_matrix, stretch: [0, 0, 1, 1]});
    draw_terrain();

    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.bindTexture(gl.TEXTURE_2D, shadow_map);
    const horizon = linear(p.horizon), zenith = linear(p.zenith);
    gl.depthMask(false);
    gl.disable(gl.DEPTH_TEST);
    const h = c.height, w = h * c.aspect;
    use_sky({horizon, zenith, ray_matrix: [w * c.x[0], w * c.x[1], w * c.x[2], 0, h * c.y[0], h * c.y[1], h * c.y[2], 0,
      -c.z[0], -c.z[1], -c.z[2], 0, 0, 0, 0, 1]});
    gl.bindVertexArray(null);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.depthMask(true);
    gl.enable(gl.DEPTH_TEST);

    const haze = 9 * extent + 3 * state.distance;
    const common = {view_projection, eye: c.eye, sun, horizon, zenith, haze, dusk: state.dark ? 1 : 0, shadow_matrix, shadow_map: 0,
      shadow_texel: 1 / shadow_size, shadow_bias: 1.6 * texel};
    // Plane and terrain overlap by a seam, or the background would shine through between them.
    const seam = 0.004, low = terrain ? Math.min(0, terrain.low) : 0, high = terrain ? terrain.high : 1;
    use_ground({...common, ...shades_of(casting), low: linear(p.low), high: linear(p.high), wall: linear(p.wall), line: linear(p.line),
      odd: p.odd, heights: [low, high], hole: terrain ? [terrain.left + seam, terrain.bottom + seam, terrain.right - seam, terrain.top - seam] : [0, 0, 0, 0],
      stretch: [Math.round(c.at[0]), Math.round(c.at[1]), 4 * haze, 4 * haze]});
    draw_plane();
    use_ground({stretch: [0, 0, 1, 1]});
    draw_terrain();
    use_solid(common);
    draw_solids(firm);
    // Ghosts first leave their depth, so that one sees through their skin but not at their limbs' insides.
    gl.colorMask(false, false, false, false);
    draw_solids(faint);
    gl.colorMask(true, true, true, true);
    gl.depthFunc(gl.LEQUAL);
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ZERO, gl.ONE);
    draw_solids(faint);
    gl.disable(gl.BLEND);
    gl.depthFunc(gl.LESS);
  };
}
)page";

inline constexpr std::string_view replay_page_canvas = R"page(
// Draws the same scene back to front, where there is no WebGL2.
function canvas_painter(canvas) {
  const pen = canvas.getContext("2d", {alpha: false});
  if (!pen) throw new Error("this browser can draw neither with WebGL2 nor with Canvas 2D");
  const css = (color, light = 1, alpha = 1) => {
    const [r, g, b] = color.map(x => Math.round(255 * clamp(x * light, 0, 1)));
    return `rgba(${r},${g},${b},${alpha})`;
  };
  return () => {
    const width = canvas.width, height = canvas.height, c = camera(width / height), p = palette(), near = c.near;
    // A change of the canvas' size resets its pen.
    pen.lineCap = pen.lineJoin = "round";
    const at = q => project(c, q, width, height);
    const haze = 9 * extent + 3 * state.distance;
    const hazed = (color, depth) => { const u = 1 - Math.exp(-((Math.max(depth, 0) / haze) ** 2)); return color.map((x, k) => mix(x, p.horizon[k], u)); };

    // Lines that lead away meet on the horizon; above it is sky.
    const level = at(add(c.eye, [-c.z[0], -c.z[1], 0], 1e5))[1];
    const sky = pen.createLinearGradient(0, level, 0, Math.min(level, 0) - height);
    sky.addColorStop(0, css(p.horizon));
    sky.addColorStop(1, css(p.zenith));
    pen.fillStyle = css(p.horizon);
    pen.fillRect(0, 0, width, height);
    pen.fillStyle = sky;
    pen.fillRect(0, 0, width, Math.max(0, level));

    // A polygon cut off where it comes too near the eye.
    const polygon = (points, fill, edge) => {
      const cut = [];
      points.forEach((a, i) => {
        const b = points[(i + 1) % points.length], da = -dot(sub(a, c.eye), c.z) - near, db = -dot(sub(b, c.eye), c.z) - near;
        if (da > 0) cut.push(at(a));
        if (da > 0 !== db > 0) cut.push(at(add(a, sub(b, a), (da + 1e-6 * Math.sign(da)) / (da - db))));
      });
      if (cut.length < 3) return;
      pen.beginPath();
      cut.forEach(q => pen.lineTo(q[0], q[1]));
      pen.closePath();
      pen.fillStyle = fill;
      pen.fill();
      if (edge) { pen.strokeStyle = fill; pen.lineWidth = edge; pen.stroke(); }
    };
    const line = (a, b, color, thick) => {
      const da = -dot(sub(a, c.eye), c.z) - near, db = -dot(sub(b, c.eye), c.z) - near;
      if (da <= 0 && db <= 0) return;
      if (da <= 0) a = add(b, sub(a, b), db / (db - da));
      if (db <= 0) b = add(a, sub(b, a), da / (da - db));
      const s = at(a), e = at(b);
      pen.strokeStyle = color;
      pen.lineWidth = thick;
      pen.beginPath();
      pen.moveTo(s[0], s[1]);
      pen.lineTo(e[0], e[1]);
      pen.stroke();
    };

    const around = Math.ceil(Math.min(40, haze)), cx = Math.round(c.at[0]), cy = Math.round(c.at[1]);
    const depth_of = q => -dot(sub(q, c.eye), c.z);
    const ground_light = 0.97, lowest = terrain ? Math.min(0, terrain.low) : 0, span = terrain ? Math.max(terrain.high - lowest, 0.5) : 1;
    const tone = (h, odd) => p.low.map((v, k) => mix(v, p.high[k], (h - lowest) / span) * ground_light * (odd ? Math.sqrt(p.odd) : 1));
    for (let j = -around; j < around; ++j) for (let i = -around; i < around; ++i) {
      const x = cx + i, y = cy + j, depth = depth_of([x + 0.5, y + 0.5, 0]);
      if (depth < -2) continue;
      const odd = (x + y) % 2 !== 0;
      polygon([[x, y, 0], [x + 1, y, 0], [x + 1, y + 1, 0], [x, y + 1, 0]],
        css(hazed(tone(0, odd), depth)), 1);
    }
    for (let i = -around; i <= around; ++i) for (let j = -around; j < around; j += 2) {
      for (const [a, b] of [[[cx + i, cy + j, 0], [cx + i, cy + j + 2, 0]], [[cx + j, cy + i, 0], [cx + j + 2, cy + i, 0]]]) {
        const depth = depth_of(add(a, sub(b, a), 0.5));
        if (depth > -2) line(a, b, css(hazed(p.line, depth * 1.3)), clamp(0.012 * at(a)[3], 0.4, 2));
      }
    }

    const solids = collect(), things = [];
    if (terrain) {
      const t = terrain, budget = 5000, r = Math.min(around, Math.sqrt(budget) * t.dx / 2);
      const i0 = Math.max(0, Math.floor((c.at[0] - r - t.left) / t.dx)), i1 = Math.min(t.nx - 1, Math.floor((c.at[0] + r - t.left) / t.dx));
      const j0 = Math.max(0, Math.floor((c.at[1] - r - t.bottom) / t.dx)), j1 = Math.min(t.ny - 1, Math.floor((c.at[1] + r - t.bottom) / t.dx));
      for (let j = j0; j <= j1; ++j) for (let i = i0; i <= i1; ++i) {
        const x = t.left + i * t.dx, y = t.bottom + j * t.dx, X = x + t.dx, Y = y + t.dx, h = t.at(i, j), middle = [x + t.dx / 2, y + t.dx / 2, h];
        const depth = depth_of(middle);
        if (depth < -t.dx) continue;
        const key = -((middle[0] - c.eye[0]) * c.z[0] + (middle[1] - c.eye[1]) * c.z[1]);
        things.push({key, draw: () => {
          for (const [di, dj, ax, ay, bx, by] of [[1, 0, X, y, X, Y], [-1, 0, x, Y, x, y], [0, 1, X, Y, x, Y], [0, -1, x, y, X, y]]) {
            const foot = t.at(i + di, j + dj);
            if (foot >= h || di * (c.eye[0] - ax) + dj * (c.eye[1] - ay) <= 0) continue;
            const light = 0.72 + 0.3 * Math.max(0, di * sun[0] + dj * sun[1]);
            polygon([[ax, ay, foot], [bx, by, foot], [bx, by, h], [ax, ay, h]], css(hazed(p.wall.map(v => v * light), depth)), 0.7);
          }
          if (c.eye[2] > h) {
            const odd = (Math.floor(middle[0]) + Math.floor(middle[1])) % 2 !== 0;
            polygon([[x, y, h], [X, y, h], [X, Y, h], [x, Y, h]], css(hazed(tone(h, odd), depth)), 0.7);
            // Seen from above a step has no wall, only an edge.
            for (const [di, dj, ax, ay, bx, by] of [[1, 0, X, y, X, Y], [-1, 0, x, Y, x, y], [0, 1, X, Y, x, Y], [0, -1, x, y, X, y]]) {
              if (h - t.at(i + di, j + dj) > 0.01) line([ax, ay, h], [bx, by, h], css(hazed(p.wall, depth)), 1.2);
            }
          }
        }});
      }
    }
)page"
R"page(
    const light_of = n => 0.5 + 0.17 * n[2] + 0.48 * Math.max(0, dot(n, sun)) + 0.1 * Math.max(0, dot(n, c.z));
    const bias = 0.35 * extent + (terrain ? terrain.dx : 0);
    const flat_key = q => -((q[0] - c.eye[0]) * c.z[0] + (q[1] - c.eye[1]) * c.z[1]);
    const thick_line = (a, b, wide, color) => {
      pen.strokeStyle = color;
      pen.lineWidth = wide;
      pen.beginPath();
      pen.moveTo(a[0], a[1]);
      pen.lineTo(b[0] + 0.01, b[1]);
      pen.stroke();
    };
    for (const s of solids) {
      const axis = s.core.indexOf(Math.max(...s.core)), half = [0, 0, 0];
      half[axis] = s.core[axis];
      const along = turn(s.rotation, half), a = add(s.place, along, -1), b = add(s.place, along);
      const girth = s.radius + (s.core[0] + s.core[1] + s.core[2] - s.core[axis]) / 2;
      if (depth_of(a) < near || depth_of(b) < near) continue;
      if (s.weight > 0) {
        const cast = q => { const h = ground_at(q[0], q[1]), d = Math.max(0, q[2] - h); return [q[0] - sun[0] / sun[2] * d, q[1] - sun[1] / sun[2] * d, h + 0.005]; };
        const ga = cast(a), gb = cast(b), fade = 0.13 * s.weight;
        if (depth_of(ga) > near && depth_of(gb) > near) {
          things.push({key: flat_key(add(ga, sub(gb, ga), 0.5)) - bias, draw: () => {
            const pa = at(ga), pb = at(gb);
            // Seen at a slant a round shadow is a flat one: it is drawn in a squeezed frame.
            const squeeze = clamp(Math.abs(c.z[2]), 0.12, 1), k = (pa[3] + pb[3]) * girth;
            pen.save();
            pen.scale(1, squeeze);
            for (const grow of [1.35, 0.95]) thick_line([pa[0], pa[1] / squeeze], [pb[0], pb[1] / squeeze], k * grow, `rgba(10,15,25,${fade * 0.75})`);
            pen.restore();
          }});
        }
      }
      const key = flat_key(s.place) - bias;
      things.push({key, draw: () => {
        const pa = at(a), pb = at(b), k = (pa[3] + pb[3]) / 2, color = hazed(s.color, depth_of(s.place) * 0.6);
        pen.globalAlpha = s.alpha;
        const boxy = s.core.filter(v => v > 1e-9).length > 1;
        if (s.flat < 1) {
          pen.fillStyle = css(color);
          pen.beginPath();
          pen.ellipse(pa[0], pa[1], s.radius * k, s.radius * k * Math.max(0.3, Math.abs(c.z[2])), 0, 0, 2 * Math.PI);
          pen.fill();
        } else if (s.taper) {
          const d = [pb[0] - pa[0], pb[1] - pa[1]], l = Math.hypot(d[0], d[1]) || 1, r = s.radius * k;
          pen.fillStyle = css(color);
          pen.beginPath();
          pen.moveTo(pb[0], pb[1]);
          pen.lineTo(pa[0] - d[1] / l * r, pa[1] + d[0] / l * r);
          pen.lineTo(pa[0] + d[1] / l * r, pa[1] - d[0] / l * r);
          pen.fill();
        } else if (boxy) {
          const e = s.core.map(v => v + s.radius * 0.3), vertex = (x, y, z) => add(s.place, turn(s.rotation, [x * e[0], y * e[1], z * e[2]]));
          for (let f = 0; f < 3; ++f) for (const side of [-1, 1]) {
            const n = [0, 0, 0];
            n[f] = side;
            const outward = turn(s.rotation, n);
            if (dot(outward, sub(c.eye, add(s.place, outward, e[f]))) <= 0) continue;
            const face = [[1, 1], [1, -1], [-1, -1], [-1, 1]].map(([u, v]) => {
              const q = [0, 0, 0];
              q[f] = side; q[(f + 1) % 3] = u; q[(f + 2) % 3] = v;
              return vertex(...q);
            });
            polygon(face, css(color, mix(light_of(outward), 1, s.glow)), s.alpha < 1 ? 0 : 1.4 * s.radius * k);
          }
        } else {
          // Three strokes, each narrower and nearer to the light, round a rod.
          const side = [dot(sun, c.x), -dot(sun, c.y)], wide = 2 * s.radius * k;
          const strokes = s.glow > 0 ? [[1, 0, 1]] : [[1, 0, 0.62], [0.8, 0.16, 0.78], [0.55, 0.3, 0.92], [0.26, 0.42, 1.05]];
          const solo = s.alpha < 1 ? [[1, 0, 0.9]] : strokes;
          for (const [share, shift, light] of solo) {
            const dx = side[0] * shift * wide / 2, dy = side[1] * shift * wide / 2;
            thick_line([pa[0] + dx, pa[1] + dy], [pb[0] + dx, pb[1] + dy], Math.max(wide * share, 0.7), css(color, light));
          }
        }
        pen.globalAlpha = 1;
      }});
    }
    things.sort((a, b) => b.key - a.key);
    for (const thing of things) thing.draw();
  };
}
)page";

inline constexpr std::string_view replay_page_controls = R"page(
let canvas = $("view"), paint = () => {}, queued = false, previous = 0;

function use(painter) {
  // A canvas keeps the first kind of drawing it was asked for, so another kind needs another canvas.
  const fresh = canvas.cloneNode(false);
  canvas.replaceWith(fresh);
  canvas = fresh;
  paint = painter(canvas);
  canvas.addEventListener("webglcontextlost", event => { event.preventDefault(); use(canvas_painter); resize(); });
  listen();
}

function resize() {
  const scale = Math.min(window.devicePixelRatio || 1, 2);
  canvas.width = Math.max(1, Math.round(window.innerWidth * scale));
  canvas.height = Math.max(1, Math.round(window.innerHeight * scale));
  draw();
}

const seconds = t => t.toFixed(2);
function draw() {
  $("scrub").value = state.time;
  $("time").textContent = seconds(state.time) + " / " + seconds(duration) + " s";
  $("speed").value = state.speed;
  $("speed_text").textContent = state.speed.toFixed(2).replace(/0$/, "") + "\u00d7";
  $("play").textContent = state.playing ? "\u275a\u275a" : "\u25b6";
  $("ghost").textContent = "Ghost: " + state.ghost;
  for (const key of ["follow", "contacts", "bones"]) $(key).setAttribute("aria-pressed", state[key]);
  $("ghost").setAttribute("aria-pressed", state.ghost !== "off");
  document.documentElement.dataset.theme = state.dark ? "dark" : "light";
  paint();
}

function tick(now) {
  queued = false;
  if (state.playing) {
    state.time += clamp((now - previous) / 1000, 0, 0.1) * state.speed;
    if (state.time > duration) state.time = duration > 0 ? state.time % duration : 0;
  }
  previous = now;
  draw();
  if (state.playing) request();
}
function request() {
  if (queued) return;
  queued = true;
  requestAnimationFrame(tick);
}

function play(on) {
  state.playing = on && duration > 0;
  if (state.playing && state.time >= duration) state.time = 0;
  previous = performance.now();
  request();
}
function seek(time) {
  state.time = clamp(time, 0, duration);
  request();
}
function follow(on) {
  // The view stays where it is; only what it is tied to changes.
  const at = target();
  state.follow = on;
  if (on) state.pan = [0, 0, 0];
  else { state.anchor = at; state.pan = [0, 0, 0]; }
  request();
}
const ghost_modes = ["overlay", "beside", "off"];
const toggle = key => { state[key] = !state[key]; request(); };
const help = on => { $("help").hidden = !on; $(on ? "help_close" : "help_open").focus(); };
const initial = {azimuth: state.azimuth, elevation: state.elevation, distance: state.distance};
const actions = {
  " ": () => play(!state.playing),
  arrowleft: many => { play(false); seek(state.time - many / main.fps); },
  arrowright: many => { play(false); seek(state.time + many / main.fps); },
  home: () => seek(0),
  end: () => { play(false); seek(duration); },
  "-": () => { state.speed = clamp(Math.round(state.speed * 16) / 20, 0.1, 2); request(); },
  "+": () => { state.speed = clamp(Math.round(state.speed * 25) / 20, 0.1, 2); request(); },
  f: () => follow(!state.follow),
  r: () => { Object.assign(state, initial, {follow: true, pan: [0, 0, 0]}); request(); },
  g: () => { state.ghost = ghost_modes[(ghost_modes.indexOf(state.ghost) + 1) % 3]; request(); },
  c: () => toggle("contacts"),
  b: () => toggle("bones"),
  l: () => toggle("dark"),
  i: () => { $("facts").open = !$("facts").open; },
  h: () => help($("help").hidden),
  escape: () => help(false),
};
actions["="] = actions["+"];
actions["?"] = actions.h;

window.addEventListener("keydown", event => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const key = event.key.toLowerCase(), act = actions[key];
  // A focused button keeps its space bar, a focused slider nothing: the keys below say more than it does.
  if (!act || (key === " " && /^(BUTTON|SUMMARY)$/.test(event.target.tagName))) return;
  event.preventDefault();
  act(event.shiftKey ? 10 : 1);
});
for (const [id, key] of [["play", " "], ["follow", "f"], ["ghost", "g"], ["contacts", "c"], ["bones", "b"], ["theme", "l"]]) {
  $(id).addEventListener("click", () => actions[key](1));
}
$("help_open").addEventListener("click", () => help(true));
$("help_close").addEventListener("click", () => help(false));
$("scrub").addEventListener("input", event => { play(false); seek(Number(event.target.value)); });
$("speed").addEventListener("input", event => { state.speed = Number(event.target.value); request(); });
window.addEventListener("resize", resize);

// One pointer orbits or pans, two pinch and pan.
function listen() {
  const held = new Map();
  const pan = (dx, dy) => {
    const c = camera(canvas.width / canvas.height), s = 2 * c.height * state.distance / window.innerHeight;
    state.pan = add(add(state.pan, c.x, -dx * s), c.y, dy * s);
  };
  const zoom = factor => { state.distance = clamp(state.distance * factor, 0.3 * extent, 60 * extent); };
  canvas.addEventListener("contextmenu", event => event.preventDefault());
  canvas.addEventListener("pointerdown", event => {
    canvas.setPointerCapture(event.pointerId);
    held.set(event.pointerId, [event.clientX, event.clientY]);
    $("tip").hidden = true;
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, event => held.delete(event.pointerId));
  canvas.addEventListener("pointerleave", () => { $("tip").hidden = true; });
  canvas.addEventListener("pointermove", event => {
    const before = held.get(event.pointerId), now = [event.clientX, event.clientY];
    if (!before) { point_at(now); return; }
    const dx = now[0] - before[0], dy = now[1] - before[1];
    if (held.size === 1) {
      if (event.buttons & 6 || event.shiftKey) pan(dx, dy);
      else {
        state.azimuth -= dx * 0.35;
        state.elevation = clamp(state.elevation + dy * 0.3, -8, 89);
      }
    } else {
      const other = [...held].find(([id]) => id !== event.pointerId)[1];
      const apart = q => Math.max(20, Math.hypot(q[0] - other[0], q[1] - other[1]));
      zoom(apart(before) / apart(now));
      pan(dx / 2, dy / 2);
    }
    held.set(event.pointerId, now);
    request();
  });
  canvas.addEventListener("wheel", event => {
    event.preventDefault();
    zoom(Math.exp(clamp(event.deltaY * (event.deltaMode ? 30 : 1), -240, 240) * 0.0012));
    request();
  }, {passive: false});
}

// The name of the body under the pointer.
function point_at([x, y]) {
  const w = window.innerWidth, h = window.innerHeight, c = camera(w / h);
  let best = null, nearest = Infinity;
  for (const s of collect()) {
    const axis = s.core.indexOf(Math.max(...s.core)), half = [0, 0, 0];
    half[axis] = s.core[axis];
    const along = turn(s.rotation, half), a = project(c, add(s.place, along, -1), w, h), b = project(c, add(s.place, along), w, h);
    const ab = [b[0] - a[0], b[1] - a[1]], u = clamp(((x - a[0]) * ab[0] + (y - a[1]) * ab[1]) / (ab[0] ** 2 + ab[1] ** 2 || 1), 0, 1);
    const girth = s.radius + (s.core[0] + s.core[1] + s.core[2] - s.core[axis]) / 2, depth = mix(a[2], b[2], u);
    if (depth < c.near || depth > nearest || Math.hypot(x - a[0] - u * ab[0], y - a[1] - u * ab[1]) > girth * mix(a[3], b[3], u) + 1) continue;
    nearest = depth;
    best = s;
  }
  $("tip").hidden = !best || !best.label;
  if (!best) return;
  $("tip").textContent = best.label;
  $("tip").style.left = Math.min(x + 14, w - 160) + "px";
  $("tip").style.top = y + 12 + "px";
}
)page";

inline constexpr std::string_view replay_page_start = R"page(
$("title").textContent = data.title;
for (const [name, value] of data.facts) {
  const row = $("fact_rows").insertRow();
  row.insertCell().textContent = name;
  row.insertCell().textContent = value;
}
$("facts").hidden = !data.facts.length;
$("facts").open = window.innerWidth > 640;
if (!data.title && !data.facts.length) $("about").hidden = true;
for (const track of tracks) {
  const button = document.createElement("button"), chip = document.createElement("i");
  chip.style.background = `rgb(${track.color.map(x => Math.round(255 * x)).join(",")})`;
  chip.style.opacity = track.ghost ? 0.55 : 1;
  button.append(chip, track.name || "track");
  button.title = "Show or hide";
  button.setAttribute("aria-pressed", true);
  button.addEventListener("click", () => {
    track.shown = !track.shown;
    button.setAttribute("aria-pressed", track.shown);
    request();
  });
  $("legend").append(button);
  for (let f = 0; track.push && f < track.frames; ++f) {
    if (track.pushed[f] !== f || (f > 0 && track.pushed[f - 1] === f - 1)) continue;
    const mark = document.createElement("i");
    mark.style.left = `calc(8px + (100% - 16px) * ${duration > 0 ? f / track.fps / duration : 0})`;
    $("marks").append(mark);
  }
}
$("ghost").hidden = !tracks.some(t => t.ghost);
$("contacts").hidden = !tracks.some(t => t.touch);
if (!$("contacts").hidden) {
  const note = "a force arrow of " + Number(extent.toPrecision(2)) + " m is " + Number(force_scale.toPrecision(3)) + " N";
  $("force_note").textContent = note[0].toUpperCase() + note.slice(1) + "; longer ones are cut at 1.3 times that.";
  $("force_note").hidden = false;
}
$("scrub").max = duration;

const number = (key, otherwise) => {
  const text = query.get(key), value = Number(text);
  return text !== null && text.trim() !== "" && Number.isFinite(value) ? value : otherwise;
};
state.speed = clamp(number("speed", 1), 0.1, 2);
state.time = clamp(number("t", 0), 0, duration);
const angles = (query.get("camera") || "").split(",").map(x => x.trim() === "" ? NaN : Number(x));
["azimuth", "elevation", "distance"].forEach((key, k) => { if (Number.isFinite(angles[k])) state[key] = angles[k]; });
state.elevation = clamp(state.elevation, -8, 89);
state.distance = clamp(state.distance, 0.3 * extent, 60 * extent);
if (ghost_modes.includes(query.get("ghost"))) state.ghost = query.get("ghost");
state.bones = query.get("view") === "bones";
const dark_wanted = window.matchMedia && matchMedia("(prefers-color-scheme: dark)").matches;
state.dark = query.has("theme") ? query.get("theme") === "dark" : Boolean(dark_wanted);

if (query.get("renderer") === "2d") use(canvas_painter);
else {
  try { use(webgl_painter); } catch (error) {
    console.warn("drawing without WebGL2: " + error.message);
    use(canvas_painter);
  }
}
resize();
const still = window.matchMedia && matchMedia("(prefers-reduced-motion: reduce)").matches;
if (!query.has("t") && !still) play(true);
})();
</script>
</body>
</html>
)page";

inline constexpr std::array<std::string_view, 1> replay_page_before_data{replay_page_style};

inline constexpr std::array<std::string_view, 7> replay_page_after_data{
    replay_page_motion, replay_page_scene,    replay_page_shaders, replay_page_webgl,
    replay_page_canvas, replay_page_controls, replay_page_start};

}  // namespace traceur::io::detail
