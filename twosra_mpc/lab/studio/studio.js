
const known = JSON.parse(byId("known").textContent);
const SVG = "http://www.w3.org/2000/svg";
const SETTLED_MS = 150; // after the last movement a plan is played
const STEP = { place: 0.005, heading: Math.PI / 90, bend: 1 }; // of an arrow key: m, rad, 1/m
const COLOURS = ["#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377", "#bbbbbb", "#000000"];
const copyOf = (value) => JSON.parse(JSON.stringify(value));
const latencies = []; // from a movement to its answer [ms]

let problem = JSON.parse(sessionStorage.getItem("problem")) ?? known.problem;
let box = null; // what the plane shows [mm]
let handles = {};
let past = [], future = [];
let held = null; // what the hand holds
let stopFilm = () => {};
let settle = null;
let run = null;
let sized = null; // width of the plane that handles were made for [mm]

const element = (name, attributes = {}, text = "") => {
  const made = document.createElementNS(SVG, name);
  Object.entries(attributes).forEach(([key, value]) => made.setAttribute(key, value));
  if (text) made.textContent = text;
  return made;
};
const html = (name, attributes = {}, text = "") => Object.assign(document.createElement(name), attributes, { textContent: text });
const fill = (select, words, chosen) => {
  byId(select).replaceChildren(...words.map((word) => html("option", { value: word }, word)));
  if (chosen !== undefined) byId(select).value = chosen;
};
const seconds = (value) => value === null || value === undefined ? "–"
  : value < 100 ? `${value.toFixed(1)} s` : `${Math.floor(value / 60)} min ${(value % 60).toFixed(0)} s`;
const percent = (share) => share === null || share === undefined ? "none proved" : `${(100 * share).toPrecision(2)} %`;

// Messages.

async function post(path, message, signal) {
  const headers = { "Content-Type": "application/json", "X-Token": known.token };
  return fetch(path, { method: "POST", headers, body: JSON.stringify(message), signal });
}

async function* records(path, message, signal) {
  const reader = (await post(path, message, signal)).body.pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) break;
    const lines = (rest + value).split("\n");
    rest = lines.pop();
    for (const line of lines) yield JSON.parse(line);
  }
  if (rest) yield JSON.parse(rest);
}

const lost = (is) => { byId("lost").hidden = !is; };
const ALIVE_MS = 2000;
setInterval(() => post("/alive", {}).then(() => lost(false), () => lost(true)), ALIVE_MS);

// Asking for plans: one question at a time; the newest waits until the one before has a first answer.

let asking = null, waiting = null;

function ask(more = {}) {
  waiting = { ...waiting, ...more, since: performance.now() };
  if (asking && !asking.answered) return;
  asking?.stop.abort();
  question();
}

async function question() {
  const { since, ...more } = waiting;
  const mine = { stop: new AbortController(), answered: false };
  [asking, waiting] = [mine, null];
  const message = { problem, greedy: byId("planner").value === "both", ...more };
  if (box) message.box_mm = box;
  try {
    for await (const record of records("/plan", message, mine.stop.signal)) {
      lost(false);
      if (asking !== mine) return;
      take(record, more, mine);
      if (record.kind !== "scene" && !mine.answered) {
        mine.answered = true;
        latencies.push(performance.now() - since);
        if (latencies.length > 1000) latencies.shift();
        if (waiting) { mine.stop.abort(); question(); return; }
      }
    }
  } catch (error) {
    if (error.name === "AbortError" || asking !== mine) return;
    lost(true);
    waiting = { ...more, ...waiting, since };
    setTimeout(() => { if (asking === mine) question(); }, 1000);
    return;
  }
  if (asking === mine) {
    asking = null;
    if (waiting) question();
  }
}

