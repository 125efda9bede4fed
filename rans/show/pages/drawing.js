// The drawing of a craft: what a visitor changes is flown at once. Lengths in m, forces in N, angles in rad.
const plan = at("plan"), HANDLE = 40, NEAR = 16;  // pixels: length of a force, reach of a pointer
let design = clone(DATA.drawing.craft), selected = 0, held = "", tapped = null, half = 0.5;
const chosen = () => design.thrusters[selected];
const planScale = () => plan.clientWidth / (2 * half);
const onPlan = ([x, y]) => [plan.clientWidth / 2 + x * planScale(), plan.clientHeight / 2 - y * planScale()];
const offPlan = ([u, v]) => [(u - plan.clientWidth / 2) / planScale(), (plan.clientHeight / 2 - v) / planScale()];
const tipOf = thruster => { const [u, v] = onPlan(thruster.at); return [u + HANDLE * Math.cos(thruster.angle), v - HANDLE * Math.sin(thruster.angle)]; };
// Flies the craft as it now stands, and says what the agent can do with it.
function redesigned() {
  const before = DATA.thrusters.length, period = DATA.period;
  use(design);
  if (DATA.thrusters.length !== before) {
    flight.refit();
    for (const record of records) record.open = [];
    valves();
  }
  // Frames of the period under way are those of the craft before.
  if (DATA.period !== period) frames = [flight.pose()];
  judged();
  told(); draw();
}
function judged() {
  const {kind, text} = verdict(design);
  Object.assign(at("authority"), {textContent: text}).dataset.kind = kind;
  at("toml").textContent = toml(design);
}

function drawPlan() {
  const [pen, width, height] = ready(plan), reach = Math.max(...design.thrusters.map(({at: place}) => Math.hypot(...place)), 0.15);
  if (!held) half = 1.9 * reach;
  const largest = Math.max(...design.thrusters.map(({force}) => force), 1e-9);
  // A grid of 10 cm, axes of B, and the craft.
  pen.strokeStyle = ink("--line"); pen.lineWidth = 1;
  const step = half > 4 ? 1 : half > 1.5 ? 0.5 : 0.1;
  for (let k = -Math.floor(half / step); k <= half / step; ++k) {
    const [u, v] = onPlan([k * step, k * step]);
    path(pen, [[u, 0], [u, height]]); pen.stroke();
    path(pen, [[0, v], [width, v]]); pen.stroke();
  }
  hull(pen, DATA, onPlan, ink("--link"));
  pen.font = "12px system-ui"; pen.fillText("x", onPlan([1.05 * DATA.radius, 0])[0], onPlan([0, 0])[1] + 4);
  design.thrusters.forEach((thruster, k) => {
    const [u, v] = onPlan(thruster.at), [x, y] = tipOf(thruster), active = k === selected;
    const size = 0.4 + 0.6 * thruster.force / largest;
    // The plume, opposite to the force.
    const share = flight.open[k] ?? 0, back = [u - (x - u) * 0.55 * size, v - (y - v) * 0.55 * size], aside = [(y - v) * 0.16 * size, -(x - u) * 0.16 * size];
    pen.fillStyle = ink("--plume"); pen.globalAlpha = 0.18 + 0.7 * share;
    path(pen, [[u, v], [back[0] + aside[0], back[1] + aside[1]], [back[0] - aside[0], back[1] - aside[1]]]); pen.fill(); pen.globalAlpha = 1;
    pen.strokeStyle = pen.fillStyle = ink(active ? "--good" : "--soft"); pen.lineWidth = active ? 3 : 2;
    path(pen, [[u, v], [x, y]]); pen.stroke();
    pen.beginPath(); pen.arc(u, v, active ? 6 : 4, 0, 7); pen.fill();
    pen.beginPath(); pen.arc(x, y, active ? 9 : 8, 0, 7); pen.fill();
    pen.fillStyle = ink("--page"); pen.font = "600 11px system-ui"; pen.textAlign = "center"; pen.textBaseline = "middle"; pen.fillText(k, x, y + 0.5);
    pen.textAlign = "start"; pen.textBaseline = "alphabetic";
  });
}
// Drawn with the flight, so that open thrusters show.
const drawFlight = draw;
draw = () => { drawFlight(); drawPlan(); };
const toldFlight = told;
told = () => { toldFlight(); for (const field of fields) field.show(); };

