// Authority and control allocation of planar thrusters: rans.policy.allocation and rans.policy.allocated, number by number.
const ON_OFF = 0, SHARED = 1, CONTINUOUS = 2, WHEEL = 3;  // kinds of effectors, the last number of a token

// What facets of the changes by thrusters bound: a change c of length in a way of a facet reaches it at support / (way c).
function facets(columns, shared) {
  const size = [0, 1, 2].map(k => Math.max(0, ...columns.map(column => Math.abs(column[k]))));
  if (!size.every(x => x > 0)) return [];
  const scaled = columns.map(column => column.map((x, k) => x / size[k]));
  const corners = [[0, 0, 0], ...scaled];
  const edges = shared ? corners.flatMap(a => corners.map(b => a.map((x, k) => x - b[k]))) : scaled;
  return normals(edges).map(normal => {
    const along = scaled.map(column => Math.max(0, product(normal, column)));
    const support = shared ? Math.max(0, ...along) : along.reduce((sum, x) => sum + x, 0);
    return {way: normal.map((x, k) => x / size[k]), support};
  });
}
// How far the changes reach where their facets are so far ahead; 0 where they have none.
function leastReach(found, ahead) {
  const least = Math.min(...found.map((facet, k) => ahead[k] > 1e-9 ? facet.support / ahead[k] : Infinity));
  return Number.isFinite(least) ? Math.max(0, least) : 0;
}
// Largest changes in all directions within 45 degrees of +x, -x, +y, -y, and of +turn and -turn, all other axes being balanced.
// 0: the axis cannot be pushed alone.
function balanced(columns, shared) {
  const found = facets(columns, shared);
  return [0, 1, 2].flatMap(axis => [1, -1].map(sign => leastReach(found, found.map(({way}) => {
    // A facet is first reached along the direction of the cone that is nearest to its normal.
    const ahead = sign * way[axis], aside = axis < 2 ? Math.abs(way[1 - axis]) : 0;
    return ahead >= aside ? Math.hypot(ahead, aside) : axis < 2 ? (ahead + aside) / Math.SQRT2 : ahead;
  }))));
}
// Largest pushes along unit vectors [x, y], without turning.
function pushesAlong(columns, shared, ways) {
  const found = facets(columns, shared);
  return ways.map(([x, y]) => leastReach(found, found.map(({way}) => way[0] * x + way[1] * y)));
}
// Least support of the twists over all directions, without units: rans.randomization.layouts.authority_margin.
function margin(columns) {
  const count = Math.max(1, columns.length);
  const force = columns.reduce((sum, [x, y]) => sum + Math.hypot(x, y), 0) / count;
  const torque = Math.sqrt(columns.reduce((sum, column) => sum + column[2] ** 2, 0) / count);
  if (!(force > 0 && torque > 0)) return 0;
  const scaled = columns.map(([x, y, turn]) => [x / force, y / force, turn / torque]);
  const supports = normals(scaled).map(normal => scaled.reduce((sum, column) => sum + Math.max(0, product(normal, column)), 0));
  return supports.length ? Math.min(...supports) : 0;
}
// Unit normals, both ways, of the planes along two of these edges.
function normals(edges) {
  const found = [];
  edges.forEach(([a, b, c], k) => edges.slice(k + 1).forEach(([x, y, z]) => {
    const normal = [b * z - c * y, c * x - a * z, a * y - b * x], length = Math.hypot(...normal);
    if (length > 1e-9) found.push(normal.map(u => u / length), normal.map(u => -u / length));
  }));
  return found;
}
const product = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

// The choice of fast to frugal, and its price of thrust.
let frugal = DATA.allocation.chosen, price = DATA.allocation.prices[frugal];

// The order in which a layout is the same however its thrusters are numbered.
const inOrder = columns => columns.map((_, k) => k).sort((k, n) => {
  const axis = [0, 1, 2].find(i => columns[k][i] !== columns[n][i]);
  return axis === undefined ? 0 : columns[k][axis] - columns[n][axis];
});

// Useful ways to open on/off thrusters: which are open, what they change, their thrust, the linear function of a demand, and what it loses far from the goal.
function subsets(columns, shared) {
  const order = inOrder(columns), count = columns.length;
  // The price of thrust falls with an authority margin below 1.
  const falling = price * Math.min(1, margin(order.map(k => columns[k]))) ** DATA.allocation.fall;
  let most = count;
  const fewer = limit => { let sum = 0, ways = 1; for (let k = 0; k <= limit; ++k) { sum += ways; ways = ways * (count - k) / (k + 1); } return sum; };
  while (fewer(most) > DATA.allocation.subsets) --most;
  const rows = [];
  for (let mask = 0; mask < 2 ** count; ++mask) {
    const opened = order.map((_, n) => mask >> n & 1), number = opened.reduce((sum, x) => sum + x, 0);
    if (number > most) continue;
    const twist = [0, 0, 0];
    let thrust = 0;
    order.forEach((k, n) => {
      const part = shared ? opened[n] / Math.max(number, 1) : opened[n];
      columns[k].forEach((x, axis) => { twist[axis] += part * x; });
      thrust += part * Math.hypot(columns[k][0], columns[k][1]);
    });
    rows.push({opened, twist, thrust});
  }
  // Of equal twists the cheapest, which comes first.
  const first = new Map();
  rows.map((_, n) => n).sort((k, n) => rows[k].thrust - rows[n].thrust || k - n).forEach(n => {
    const name = rows[n].twist.map(x => Math.round(x / 1e-6) + 0).join();
    if (!first.has(name)) first.set(name, n);
  });
  return [...first.values()].sort((k, n) => k - n).map(n => {
    const {opened, twist, thrust} = rows[n], placed = new Array(count).fill(0);
    order.forEach((k, place) => { placed[k] = opened[place]; });
    return {opened: placed, twist, offset: -product(twist, twist) - falling * thrust, thrust, dearer: (DATA.allocation.away[frugal] - 1) * falling * thrust};
  });
}