function take(record, asked, mine) {
  if (record.kind === "scene") {
    box ??= record.box_mm;
    if (asked.pull) problem[asked.pull.end].kappa_per_m = record.problem[asked.pull.end].kappa_per_m;
    if (asked.path_model) problem = record.problem;
    sessionStorage.setItem("problem", JSON.stringify(problem));
    showScene(record);
  } else if (record.kind === "bound") {
    byId("message").textContent = `proved without obstacles: no plan costs less than ${seconds(record.lower_bound_s)}`;
  } else if (record.kind === "result") {
    showResult(record);
  } else if (record.kind === "film") {
    if (held) return;
    showFilm(record);
  } else if (record.kind === "confirmed") {
    byId("confirmed-gap").textContent = percent(record.gap);
  } else if (record.kind === "refused") {
    showRefusal(record);
    mine.answered = true;
  }
}

// What is shown.

function showScene(scene) {
  handles = scene.handles;
  if (scene.plane && !held) {
    stopFilm();
    byId("plane").innerHTML = scene.plane;
    byId("hand").setAttribute("viewBox", box.join(" "));
    makeHandles();
  }
  for (const [end, pose] of Object.entries(scene.ends)) {
    const ghost = document.querySelector(`#plane .ghost.${end}`);
    const parts = [...pose.wheels, ...pose.units, ...pose.links, ...pose.segments];
    [...ghost.children].forEach((child, i) => child.setAttribute("points", parts[i]));
  }
  if (!scene.plane) {
    const robot = byId("robot");
    [["segment", "segments"], ["hatch", "segments"], ["link", "links"], ["unit", "units"], ["wheel", "wheels"]].forEach(
      ([name, key]) => robot.querySelectorAll(`.${name}`).forEach((part, i) => part.setAttribute("points", scene.ends.start[key][i])));
  }
  placeHandles();
  showNumbers(scene);
  document.querySelectorAll("[aria-invalid]").forEach((input) => input.removeAttribute("aria-invalid"));
}

function impossible(is) {
  byId("status").classList.toggle("impossible", is);
  document.querySelectorAll("#plane .ghost.goal, #handles .goal").forEach((part) => part.classList.toggle("impossible", is));
}

function showResult(made) {
  const searching = made.found ? `${made.status}, being improved` : "searching";
  byId("status").textContent = made.complete ? made.status : searching;
  impossible(!made.found && made.complete);
  byId("sequence").textContent = made.found ? made.sequence : "";
  if (made.found || made.complete) byId("message").textContent = made.found ? "" : made.message;
  byId("why").textContent = made.found ? made.why : "";
  byId("duration").textContent = made.found ? seconds(made.duration_s) : "–";
  byId("confirmed").textContent = made.found ? seconds(made.confirmed_s) : "–";
  byId("gap").textContent = made.found ? percent(made.gap) : "–";
  byId("confirmed-gap").textContent = "–";
  byId("energy").textContent = made.found ? `${made.energy_J.toFixed(0)} J` : "–";
  byId("way").replaceChildren(...(made.found ? [element("polyline", { points: made.path.join(" "), fill: "none" })] : []));
  if (!made.found) { byId("timeline").replaceChildren(); byId("readings").replaceChildren(); }
}

function showRefusal(record) {
  impossible(true);
  byId("status").textContent = "refused";
  byId("sequence").textContent = "";
  byId("message").textContent = record.message;
  byId("way").replaceChildren();
  const field = record.field ?? "";
  document.querySelectorAll("#numbers input").forEach((input) => {
    if (field.startsWith(input.dataset.field)) input.setAttribute("aria-invalid", "true");
  });
}

function showFilm(record) {
  stopFilm();
  for (const part of ["plane", "readings", "timeline"]) byId(part).innerHTML = record[part];
  byId("greedy").textContent = record.greedy_s ? seconds(record.greedy_s) : record.greedy ? "no plan" : "–";
  stopFilm = player(record.data);
  byId("way").replaceChildren();
  impossible(false);
  stale(false);
}

// Numbers.

const FIELDS = [["x_m", "x [m]", 1], ["y_m", "y [m]", 1], ["phi_rad", "heading [°]", 180 / Math.PI]];
const rows = () => [...FIELDS, ...problem.start.kappa_per_m.map((_, j) => [`kappa_per_m.${j}`, `curvature ${j + 1} [1/m]`, 1])];
const valueOf = (end, key) => key.split(".").reduce((value, part) => value?.[part], problem[end]);
const setValue = (end, key, value) => {
  const [name, number] = key.split(".");
  if (number === undefined) problem[end][name] = value;
  else (problem[end][name] ??= problem.start.kappa_per_m.map(() => null))[number] = value;
};
const rounded = (value) => Number(value.toFixed(4));

