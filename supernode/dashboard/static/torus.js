// The torus as a heat map: a square for each cell, with a cursor for the keyboard.

import { announceVisited, make, number } from "./common.js";

const SVG = "http://www.w3.org/2000/svg";
const RAMP = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]]; // viridis
const STEPS = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] };

export class Torus {
  // `choose` is called with the index of a cell that is clicked or at which Enter is pressed; `describe` returns words
  // for a cell.
  constructor(svg, legend, { choose = () => {}, describe }) {
    Object.assign(this, { svg, legend, choose, describe, rows: 0, columns: 0, cursor: 0, squares: [] });
    svg.addEventListener("click", (event) => this.#choose(this.squares.indexOf(event.target)));
    svg.addEventListener("keydown", (event) => this.#press(event));
    svg.addEventListener("focus", () => svg.matches(":focus-visible") && this.#visit(this.cursor));
  }

  // `cells` are {value, state, job}, row by row. Each job has its own scale of colours. `words` say what the colours
  // mean, `none` says why no cell has a value.
  show(rows, columns, cells, words, none) {
    if (rows !== this.rows || columns !== this.columns) this.#build(rows, columns);
    const scales = scalesOf(cells);
    this.squares.forEach((square, index) => {
      const { value = null, state = "joining", job } = cells[index] ?? {};
      const marked = state !== "alive" ? state : value === null ? "unknown" : "";
      set(square, "class", marked);
      set(square, "fill", marked ? "" : colour(value, scales.get(job)));
      set(square, "data-state", state);
    });
    const dead = cells.map((cell, index) => (cell.state === "dead" ? cross(...this.place(index)) : ""));
    set(this.crosses, "d", dead.join(""));
    this.#explain([...scales.values()], words, none);
  }

  // Joins the places where champions were born, in order; if the topology `wraps`, by the shorter way round.
  trace(cells, wraps) {
    const places = cells.map((cell) => this.place(cell));
    const strokes = places.slice(1).map((to, index) => this.#stroke(places[index], to, wraps));
    draw(this.lineage, strokes.join(""));
    this.births.replaceChildren(...places.map(([row, column], index) => {
      const circle = document.createElementNS(SVG, "circle");
      const radius = index === places.length - 1 ? .22 : .1;
      Object.entries({ cx: column + .5, cy: row + .5, r: radius }).forEach(([name, value]) => set(circle, name, value));
      return circle;
    }));
  }

  // A line that leaves the torus at one edge comes back at the opposite edge, so it is drawn twice.
  #stroke(from, to, wraps) {
    const sizes = [this.rows, this.columns];
    const step = to.map((end, side) => {
      const straight = end - from[side], size = sizes[side];
      return wraps && 2 * Math.abs(straight) > size ? straight - Math.sign(straight) * size : straight;
    });
    const line = ([row, column]) => `M${column + .5} ${row + .5}l${step[1]} ${step[0]}`;
    const entry = to.map((end, side) => end - step[side]);
    return line(from) + (entry.join() === from.join() ? "" : line(entry));
  }

  place(cell) { return [Math.floor(cell / this.columns), cell % this.columns]; }

  #build(rows, columns) {
    Object.assign(this, { rows, columns, cursor: 0 });
    this.svg.setAttribute("viewBox", `-.1 -.1 ${columns + .2} ${rows + .2}`);
    this.squares = Array.from({ length: rows * columns }, (_, index) => {
      const square = document.createElementNS(SVG, "rect"), [row, column] = this.place(index);
      const shape = { x: column + .03, y: row + .03, width: .94, height: .94, rx: .08, "data-cell": index };
      Object.entries(shape).forEach(([name, value]) => set(square, name, value));
      return square;
    });
    this.svg.replaceChildren(...this.squares);
    for (const [name, tag] of [["crosses", "path"], ["lineage", "g"], ["births", "g"], ["mark", "g"]]) {
      this[name] = document.createElementNS(SVG, tag);
      this[name].setAttribute("class", name);
      this.svg.append(this[name]);
    }
    for (const each of [this.lineage, this.mark]) { // a light line inside a dark one is visible on any colour
      each.append(document.createElementNS(SVG, "path"), document.createElementNS(SVG, "path"));
    }
  }

  #press(event) {
    if (event.key === "Enter" || event.key === " ") this.#choose(this.cursor);
    else if (!STEPS[event.key]) return;
    else {
      const [row, column] = this.place(this.cursor), [down, right] = STEPS[event.key];
      const [rows, columns] = [this.rows, this.columns];
      this.#visit(((row + down + rows) % rows) * columns + (column + right + columns) % columns);
    }
    event.preventDefault();
  }

  #choose(cell) {
    if (cell < 0) return;
    this.#move(cell);
    this.choose(cell);
  }

  #visit(cell) {
    if (!this.squares[cell]) return; // no snapshot has arrived yet
    this.#move(cell);
    announceVisited(this.describe(cell));
  }

  #move(cell) {
    const [row, column] = this.place(cell);
    this.cursor = cell;
    draw(this.mark, `M${column} ${row}h1v1h-1z`);
  }

  #explain(scales, words, none) {
    const ends = scales.length > 1 ? [["lowest", "highest of its job"]] : scales.map((scale) => scale.map(number));
    const key = [words, none, ...ends].join();
    if (this.legend.dataset.key === key) return;
    this.legend.dataset.key = key;
    const ramps = ends.flatMap(([low, high]) => [`${words}: ${low}`, make("span", { class: "ramp" }), high]);
    this.legend.replaceChildren(...(ends.length ? ramps : [none]), make("span", {}, "· grey: none yet · ✕ dead · dashed: joining"));
  }
}

// Returns the least and the greatest value of each job.
function scalesOf(cells) {
  const scales = new Map();
  for (const { value, job } of cells) {
    if (value === null || value === undefined) continue;
    const [low, high] = scales.get(job) ?? [value, value];
    scales.set(job, [Math.min(low, value), Math.max(high, value)]);
  }
  return scales;
}

function draw(lines, shape) {
  for (const line of lines.children) set(line, "d", shape);
}

function set(element, name, value) {
  if (element.getAttribute(name) !== String(value)) element.setAttribute(name, value);
}

const cross = (row, column) => `M${column + .25} ${row + .25}l.5 .5m0 -.5l-.5 .5`;

function colour(value, [low, high]) {
  const place = (high > low ? (value - low) / (high - low) : .5) * (RAMP.length - 1);
  const index = Math.min(Math.floor(place), RAMP.length - 2), rest = place - index;
  const mixed = RAMP[index].map((from, part) => Math.round(from + rest * (RAMP[index + 1][part] - from)));
  return `rgb(${mixed.join()})`;
}
