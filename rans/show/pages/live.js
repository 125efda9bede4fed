// One flight that `rans view --play` steps on this computer: the same controls as where physics and policy are JavaScript.
class Flight {
  constructor(number) {
    this.delay = DATA.delay;  // control periods from a decision until thrusters obey; may be a fraction
    this.noise = 0;  // share of the full noise of the sensors
    this.faults = DATA.thrusters.map(() => "ok");  // or "dead", or "stuck open"
    this.restart(number);
  }

  // Does what is asked for, with the controls as they are; everything of the flight is as the answer says.
  ask(what, value = null) {
    const request = new XMLHttpRequest(), {delay, noise, faults} = this;
    request.open("POST", "flight", false);
    request.setRequestHeader("Content-Type", "application/json");
    try {
      request.send(JSON.stringify({what, value, delay, noise, faults}));
      Object.assign(this, JSON.parse(request.responseText));
    } catch {
      this.over = "rans view has ended";
    }
  }

  restart(number = this.number) { this.past = []; this.ask("restart", number); }
  pose(offset = 0) { return this.carried.slice(offset, offset + (DATA.planar ? 3 : 7)); }
  get goal() { return this.pose(DATA.goal); }
  placeGoal(coordinates) { this.ask("goal", coordinates); }
  follow() { this.ask("next"); }

  // The share of its force that each thruster gives.
  get open() {
    return this.faults.map((fault, k) => ({ok: Math.max(0, this.command[k]), dead: 0, "stuck open": 1})[fault]);
  }

  // Flies one control period and returns the poses within it; nothing moves once the flight is over.
  step() {
    if (this.over) return [this.pose()];
    this.past.push({carried: this.carried});
    this.ask("step");
    return this.poses;
  }

  rewind(periods) {
    this.past.splice(Math.max(0, this.past.length - periods));
    this.ask("rewind", periods);
  }
}
