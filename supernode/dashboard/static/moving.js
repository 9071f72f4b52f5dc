// A solution as bodies that move in space. The bodies are fetched once, the placements of their frames with each better
// solution. All bodies of a role are one trace, whose vertices a slider over the steps moves. Plotly reads tags in the
// names of traces, so names from problem files are not among these.

import { getJson, make, number, setText } from "./common.js";
import { plot as plotCurves } from "./history.js";
import { draw, newFigure } from "./spaces.js";

const COLORS = { robot: "#7d8ea8", attached: "#d9822b", obstacle: "#b8a888" };
const GHOSTS = { start: "#2a8c4a", goal: "#3b82d6" }; // others have the color of the robot
const PALE = 0.14, OBSTACLES = 0.55; // opacities
const LIGHT = { ambient: 0.55, diffuse: 0.7, specular: 0.1, roughness: 0.7, fresnel: 0.05 };
const AXES = ["#c8321e", "#2a8c4a", "#3b82d6"], AXIS = 0.1; // m, of a pose that is to be reached
const EYE = { x: 1.5, y: -1.4, z: 0.9 };

export class Moving {
  constructor(parent, address) {
    Object.assign(this, { parent, address, key: null, bodies: [], solution: null, plot: null, frame: null });
  }

  // Shows a better solution. Camera and slider stay where they are.
  async show(solution, words) {
    await this.fetchBodies(solution.bodies);
    this.solution = solution;
    if (this.plot === null) this.build();
    const steps = solution.frames.length, before = Number(this.slider.max);
    if (before > 0) this.share = Number(this.slider.value) / before;
    this.slider.max = steps - 1;
    this.slider.value = Math.round(this.share * (steps - 1));
    this.row.hidden = steps < 2;
    this.label();
    const text = `${words}, in space. Drag it, or press the arrow keys, to turn it; the slider moves the robot.`;
    this.plot.setAttribute("aria-label", text);
    await draw(this.plot, this.traces(), this.scene());
    this.showCurves();
  }

  async fetchBodies(key) {
    if (key === this.key) return;
    const { bodies } = await getJson(`${this.address}?key=${encodeURIComponent(key)}`);
    Object.assign(this, { bodies, key });
  }

  build() {
    const figure = newFigure();
    [, this.plot] = figure.children;
    this.slider = make("input", { type: "range", min: 0, max: 0, value: 0, "aria-label": "Step of the solution" });
    this.output = make("output");
    this.row = make("label", { class: "step" }, this.slider, this.output);
    this.share = 0; // where the slider is: it stays there if a solution without steps comes between
    this.slider.addEventListener("input", () => {
      this.label();
      this.frame ??= requestAnimationFrame(() => this.move()); // at most once for each frame of the screen
    });
    this.curves = make("div", { class: "plot", role: "img" });
    figure.append(this.row, this.curves);
    this.parent.replaceChildren(figure);
  }

  get step() {
    return Number(this.slider.value);
  }

  label() {
    const { along, along_name: name } = this.solution, [what, unit] = name.split(" / ");
    const text = `${what} ${number(Number(along[this.step].toFixed(3)))}${unit ? ` ${unit}` : ""}`;
    setText(this.output, text);
    this.slider.setAttribute("aria-valuetext", text);
  }

  // Moves what moves to the slider's step. Those are the first traces, see `traces`.
  move() {
    this.frame = null;
    const placements = this.solution.frames[this.step];
    const places = this.roles().map((role) => placed(this.of(role), placements));
    const [x, y, z] = ["x", "y", "z"].map((name) => places.map((each) => each[name]));
    Plotly.restyle(this.plot, { x, y, z }, places.map((_, index) => index));
    if (!this.curves.hidden) Plotly.relayout(this.curves, { shapes: this.mark() });
  }

  // The joints, or what else the solution's curves are, with a mark at the slider's step.
  showCurves() {
    const { along, along_name: title, names, curves, curves_name: values } = this.solution;
    this.curves.hidden = along.length < 2 || names.length === 0;
    if (this.curves.hidden) return;
    const mode = title === "solution" ? "markers" : "lines";
    const lines = names.map((_, index) => ({ name: `${index + 1}`, x: along, y: curves.map((row) => row[index]), mode }));
    plotCurves(this.curves, lines, [title, values], `${values} against ${title}: ${names.join(", ")}`, { shapes: this.mark() });
  }

