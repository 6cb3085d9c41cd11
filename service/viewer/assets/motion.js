// The arm's forward kinematics, and motions as piecewise polynomials.
class Arm {
  constructor(data) {
    this.data = data;
    this.count = data.joints.length;
  }
  // Frames of the joints at a configuration; number -1 is the root.
  frames(q) {
    const frames = { "-1": Matrix.identity() };
    for (let i = 0; i < this.count; i++) {
      const moved = this.data.joints[i].slides ? Matrix.slideZ(q[i]) : Matrix.turnZ(q[i]);
      frames[i] = Matrix.multiply(Matrix.multiply(frames[i - 1], this.data.offsets[i]), moved);
    }
    // Bodies on joints that mimic one of the chain are numbered behind those of the chain.
    this.data.followers.forEach(({ parent, leader, multiplier, offset, slides, frame }, k) => {
      const value = multiplier * q[leader] + offset, moved = slides ? Matrix.slideZ(value) : Matrix.turnZ(value);
      frames[this.count + k] = Matrix.multiply(Matrix.multiply(frames[parent], frame), moved);
    });
    return frames;
  }
  tip(q) {
    const { joint, frame } = this.data.tip;
    return Matrix.multiply(this.frames(q)[joint], frame);
  }
}
class Motion {
  constructor({ breaks, coefficients }) {
    this.breaks = breaks;
    this.coefficients = coefficients;
    this.duration = breaks[breaks.length - 1];
  }
  // A derivative of every joint at a time.
  at(time, derivative = 0) {
    let low = 0, high = this.coefficients.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.breaks[middle] <= time) low = middle; else high = middle - 1;
    }
    const t = Math.min(Math.max(time, 0), this.duration) - this.breaks[low];
    return this.coefficients[low].map((row) => polynomial(row, t, derivative));
  }
}
function polynomial(coefficients, t, derivative) {
  let value = 0;
  for (let k = coefficients.length - 1; k >= derivative; k--) {
    let factor = coefficients[k];
    for (let d = 0; d < derivative; d++) factor *= k - d;
    value = value * t + factor;
  }
  return value;
}
// The index of the last time that is not after a given one, and how far it is to the next.
function interval(times, time) {
  let i = 0;
  while (i + 2 < times.length && times[i + 1] <= time) i++;
  const width = times[i + 1] - times[i];
  return [i, width > 0 ? Math.min(Math.max((time - times[i]) / width, 0), 1) : 0];
}
