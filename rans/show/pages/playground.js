// Controls and drawing of the page; the flight itself is `Flight`.
// ?part in the address: the picture, its status and its buttons fill a frame. A fragment would scroll the page around it.
document.body.classList.toggle("part", new URLSearchParams(location.search).has("part"));
const at = id => document.getElementById(id);
const flight = new Flight(DATA.episode);
const field = at("field"), strip = at("history");
const SPAN = 25 * DATA.pace;  // seconds of the history
let running = !matchMedia("(prefers-reduced-motion: reduce)").matches;
let speed = 1, frames = [flight.pose()], clock = 0, last = 0, records = [], trail = [], dragged = "";
const DIMENSION = DATA.planar ? 2 : 3, SIZE = DATA.planar ? 3 : 7;  // of a position and of a pose
let view = {centre: [0, 0, 0], half: 3, floor: 0};
let close = false, hovered = -1;  // whether the craft fills the picture; the thruster under the pointer
const extent = () => close ? Math.min(view.half, 4 * DATA.radius) : view.half;
const eye = () => close ? frames[0] : view.centre;
let azimuth = -1.1, elevation = 0.4;  // from where a flight in space is seen, rad
const follows = !DATA.errors.some(error => error.name === "position");
const ink = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const dot = (a, b) => a.reduce((sum, x, k) => sum + x * (b[k] ?? 0), 0);
const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];
// A spacecraft far away in space is drawn larger than it is, with a radius of 12 pixels at least.
const enlarged = () => DATA.planar ? 1 : Math.max(1, 12 / (DATA.radius * scale()));
// A point of B, m, in the picture.
const drawn = (pose, point) => shown(turn(pose, point.map(u => u * enlarged())));
// A point of B, m, in W: the pose is (x, y, heading), or (x, y, z) and a quaternion (w, x, y, z).
function turn(pose, point) {
  if (DATA.planar) {
    const [x, y, angle] = pose, [u, v] = point;
    return [x + u * Math.cos(angle) - v * Math.sin(angle), y + u * Math.sin(angle) + v * Math.cos(angle)];
  }
  const [w, ...axis] = pose.slice(3), once = cross(axis, point), twice = cross(axis, once);
  return point.map((u, k) => pose[k] + u + 2 * (w * once[k] + twice[k]));
}

// A canvas as sharp as the screen; returns its pen, width and height in CSS pixels.
function ready(canvas) {
  const ratio = Math.min(devicePixelRatio || 1, 2), width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  return [pen, width, height];
}