  mark() {
    const at = this.solution.along[this.step];
    return [{ type: "line", x0: at, x1: at, y0: 0, y1: 1, yref: "paper", line: { color: "#c8321e", width: 1 } }];
  }

  of(role) {
    return this.bodies.filter((body) => body.role === role);
  }

  // The roles that have bodies, of those that move.
  roles() {
    return ["robot", "attached"].filter((role) => this.of(role).length > 0);
  }

  traces() {
    const { frames, ghosts, lines, targets } = this.solution, now = frames[this.step];
    const moving = this.roles().map((role) => solid(this.of(role), now, COLORS[role], { name: role }));
    const still = this.of("obstacle").length
      ? [solid(this.of("obstacle"), now, COLORS.obstacle, { name: "obstacle", opacity: OBSTACLES })] : [];
    const copied = this.bodies.filter((body) => body.role !== "obstacle");
    const pale = copied.length ? ghosts.map((ghost) => solid(copied, ghost.frames, GHOSTS[ghost.name] ?? COLORS.robot,
      { name: ghost.name, opacity: PALE, showlegend: ghost.name in GHOSTS })) : [];
    return [...moving, ...still, ...pale, ...lines.map(way), ...targets.map(pose)];
  }

  scene() {
    const [low, high] = this.solution.box;
    const axes = ["x", "y", "z"].map((name, axis) =>
      [`${name}axis`, { range: [low[axis], high[axis]], title: { text: `${name} / m` } }]);
    return { ...Object.fromEntries(axes), aspectmode: "data", camera: { eye: EYE, center: { x: 0, y: 0, z: -0.1 } } };
  }
}

// The vertices of bodies, one after the other, where the placements of their frames put them.
function placed(bodies, placements) {
  const count = bodies.reduce((sum, { vertices }) => sum + vertices.length / 3, 0);
  const [x, y, z] = [new Float32Array(count), new Float32Array(count), new Float32Array(count)];
  let at = 0;
  for (const { frame, vertices } of bodies) {
    const [a, b, c, p, d, e, f, q, g, h, i, r] = placements[frame];
    for (let corner = 0; corner < vertices.length; corner += 3, at += 1) {
      const u = vertices[corner], v = vertices[corner + 1], w = vertices[corner + 2];
      x[at] = a * u + b * v + c * w + p;
      y[at] = d * u + e * v + f * w + q;
      z[at] = g * u + h * v + i * w + r;
    }
  }
  return { x, y, z };
}

function solid(bodies, placements, color, more) {
  const corners = [[], [], []];
  let before = 0;
  for (const { vertices, triangles } of bodies) {
    triangles.forEach((vertex, index) => corners[index % 3].push(before + vertex));
    before += vertices.length / 3;
  }
  const [i, j, k] = corners;
  return {
    type: "mesh3d", ...placed(bodies, placements), i, j, k, color, flatshading: true, lighting: LIGHT,
    lightposition: { x: 1000, y: -2000, z: 3000 }, hoverinfo: "skip", showlegend: false, ...more,
  };
}

// The way of a point of interest, such as the tool.
function way(points) {
  const [x, y, z] = [0, 1, 2].map((axis) => points.map((point) => point[axis]));
  return {
    type: "scatter3d", mode: "lines", x, y, z, line: { color: "#8a4fbf", width: 4 }, name: "way of the tool",
    hoverinfo: "skip", showlegend: false,
  };
}

// The axes of a pose that is to be reached. Each is a line of its own color.
function pose(placement) {
  const ends = [0, 1, 2].flatMap((axis) => [0, AXIS, null].map((far) =>
    [0, 1, 2].map((row) => far === null ? null : placement[4 * row + 3] + far * placement[4 * row + axis])));
  const [x, y, z] = [0, 1, 2].map((row) => ends.map((end) => end[row]));
  return {
    type: "scatter3d", mode: "lines", x, y, z, name: "pose to reach", hoverinfo: "skip", showlegend: false,
    line: { color: AXES.flatMap((color) => [color, color, color]), width: 6 },
  };
}
