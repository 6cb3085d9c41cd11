// Texts beside points of the 3D view, so that none covers another.
const LINE = 19, NEAR = 0.03;
// Numbers in short: "2 to 5, 8".
function ranges(numbers) {
  const runs = [];
  for (const n of numbers) {
    if (runs.length && runs[runs.length - 1][1] === n - 1) runs[runs.length - 1][1] = n; else runs.push([n, n]);
  }
  return runs.map(([a, b]) => (a === b ? `${a}` : `${a} to ${b}`)).join(", ");
}
// Marks of one sign whose places are seen close together become one mark with all their numbers.
function gathered(marks) {
  const groups = [];
  for (const mark of marks) {
    const group = groups.find((item) => item.sign === mark.sign && Math.hypot(item.at[0] - mark.at[0], item.at[1] - mark.at[1]) < NEAR);
    if (group) group.numbers.push(mark.number); else groups.push({ sign: mark.sign, at: mark.at, numbers: [mark.number] });
  }
  return groups.map((group) => ({ at: group.at, text: `${group.sign} ${ranges(group.numbers)}` }));
}
// Show texts at shares of the width and height, the first where it belongs, later ones above or below those in their way.
function showLabels(box, items) {
  const made = items.map(({ text, at, chosen }) => {
    const span = Object.assign(document.createElement("span"), { textContent: text, className: chosen ? "chosen" : "" });
    span.style.left = `${100 * at[0]}%`; span.style.top = `${100 * at[1]}%`;
    return span;
  });
  box.replaceChildren(...made);
  const taken = [], width = box.clientWidth, height = box.clientHeight;
  made.forEach((span, i) => {
    const x = items[i].at[0] * width, y = items[i].at[1] * height, own = span.offsetWidth + 6;
    const free = (at) => taken.every(([left, right, middle]) => x > right || x + own < left || Math.abs(at - middle) >= LINE + 4);
    let place = y;
    for (let k = 1; !free(place) && k < 60; k++) place = y + (k % 2 ? 1 : -1) * Math.ceil(k / 2) * (LINE + 4);
    if (place !== y) span.style.top = `${(100 * place) / height}%`;
    taken.push([x, x + own, place]);
  });
}
