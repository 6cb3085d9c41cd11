// The page: time, switches, words and keys around the view and the curves.
const data = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);
const GHOSTS = 9, PATH_POINTS = 300, STEP = 0.02;
const LINK = [0.78, 0.8, 0.83], HELD = [0.95, 0.72, 0.2], OBSTACLE = [0.45, 0.56, 0.68], CLOSE = [0.86, 0.42, 0.1];
// Colour and sign of a configuration by its verdict, and by the reason where it was rejected.
const VERDICTS = {
  valid: [[0.15, 0.5, 0.75], "✓ valid"], asked: [[0.3, 0.32, 0.36], "• asked for"],
  collision: [[0.78, 0.2, 0.1], "✗ collides"], limits: [[0.5, 0.2, 0.65], "⊘ outside limits"], other: [[0.6, 0.45, 0.1], "△ rejected"],
};
const arm = new Arm(data);
const motion = data.motion ? new Motion(data.motion) : null;
const state = { time: 0, playing: false, speed: 1, shown: { ghosts: false, path: true, nearest: true, tree: true, others: true, visuals: true, obstacles: true, labels: true }, chosen: 0, changed: true };
const view = new View(byId("view"), data);
const plot = new Plot(byId("plot"), byId("legend"));
const curves = motion ? curvesOf(data, motion) : [];
const stages = data.stages || [], fingers = data.fingers || {};
const path = motion ? Array.from({ length: PATH_POINTS }, (_, i) => Matrix.origin(arm.tip(motion.at((motion.duration * i) / (PATH_POINTS - 1))))) : [];
const ghosts = motion ? Array.from({ length: GHOSTS }, (_, i) => motion.duration * i / (GHOSTS - 1)).map((time) => placed(arm.frames(motion.at(time)), time)) : [];
const singles = data.configurations.map((item) => arm.frames(item.joints)), tips = data.configurations.map((item) => arm.tip(item.joints));
// The tree that grows from goals is dashed, that of the start is not.
const trees = (data.tree ? data.tree.parts : []).map((part) => ({ ...view.edges(part.points, part.name === "goals"), color: part.name === "goals" ? [0.55, 0.15, 0.45] : [0.1, 0.4, 0.2] }));
const rest = arm.frames(data.joints.map(() => 0));

