// A planar craft with on/off thrusters that a visitor may change. Places are in B, about the centre of mass.
const sums = (thrusters, share) => thrusters.reduce((sum, {at: [x, y], force, angle}, k) => {
  const [u, v] = [force * Math.cos(angle) * share(k), force * Math.sin(angle) * share(k)];
  return [sum[0] + u, sum[1] + v, sum[2] + x * v - y * u];
}, [0, 0, 0]);
const accelerations = ({mass, inertia, thrusters}) => thrusters.map((_, k) => {
  const [x, y, turn] = sums(thrusters, n => n === k ? 1 : 0);
  return [x / mass, y / mass, turn / inertia];
});
const WAYS = ["along +x", "along −x", "along +y", "along −y", "about +z", "about −z"];
const clone = craft => ({...craft, thrusters: craft.thrusters.map(thruster => ({...thruster, at: [...thruster.at]}))});

// What the agent is told of a craft, and what is wrong with it: {columns, ways, period, missing, outside}.
function assessed(craft) {
  const columns = accelerations(craft), ways = balanced(columns, craft.shared);
  const missing = ways.findIndex(way => !(way > 0));
  const [, long, short] = DATA.drawing.timings;
  const period = Math.min(ways[4], ways[5]) * long.period <= DATA.drawing.turn ? long.period : short.period;
  const numbers = [period, Math.min(...ways.slice(0, 4)), Math.min(...ways.slice(4)), margin(columns)];
  const outside = DATA.drawing.ranges.map((range, k) => ({...range, number: numbers[k]}))
    .filter(({low, high, number}) => number < low * (1 - 1e-3) || (high !== null && number > high * (1 + 1e-3)));
  return {columns, ways, period, numbers, missing: missing < 0 ? "" : WAYS[missing], outside};
}

const number = x => x === 0 ? "0" : Math.abs(x) >= 100 || Math.abs(x) < 0.001 ? x.toExponential(2) : String(Number(x.toPrecision(3)));

// What the agent can do with a craft, in words: {kind, text}.
function verdict(craft) {
  const {columns, numbers: [period, a, alpha, least], missing, outside} = assessed(craft);
  if (columns.every(([, , turn]) => Math.abs(turn) < 1e-9)) {
    return {kind: "bad", text: "All of these thrusters push through the centre of mass, so that the craft cannot turn. " +
      "No agent can steer it to a pose."};
  }
  if (missing) {
    return {kind: "bad", text: `These thrusters cannot accelerate the craft ${missing} without turning it or pushing it another way. ` +
      "No agent can steer it: it drifts."};
  }
  if (!outside.length) {
    return {kind: "ok", text: `Authority: ${number(a)} m/s² and ${number(alpha)} rad/s² at least; margin ${number(least)}; ` +
      `control period ${period} s. Within the ranges of the training.`};
  }
  const said = outside.map(({name, number: x, unit, low, high}) =>
    `The ${name} is ${number(x)}${unit && ` ${unit.replace("^2", "²")}`}; the agent was trained ${high === null ? `above ${low}` : `from ${low} to ${high}`}.`);
  return {kind: "outside", text: `Outside of the training. ${said.join(" ")} It may not reach its goals.`};
}
// The craft as the file of a spacecraft.
function toml({mass, inertia, shared, thrusters}) {
  const decimal = x => { const text = String(x); return /[.e]/.test(text) ? text : `${text}.0`; };
  const lines = ['name = "drawn"', "dimension = 2", `mass = ${decimal(mass)}`, `inertia = ${decimal(inertia)}`];
  if (shared) lines.push('thrust_sharing = "split"');
  for (const {at: [x, y], angle, force} of thrusters) {
    lines.push("", "[[thruster]]", `position = [${decimal(x)}, ${decimal(y)}]`, `direction = [${decimal(Math.cos(angle))}, ${decimal(Math.sin(angle))}]`, `force = ${decimal(force)}`);
  }
  return lines.join("\n");
}

let drawn_craft = clone(DATA.drawing.craft), push = PUSHES[0];
// Flies this craft from now on. One that cannot be pushed every way drifts, because the agent cannot steer it.
function use(craft) {
  const {columns, ways, period, missing} = assessed(craft);
  drawn_craft = clone(craft);
  const chosen = DATA.drawing.timings.findIndex(timing => timing.period === period);  // the page's own comes first
  push = PUSHES[chosen];
  Object.assign(DATA, DATA.drawing.timings[chosen]);
  DATA.commands = craft.thrusters.length;
  const largest = Math.max(0, ...craft.thrusters.map(({force}) => force)) || 1;
  DATA.thrusters = craft.thrusters.map(({at, force, angle}) => ({at: [...at, 0], along: [force / largest * Math.cos(angle), force / largest * Math.sin(angle), 0]}));
  DATA.radius = Math.max(0.1, ...craft.thrusters.map(({at}) => Math.hypot(...at)));
  if (missing) {
    tokens = null;
    allocated = () => craft.thrusters.map(() => 0);
    authority = DATA.allocation.authority;
    return;
  }
  const [a, alpha] = [Math.min(...ways.slice(0, 4)), Math.min(...ways.slice(4))];
  authority = [period, ...ways, a, alpha, ...pushesAlong(columns, craft.shared, DATA.allocation.ways)];
  const units = [a, a, alpha];
  tokens = columns.map(column => [...column.map((x, axis) => x / units[axis]), craft.shared ? SHARED : ON_OFF]);
  allocated = allocation(tokens);
}
function advance(carried, command, gain, leak) {
  const open = command.map((x, k) => gain[k] * x + leak[k]), total = open.reduce((sum, x) => sum + x, 0);
  const supply = drawn_craft.shared ? Math.max(1, total) : 1;
  return push(carried, sums(drawn_craft.thrusters, k => open[k] / supply), [drawn_craft.mass, drawn_craft.inertia]);
}