function makeForms() {
  byId("numbers").replaceChildren(...rows().map(([key, words, unit]) => {
    const row = html("tr");
    row.append(html("th", { scope: "row" }, words), ...["start", "goal"].map((end) => {
      const cell = html("td");
      if (!problem[end]) return cell;
      const input = html("input", { type: "number", step: "any", ariaLabel: `${end}: ${words}` });
      input.dataset.field = `${end}.${key}`;
      input.addEventListener("change", () => {
        remember();
        setValue(end, key, input.value === "" && end === "goal" ? null : Number(input.value) / unit);
        moved();
      });
      cell.append(input);
      return cell;
    }));
    return row;
  }));
  const segments = problem.start.kappa_per_m.map((_, j) => slider(`segment ${j + 1} [°C]`, (value) => {
    problem.start.temperature_C ??= problem.start.kappa_per_m.map(() => value);
    problem.start.temperature_C[j] = value;
    delete problem.start.melt_fraction;
    delete problem.start.body_temperature_C;
  }, 0, 84));
  byId("sliders").replaceChildren(...segments, slider("air [°C]", (value) => { problem.ambient_C = value; }, 0, 45));
  const own = typeof problem.robot === "string" ? problem.robot : "its own";
  fill("robot-name", own === "its own" ? [...known.robots, own] : known.robots, own);
  fill("path-model", ["the robot's", ...known.path_models]);
  byId("gap-asked").value = 100 * (problem.gap ?? 0.01);
  fill("broken", ["none", ...problem.start.kappa_per_m.map((_, j) => `${j + 1}`)]);
  const names = ["x", "y", "phi", ...problem.start.kappa_per_m.map((_, j) => `kappa${j + 1}`)];
  fill("map-x", names, "kappa1");
  fill("map-y", names, names.includes("kappa2") ? "kappa2" : "x");
  showThings();
}

function slider(words, change, min, max) {
  const label = html("label", {}, words), input = html("input", { type: "range", min, max, step: 1 });
  input.addEventListener("pointerdown", remember);
  input.addEventListener("input", () => { change(Number(input.value)); moved(); });
  label.append(input, html("output"));
  return label;
}

function showNumbers(scene) {
  document.querySelectorAll("#numbers input").forEach((input) => {
    if (input === document.activeElement && input.matches(":focus-visible") && !held) return;
    const [end, ...key] = input.dataset.field.split(".");
    const [, , unit] = rows().find(([name]) => name === key.join("."));
    const value = valueOf(end, key.join("."));
    input.value = value === null || value === undefined ? "" : rounded(value * unit);
  });
  const shown = [...scene.temperatures_C, scene.air_C];
  document.querySelectorAll("#sliders label").forEach((label, j) => {
    label.querySelector("input").value = shown[j];
    label.querySelector("output").textContent = `${shown[j].toFixed(0)} °C`;
  });
}

// The hand.

function makeHandles() {
  const made = [...byId("handles").querySelectorAll(".handle")].map((part) => `${part.dataset.end} ${part.dataset.name}`);
  const asked = Object.entries(handles).flatMap(([end, places]) => Object.keys(places).map((name) => `${end} ${name}`));
  if (made.join() === asked.join() && sized === box[2]) return;
  sized = box[2];
  const size = box[2] / 90;
  const parts = Object.entries(handles).flatMap(([end, places]) => [
    element("line", { class: "arm", "data-end": end }),
    ...Object.keys(places).map((name) => {
      const words = name === "place" ? `${end}: position` : name === "heading" ? `${end}: heading` : `${end}: bend of segment ${Number(name.at(-1)) + 1}`;
      const shape = name === "heading" ? element("rect", { width: 2 * size, height: 2 * size }) : element("circle", { r: size });
      for (const [key, value] of Object.entries({ class: `handle ${end}`, tabindex: 0, role: "button", "aria-label": words, "data-end": end, "data-name": name })) shape.setAttribute(key, value);
      shape.append(element("title", {}, words));
      shape.addEventListener("pointerdown", grab);
      shape.addEventListener("keydown", nudge);
      return shape;
    }),
  ]);
  byId("handles").replaceChildren(...parts);
}