// From W, m, to the picture and back.
const scale = () => Math.min(field.clientWidth, field.clientHeight) / (2 * extent());
// Axes of the picture in W: to the right, up, and towards the reader.
function camera() {
  if (DATA.planar) return [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
  const [c, s] = [Math.cos(azimuth), Math.sin(azimuth)], [level, height] = [Math.cos(elevation), Math.sin(elevation)];
  return [[-s, c, 0], [-height * c, -height * s, level], [level * c, level * s, height]];
}
const offset = (point, from = eye()) => {
  const away = [0, 1, 2].map(k => k < DIMENSION ? (point[k] ?? 0) - from[k] : 0);
  return camera().map(axis => dot(axis, away));
};
const shown = point => {
  const [u, v] = offset(point.slice(0, DIMENSION));
  return [field.clientWidth / 2 + u * scale(), field.clientHeight / 2 - v * scale()];
};
// A point moved within the picture by so many metres to the right and up.
const pushed = (point, u, v) => { const [right, up] = camera(); return point.map((x, k) => k < DIMENSION ? x + u * right[k] + v * up[k] : x); };
const placed = (x, y) => pushed(eye().slice(0, 3), (x - field.clientWidth / 2) / scale(), (field.clientHeight / 2 - y) / scale());

function frame() {
  const pose = flight.pose(), goal = flight.goal;
  if (follows) { view = {...view, centre: centre(pose, pose), half: 3, floor: pose[2] - 1}; return; }
  const reach = Math.max(...[pose, goal].flatMap(one => offset(one.slice(0, DIMENSION), view.centre).slice(0, 2).map(Math.abs))) + 3 * DATA.radius;
  if (reach > view.half) view.half = reach;
}
const centre = (a, b) => [0, 1, 2].map(k => k < DIMENSION ? (a[k] + b[k]) / 2 : 0);
function begin_anew() {
  const pose = flight.pose(), goal = flight.goal, start = flight.seen;
  view = {centre: centre(pose, goal), half: DATA.planar ? 1.5 : 5 * DATA.radius, floor: Math.min(pose[2], goal[2]) - 2 * DATA.radius};
  records = []; trail = [pose]; frames = [pose]; clock = 0;
  frame(); view.half *= 1.1;
  // A keep-out zone is seen as a whole.
  shapes(start.scenery, (kind, values) => {
    if (kind === "Ball") view.half = Math.max(view.half, ...offset(values.slice(0, DIMENSION), view.centre).slice(0, 2).map(x => Math.abs(x) + values[2 * DIMENSION]));
  });
  told(); draw();
}

function path(pen, points) {
  pen.beginPath();
  points.forEach(([x, y], k) => k ? pen.lineTo(x, y) : pen.moveTo(x, y));
}
function arrow(pen, from, vector, colour) {
  const a = shown(from), b = shown(vector.map((x, k) => from[k] + 2 * x));
  const angle = Math.atan2(b[1] - a[1], b[0] - a[0]);
  pen.strokeStyle = colour; pen.lineWidth = 3;
  path(pen, [a, b]); pen.stroke();
  path(pen, [-0.4, 0, 0.4].map(turned => turned ? [b[0] - 9 * Math.cos(angle + turned), b[1] - 9 * Math.sin(angle + turned)] : b));
  pen.stroke();
}
// m from line to line of the grid: 1, 2 or 5 times a power of ten, so that there are 6 to 20 lines.
function every() {
  const size = extent() / 5, decade = 10 ** Math.floor(Math.log10(size));
  return decade * [1, 2, 5, 10].find(u => u * decade >= size);
}
function floor(pen, width, height) {
  pen.strokeStyle = ink("--line"); pen.lineWidth = 1;
  pen.fillStyle = ink("--soft"); pen.font = "12px system-ui"; pen.fillText(`grid ${Number(every().toPrecision(1))} m`, 8, height - 8);
  if (DATA.planar) lines(pen, placed(0, height), placed(width, 0), every());
  else ground(pen, every());
}
// A level grid below start and goal, with plumb lines.
function ground(pen, every) {
  const under = ([x, y]) => [x, y, view.floor], reach = every * Math.ceil(1.3 * extent() / every);
  const [x, y] = eye().slice(0, 2).map(u => every * Math.round(u / every));
  for (let k = -reach; k <= reach + 1e-9; k += every) {
    path(pen, [[x + k, y - reach], [x + k, y + reach]].map(one => shown(under(one)))); pen.stroke();
    path(pen, [[x - reach, y + k], [x + reach, y + k]].map(one => shown(under(one)))); pen.stroke();
  }
  pen.strokeStyle = ink("--soft"); pen.setLineDash([2, 4]);
  for (const pose of follows ? [frames[0]] : [frames[0], flight.goal]) { path(pen, [shown(pose), shown(under(pose))]); pen.stroke(); }
  pen.setLineDash([]);
}
function lines(pen, [x0, y0], [x1, y1], every) {
  for (let x = Math.ceil(x0 / every) * every; x <= x1; x += every) { path(pen, [shown([x, y0]), shown([x, y1])]); pen.stroke(); }
  for (let y = Math.ceil(y0 / every) * every; y <= y1; y += every) { path(pen, [shown([x0, y]), shown([x1, y])]); pen.stroke(); }
}
// Calls back with the kind and the numbers of each zone, cone and slope.
function shapes(numbers, each) {
  let from = 0;
  for (const {kind, size} of DATA.scenery) { each(kind, numbers.slice(from, from + size)); from += size; }
}
function scenery(pen, numbers) {
  pen.strokeStyle = ink("--zone"); pen.fillStyle = ink("--zone"); pen.lineWidth = 2;
  shapes(numbers, (kind, values) => {
    pen.beginPath();
    if (kind === "Ball") {
      pen.arc(...shown(values), values[2 * DIMENSION] * scale(), 0, 7);
    } else if (kind === "GlideSlope") {
      const [apex, up, angle] = [values.slice(0, 3), values.slice(3, 6), values[6]];
      cone(pen, [...apex, ...up, Math.PI / 2 - angle, extent()]);
      pen.strokeStyle = ink("--good");
    } else if (!DATA.planar) {
      cone(pen, values);
      pen.strokeStyle = ink("--good");
    } else {
      const [x, y, u, v, half, length] = values, heading = Math.atan2(v, u);
      pen.moveTo(...shown([x, y]));
      pen.arc(...shown([x, y]), length * scale(), -heading - half, -heading + half);
      pen.closePath();
      pen.strokeStyle = ink("--good");
    }
    pen.globalAlpha = kind === "Ball" ? 0.2 : 0;
    pen.fill();
    pen.globalAlpha = 1;
    pen.stroke();
    pen.strokeStyle = ink("--zone");
  });
}
// Points that the mission has dealt with are green, others are rings.
function markers(pen, numbers) {
  for (let k = 0; k < numbers.length; k += DIMENSION + 1) {
    const done = numbers[k + DIMENSION];
    pen.fillStyle = pen.strokeStyle = ink(done ? "--good" : "--soft"); pen.lineWidth = 1;
    pen.beginPath(); pen.arc(...shown(numbers.slice(k, k + DIMENSION)), 2.5, 0, 7);
    if (done) pen.fill(); else pen.stroke();
  }
}
// The rim of a cone in space, and lines from its apex.
function cone(pen, [x, y, z, a, b, c, half, length]) {
  const axis = [a, b, c], side = cross(axis, Math.abs(c) < 0.9 ? [0, 0, 1] : [1, 0, 0]), size = Math.hypot(...side);
  const first = side.map(u => u / size), second = cross(axis, first);
  for (let k = 0; k <= 24; ++k) {
    const [u, v] = [Math.cos(k * Math.PI / 12), Math.sin(k * Math.PI / 12)].map(t => t * length * Math.sin(half));
    const rim = [x, y, z].map((p, n) => p + length * Math.cos(half) * axis[n] + u * first[n] + v * second[n]);
    if (k) pen.lineTo(...shown(rim)); else pen.moveTo(...shown(rim));
    if (k % 4 === 0) { pen.lineTo(...shown([x, y, z])); pen.moveTo(...shown(rim)); }
  }
}
function goal(pen) {
  const place = flight.goal, size = DATA.radius * scale();
  if (follows) {
    const pose = frames[0], v = flight.carried.slice(DATA.goal + SIZE, DATA.goal + SIZE + DIMENSION);
    arrow(pen, pose, v, ink("--good"));
    arrow(pen, pose, flight.carried.slice(SIZE, SIZE + DIMENSION), ink("--link"));
    return;
  }
  if (!DATA.planar) {
    pen.globalAlpha = 0.6; hull(pen, DATA, point => drawn(place, point), ink("--good")); pen.globalAlpha = 1;
    return;
  }
  const [x, y] = shown(place);
  pen.strokeStyle = ink("--good"); pen.fillStyle = ink("--good"); pen.lineWidth = 2;
  pen.beginPath(); pen.arc(x, y, size, 0, 7); pen.globalAlpha = 0.15; pen.fill(); pen.globalAlpha = 1;
  pen.setLineDash([6, 4]); pen.stroke(); pen.setLineDash([]);
  if (DATA.turned) {
    const tip = shown(turn(place, [1.5 * DATA.radius, 0]));
    path(pen, [[x, y], tip]); pen.stroke();
    if (DATA.moves) { pen.beginPath(); pen.arc(...tip, 6, 0, 7); pen.fill(); }
  } else {
    pen.beginPath(); pen.arc(x, y, 4, 0, 7); pen.fill();
  }
}
function craft(pen, pose) {
  const size = DATA.radius * scale() * enlarged(), place = point => drawn(pose, point);
  plumes(pen, DATA, place, flight.open, ink("--plume"), Math.max(3, size / 6));
  hull(pen, DATA, place, ink("--link"));
  pen.font = "600 11px system-ui"; pen.textAlign = "center"; pen.textBaseline = "middle";
  const places = nozzles(pose), apart = places.every(([u, v], k) => places.slice(0, k).every(([x, y]) => Math.hypot(u - x, v - y) > 13));
  places.forEach(([u, v], k) => {
    pen.fillStyle = {ok: ink("--soft"), dead: ink("--bad"), "stuck open": ink("--plume")}[flight.faults[k]];
    const marked = flight.faults[k] !== "ok" || k === hovered;
    if (marked) { pen.beginPath(); pen.arc(u, v, 8, 0, 7); pen.fill(); pen.fillStyle = ink("--page"); }
    if (marked || (apart && size > (DATA.planar ? 22 : 90))) pen.fillText(k, u, v);
  });
  pen.textAlign = "start"; pen.textBaseline = "alphabetic";
}
// Where the numbers of thrusters stand, all of them only where there is room, or else that under the pointer: inwards of the nozzle, along its force, so that two of a corner are apart.
const nozzles = pose => DATA.thrusters.map(({at: place, along}) => {
  const size = Math.hypot(...along) || 1;
  return drawn(pose, place.map((u, n) => u * 0.86 + along[n] / size * DATA.radius * 0.2));
});

function history() {
  const [pen, width, height] = ready(strip), count = DATA.thrusters.length;
  const periods = Math.round(SPAN / DATA.period), first = Math.max(0, records.length - periods), left = 92;
  const x = k => left + (k - first) / periods * (width - left - 8), split = height * 0.52, row = (height - split - 10) / count;
  const y = share => split - 8 - (Math.log10(Math.min(300, Math.max(0.1, share))) + 1) / 3.5 * (split - 14);
  pen.font = "12px system-ui"; pen.fillStyle = ink("--good"); pen.globalAlpha = 0.14;
  pen.fillRect(left, y(1), width - left - 8, split - 8 - y(1)); pen.globalAlpha = 1;
  pen.strokeStyle = ink("--good"); pen.setLineDash([4, 4]); path(pen, [[left, y(1)], [width - 8, y(1)]]); pen.stroke(); pen.setLineDash([]);
  pen.textAlign = "right"; pen.fillText("within tolerance", width - 14, y(1) + 14); pen.textAlign = "start";
  const colours = ["--link", "--plume", "--bad", "--soft"].map(ink);
  DATA.errors.forEach((error, n) => {
    if (!error.tolerance) return;
    pen.fillStyle = pen.strokeStyle = colours[n % 4]; pen.lineWidth = 2;
    pen.fillText(error.name, 8, 16 + 15 * n);
    path(pen, records.slice(first).map((record, k) => [x(first + k + 1), y(record.errors[n] / error.tolerance)])); pen.stroke();
  });
  pen.fillStyle = ink("--soft"); pen.fillText("thrusters", 8, (split + height) / 2 + 4);
  records.slice(first).forEach((record, k) => record.open.forEach((share, n) => {
    if (!share) return;
    pen.globalAlpha = Math.max(0.25, share); pen.fillStyle = ink("--plume");
    pen.fillRect(x(first + k), split + n * row, Math.max(1, x(1) - x(0)), Math.max(1, row - 1));
  }));
  pen.globalAlpha = 1; pen.strokeStyle = ink("--line"); pen.lineWidth = 1; pen.strokeRect(left, split, width - left - 8, row * count);
}

const draw = () => {
  frame();
  const [pen, width, height] = ready(field), pose = frames[0];
  floor(pen, width, height);
  scenery(pen, flight.seen.scenery);
  markers(pen, flight.seen.markers);
  pen.strokeStyle = ink("--link"); pen.globalAlpha = 0.5; pen.lineWidth = 2;
  path(pen, trail.map(shown)); pen.stroke(); pen.globalAlpha = 1;
  goal(pen);
  craft(pen, pose);
  history();
};
let told = () => {
  const {errors, reached} = flight.seen;
  const parts = [...(flight.name ? [flight.name] : []), `Start ${flight.number}`, `${flight.time.toFixed(1)} s`];
  DATA.errors.forEach(({name, factor, unit}, n) => {
    const value = factor * errors[n], far = value >= 1000 && unit.startsWith("cm");
    parts.push(`${name} ${far ? (value / 100).toFixed(1) : value.toFixed(1)} ${far ? unit.slice(1) : unit}`);
  });
  if (flight.over) parts.push({won: "mission won: restart, or take the next start", failed: "failed: go back, or restart"}[flight.over] ?? flight.over);
  else if (reached[0]) parts.push("within all tolerances");
  at("status").textContent = parts.join(" · ");
  at("pause").textContent = running ? "Pause" : "Go";
  at("valves").childNodes.forEach((button, k) => {
    const fault = flight.faults[k];
    button.dataset.fault = fault;
    button.textContent = `${k}: ${fault === "ok" ? "works" : fault === "dead" ? "dead" : "stuck"}`;
    button.setAttribute("aria-label", `Thruster ${k}: ${fault === "ok" ? "works" : fault}`);
  });
  for (const one of sliders) one.show();
};

function advance_flight() {
  frames = flight.step();
  if (flight.past.length > records.length) records.push({open: flight.open, errors: flight.seen.errors});
  trail.push(frames[frames.length - 1]);
  if (trail.length > SPAN / DATA.period) trail.shift();
  told();
}
// The left stick of a gamepad moves the goal, at its end by 1 m/s; below 0.15 it rests.
function pushed_by_stick(seconds) {
  const pad = DATA.moves && (navigator.getGamepads?.() ?? []).find(Boolean);
  const [x, y] = pad ? pad.axes.map(u => Math.abs(u) < 0.15 ? 0 : u) : [0, 0];
  if (x || y) moved(pushed(flight.goal, seconds * x, -seconds * y));
}
function tick(now) {
  const passed = Math.min(0.1, (now - last) / 1000);
  last = now;
  pushed_by_stick(passed);
  if (running && !flight.over) {
    clock += passed * speed * DATA.pace;
    // One frame of the control period after the other, then the next period.
    const each = DATA.period / DATA.checks;
    while (clock >= each) {
      clock -= each;
      if (frames.length > 1) frames.shift(); else advance_flight();
    }
    draw();
  }
  requestAnimationFrame(tick);
}

// Controls
function cycle(k) {
  flight.faults[k] = {ok: "dead", dead: "stuck open", "stuck open": "ok"}[flight.faults[k]];
  told(); draw();
}
function rewound(periods) {
  flight.rewind(periods);
  records.length = Math.min(records.length, flight.past.length);
  trail = [...flight.past.slice(-Math.round(SPAN / DATA.period)).map(one => one.carried.slice(0, SIZE)), flight.pose()];
  frames = [flight.pose()];
  told(); draw();
}
function moved(coordinates) {
  const angle = x => DATA.planar ? Math.atan2(Math.sin(x), Math.cos(x)) : x;
  flight.placeGoal(coordinates.map((x, k) => k < DIMENSION ? Math.max(-20, Math.min(20, x)) : angle(x)));
  told(); draw();
}
at("pause").onclick = () => { running = !running; told(); };
at("step").onclick = () => { running = false; advance_flight(); frames = [flight.pose()]; draw(); };
const back = 5 * DATA.pace;
at("back").textContent = `Back ${back} s`;
at("back").onclick = () => rewound(Math.max(1, Math.round(back / DATA.period)));
at("again").onclick = () => { flight.restart(); begin_anew(); };
at("next").onclick = () => { flight.restart(flight.number + 1); begin_anew(); };
at("closer").onclick = () => { close = !close; at("closer").textContent = close ? "Whole way" : "Closer"; draw(); };
at("repair").onclick = () => { flight.faults.fill("ok"); told(); draw(); };
function valves() {
  at("valves").replaceChildren(...DATA.thrusters.map((_, k) => {
    const button = document.createElement("button");
    button.type = "button";
    button.onclick = () => cycle(k);
    return button;
  }));
}
valves();

// A slider: where it stands, its label and range, how its value is read and set, and how it is written.
function slider(parent, label, [low, high, each], get, set, write) {
  const name = document.createElement("label"), input = document.createElement("input"), value = document.createElement("output");
  Object.assign(input, {type: "range", min: low, max: high, step: each, id: `slider-${label.replaceAll(" ", "-")}`});
  name.htmlFor = input.id; name.textContent = label;
  input.oninput = () => { set(Number(input.value)); told(); draw(); };
  at(parent).append(name, input, value);
  return {show: () => { input.value = get(); value.textContent = write(get()); }};
}
const sliders = [
  slider("world", "delay", [0, DATA.longest, 0.05], () => flight.delay, x => { flight.delay = x; }, x => DATA.period > 2 ? `${(x * DATA.period).toFixed(1)} s` : `${(x * DATA.period * 1000).toFixed(0)} ms`),
  slider("world", "noise", [0, 1, 0.05], () => flight.noise, x => { flight.noise = x; }, x => `${(100 * x).toFixed(0)} %`),
  slider("world", "speed", [0.25, 4, 0.25], () => speed, x => { speed = x; }, x => `${x * DATA.pace} ×`),
];
if (DATA.moves) {
  const set = (k, x) => moved(flight.goal.map((old, n) => n === k ? x : old));
  sliders.push(slider("place", "x", [-5, 5, 0.05], () => flight.goal[0], x => set(0, x), x => `${x.toFixed(2)} m`));
  sliders.push(slider("place", "y", [-5, 5, 0.05], () => flight.goal[1], x => set(1, x), x => `${x.toFixed(2)} m`));
  if (!DATA.planar) sliders.push(slider("place", "z", [-5, 5, 0.05], () => flight.goal[2], x => set(2, x), x => `${x.toFixed(2)} m`));
  if (DATA.turned && !DATA.planar) ["roll", "pitch", "yaw"].forEach((name, k) => {
    const set = x => moved([...flight.goal.slice(0, 3), ...quaternion(angles(flight.goal.slice(3)).map((old, n) => n === k ? x * Math.PI / 180 : old))]);
    const most = name === "pitch" ? 85 : 180;
    sliders.push(slider("place", name, [-most, most, 5], () => angles(flight.goal.slice(3))[k] * 180 / Math.PI, set, x => `${x.toFixed(0)}°`));
  });
  if (DATA.turned && DATA.planar) {
    const degrees = () => flight.goal[2] * 180 / Math.PI;
    sliders.push(slider("place", "heading", [-180, 180, 5], degrees, x => set(2, x * Math.PI / 180), x => `${x.toFixed(0)}°`));
  }
} else {
  at("goals").hidden = true;
  at("lead").textContent = at("lead").textContent.replace("Drag the goal, or click", "Click");
}

const NAMES = {Ball: "The red zone is forbidden.", Cone: "The green cone is the way in.", GlideSlope: "The green cone is the glide slope, below which the craft must not fly."};
for (const text of new Set(DATA.scenery.map(({kind}) => NAMES[kind]))) at("lead").append(` ${text}`);
if (flight.seen.markers.length) at("lead").append(" Points turn green once they have been seen in sunlight.");
if (!DATA.planar) {
  at("lead").append(" Drag the background to turn the view.");
  field.setAttribute("aria-label", "The spacecraft and its goal in space. Arrow keys move the goal; with Shift they turn the view.");
}
// Roll, pitch and yaw (about x, y and z of B in reverse order) of a quaternion (w, x, y, z), rad, and back.
function angles([w, x, y, z]) {
  return [Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)), Math.asin(Math.max(-1, Math.min(1, 2 * (w * y - z * x)))),
    Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))];
}
function quaternion([roll, pitch, yaw]) {
  const [a, b, c] = [roll, pitch, yaw].map(x => Math.cos(x / 2)), [d, e, f] = [roll, pitch, yaw].map(x => Math.sin(x / 2));
  return [a * b * c + d * e * f, d * b * c - a * e * f, a * e * c + d * b * f, a * b * f - d * e * c];
}

