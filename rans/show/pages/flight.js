// One flight, driven by the printed functions: its goal, thrusters, sensors and delay may change while it lasts.
const LAYERS = Object.fromEntries(Object.entries(WEIGHTS).map(([name, layer]) => {
  const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer;
  return [name, {weights: new ({8: Int8Array, 16: Int16Array, 32: Int32Array}[DATA.bits])(bytes(layer.weights)), scales: new Float32Array(bytes(layer.scales)),
    biases: new Float32Array(bytes(layer.biases))}];
}));

function dense(name, activation, x) {
  const {weights, scales, biases} = LAYERS[name], f = ACTIVATIONS[activation], width = x.length;
  return Array.from(biases, (bias, i) => {
    let sum = 0;
    for (let k = 0; k < width; ++k) sum += weights[i * width + k] * x[k];
    return f(bias + scales[i] * sum);
  });
}

class Flight {
  constructor(number) {
    this.delay = DATA.delay;  // control periods from a decision until thrusters obey; may be a fraction
    this.noise = 0;  // share of the full noise of the sensors
    this.faults = DATA.thrusters.map(() => "ok");  // or "dead", or "stuck open"
    this.restart(number);
  }

  restart(number = this.number) {
    this.number = number;
    this.carried = begin([...DATA.words, number]).carried;
    this.memory = new Array(DATA.memory).fill(0);
    this.waiting = [];
    this.command = new Array(DATA.commands).fill(0);
    this.over = "";
    this.past = [];
    this.time = 0;
  }
  get seen() { return describe(this.carried); }
  pose(offset = 0) { return this.carried.slice(offset, offset + (DATA.planar ? 3 : 7)); }
  get goal() { return this.pose(DATA.goal); }

  placeGoal(coordinates) {
    this.carried = this.carried.map((x, k) => coordinates[k - DATA.goal] ?? x);
  }

  // The share of its force that each thruster gives.
  get open() {
    return this.faults.map((fault, k) => ({ok: Math.max(0, this.command[k]), dead: 0, "stuck open": 1})[fault]);
  }

  // Flies one control period and returns the poses within it; nothing moves once the flight is over.
  step() {
    if (this.over) return [this.pose()];
    const {carried, memory, waiting, command, over, time} = this;
    this.past.push({carried, memory, waiting: [...waiting], command, over, time});
    this.time = time + DATA.period;
    const answer = act(carried, DATA.noise.map(scale => this.noise * scale * normal()), memory);
    this.memory = answer.memory;
    // Of a period that begins with an older command, the mean: the impulse is the same, its instant is not.
    const whole = Math.floor(this.delay), share = this.delay - whole;
    this.waiting = [...waiting, answer.command].slice(-DATA.longest - 2);
    const before = periods => this.waiting.at(-1 - periods) ?? new Array(DATA.commands).fill(0);
    this.command = before(whole).map((x, k) => (1 - share) * x + share * before(whole + 1)[k]);
    const after = advance(carried, this.command, this.faults.map(fault => fault === "ok" ? 1 : 0),
      this.faults.map(fault => fault === "stuck open" ? 1 : 0));
    this.carried = after.carried;
    this.over = after.over[1] ? "won" : after.over[0] ? "failed" : "";
    const size = after.poses.length / DATA.checks;
    return Array.from({length: DATA.checks}, (_, k) => after.poses.slice(k * size, (k + 1) * size));
  }

  rewind(periods) {
    if (!this.past.length) return;
    const [then] = this.past.splice(Math.max(0, this.past.length - periods));
    Object.assign(this, then);
  }
}

// A standard normal number (Box and Muller, 1958).
function normal() {
  return Math.sqrt(-2 * Math.log(1 - Math.random())) * Math.cos(2 * Math.PI * Math.random());
}