function placeHandles() {
  const size = box[2] / 90;
  for (const part of byId("handles").children) {
    const places = handles[part.dataset.end];
    if (part.tagName === "line") {
      const [[x1, y1], [x2, y2]] = [places.place, places.heading];
      Object.entries({ x1, y1, x2, y2 }).forEach(([key, value]) => part.setAttribute(key, value));
    } else {
      const [x, y] = places[part.dataset.name];
      const square = part.tagName === "rect";
      part.setAttribute(square ? "x" : "cx", square ? x - size : x);
      part.setAttribute(square ? "y" : "cy", square ? y - size : y);
    }
  }
}

function at(event) { // the place of a pointer [m, y up]
  const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(byId("hand").getScreenCTM().inverse());
  return [point.x / 1000, -point.y / 1000];
}

function hold(event, what, move) {
  event.preventDefault();
  held = { what, move };
  event.target.setPointerCapture(event.pointerId);
  const drag = (one) => move(at(one), one);
  const release = () => {
    event.target.removeEventListener("pointermove", drag);
    held = null;
    moved();
  };
  event.target.addEventListener("pointermove", drag);
  event.target.addEventListener("pointerup", release, { once: true });
  event.target.addEventListener("pointercancel", release, { once: true });
}

function grab(event) {
  const { end, name } = event.target.dataset;
  event.target.focus();
  remember();
  const [x0, y0] = at(event), before = copyOf(problem[end]);
  hold(event, event.target, ([x, y]) => {
    const now = problem[end], [cx, cy] = handles[end].place;
    if (name === "place") {
      now.x_m = rounded((before.x_m ?? cx / 1000) + x - x0);
      now.y_m = rounded((before.y_m ?? -cy / 1000) + y - y0);
      moved();
    } else if (name === "heading") {
      now.phi_rad = rounded(Math.atan2(y + cy / 1000, x - cx / 1000));
      moved();
    } else {
      moved({ pull: { end, segment: Number(name.at(-1)), x_m: x, y_m: y } });
    }
  });
}

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

function nudge(event) {
  if (!ARROWS[event.key]) return;
  event.preventDefault();
  const { end, name } = event.target.dataset, [dx, dy] = ARROWS[event.key], much = event.shiftKey ? 5 : 1;
  const now = problem[end], [cx, cy] = handles[end].place;
  remember();
  if (name === "place") {
    now.x_m = rounded((now.x_m ?? cx / 1000) + much * STEP.place * dx);
    now.y_m = rounded((now.y_m ?? -cy / 1000) + much * STEP.place * dy);
  } else if (name === "heading") {
    now.phi_rad = rounded((now.phi_rad ?? 0) - much * STEP.heading * (dx - dy));
  } else {
    const j = Number(name.at(-1));
    setValue(end, `kappa_per_m.${j}`, rounded((valueOf(end, `kappa_per_m.${j}`) ?? 0) + much * STEP.bend * (dx + dy)));
  }
  moved();
}

const stale = (is) => { for (const part of ["readings", "timeline"]) byId(part).classList.toggle("stale", is); };

function moved(more = {}) { // the problem is another one
  stale(true);
  ask({ film: false, pull: undefined, ...more });
  clearTimeout(settle);
  settle = setTimeout(() => { if (!held) ask({ film: true }); }, SETTLED_MS);
}

function remember() {
  past.push(copyOf(problem));
  future = [];
  showHistory();
}

function showHistory() {
  byId("undo").disabled = !past.length;
  byId("redo").disabled = !future.length;
}

function travel(from, to) {
  if (!from.length) return;
  to.push(copyOf(problem));
  show(from.pop());
}

function show(other) {
  problem = other;
  makeForms();
  showHistory();
  moved();
}

