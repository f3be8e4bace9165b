"use strict";
// The page: choices, the views of one run, one cursor for all of them.

const RUNS = JSON.parse(document.getElementById("data").textContent);
const $ = (id) => document.getElementById(id);
const AXES = ["#0072b2", "#d55e00", "#009e73"]; // of controls, by axis
const START = { start: COLOURS[0], tuned: COLOURS[1] };
const FACTORS = Array.from({ length: 16 }, (_, k) => [1, 2, 5][k % 3] * 10 ** Math.floor(k / 3));
const state = { run: 0, contour: 0, plant: 0, along: "time", factor: 1, zoom: 1, cursor: 0,
  shown: new Set(), point: 0 };
let views = {}; // id -> the frame drawn last, to find what is under the pointer

const run = () => RUNS[state.run];
const contour = () => run().contours[state.contour];
const colour = (design) => START[run().designs[design]] || COLOURS[(design + 1) % COLOURS.length];

// A loop: `Uint8Array.from` would call back for every byte, most of the time of a new contour.
function numbers(packed) {
  const letters = atob(packed.f32), bytes = new Uint8Array(letters.length);
  for (let k = 0; k < bytes.length; k++) bytes[k] = letters.charCodeAt(k);
  return new Float32Array(bytes.buffer);
}

// Arrays of a contour, read when it is first shown.
function signals(one) {
  if (!one.read) {
    one.read = {};
    for (const [name, value] of Object.entries(one)) {
      if (value && value.f32 !== undefined) one.read[name] = numbers(value);
    }
  }
  return one.read;
}

// What was read or computed once for the contour that is shown.
function kept(name, make) {
  const one = contour();
  one.kept_values ||= new Map();
  if (!one.kept_values.has(name)) one.kept_values.set(name, make());
  return one.kept_values.get(name);
}

// Column of a signal of one run: (design, plant, sample, column), row by row.
function column(name, design, plant, index, columns) {
  return kept(`${name} ${design} ${plant} ${index}`, () => {
    const one = contour(), all = signals(one)[name];
    const first = (design * run().plants.length + plant) * one.kept * columns + index;
    return Float32Array.from({ length: one.kept }, (_, k) => all[first + k * columns]);
  });
}

function errorSize(design, plant) {
  return kept(`size ${design} ${plant}`, () => {
    const axes = run().axes.length;
    const parts = run().axes.map((_, axis) => column("error", design, plant, axis, axes));
    return Float32Array.from(parts[0], (_, k) => Math.hypot(...parts.map((part) => part[k])));
  });
}

// Where the tool should be, along one axis [mm].
function wantedAlong(axis) {
  return kept(`wanted ${axis}`, () => {
    const all = signals(contour()).reference, axes = run().axes.length;
    return Float32Array.from({ length: contour().kept }, (_, row) => all[row * axes + axis]);
  });
}

function plantsShown() {
  return state.plant < 0 ? run().plants.map((_, k) => k) : [state.plant];
}

// Every line to draw: all plants thin where the family is shown, the nominal one thick.
function runsShown() {
  const runs = [];
  for (const design of state.shown) {
    for (const plant of plantsShown()) {
      runs.push({ design, plant, colour: colour(design), thick: state.plant >= 0 || plant === 0 });
    }
  }
  return runs.sort((a, b) => Number(a.thick) - Number(b.thick));
}

const abscissa = () => signals(contour())[state.along];

// --- views over time or path

function overTime(id, values) {
  const lines = runsShown().map((one) => ({ ...one, parts: values(one.design, one.plant) }));
  const x = abscissa();
  const plot = frame($(id), [x[0], x[x.length - 1]], range(lines.flatMap((one) => one.parts)));
  views[id] = plot;
  if (!plot) return;
  for (const one of lines) {
    one.parts.forEach((part, k) => { // of several inputs each has its colour, and start is dashed
      const several = one.parts.length > 1, dashed = several && run().designs[one.design] === "start";
      const shade = several ? AXES[k % AXES.length] : one.colour;
      line(plot, x, part, shade, one.thick ? 1.3 : 0.8, one.thick ? 1 : 0.45, dashed ? [5, 3] : []);
    });
  }
  line(plot, [x[state.cursor], x[state.cursor]], [plot.y0, plot.y1], ink("--soft"), 1);
  plot.end();
}