function nearestAt(time) {
  const clearance = data.motion.clearance;
  if (!clearance.values.length) return null;
  const [i, share] = interval(clearance.times, time), k = share > 0.5 ? i + 1 : i;
  return clearance.values[k] === null ? null : { distance: clearance.values[k], pair: clearance.pairs[k], points: clearance.points[k] };
}
// Frames of the joints, and places of what is carried by turns.
function placed(frames, time) {
  for (const [name, carriers] of Object.entries(data.carriers || {})) {
    const now = carriers.filter((item) => item.begins <= time + 1e-9).pop() || carriers[0];
    frames[name] = Matrix.multiply(frames[now.joint], now.frame);
  }
  // Fingers move in the frame of the joint that carries their gripper, straight between instants.
  for (const body of data.bodies) {
    const track = fingers[body.name];
    if (!track || (body.kind !== "link" && body.kind !== "visual")) continue;
    const [i, share] = track.times.length > 1 ? interval(track.times, time) : [0, 0], next = Math.min(i + 1, track.times.length - 1);
    const turn = track.frames[i].map((v, k) => v + share * (track.frames[next][k] - v));
    frames[`finger ${body.name}`] = Matrix.multiply(frames[body.joint], turn);
  }
  return frames;
}
// Links that look like something are drawn so, unless their collision geometry is asked for.
const looks = new Set(data.bodies.filter((body) => body.kind === "visual").map((body) => body.name));
function isDrawn(body) {
  if (body.kind === "visual") return state.shown.visuals;
  return !(body.kind === "link" && state.shown.visuals && looks.has(body.name));
}
function stageAt(time) { return stages.filter((item) => item.begins <= time + 1e-9).pop(); }
function draw() {
  const shown = state.shown, item = data.configurations[state.chosen];
  const frames = motion ? placed(arm.frames(motion.at(state.time)), state.time) : singles[state.chosen] || rest;
  const near = motion ? (shown.nearest ? nearestAt(state.time) : null) : item ? item.near : null;
  const pair = motion ? (near && near.pair) || [] : (item && item.pair) || [];
  view.begin();
  const color = (body) => (pair.includes(body.name) ? CLOSE : body.color && (motion || !item) ? body.color : body.kind === "obstacle" ? OBSTACLE : body.kind === "held" || body.kind === "moved" ? HELD : !motion && item ? mixed(VERDICTS[item.cause || item.verdict][0]) : LINK);
  const striped = (body) => pair.includes(body.name);
  view.draw(frames, { only: (body) => isDrawn(body) && (body.kind !== "obstacle" || shown.obstacles), color, striped });
  if (shown.path) view.lines(path, [0.1, 0.35, 0.7]);
  if (shown.tree) for (const tree of trees) view.strokes(tree.buffer, tree.count, tree.color, true);
  if (near && near.points) view.lines(near.points, [0.8, 0.1, 0.05]);
  const moves = (body) => !["obstacle", "moved"].includes(body.kind) && body.joint >= 0 && isDrawn(body);
  if (shown.ghosts) for (const ghost of ghosts) view.draw(ghost, { only: moves, color: () => [0.3, 0.5, 0.8], alpha: 0.12 });
  if (!motion && shown.others) singles.forEach((single, i) => {
    if (i !== state.chosen) view.draw(single, { only: moves, color: () => VERDICTS[data.configurations[i].cause || data.configurations[i].verdict][0], alpha: 0.15 });
  });
  view.lines([[0, 0, 0], [0.15, 0, 0], [0, 0, 0], [0, 0.15, 0], [0, 0, 0], [0, 0, 0.15]], [0.2, 0.2, 0.2], true);
  if (motion) plot.draw(state.time, motion.duration);
  if (shown.labels) label(frames, pair); else byId("labels").replaceChildren();
  tell(near, item);
}
// Names of the closest pair, and the numbers of the configurations at their tips: the list has them too.
function label(frames, pair) {
  const items = [], marks = [];
  const add = (list, point, item) => {
    const at = view.project(point);
    if (at && !at.some((v) => v < 0 || v > 1)) list.push({ ...item, at });
  };
  if (!motion) data.configurations.forEach((item, i) => {
    const mark = { sign: sign(item)[0], number: i };
    if (i === state.chosen) add(items, Matrix.origin(tips[i]), { text: `${mark.sign} ${mark.number}`, chosen: true });
    else if (state.shown.others) add(marks, Matrix.origin(tips[i]), mark);
  });
  for (const body of view.bodies) if (body.kind !== "visual" && pair.includes(body.name)) add(items, view.middle(body, frames), { text: body.name });
  showLabels(byId("labels"), [...items, ...gathered(marks)]);
}
function sign(item) { return VERDICTS[item.cause || item.verdict][1]; }
function mixed(color) { return color.map((v, i) => 0.5 * v + 0.5 * LINK[i]); }
function tell(near, item) {
  const q = motion ? motion.at(state.time) : item ? item.joints : null;
  const rows = q ? data.joints.map((joint, i) => [joint.name, `${q[i].toFixed(4)} ${joint.slides ? "m" : "rad"}`]) : [];
  if (q) rows.push([data.tip.name, Matrix.origin(arm.tip(q)).map((v) => v.toFixed(3)).join(", ") + " m"]);
  const stage = stageAt(state.time);
  if (stage) {
    rows.unshift(["stage", stage.label]);
    byId("list").querySelectorAll("button").forEach((button, k) => (stages[k] === stage ? button.setAttribute("aria-current", "step") : button.removeAttribute("aria-current")));
  }
  if (near) rows.push([near.distance < 0 ? "overlap" : "clearance", `${Math.abs(1000 * near.distance).toFixed(1)} mm${near.pair ? `, ${near.pair.join(" and ")}` : ""}`]);
  byId("now").replaceChildren(table(rows));
  if (!motion) return;
  byId("clock").textContent = `${state.time.toFixed(3)} of ${motion.duration.toFixed(3)} s`;
  byId("time").value = String(Math.round((1000 * state.time) / Math.max(motion.duration, 1e-9)));
  byId("time").setAttribute("aria-valuetext", `${state.time.toFixed(3)} seconds`);
  byId("plot").setAttribute("aria-valuenow", state.time.toFixed(3));
  byId("plot").setAttribute("aria-valuetext", `${state.time.toFixed(3)} seconds: ${plot.words(state.time)}`);
}
function table(rows) {
  const made = document.createElement("table");
  for (const row of rows) {
    const line = made.insertRow();
    row.forEach((text, i) => {
      const cell = document.createElement(i ? "td" : "th");
      if (!i) cell.scope = "row";
      cell.textContent = text; line.append(cell);
    });
  }
  return made;
}
function setTime(time) { if (motion) { state.time = Math.min(Math.max(time, 0), motion.duration); state.changed = true; } }
function setPlaying(playing) {
  state.playing = playing && motion !== null;
  if (state.playing && state.time >= motion.duration) setTime(0);
  byId("play").textContent = state.playing ? "Pause" : "Play";
  byId("play").setAttribute("aria-label", state.playing ? "Pause" : "Play");
}
function frame(now) {
  const elapsed = frame.last === undefined ? 0 : (now - frame.last) / 1000;
  frame.last = now;
  if (state.playing) {
    setTime(state.time + elapsed * state.speed);
    if (state.time >= motion.duration) setPlaying(false);
  }
  if (state.changed || view.changed) { state.changed = view.changed = false; draw(); }
  window.requestAnimationFrame(frame);
}
function addSwitch(name, text) {
  const label = document.createElement("label"), box = document.createElement("input");
  box.type = "checkbox"; box.checked = state.shown[name]; box.id = `show-${name}`;
  box.addEventListener("change", () => { state.shown[name] = box.checked; state.changed = true; });
  label.append(box, ` ${text}`);
  byId("switches").append(label);
}
function choose(i) {
  state.chosen = i; state.changed = true;
  byId("list").querySelectorAll("button").forEach((button, k) => button.setAttribute("aria-pressed", String(k === i)));
}
function fill() {
  byId("title").textContent = data.title;
  byId("verdict").textContent = data.failed ? "✗ No answer: see why below" : data.sentences[0] || "";
  byId("words-title").textContent = data.failed ? "Why" : "In words";
  byId("words").replaceChildren(...data.sentences.map((text) => Object.assign(document.createElement("li"), { textContent: text })));
  if (data.simplified.length) byId("words").append(Object.assign(document.createElement("li"), { textContent: `Drawn by their hulls or thinned out: ${data.simplified.join(", ")}.` }));
  byId("request").textContent = JSON.stringify(data.request, null, 1);
  addSwitch("obstacles", "obstacles"); addSwitch("labels", "names in the view");
  if (looks.size) {
    addSwitch("visuals", "visual meshes (off: the collision geometry, which the proof is about)");
  }
  if (data.visuals_left_out) byId("words").append(Object.assign(document.createElement("li"), { textContent: "The visual meshes are left out: the page would grow beyond 10 MB." }));
  if (trees.length) addSwitch("tree", trees.length > 1 ? `trees of ${data.tree.planner} (of the goals: dashed)` : `tree or roadmap of ${data.tree.planner}`);
  if (motion) {
    addSwitch("path", "path of the tool"); addSwitch("ghosts", `${GHOSTS} configurations on the way`); addSwitch("nearest", "closest pair (striped)");
    curves.forEach((curve, i) => byId("curve").append(new Option(`${curve.name} [${curve.unit}]`, String(i))));
    plot.show(curves[0]);
    byId("plot").setAttribute("aria-valuemax", motion.duration.toFixed(3));
    plot.marks = stages.map((item) => item.begins);
    stages.forEach((item) => {
      const button = document.createElement("button");
      button.type = "button"; button.textContent = `${item.label}, from ${item.begins.toFixed(2)} s`;
      button.addEventListener("click", () => { setPlaying(false); setTime(item.begins); });
      byId("list").append(button);
    });
  } else {
    byId("bar").hidden = byId("plots").hidden = true;
    addSwitch("others", "the other configurations");
    data.configurations.forEach((item, i) => {
      const button = document.createElement("button");
      button.type = "button"; button.setAttribute("aria-pressed", "false");
      button.textContent = `${i}. ${sign(item)}: ${item.label}${item.reason ? `. ${item.reason}` : ""}`;
      button.addEventListener("click", () => choose(i));
      byId("list").append(button);
    });
    if (data.configurations.length) choose(Math.max(data.configurations.findIndex((item) => item.verdict === "rejected"), 0));
  }
}
function listen() {
  byId("play").addEventListener("click", () => setPlaying(!state.playing));
  byId("back").addEventListener("click", () => setTime(state.time - STEP));
  byId("forward").addEventListener("click", () => setTime(state.time + STEP));
  byId("time").addEventListener("input", (event) => { setPlaying(false); setTime((motion.duration * Number(event.target.value)) / 1000); });
  byId("speed").addEventListener("change", (event) => { state.speed = Number(event.target.value); });
  byId("curve").addEventListener("change", (event) => { plot.show(curves[Number(event.target.value)]); state.changed = true; });
  let scrubbing = false;
  const scrub = (event) => { if (scrubbing && motion) { setPlaying(false); setTime(plot.timeAt(event.clientX, motion.duration)); } };
  byId("plot").addEventListener("pointerdown", (event) => { scrubbing = true; byId("plot").setPointerCapture(event.pointerId); scrub(event); });
  byId("plot").addEventListener("pointermove", scrub);
  byId("plot").addEventListener("pointerup", () => { scrubbing = false; });
  window.addEventListener("resize", () => { state.changed = true; });
  document.addEventListener("keydown", (event) => {
    if (["INPUT", "SELECT", "BUTTON", "SUMMARY"].includes(event.target.tagName)) return;
    const actions = { " ": () => setPlaying(!state.playing), ArrowLeft: () => setTime(state.time - STEP), ArrowRight: () => setTime(state.time + STEP), Home: () => setTime(0), End: () => setTime(motion ? motion.duration : 0) };
    if (actions[event.key]) { actions[event.key](); event.preventDefault(); }
  });
}
function frameAll() {
  // The camera looks at everything that is not a ground.
  let low = [1e9, 1e9, 1e9], high = [-1e9, -1e9, -1e9];
  const frames = motion ? placed(arm.frames(motion.at(0)), 0) : singles[state.chosen] || rest;
  for (const body of view.bodies) {
    if (body.kind === "obstacle" && Math.max(...minus(body.high, body.low)) > 2.5) continue;
    const center = view.middle(body, frames), radius = 0.5 * Math.sqrt(dot(minus(body.high, body.low), minus(body.high, body.low)));
    low = low.map((v, i) => Math.min(v, center[i] - radius));
    high = high.map((v, i) => Math.max(v, center[i] + radius));
  }
  if (low[0] > high[0]) return;
  const size = minus(high, low);
  view.target = times(plus(low, high), 0.5);
  view.distance = Math.max(1.1 * Math.sqrt(dot(size, size)), 0.5);
}
fill();
listen();
frameAll();
window.armwrightView = state;
window.requestAnimationFrame(frame);
checkWitnesses();