// World and tasks.

const shifted = (thing, dx, dy) => {
  const moved = copyOf(thing), by = (pair, d) => pair.map((value) => rounded(value + d));
  if (moved.pose) { moved.pose.x_m = rounded(moved.pose.x_m + dx); moved.pose.y_m = rounded(moved.pose.y_m + dy); }
  else if (moved.box) { moved.box.x_m = by(moved.box.x_m, dx); moved.box.y_m = by(moved.box.y_m, dy); }
  else if (moved.disc) { moved.disc.x_m = rounded(moved.disc.x_m + dx); moved.disc.y_m = rounded(moved.disc.y_m + dy); }
  else moved.polygon_m = moved.polygon_m.map(([x, y]) => [rounded(x + dx), rounded(y + dy)]);
  return moved;
};

byId("plane").addEventListener("pointerdown", (event) => {
  const kind = ["obstacle", "object"].find((name) => event.target.classList.contains(name));
  if (!kind) return;
  const all = [...document.querySelectorAll(`#plane .${kind}`)], number = all.indexOf(event.target), key = `${kind}s`;
  if (!Array.isArray(problem[key])) return;
  remember();
  const before = copyOf(problem[key][number]), [x0, y0] = at(event), where = event.target.getAttribute("transform") ?? "";
  hold(event, event.target, ([x, y]) => {
    problem[key][number] = shifted(before, x - x0, y - y0);
    event.target.setAttribute("transform", `translate(${1000 * (x - x0)},${1000 * (y0 - y)}) ${where}`);
    moved();
  });
});

const middle = () => [rounded((box[0] + box[2] / 2) / 1000), rounded(-(box[1] + box[3] / 2) / 1000)];
const freeName = (word, list) => { let i = 1; while (list.some((one) => one.name === `${word} ${i}`)) i += 1; return `${word} ${i}`; };
const add = (key, word, make) => () => {
  remember();
  problem[key] = Array.isArray(problem[key]) ? problem[key] : [];
  problem[key].push({ name: freeName(word, problem[key]), ...make(...middle()) });
  show(problem);
};
byId("add-box").addEventListener("click", add("obstacles", "box", (x, y) => ({ box: { x_m: [x - 0.02, x + 0.02], y_m: [y - 0.02, y + 0.02] } })));
byId("add-disc").addEventListener("click", add("obstacles", "disc", (x, y) => ({ disc: { x_m: x, y_m: y, radius_m: 0.02 } })));
byId("add-object").addEventListener("click", add("objects", "object", (x, y) => ({ disc: { radius_m: 0.03 }, pose: { x_m: x, y_m: y, phi_rad: 0 } })));

function buttons(list, number, moves) {
  const make = (words, label, act) => {
    const made = html("button", { type: "button", ariaLabel: label }, words);
    made.addEventListener("click", () => { remember(); act(); show(problem); });
    return made;
  };
  const swap = (other) => { [list[number], list[other]] = [list[other], list[number]]; };
  return [
    ...(moves && number > 0 ? [make("↑", "earlier", () => swap(number - 1))] : []),
    ...(moves && number < list.length - 1 ? [make("↓", "later", () => swap(number + 1))] : []),
    make("×", "remove", () => list.splice(number, 1)),
  ];
}

function showThings() {
  const item = (words, list, number, moves) => {
    const line = html("li", {}, `${words} `);
    line.append(...buttons(list, number, moves));
    return line;
  };
  const lists = ["obstacles", "objects"].map((key) => Array.isArray(problem[key]) ? problem[key] : []);
  byId("world").replaceChildren(...lists.flatMap((list, k) =>
    list.map((one, i) => item(one.name || `${["obstacle", "object"][k]} ${i + 1}`, list, i, false))));
  const tasks = problem.tasks ?? [];
  byId("tasks").replaceChildren(...tasks.map((task, i) => item([task.do, task.name, task.object].filter(Boolean).join(" "), tasks, i, true)));
}

// Runs.

byId("pace-of-run").addEventListener("input", showPace);
function showPace() { byId("pace-shown").textContent = `${pace().toFixed(0)} times as fast`; }
const pace = () => 10 ** Number(byId("pace-of-run").value);