function drawControl() {
  const inputs = run().inputs;
  overTime("control", (design, plant) =>
    Array.from({ length: inputs }, (_, k) => column("control", design, plant, k, inputs)));
}

// --- the part, its error magnified

function drawPart() {
  const flat = run().axes.length === 1, read = signals(contour()), axes = run().axes.length;
  const wanted = flat ? [read.time, wantedAlong(0)] : [wantedAlong(0), wantedAlong(1)];
  const tools = runsShown().map((one) => {
    const where = wanted.map((_, k) => {
      const axis = flat ? 0 : k;
      const tool = column("output", one.design, one.plant, axis, axes);
      const error = column("error", one.design, one.plant, axis, axes); // um
      return tool.map((value, row) => value + (state.factor - 1) * 1e-3 * error[row]);
    });
    return { ...one, where: flat ? [read.time, where[1]] : where };
  });
  let [xs, ys] = wanted.map((part, k) => range([part, ...tools.map((one) => one.where[k])]));
  if (state.zoom > 1) { // about the cursor
    const about = wanted.map((part) => part[state.cursor]);
    [xs, ys] = [xs, ys].map(([low, high], k) =>
      [about[k] - (high - low) / 2 / state.zoom, about[k] + (high - low) / 2 / state.zoom]);
  }
  const plot = frame($("part"), xs, ys, { equal: !flat });
  views.part = plot && { ...plot, wanted };
  if (!plot) return;
  line(plot, wanted[0], wanted[1], ink("--soft"), 1, 1, [4, 3]);
  for (const one of tools) {
    line(plot, one.where[0], one.where[1], one.colour, one.thick ? 1.5 : 0.8, one.thick ? 1 : 0.45);
    if (one.thick) dot(plot, one.where[0][state.cursor], one.where[1][state.cursor], one.colour);
  }
  dot(plot, wanted[0][state.cursor], wanted[1][state.cursor], ink("--ink"), 6, true);
  if (!flat) { // pixels of a micrometre of error, and a round number of them
    const each = 1e-3 * state.factor * plot.wide / (plot.x1 - plot.x0);
    const [power, part] = [10 ** Math.floor(Math.log10(120 / each)), 120 / each];
    const size = power * [5, 2, 1].find((one) => one * power <= part);
    scaleBar(plot, size * each, `error of ${number(size)} um`);
  }
  plot.end();
}

// --- sensitivity and front

function drawSensitivity() {
  const sensitivity = run().sensitivity;
  $("sensitivity-figure").hidden = !sensitivity;
  if (!sensitivity) return;
  const x = sensitivity.frequency.map(Math.log10);
  const designs = Object.entries(sensitivity.designs).map(([name, packed]) => ({
    colour: START[name] || COLOURS[2], values: numbers(packed).map(Math.log10) }));
  const plot = frame($("sensitivity"), [x[0], x[x.length - 1]],
    range(designs.map((one) => one.values)), { logx: true, logy: true });
  if (!plot) return;
  for (const one of designs) {
    const largest = new Float32Array(x.length).fill(-Infinity);
    for (let first = 0; first < one.values.length; first += x.length) {
      const row = one.values.subarray(first, first + x.length);
      line(plot, x, row, one.colour, 0.7, 0.5);
      row.forEach((value, k) => { if (value > largest[k]) largest[k] = value; });
    }
    line(plot, x, largest, one.colour, 1.8);
  }
  if (run().limit) line(plot, [x[0], x[x.length - 1]], Array(2).fill(Math.log10(run().limit)), ink("--ink"), 1, 1, [6, 4]);
  plot.end();
}

function drawFront() {
  const front = run().points;
  $("front-figure").hidden = !front || !front.points.length;
  if (!front || !front.points.length) return;
  const x = front.points.map((one) => Math.log10(one.x)), y = front.points.map((one) => Math.log10(one.y));
  const plot = frame($("front"), range([x]), range([y]), { logx: true, logy: true });
  views.front = plot && { ...plot, xs: x, ys: y };
  if (!plot) return;
  front.points.forEach((one, k) => dot(plot, x[k], y[k], one.feasible ? COLOURS[1] : "#999", 3.5, !one.feasible));
  front.points.forEach((one, k) => { if (one.recommended) mark(plot, x[k], y[k], "recommended"); });
  dot(plot, x[state.point], y[state.point], COLOURS[0], 8, true);
  plot.end();
}

