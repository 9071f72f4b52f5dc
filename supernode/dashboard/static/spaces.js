// Scenes in three dimensions, made from plain numbers; a pointer or the arrow keys turn them.

import { make, setText } from "./common.js";

const TURN = Math.PI / 18; // by an arrow key, rad
const TURNS = { ArrowLeft: [-TURN, 0], ArrowRight: [TURN, 0], ArrowUp: [0, TURN], ArrowDown: [0, -TURN] };

export const canTurn = () => document.createElement("canvas").getContext("webgl") !== null;

// Shows one plot for each scene, under its title. `words` describe the scenes to screen readers.
export function showSpaces(parent, spaces, words) {
  while (parent.children.length > spaces.length) parent.lastChild.remove();
  while (parent.children.length < spaces.length) parent.append(newFigure()); // all, before one is drawn at its size
  spaces.forEach(({ title, traces, scene }, index) => {
    const [caption, plot] = parent.children[index].children;
    setText(caption, title);
    caption.hidden = title === "";
    plot.setAttribute("aria-label", `${title} ${words}, in space. Drag it, or press the arrow keys, to turn it.`.trim());
    draw(plot, traces, scene);
  });
}

export function newFigure() {
  const plot = make("div", { class: "plot space", tabindex: "0", role: "application" });
  plot.addEventListener("keydown", (event) => {
    if (!TURNS[event.key]) return;
    event.preventDefault();
    Plotly.relayout(plot, { "scene.camera.eye": turned(plot.layout.scene.camera.eye, ...TURNS[event.key]) });
  });
  return make("figure", {}, make("figcaption"), plot);
}

function turned({ x, y, z }, around, up) {
  const far = Math.hypot(x, y, z), angle = Math.atan2(y, x) + around;
  const height = Math.min(Math.max(Math.asin(z / far) + up, -1.5), 1.5);
  return { x: far * Math.cos(height) * Math.cos(angle), y: far * Math.cos(height) * Math.sin(angle), z: far * Math.sin(height) };
}

// Draws traces in one scene; a scene that is there already keeps its camera.
export function draw(plot, traces, scene) {
  const style = getComputedStyle(document.documentElement), of = (name) => style.getPropertyValue(name).trim();
  const axis = { color: of("--faint"), gridcolor: of("--line"), zerolinecolor: of("--line"), showspikes: false, nticks: 6 };
  const axes = Object.fromEntries(["xaxis", "yaxis", "zaxis"].map((name) => [name, { ...axis, ...scene[name] }]));
  const camera = plot.layout?.scene?.camera ?? scene.camera; // `uirevision` keeps no turn by the arrow keys
  return Plotly.react(plot, traces, {
    scene: { ...scene, ...axes, camera, dragmode: "orbit" }, margin: { l: 0, r: 0, t: 0, b: 0 }, uirevision: "same",
    paper_bgcolor: "rgba(0,0,0,0)", font: { color: of("--ink"), family: "system-ui, sans-serif" },
    legend: { orientation: "h", x: 0, y: 1 },
  }, { displayModeBar: false, responsive: true, scrollZoom: false });
}
