// The torus as a heat map: a square for each cell, with a cursor for the keyboard.

import { announce, make, number } from "./common.js";

const SVG = "http://www.w3.org/2000/svg";
const RAMP = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
const STEPS = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] };

export class Torus {
  // `choose` is called with a cell that is clicked, or at which Enter is pressed; `describe` says a cell in words.
  constructor(svg, legend, { choose = () => {}, describe }) {
    Object.assign(this, { svg, legend, choose, describe, rows: 0, columns: 0, cursor: 0, squares: [] });
    svg.addEventListener("click", (event) => this.#choose(this.squares.indexOf(event.target)));
    svg.addEventListener("keydown", (event) => this.#press(event));
  }

  // `cells` are {value, state}, row by row.
  show(rows, columns, cells) {
    if (rows !== this.rows || columns !== this.columns) this.#build(rows, columns);
    const known = cells.map((cell) => cell.value).filter((value) => value !== null && value !== undefined);
    const low = Math.min(...known), high = Math.max(...known);
    this.squares.forEach((square, index) => {
      const { value = null, state = "joining" } = cells[index] ?? {};
      const marked = state !== "alive" ? state : value === null ? "unknown" : "";
      set(square, "class", marked);
      set(square, "fill", marked ? "" : colour(high > low ? (value - low) / (high - low) : .5));
      set(square, "data-state", state);
    });
    const dead = cells.map((cell, index) => (cell.state === "dead" ? cross(...this.place(index)) : ""));
    set(this.crosses, "d", dead.join(""));
    this.#explain(known.length ? [low, high] : null);
  }

  // The places where champions were born, joined in order; where the topology `wraps`, by the shorter way around.
  trace(cells, wraps) {
    const places = cells.map((cell) => this.place(cell));
    const strokes = places.slice(1).map((to, index) => this.#stroke(places[index], to, wraps));
    set(this.lineage, "d", strokes.join(""));
    this.births.replaceChildren(...places.map(([row, column], index) => {
      const circle = document.createElementNS(SVG, "circle");
      const radius = index === places.length - 1 ? .22 : .1;
      Object.entries({ cx: column + .5, cy: row + .5, r: radius }).forEach(([name, value]) => set(circle, name, value));
      return circle;
    }));
  }

  // One that leaves the torus at an edge comes back at the opposite one.
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
    for (const [name, tag] of [["crosses", "path"], ["lineage", "path"], ["births", "g"], ["mark", "path"]]) {
      this[name] = document.createElementNS(SVG, tag);
      this[name].setAttribute("class", name === "mark" ? "cursor" : name);
      this.svg.append(this[name]);
    }
  }

  #press(event) {
    if (event.key === "Enter" || event.key === " ") this.#choose(this.cursor);
    else if (!STEPS[event.key]) return;
    else {
      const [row, column] = this.place(this.cursor), [down, right] = STEPS[event.key];
      const [rows, columns] = [this.rows, this.columns];
      this.#move(((row + down + rows) % rows) * columns + (column + right + columns) % columns);
      announce(this.describe(this.cursor));
    }
    event.preventDefault();
  }

  #choose(cell) {
    if (cell < 0) return;
    this.#move(cell);
    this.choose(cell);
  }

  #move(cell) {
    const [row, column] = this.place(cell);
    this.cursor = cell;
    set(this.mark, "d", `M${column} ${row}h1v1h-1z`);
  }

  #explain(ends) {
    const words = ends ? ends.map(number).join() : "none";
    if (this.legend.dataset.words === words) return;
    this.legend.dataset.words = words;
    const scale = ends ? [number(ends[0]), make("span", { class: "ramp" }), number(ends[1])] : ["no job on the nodes"];
    this.legend.replaceChildren(...scale, make("span", {}, "· ✕ dead · dashed: joining"));
  }
}

function set(element, name, value) {
  if (element.getAttribute(name) !== String(value)) element.setAttribute(name, value);
}

const cross = (row, column) => `M${column + .25} ${row + .25}l.5 .5m0 -.5l-.5 .5`;

function colour(share) {
  const place = Math.min(Math.max(share, 0), 1) * (RAMP.length - 1);
  const index = Math.min(Math.floor(place), RAMP.length - 2), rest = place - index;
  const mixed = RAMP[index].map((from, part) => Math.round(from + rest * (RAMP[index + 1][part] - from)));
  return `rgb(${mixed.join()})`;
}