// Changes
function add(place) {
  if (design.thrusters.length >= DATA.drawing.most) return;
  const [x, y] = place, force = chosen()?.force ?? 1;
  // Its force points inwards along the nearer axis.
  const angle = Math.abs(x) >= Math.abs(y) ? (x > 0 ? Math.PI : 0) : (y > 0 ? -Math.PI / 2 : Math.PI / 2);
  selected = design.thrusters.push({at: [rounded(x), rounded(y)], angle, force}) - 1;
  redesigned();
}
function remove() {
  if (!chosen()) return;
  design.thrusters.splice(selected, 1);
  selected = Math.max(0, Math.min(selected, design.thrusters.length - 1));
  redesigned();
}
const rounded = x => Math.round(Math.max(-5, Math.min(5, x)) * 100) / 100;
const whole = angle => { const step = Math.PI / 36, near = Math.round(angle / step) * step; return Math.atan2(Math.sin(near), Math.cos(near)); };
function change(values) { if (chosen()) { Object.assign(chosen(), values); redesigned(); } }
at("add").onclick = () => add([0.7 * DATA.radius, 0.7 * DATA.radius]);
at("remove").onclick = remove;
at("other").onclick = () => { selected = (selected + 1) % Math.max(1, design.thrusters.length); told(); draw(); };
at("original").onclick = () => { design = clone(DATA.drawing.craft); selected = 0; redesigned(); };

// A number that is typed; what is no number, or not above the least, changes nothing.
function typed(label, get, set, least = -Infinity) {
  const name = document.createElement("label"), input = document.createElement("input");
  Object.assign(input, {type: "number", step: "any", inputMode: "decimal"});
  name.append(label, input);
  input.oninput = () => { const x = input.valueAsNumber; if (Number.isFinite(x) && x > least) set(x); };
  input.onchange = () => { input.value = ""; told(); };
  at("figures").append(name);
  return {show: () => { if (document.activeElement !== input) { const x = get(); input.value = x === undefined ? "" : Number(x.toPrecision(6)); } }};
}
const degree = Math.PI / 180;
const fields = [
  typed("mass, kg", () => design.mass, x => { design.mass = x; redesigned(); }, 0),
  typed("inertia, kg m²", () => design.inertia, x => { design.inertia = x; redesigned(); }, 0),
  typed("x, m", () => chosen()?.at[0], x => change({at: [x, chosen().at[1]]})),
  typed("y, m", () => chosen()?.at[1], x => change({at: [chosen().at[0], x]})),
  typed("direction, °", () => chosen() && chosen().angle / degree, x => change({angle: x * degree})),
  typed("force, N", () => chosen()?.force, x => change({force: x}), 0),
];

// Pointer: the tip of a force turns it, a thruster is dragged, and elsewhere a click adds one.
const pointed = event => { const box = plan.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
function under([u, v]) {
  const away = ([x, y]) => Math.hypot(x - u, y - v);
  const near = (place, part) => design.thrusters.map((thruster, k) => ({part, k, far: away(place(thruster)) - (k === selected ? 2 : 0)}));
  const [best] = [...near(({at: place}) => onPlan(place), "at"), ...near(tipOf, "angle")].sort((a, b) => a.far - b.far);
  return best && best.far < NEAR ? best : null;
}
plan.onpointerdown = event => {
  const best = under(pointed(event));
  if (!best) { tapped = pointed(event); return; }
  selected = best.k; held = best.part;
  plan.setPointerCapture(event.pointerId);
  told(); draw();
};
plan.onpointermove = event => {
  const spot = pointed(event);
  if (!held) { plan.style.cursor = under(spot) ? "grab" : "copy"; return; }
  if (!chosen()) return;
  const [x, y] = offPlan(spot), [a, b] = chosen().at;
  if (held === "at") change({at: [rounded(x), rounded(y)]});
  else change({angle: whole(Math.atan2(y - b, x - a))});
};
plan.onpointerup = event => {
  const [u, v] = pointed(event);
  if (tapped && Math.hypot(tapped[0] - u, tapped[1] - v) < 8) add(offPlan([u, v]));
  held = ""; tapped = null; draw();
};
plan.onpointercancel = () => { held = ""; tapped = null; draw(); };
plan.onkeydown = event => {
  const way = {ArrowLeft: [-0.01, 0], ArrowRight: [0.01, 0], ArrowUp: [0, 0.01], ArrowDown: [0, -0.01]}[event.key];
  if (event.key === "Delete" || event.key === "Backspace") { event.preventDefault(); remove(); }
  if (!way || !chosen()) return;
  event.preventDefault();
  const [x, y] = chosen().at;
  if (event.shiftKey) change({angle: whole(chosen().angle + (way[0] - way[1] < 0 ? 5 : -5) * degree)});
  else change({at: [rounded(x + way[0]), rounded(y + way[1])]});
};
// A finger on a thruster drags it; elsewhere it scrolls the page.
plan.addEventListener("touchstart", event => { if (under(pointed(event.touches[0]))) event.preventDefault(); }, {passive: false});
at("copy").onclick = async () => { await navigator.clipboard.writeText(toml(design)); at("copy").textContent = "Copied"; };
at("lead").textContent = "The agent flies in this page, and any craft that you draw: it was trained on random layouts of thrusters. Drag the goal, or click a thruster to make it fail.";
judged(); told(); draw();