byId("run").addEventListener("click", async () => {
  if (run) { run.stop.abort(); return; }
  run = { stop: new AbortController(), number: null };
  stopFilm();
  byId("run").textContent = "Stop";
  byId("events").replaceChildren();
  const broken = byId("broken").selectedIndex > 0 ? [Number(byId("broken").value)] : [];
  const message = { problem, plant: byId("plant").value, disturbance: byId("level").value, seed: Number(byId("seed").value), broken_heaters: broken, speed: pace() };
  try {
    for await (const record of records("/run", message, run.stop.signal)) {
      if (record.kind === "run") run.number = record.run;
      else if (record.kind === "frame") showFrame(record);
      else if (record.kind === "refused") byId("run-clock").textContent = record.message;
    }
  } catch (error) {
    if (error.name !== "AbortError") lost(true);
    else byId("run-clock").textContent += ", stopped";
  }
  run = null;
  byId("run").textContent = "Run";
});

function outline(group, pose) {
  const parts = [...pose.wheels, ...pose.units].map((points) => ["polygon", points])
    .concat([...pose.links, ...pose.segments].map((points) => ["polyline", points]));
  if (group.childElementCount !== parts.length) group.replaceChildren(...parts.map(([kind]) => element(kind)));
  parts.forEach(([, points], i) => group.children[i].setAttribute("points", points));
}

function showFrame(frame) {
  const live = byId("live");
  if (!live.children.length) live.append(element("g", { class: "true" }), element("g", { class: "seen" }));
  outline(live.children[0], frame.true);
  outline(live.children[1], frame.seen);
  if (frame.plan) {
    run.sequence = frame.plan.sequence;
    byId("way").replaceChildren(element("polyline", { points: frame.plan.path.join(" "), fill: "none" }));
  }
  const warm = frame.temperature_C.map((value, j) => `${value.toFixed(1)} °C (${(100 * frame.melt_fraction[j]).toFixed(0)} % molten)`).join(", ");
  byId("run-clock").textContent = `${seconds(frame.time_s)}: ${frame.ended ?? frame.doing}; ${warm}; plan ${run.sequence}`;
  for (const [time, kind, text] of frame.events) {
    byId("events").append(html("li", {}, `${time.toFixed(1)} s, ${kind}: ${text}`));
    byId("events").scrollTop = byId("events").scrollHeight;
  }
}

byId("live").addEventListener("pointerdown", (event) => {
  if (!run?.number) return;
  let last = at(event);
  const mine = run;
  event.target.setPointerCapture(event.pointerId);
  const drag = (one) => {
    const here = at(one);
    post("/push", { run: mine.number, x_m: here[0] - last[0], y_m: here[1] - last[1] });
    last = here;
  };
  event.target.addEventListener("pointermove", drag);
  event.target.addEventListener("pointerup", () => event.target.removeEventListener("pointermove", drag), { once: true });
});

// The map of goals.

let mapping = null;

byId("map-make").addEventListener("click", async () => {
  mapping?.abort();
  mapping = new AbortController();
  const mine = mapping, over = [byId("map-x").value, byId("map-y").value], cells = new Map(), colours = new Map();
  let ranges = null;
  byId("map").replaceChildren();
  try {
    for await (const record of records("/map", { problem, over }, mine.signal)) {
      if (record.kind === "refused") { byId("map-key").replaceChildren(html("li", {}, record.message)); return; }
      if (record.kind === "ranges") { ranges = over.map((name) => record.ranges[name]); byId("map").ranges = { over, ranges }; continue; }
      cells.set(`${record.x},${record.y}`, record);
      drawMap([...cells.values()], ranges, colours);
    }
  } catch (error) {
    if (error.name !== "AbortError") lost(true);
  }
});

