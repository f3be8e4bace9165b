"use strict";
// Drawing on canvases: axes, lines, points. Knows nothing of runs.

const COLOURS = ["#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#999933", "#882255"];
const MARGIN = { left: 58, right: 10, top: 8, bottom: 24 };

function ink(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

// A canvas in CSS pixels, sharp on any screen; null where it is not shown.
function context(canvas) {
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (!width || !height) return null;
  const ratio = Math.max(window.devicePixelRatio || 1, 1);
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = "12px system-ui, sans-serif";
  pen.lineJoin = "round";
  return { pen, width, height };
}

// Lowest and highest finite number of several arrays, with a little room.
function range(arrays, low = Infinity, high = -Infinity) {
  for (const values of arrays) {
    for (const value of values) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  if (!(high >= low)) return [0, 1];
  const room = 0.04 * (high - low) || Math.abs(high) * 0.1 || 1;
  return [low - room, high + room];
}

function ticks(low, high, count) {
  const raw = (high - low) / Math.max(count, 1), power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 2.5, 5, 10].map((one) => one * power).find((one) => one >= raw) || power;
  const places = [];
  for (let k = Math.ceil(low / step); k * step <= high; k++) places.push(k * step);
  return places;
}

// Logarithms of round numbers.
function decades(low, high) {
  if (high - low < 1) return ticks(10 ** low, 10 ** high, 4).filter((one) => one > 0).map(Math.log10);
  const places = [];
  for (let k = Math.floor(low); k <= Math.ceil(high); k++) {
    for (const one of high - low < 2 ? [1, 2, 5] : [1]) {
      const value = k + Math.log10(one);
      if (value >= low && value <= high) places.push(value);
    }
  }
  return places;
}

function number(value, digits = 4) {
  if (!Number.isFinite(value)) return "-";
  const size = Math.abs(value);
  if (size !== 0 && (size >= 1e6 || size < 1e-3)) return value.toExponential(2);
  return String(Number(value.toPrecision(digits)));
}

// A place or a time, far from the origin too.
const placed = (value) => String(Number(value.toFixed(3)));

// Words of ticks: as many digits as tell one from the next.
function tickWords(places, log) {
  const most = Math.max(...places.map(Math.abs)), step = places[1] - places[0];
  const digits = log || places.length < 2 ? 4 : Math.min(Math.max(4, Math.ceil(Math.log10(most / step)) + 2), 15);
  return places.map((one) => number(log ? 10 ** one : one, digits));
}

// Frame with ticks; returns how numbers become pixels. Log scales take logarithms.
function frame(canvas, xs, ys, options = {}) {
  const on = context(canvas);
  if (!on) return null;
  const { pen, width, height } = on, m = MARGIN;
  const wide = width - m.left - m.right, tall = height - m.top - m.bottom;
  let [x0, x1] = xs, [y0, y1] = ys;
  if (options.equal) { // one millimetre is as long both ways
    const scale = Math.max((x1 - x0) / wide, (y1 - y0) / tall);
    const x = (x0 + x1) / 2, y = (y0 + y1) / 2;
    [x0, x1, y0, y1] = [x - scale * wide / 2, x + scale * wide / 2, y - scale * tall / 2, y + scale * tall / 2];
  }
  const px = (x) => m.left + (x - x0) / (x1 - x0) * wide;
  const py = (y) => m.top + tall - (y - y0) / (y1 - y0) * tall;
  pen.lineWidth = 1;
  pen.strokeStyle = ink("--line");
  pen.fillStyle = ink("--soft");
  const xticks = options.logx ? decades(x0, x1) : ticks(x0, x1, wide / 90);
  const yticks = options.logy ? decades(y0, y1) : ticks(y0, y1, tall / 45);
  pen.beginPath();
  for (const x of xticks) { pen.moveTo(px(x), m.top); pen.lineTo(px(x), m.top + tall); }
  for (const y of yticks) { pen.moveTo(m.left, py(y)); pen.lineTo(m.left + wide, py(y)); }
  pen.stroke();
  pen.textAlign = "center";
  pen.textBaseline = "top";
  tickWords(xticks, options.logx).forEach((words, k) => { // the outermost words stay on the canvas
    const half = pen.measureText(words).width / 2;
    pen.fillText(words, Math.min(Math.max(px(xticks[k]), half), width - half), m.top + tall + 5);
  });
  pen.textAlign = "right";
  pen.textBaseline = "middle";
  tickWords(yticks, options.logy).forEach((words, k) => pen.fillText(words, m.left - 5, py(yticks[k])));
  pen.save();
  pen.beginPath();
  pen.rect(m.left, m.top, wide, tall);
  pen.clip();
  return { pen, px, py, wide, tall, x0, x1, y0, y1, end: () => pen.restore() };
}

function line(plot, xs, ys, colour, width = 1.3, alpha = 1, dash = []) {
  const { pen, px, py } = plot;
  pen.strokeStyle = colour;
  pen.lineWidth = width;
  pen.globalAlpha = alpha;
  pen.setLineDash(dash);
  pen.beginPath();
  let drawing = false;
  for (let k = 0; k < xs.length; k++) {
    if (!Number.isFinite(xs[k]) || !Number.isFinite(ys[k])) { drawing = false; continue; }
    if (drawing) pen.lineTo(px(xs[k]), py(ys[k]));
    else pen.moveTo(px(xs[k]), py(ys[k]));
    drawing = true;
  }
  pen.stroke();
  pen.setLineDash([]);
  pen.globalAlpha = 1;
}

// A bar of so many pixels in the lower right corner, with what it stands for.
function scaleBar(plot, length, words) {
  const { pen, wide, tall } = plot, right = MARGIN.left + wide - 10, y = MARGIN.top + tall - 10;
  pen.strokeStyle = pen.fillStyle = ink("--ink");
  pen.lineWidth = 3;
  pen.beginPath();
  pen.moveTo(right - length, y);
  pen.lineTo(right, y);
  pen.stroke();
  pen.textAlign = "right";
  pen.textBaseline = "bottom";
  pen.fillText(words, right, y - 4);
}

// A point with its name beside it, within the frame.
function mark(plot, x, y, words) {
  const { pen, px, py, wide } = plot, left = px(x) > MARGIN.left + wide / 2;
  dot(plot, x, y, ink("--ink"), 6);
  pen.fillStyle = ink("--ink");
  pen.textAlign = left ? "right" : "left";
  pen.textBaseline = "bottom";
  pen.fillText(words, px(x) + (left ? -9 : 9), py(y) - 9);
}

function dot(plot, x, y, colour, size = 4, hollow = false) {
  if (!Number.isFinite(x) || !Number.isFinite(y)) return;
  const { pen, px, py } = plot;
  pen.beginPath();
  pen.arc(px(x), py(y), size, 0, 2 * Math.PI);
  if (hollow) { pen.strokeStyle = colour; pen.lineWidth = 1.5; pen.stroke(); }
  else { pen.fillStyle = colour; pen.fill(); }
}