function choosePoint(index) {
  state.point = index;
  $("point").value = String(index);
  const one = run().points.points[index];
  const weights = Object.entries(one.weights).map(([name, value]) => `${name}  ${[value].flat().map((part) => number(part)).join(" ")}`);
  const lines = [`error ${number(one.y)} um, ${run().points.x.split(" [")[0]} ${number(one.x)}${one.feasible ? "" : ", beyond a limit"}`];
  $("point-weights").textContent = [...lines, ...weights].join("\n");
  const design = run().designs.indexOf(one.design);
  if (design >= 0) {
    state.shown = new Set([design]);
    tickDesigns();
  }
  draw();
}

// --- text

function fill(table, rows, head) {
  table.replaceChildren();
  rows.forEach((cells, index) => {
    const row = table.insertRow();
    cells.forEach((cell, k) => {
      const box = document.createElement(head && index === 0 ? "th" : "td");
      box.textContent = typeof cell === "number" ? number(cell) : cell;
      if (typeof cell === "number") box.className = "number";
      row.append(box);
    });
  });
}

function tellCursor() {
  const read = signals(contour()), k = state.cursor, names = run().axes;
  const place = names.map((name, axis) => `${name} ${placed(read.reference[k * names.length + axis])}`).join(", ");
  $("cursor-value").textContent = `${placed(read.time[k])} s, ${placed(read.arc[k])} mm along, ${place} mm`;
  const rows = [["weights", "plant", "error [um]", "feed [mm/min]", `control [${run().control_unit}]`]];
  for (const one of runsShown()) {
    const control = Array.from({ length: run().inputs }, (_, i) => number(column("control", one.design, one.plant, i, run().inputs)[k]));
    rows.push([run().designs[one.design], run().plants[one.plant], errorSize(one.design, one.plant)[k],
      column("feed", one.design, one.plant, 0, 1)[k], control.join(", ")]);
  }
  fill($("readout"), rows, true);
}

function tellMetrics() {
  const one = contour(), shown = Object.entries(run().shown);
  const rows = [["weights", "plant", ...shown.map(([, [heading]]) => heading)]];
  run().designs.forEach((design, d) => run().plants.forEach((plant, p) => {
    const values = shown.map(([name, [, factor]]) => factor * (one.metrics[name]?.[d][p] ?? NaN));
    rows.push([design, one.diverged[d][p] ? `${plant} (diverged)` : plant, ...values]);
  }));
  fill($("metrics"), rows, true);
}

function tellAxes() {
  const over = state.along === "time" ? "over time [s]" : "over path [mm]", names = run().axes;
  const several = run().inputs > 1 && run().inputs === names.length;
  $("error-title").textContent = `Error [um] ${over}`;
  $("control-title").textContent = `Control [${run().control_unit}] ${over}`;
  if (several) names.forEach((name, k) => {
    const word = document.createElement("span");
    word.textContent = ` ${name}`;
    word.style.color = AXES[k % AXES.length];
    $("control-title").append(word);
  });
  $("feed-title").textContent = `Feed [mm/min] ${over}`;
  $("part-title").textContent = names.length === 1 ? `${names[0]} [mm] over time [s]` : `Part: ${names[1]} over ${names[0]} [mm]; dashed where the tool should be`;
}

