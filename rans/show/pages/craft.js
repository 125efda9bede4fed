// The outline of a craft in a canvas. Its thrusters' places (at) are in B, m; along is the force as a part of the largest.
// The function place gives the pixel of a point of B, m.
const PLUME = 0.9;  // length of a plume at full force, in radii
function plumes(pen, {thrusters, radius}, place, open, colour, width) {
  pen.strokeStyle = colour; pen.lineWidth = width; pen.lineCap = "round";
  thrusters.forEach(({at, along}, k) => {
    if (!(open[k] > 0)) return;
    pen.beginPath(); pen.moveTo(...place(at)); pen.lineTo(...place(at.map((x, n) => x - along[n] * radius * PLUME * open[k]))); pen.stroke();
  });
}
// In the plane a disc with its heading; in space a box as large as the thrusters lie apart: the faces that are seen, and
// its x axis, which is longer, with its y and z axes. Colours fade by the pen's own globalAlpha.
function hull(pen, {planar, radius, thrusters}, place, colour) {
  const before = pen.globalAlpha, middle = place([0, 0, 0]), tip = (k, length) => [0, 1, 2].map(n => n === k ? length * radius : 0);
  const line = (...points) => { pen.beginPath(); points.forEach((p, k) => k ? pen.lineTo(...p) : pen.moveTo(...p)); };
  pen.fillStyle = pen.strokeStyle = colour;
  if (planar) {
    const end = place(tip(0, 1));
    pen.lineWidth = 2; pen.beginPath(); pen.arc(...middle, Math.hypot(end[0] - middle[0], end[1] - middle[1]), 0, 7);
    pen.globalAlpha = 0.25 * before; pen.fill(); pen.globalAlpha = before; pen.stroke();
    pen.lineWidth = 3; line(middle, end); pen.stroke();
    return;
  }
  const halves = [0, 1, 2].map(k => Math.max(0.25 * radius, ...thrusters.map(({at}) => Math.abs(at[k]))));
  const axes = [0, 1, 2].map(k => place(tip(k, 1)).map((x, n) => (x - middle[n]) / radius));  // pixels of a metre along each
  const scale = Math.max(...axes.map(([u, v]) => Math.hypot(u, v)), 1e-9);
  pen.lineWidth = 1.5;
  [0, 1, 2].forEach(k => [-1, 1].forEach(side => {
    // Counterclockwise from outside; y points down in a canvas.
    const [m, n] = [(k + 1) % 3, (k + 2) % 3];
    const facing = -side * (axes[m][0] * axes[n][1] - axes[m][1] * axes[n][0]) / scale ** 2;
    if (facing <= 0) return;
    line(...[[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([u, v]) => {
      const point = [0, 0, 0];
      [point[k], point[m], point[n]] = [side * halves[k], u * halves[m], v * halves[n]];
      return place(point);
    }));
    pen.closePath();
    pen.globalAlpha = before * (0.15 + 0.35 * Math.min(1, facing)); pen.fill(); pen.globalAlpha = before; pen.stroke();
  }));
  [1.9, 1.3, 1.3].forEach((length, k) => { pen.lineWidth = k ? 1 : 3; line(middle, place(tip(k, length))); pen.stroke(); });
}