// Shares of continuous thrusters by coordinate descent, and what is left of the demand.
function shares(demand, columns) {
  const order = inOrder(columns), share = columns.map(() => 0);
  let left = [...demand];
  for (let pass = 0; pass < DATA.allocation.passes; ++pass) for (const k of order) {
    const column = columns[k], square = product(column, column);
    if (!square) continue;
    const step = column.reduce((sum, x, axis) => sum + x / square * left[axis], 0) - 0.5 * price * Math.hypot(column[0], column[1]) / square;
    const after = Math.min(1, Math.max(0, share[k] + step)), change = after - share[k];
    left = left.map((e, axis) => e - column[axis] * change);
    share[k] = after;
  }
  return {share, left};
}

// Thrusters that hold a pose: shut ones, or the pulse of least thrust for each period inside the tolerances; undefined: they are the network's.
// rans.policy.holding, number by number.
function holding([x, y, vx, vy, turn, spin], pulses) {
  const {kept, periods, seconds, least, none, ...size} = DATA.allocation.hold, [period] = authority, ahead = Math.max(periods, seconds / period), units = [7, 8].map(k => authority[k] * period ** 2);
  const radius = size.distance / units[0], angle = size.angle / units[1];
  [x, y, turn] = [x / units[0], y / units[0], turn / units[1]];
  const inside = (x, y, turn, part) => x * x + y * y < (part * radius) ** 2 && Math.abs(turn) < part * angle;
  if (!inside(x, y, turn, 1)) return undefined;
  if (inside(x - ahead * vx, y - ahead * vy, turn - ahead * spin, kept)) return pulses[0].opened.map(() => 0);
  const cheapest = Math.min(...pulses.map(pulse => pulse.thrust));
  let best, most = none;
  for (const {opened, twist: [pushX, pushY, kick], thrust} of pulses) {
    const [px, py, pt] = [x - vx - 0.5 * pushX, y - vy - 0.5 * pushY, turn - spin - 0.5 * kick], [sx, sy, w] = [vx + pushX, vy + pushY, spin + kick];
    if (!inside(px, py, pt, kept)) continue;
    const square = sx * sx + sy * sy + 1e-6, along = px * sx + py * sy;
    const leaves = (along + Math.sqrt(Math.max(0, along * along - square * (px * px + py * py - (kept * radius) ** 2)))) / square;
    const time = Math.min(leaves, (kept * angle + (w < 0 ? -pt : pt)) / (Math.abs(w) + 1e-4)), value = -thrust / cheapest / Math.max(time - 1, least - 1);
    if (time > least && value > most) [best, most] = [opened, value];
  }
  return best;
}

// Commands, 0 to 1, for a demand: a function made once for the tokens of a craft. Wheels, which come last, turn by what thrusters leave.
function allocation(tokens) {
  const columns = kinds => tokens.filter(token => kinds.includes(token[3])).map(token => token.slice(0, 3));
  const switched = columns([ON_OFF, SHARED]), throttled = columns([CONTINUOUS]), torques = columns([WHEEL]).map(column => column[2]);
  const table = subsets(switched, tokens.length > 0 && tokens[0][3] === SHARED), total = torques.reduce((sum, x) => sum + Math.abs(x), 0);
  const pulses = tokens.every(token => token[3] === ON_OFF || token[3] === SHARED) ? table.filter(({opened}) => opened.some(x => x) && opened.filter(x => x).length <= DATA.allocation.hold.open) : [];
  return ({demand, away = [0], pose}) => {
    const pulse = pose && pulses.length ? holding(pose, pulses) : undefined;
    if (pulse) return pulse;
    let best = table[0], most = -Infinity;
    for (const row of table) {
      const value = 2 * product(demand, row.twist) + row.offset - away[0] * row.dearer;
      if (value > most) [best, most] = [row, value];
    }
    const {share, left} = shares(demand.map((x, axis) => x - best.twist[axis]), throttled);
    const wheels = torques.map(torque => Math.min(1, Math.max(0, left[2] * 0.5 * Math.sign(torque) / total + 0.5)));
    return [...best.opened, ...share, ...wheels];
  };
}
let allocated = allocation(DATA.allocation.tokens), authority = DATA.allocation.authority, tokens = DATA.allocation.tokens;
const demands = typeof demand1 === "undefined" ? [demand0] : [demand0, demand1, demand2];
// Fast to frugal: what the network is given, and the price of thrust. A craft that cannot be steered has no tokens.
function save(number) {
  frugal = number;
  price = DATA.allocation.prices[number];
  if (tokens) allocated = allocation(tokens);
}
function act(carried, errors, memory) {
  return {command: in_ranges(allocated(demands[frugal](carried, errors, authority))).command, memory};
}