function tellRun() {
  const one = run();
  $("title").textContent = `${one.command}: ${one.controller}${one.machine ? ` on ${one.machine}` : ""}, folder ${one.name}`;
  $("repeat").textContent = one.repeat;
  $("verdict").hidden = !one.verdict;
  if (one.verdict) {
    $("verdict").className = one.verdict.usable ? "" : "against";
    $("verdict").textContent = one.verdict.lines.join("\n");
  }
  fill($("answer"), one.answer);
  $("alternatives-section").hidden = !one.alternatives.length;
  const effort = `RMS change of the control per sample [${one.control_unit}]`;
  fill($("alternatives"), [["", `worst RMS ${one.error} error of all contours and plants [um]`, "Ms", effort, "cycle time [s]", ""],
    ...one.alternatives.map((row) => [row.name, row.error, row.margin ?? NaN, row.effort ?? NaN, row.time ?? NaN,
      row.note])], true);
  $("lines").textContent = one.lines.join("\n");
  $("lines-section").hidden = !one.lines.length;
  $("drives-section").hidden = !Object.keys(one.drives).length;
  options($("product"), Object.keys(one.drives), 0);
  tellDrive(0);
  const settings = Object.entries(one.settings);
  fill($("settings"), settings.length ? settings : [["none"]]);
  fill($("versions"), Object.entries(one.versions));
  const where = one.command === "tune" ? " of the training contours, smooth machine" : "";
  if (one.points) $("front-title").textContent = `Points: worst RMS ${one.error} error [um]${where} over ${one.points.x}; hollow ones exceed a limit`;
}

function tellDrive(index) {
  $("drive-gains").textContent = (Object.values(run().drives)[index] || []).join("\n");
}

// --- choices

function options(select, words, chosen) {
  select.replaceChildren(...words.map((word, k) => new Option(word, String(k))));
  select.value = String(chosen);
}

function tickDesigns() {
  $("designs").querySelectorAll("input").forEach((box, k) => { box.checked = state.shown.has(k); });
}

function chooseRun(index) {
  Object.assign(state, { run: index, contour: 0, plant: 0, cursor: 0, point: 0 });
  const one = run(), legend = $("designs").firstElementChild;
  state.shown = new Set(one.command === "front" ? [0] : one.designs.keys());
  options($("contour"), one.contours.map((each) => each.name + (each.training ? "" : one.command === "tune" ? " (held out)" : "")), 0);
  options($("plant"), one.plants, 0);
  if (one.plants.length > 1) $("plant").append(new Option("whole family", "-1"));
  $("designs").replaceChildren(legend, ...one.designs.map((name, k) => {
    const label = document.createElement("label"), box = document.createElement("input"), swatch = document.createElement("span");
    Object.assign(box, { type: "checkbox", checked: state.shown.has(k) });
    box.addEventListener("change", () => { state.shown[box.checked ? "add" : "delete"](k); draw(); });
    swatch.className = "swatch";
    swatch.style.background = colour(k);
    label.append(box, " ", swatch, name);
    return label;
  }));
  for (const id of ["part", "error", "control", "feed"]) $(id).parentElement.hidden = !one.contours.length;
  $("choices").querySelectorAll("label:not(#run-label), fieldset").forEach((part) => { part.hidden = !one.contours.length; });
  tellRun();
  if (one.points && one.points.points.length) {
    options($("point"), one.points.points.map((point) => `${number(point.x)}: ${number(point.y)} um`), 0);
    choosePoint(bestPoint(one.points.points));
  }
  const worst = worstRun();
  $("contour").value = String(worst.contour);
  $("plant").value = String(state.plant = worst.plant);
  chooseContour(worst.contour);
}

// Contour and plant of the largest error with the last weights, on the user's parts if there are any.
function worstRun() {
  const worst = { contour: 0, plant: 0, size: -1 }, name = `peak_${run().error}_error`;
  const own = run().contours.some((one) => one.training);
  run().contours.forEach((one, contour) => {
    if (one.training === own) (one.metrics[name] || []).slice(-1).flat().forEach((size, plant) => {
      if (size > worst.size) Object.assign(worst, { contour, plant, size });
    });
  });
  return worst;
}

// The lowest error within the limits.
function bestPoint(points) {
  let best = 0;
  points.forEach((one, k) => {
    const old = points[best];
    if (one.feasible !== old.feasible ? one.feasible : one.y < old.y) best = k;
  });
  return best;
}