// Pointer: a thruster, the goal's heading, or the goal.
function hit(x, y) {
  const near = ([u, v], reach) => Math.hypot(u - x, v - y) < reach;
  const found = nozzles(frames[0]).map((place, k) => [Math.hypot(place[0] - x, place[1] - y), k]).sort((a, b) => a[0] - b[0])[0];
  if (found && found[0] < 13) return found[1];
  const elsewhere = DATA.planar ? "" : "view";
  if (!DATA.moves) return elsewhere;
  if (DATA.turned && DATA.planar && near(shown(turn(flight.goal, [1.5 * DATA.radius, 0])), 16)) return "heading";
  return near(shown(flight.goal), Math.max(DATA.radius * scale(), 22)) ? "goal" : elsewhere;
}
const inside = event => { const box = field.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
field.onpointerdown = event => {
  const found = hit(...inside(event));
  if (typeof found === "number") cycle(found);
  else if (found) { dragged = found; field.setPointerCapture(event.pointerId); }
};
field.onpointermove = event => {
  const [x, y] = inside(event);
  if (!dragged) {
    const found = hit(x, y), before = hovered;
    field.style.cursor = found === "" ? "default" : "pointer";
    hovered = typeof found === "number" ? found : -1;
    if (hovered !== before) draw();
    return;
  }
  const now = flight.goal, [a, b] = shown(now), [u, v] = [(x - a) / scale(), (b - y) / scale()];
  if (dragged === "view") looked(event.movementX / 120, event.movementY / 120);
  else if (dragged === "goal") moved(pushed(now, u, v));
  else moved([now[0], now[1], Math.atan2(v, u)]);
};
function looked(aside, up) {
  azimuth -= aside;
  elevation = Math.max(-1.5, Math.min(1.5, elevation + up));
  draw();
}
field.onpointerleave = () => { hovered = -1; draw(); };
field.onpointerup = field.onpointercancel = () => { dragged = ""; };
// A finger on the goal drags it; elsewhere it scrolls the page.
field.addEventListener("touchstart", event => {
  const touch = event.touches[0];
  if (hit(...inside(touch)) !== "") event.preventDefault();
}, {passive: false});
addEventListener("keydown", event => {
  if (event.key === " " && !["BUTTON", "INPUT"].includes(event.target.tagName)) { event.preventDefault(); at("pause").click(); }
  const way = {ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1]}[event.key];
  if (!way || event.target !== field || !(DATA.moves || !DATA.planar)) return;
  event.preventDefault();
  if (event.shiftKey && !DATA.planar) looked(way[0], way[1]);
  else if (DATA.moves) moved(pushed(flight.goal, ...way));
});
addEventListener("resize", draw);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
begin_anew();
requestAnimationFrame(now => { last = now; tick(now); });