function drawMap(cells, [[x0, x1], [y0, y1]], colours) {
  const side = cells.length <= 25 ? 5 : cells.length <= 81 ? 9 : 17;
  const width = 100 / side, longest = Math.max(...cells.map((cell) => cell.duration_s ?? 0));
  for (const cell of cells) if (cell.sequence && !colours.has(cell.sequence)) colours.set(cell.sequence, COLOURS[colours.size % COLOURS.length]);
  const last = cells.at(-1), px = (100 - width) * (last.x - x0) / (x1 - x0), py = (100 - width) * (y1 - last.y) / (y1 - y0);
  const shade = last.sequence ? 1 - 0.7 * last.duration_s / longest : 1;
  const words = last.sequence ? `${last.sequence}: ${seconds(last.duration_s)}` : last.status;
  const square = element("rect", { x: px, y: py, width, height: width, fill: colours.get(last.sequence) ?? "none", "fill-opacity": shade });
  square.append(element("title", {}, words));
  byId("map").append(square);
  byId("map-key").replaceChildren(...[...colours].map(([sequence, colour]) => {
    const line = html("li", {}, ""), mark = html("span");
    mark.style.background = colour;
    line.append(mark, sequence);
    return line;
  }), html("li", {}, "paler: longer; empty: no plan"));
}

byId("map").addEventListener("click", (event) => {
  const { over, ranges } = byId("map").ranges ?? {};
  if (!over) return;
  const frame = byId("map").getBoundingClientRect();
  const shares = [(event.clientX - frame.left) / frame.width, 1 - (event.clientY - frame.top) / frame.height];
  remember();
  over.forEach((name, i) => {
    const value = rounded(ranges[i][0] + shares[i] * (ranges[i][1] - ranges[i][0]));
    setValue("goal", name.startsWith("kappa") ? `kappa_per_m.${Number(name.slice(5)) - 1}` : name === "phi" ? "phi_rad" : `${name}_m`, value);
  });
  show(problem);
});

// Files, history, choices.

async function save(form) {
  const answer = await (await post("/save", { problem, form })).json();
  if (answer.kind === "refused") { showRefusal(answer); return null; }
  return answer;
}

function download({ name, text }) {
  const address = URL.createObjectURL(new Blob([text]));
  Object.assign(document.createElement("a"), { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 10000);
}

byId("save-as").addEventListener("change", async () => {
  const made = await save(byId("save-as").value);
  byId("save-as").value = "";
  if (made) download(made);
});
byId("copy").addEventListener("click", async () => {
  const made = await save("py");
  if (!made) return;
  const area = html("textarea", { value: made.text });
  document.body.append(area);
  area.select();
  byId("copy").textContent = document.execCommand("copy") ? "Copied" : "Not copied";
  area.remove();
});
byId("undo").addEventListener("click", () => travel(past, future));
byId("redo").addEventListener("click", () => travel(future, past));
addEventListener("keydown", (event) => {
  if (!(event.ctrlKey || event.metaKey) || event.target.matches("input[type=number]")) return;
  if (event.key === "z" && !event.shiftKey) travel(past, future);
  else if (event.key === "y" || (event.key.toLowerCase() === "z" && event.shiftKey)) travel(future, past);
  else return;
  event.preventDefault();
});
byId("scenario").addEventListener("change", async () => {
  const scene = await (await post("/open", { scenario: byId("scenario").value })).json();
  remember();
  box = null;
  show(scene.problem);
});
byId("planner").addEventListener("change", () => {
  remember();
  problem.planner = byId("planner").value === "greedy" ? "greedy" : "optimal";
  moved();
});
byId("gap-asked").addEventListener("change", () => { remember(); problem.gap = Number(byId("gap-asked").value) / 100; moved(); });
byId("robot-name").addEventListener("change", () => { remember(); problem.robot = byId("robot-name").value; moved(); });
byId("path-model").addEventListener("change", () => {
  remember();
  if (byId("path-model").selectedIndex > 0) moved({ path_model: byId("path-model").value });
});
byId("form").addEventListener("submit", (event) => event.preventDefault());

fill("scenario", known.scenarios.includes(known.name) ? known.scenarios : [known.name, ...known.scenarios], known.name);
fill("plant", known.plants);
fill("level", known.levels, "moderate");
showPace();
makeForms();
ask({ film: true });