function chooseContour(index) {
  state.contour = index;
  if (run().contours.length) {
    $("cursor").max = String(contour().kept - 1);
    state.factor = fittingFactor();
    $("factor").value = String(FACTORS.indexOf(state.factor));
    moveCursor(loudest());
    tellMetrics();
    $("samples-drawn").textContent = `${contour().samples} samples, ${contour().kept} of them drawn: no peak is left out.`;
  } else {
    $("samples-drawn").textContent = "The run kept no signals (--rollouts none).";
  }
  draw();
}

function loudest() {
  let best = 0, most = -1;
  for (const design of state.shown) {
    errorSize(design, plantsShown()[0]).forEach((value, k) => { if (value > most) { most = value; best = k; } });
  }
  return best;
}

// The largest of the slider's factors that draws no error longer than a twentieth of the part.
function fittingFactor() {
  const wanted = signals(contour()).reference;
  const size = range([wanted])[1] - range([wanted])[0];
  let most = 0;
  for (const design of state.shown) for (const value of errorSize(design, plantsShown()[0])) if (value > most) most = value;
  return FACTORS.findLast((one) => 1e-3 * one * most <= 0.05 * size) || 1;
}

function moveCursor(index) {
  state.cursor = Math.min(Math.max(index, 0), contour().kept - 1);
  $("cursor").value = String(state.cursor);
}

let waiting = 0;
function draw() { // once a frame, however often it is asked for
  if (!waiting) waiting = requestAnimationFrame(drawNow);
}

function drawNow() {
  waiting = 0;
  $("factor-value").textContent = number(state.factor);
  $("zoom-value").textContent = number(state.zoom);
  drawFront();
  drawSensitivity();
  if (!run().contours.length) return;
  drawPart();
  overTime("error", (design, plant) => [errorSize(design, plant)]);
  drawControl();
  overTime("feed", (design, plant) => [column("feed", design, plant, 0, 1)]);
  tellAxes();
  tellCursor();
}

// --- pointer

function nearest(xs, x) {
  let best = 0;
  for (let k = 1; k < xs.length; k++) if (Math.abs(xs[k] - x) < Math.abs(xs[best] - x)) best = k;
  return best;
}

function nearestPoint(plot, xs, ys, event) {
  let best = 0, least = Infinity;
  for (let k = 0; k < xs.length; k++) {
    const far = Math.hypot(plot.px(xs[k]) - event.offsetX, plot.py(ys[k]) - event.offsetY);
    if (far < least) { least = far; best = k; }
  }
  return best;
}

for (const id of ["error", "control", "feed"]) {
  const follow = (event) => {
    const plot = views[id];
    if (!plot || (event.type === "pointermove" && event.pointerType === "touch" && !event.buttons)) return;
    moveCursor(nearest(abscissa(), plot.x0 + (event.offsetX - MARGIN.left) / plot.wide * (plot.x1 - plot.x0)));
    draw();
  };
  $(id).addEventListener("pointermove", follow);
  $(id).addEventListener("pointerdown", follow);
}
$("part").addEventListener("pointerdown", (event) => {
  if (!views.part) return;
  moveCursor(nearestPoint(views.part, views.part.wanted[0], views.part.wanted[1], event));
  draw();
});
$("front").addEventListener("pointerdown", (event) => {
  if (views.front) choosePoint(nearestPoint(views.front, views.front.xs, views.front.ys, event));
});

const whole = (id, choose) => $(id).addEventListener("change", () => { choose(Number($(id).value)); });
whole("run", chooseRun);
whole("contour", chooseContour);
whole("point", choosePoint);
whole("product", tellDrive);
whole("plant", (index) => { state.plant = index; draw(); });
$("along").addEventListener("change", () => { state.along = $("along").value; draw(); });
$("factor").addEventListener("input", () => { state.factor = FACTORS[Number($("factor").value)]; draw(); });
$("zoom").addEventListener("input", () => { state.zoom = 10 ** (Number($("zoom").value) / 40); draw(); });
$("cursor").addEventListener("input", () => { moveCursor(Number($("cursor").value)); draw(); });
$("choices").addEventListener("submit", (event) => event.preventDefault());
for (const event of ["resize", "beforeprint", "afterprint"]) window.addEventListener(event, drawNow);

options($("run"), RUNS.map((one) => one.name), 0);
$("run-label").hidden = RUNS.length < 2;
chooseRun(0);
drawNow();
