// Curves over time with their limits, on one cursor. Lines differ by dashes as well as by colour.
const COLORS = ["#1f5fa8", "#b3541e", "#2b7a3d", "#8a2b8f", "#7a5c00", "#0f7c86", "#a3182e"];
const DASHES = [[], [8, 3], [2, 3], [10, 3, 2, 3], [5, 5], [14, 4], [2, 6]];
function style(i) { return [COLORS[i % COLORS.length], DASHES[Math.floor(i / COLORS.length + i) % DASHES.length]]; }
// All curves of a motion: name, unit, rows of values for the times, and a limit for each row.
function curvesOf(data, motion) {
  const joints = data.joints, times = Array.from({ length: 401 }, (_, i) => (motion.duration * i) / 400);
  const slides = joints.some((joint) => joint.slides), turns = joints.some((joint) => !joint.slides);
  const angle = turns && slides ? "rad or m" : slides ? "m" : "rad";
  const names = joints.map((joint) => joint.name);
  const found = [];
  ["position", "velocity", "acceleration", "jerk"].forEach((name, derivative) => {
    const rows = times.map((time) => motion.at(time, derivative));
    const limit = (joint) => (derivative === 0 ? [joint.lower, joint.upper] : joint[name] === null ? [null, null] : [-joint[name], joint[name]]);
    found.push({ name: `${name} of joints`, unit: derivative ? `${angle}/s${["", "", "²", "³"][derivative]}` : angle, times, names,
                 rows: names.map((_, j) => rows.map((row) => row[j])), limits: joints.map(limit) });
  });
  const torque = data.motion.torque;
  if (torque) {
    found.push({ name: "torque of joints", unit: slides ? "N m or N" : "N m", times: torque.times, names,
                 rows: names.map((_, j) => torque.values.map((row) => row[j])),
                 limits: joints.map((joint) => (joint.effort === null ? [null, null] : [-joint.effort, joint.effort])) });
  }
  const speed = data.motion.tool_speed;
  found.push({ name: "tool speed", unit: "m/s", times: speed.times, names: [data.tip.name], rows: [speed.values], limits: [[null, speed.limit]] });
  const clearance = data.motion.clearance;
  if (clearance.values.some((value) => value !== null)) {
    found.push({ name: "clearance", unit: "m", times: clearance.times, names: ["closest pair"], rows: [clearance.values], limits: [[0, null]] });
  }
  return found;
}
class Plot {
  constructor(canvas, legend) { this.canvas = canvas; this.legend = legend; this.marks = []; this.left = 62; this.right = 12; }
  show(curve) {
    this.curve = curve;
    this.legend.replaceChildren(...curve.names.map((name, i) => {
      const [color, dashes] = style(i), item = document.createElement("span");
      const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
      svg.setAttribute("width", "34"); svg.setAttribute("height", "8"); svg.setAttribute("aria-hidden", "true");
      const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
      for (const [key, value] of Object.entries({ x1: 0, x2: 34, y1: 4, y2: 4, stroke: color, "stroke-width": 2.5, "stroke-dasharray": dashes.join(" ") })) line.setAttribute(key, String(value));
      svg.append(line);
      const [low, high] = curve.limits[i];
      const bounds = low === null && high === null ? "no limit" : `limit ${[low, high].filter((v) => v !== null).map((v) => v.toPrecision(3)).join(" to ")}`;
      item.append(svg, `${curve.names.length > 1 ? `${i + 1}: ` : ""}${name}, ${bounds}`);
      return item;
    }));
  }
  // Values drawn and, where they are near, limits.
  range() {
    const values = this.curve.rows.flat().filter((v) => v !== null);
    let low = Math.min(...values), high = Math.max(...values);
    const span = Math.max(high - low, 1e-9);
    for (const limit of this.curve.limits.flat()) {
      if (limit !== null && limit > low - 1.5 * span && limit < high + 1.5 * span) { low = Math.min(low, limit); high = Math.max(high, limit); }
    }
    const pad = 0.06 * Math.max(high - low, 1e-9);
    return [low - pad, high + pad];
  }
  draw(time, duration) {
    const canvas = this.canvas, ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    canvas.width = width * ratio; canvas.height = height * ratio;
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    const [low, high] = this.range(), bottom = height - 24;
    const x = (t) => this.left + ((width - this.left - this.right) * t) / Math.max(duration, 1e-9);
    const y = (v) => 8 + ((bottom - 8) * (high - v)) / (high - low);
    pen.font = "12px system-ui, sans-serif"; pen.fillStyle = "#38424f"; pen.strokeStyle = "#d5dae1"; pen.lineWidth = 1;
    for (let k = 0; k <= 4; k++) {
      const value = low + ((high - low) * k) / 4, at = (duration * k) / 4;
      pen.beginPath(); pen.moveTo(this.left, y(value)); pen.lineTo(width - this.right, y(value)); pen.stroke();
      pen.textAlign = "right"; pen.fillText(value.toPrecision(3), this.left - 6, y(value) + 4);
      pen.textAlign = k === 4 ? "right" : "center"; pen.fillText(`${at.toFixed(2)} s`, x(at), height - 6);
    }
    for (const mark of this.marks) { pen.beginPath(); pen.moveTo(x(mark), bottom); pen.lineTo(x(mark), bottom + 7); pen.strokeStyle = "#38424f"; pen.stroke(); }
    this.curve.rows.forEach((row, i) => {
      const [color, dashes] = style(i);
      pen.strokeStyle = color;
      for (const limit of this.curve.limits[i]) {
        if (limit === null || limit < low || limit > high) continue;
        pen.lineWidth = 1; pen.setLineDash([1, 4]);
        pen.beginPath(); pen.moveTo(this.left, y(limit)); pen.lineTo(width - this.right, y(limit)); pen.stroke();
      }
      pen.lineWidth = 2; pen.setLineDash(dashes); pen.beginPath();
      row.forEach((value, k) => { if (value !== null) pen.lineTo(x(this.curve.times[k]), y(value)); });
      pen.stroke();
    });
    pen.setLineDash([]);
    this.number(pen, x, y, duration);
    pen.strokeStyle = "#1b2430"; pen.lineWidth = 1.5;
    pen.beginPath(); pen.moveTo(x(time), 4); pen.lineTo(x(time), bottom); pen.stroke();
    pen.textAlign = "left"; pen.fillText(this.curve.unit, this.left + 4, 18);
  }
  // Every curve has its number of the legend on it, one beside the other.
  number(pen, x, y, duration) {
    const count = this.curve.rows.length;
    if (count < 2) return;
    pen.textAlign = "center";
    this.curve.rows.forEach((row, i) => {
      const value = this.value(row, (duration * (i + 0.5)) / count);
      if (value === null) return;
      const at = [x((duration * (i + 0.5)) / count), y(value)];
      pen.fillStyle = "#fff"; pen.beginPath(); pen.arc(at[0], at[1], 8.5, 0, 7); pen.fill();
      pen.strokeStyle = pen.fillStyle = style(i)[0]; pen.lineWidth = 1; pen.stroke();
      pen.fillText(String(i + 1), at[0], at[1] + 4);
    });
    pen.fillStyle = "#38424f";
  }
  // The value of a row at a time; null where there is none.
  value(row, time) {
    const [i, share] = interval(this.curve.times, time);
    return row[i] === null || row[i + 1] === null ? null : row[i] + share * (row[i + 1] - row[i]);
  }
  // The values at a time in words.
  words(time) {
    return this.curve.names.map((name, i) => {
      const value = this.value(this.curve.rows[i], time);
      return `${name} ${value === null ? "unknown" : `${value.toPrecision(3)} ${this.curve.unit}`}`;
    }).join(", ");
  }
  timeAt(clientX, duration) {
    const box = this.canvas.getBoundingClientRect();
    const share = (clientX - box.left - this.left) / (box.width - this.left - this.right);
    return Math.min(Math.max(share, 0), 1) * duration;
  }
}
