// One job: convergence, diversity, lineage and the best solution so far.

import {
  TROUBLED, announce, byId, fillRow, follow, getJson, hasEnded, make, number, postJson, setText, showFacts,
} from "./common.js";
import { History, generation, line, plot, since } from "./history.js";
import { canTurn, showSpaces } from "./spaces.js";
import { Torus } from "./torus.js";

const LINEAGE = 40; // births that are drawn
const SCENE_EVERY = 1100; // ms
const DRAW_EVERY = 2000; // ms: long curves take a while
const id = byId("job").dataset.job, address = `/api/jobs/${encodeURIComponent(id)}`;
const history = new History(id);
let job = null, busy = false, patient = 0, heard = "", drawn = 0, stale = true, bests = [];

const torus = new Torus(byId("torus"), byId("legend"), {
  describe: (cell) => `cell ${cell}, best ${number(bests[cell])}`,
});

async function show(snapshot) {
  showCells(snapshot);
  const line = snapshot.jobs.find((each) => each.job === id), number = line?.number ?? job?.number;
  const now = JSON.stringify([line, snapshot.statistics[number]?.generation, snapshot.bests[number]]);
  if (busy || now === heard || Date.now() < patient) return;
  busy = true;
  try {
    job = await getJson(address);
    showJob();
    stale = (await history.load()) || stale;
    if (stale && (hasEnded(job.status) || Date.now() >= drawn + DRAW_EVERY)) showHistory();
    if (!stale) heard = now;
    setText(byId("trouble"), "");
  } catch (error) {
    setText(byId("trouble"), error.message);
    patient = Date.now() + TROUBLED;
  } finally {
    busy = false;
  }
}

function showJob() {
  const { name, kind, status, fitness, topology, generations } = { ...job, generations: job.result?.generations };
  const end = job.ended ?? Date.now() / 1000;
  showFacts(byId("facts"), {
    status, fitness, problem: name, kind, topology, seed: job.run.seed,
    seconds: job.started ? Number((end - job.started).toFixed(1)) : null,
    ...(generations !== undefined && { generations }), ...(job.message && { message: job.message }),
  });
  if (byId("cancel").dataset.status !== status) announce(`job ${id} is ${status}`);
  byId("cancel").dataset.status = status;
  byId("cancel").hidden = hasEnded(status);
  const best = job.best && [job.best.world, job.best.fitness, job.world];
  scene.show(JSON.stringify(best ?? [job.world]));
}

function showHistory() {
  [drawn, stale] = [Date.now(), false];
  const seconds = byId("against").value === "seconds";
  const x = seconds ? since(job.started ?? job.submitted) : generation;
  const along = seconds ? "seconds" : "generation", { statistics, improvements } = history;
  const lines = [
    line("worst", statistics, x, "worst", { line: { color: "#b0713c", width: 1 } }),
    line("median", statistics, x, "median", { line: { color: "#8a4fbf", width: 1.5 } }),
    line("best", statistics, x, "best", { line: { color: "#2a8c4a", width: 1.5 } }),
    line("verified", improvements, x, "fitness",
      { line: { color: "#3b82d6", width: 2.5, shape: "hv" }, mode: "lines+markers", marker: { size: 5 } }),
  ];
  plot(byId("convergence"), lines, [along, "fitness"], { yaxis: { type: byId("log").checked ? "log" : "linear" } });
  plot(byId("diversity"), [
    line("diversity", statistics, x, "diversity", { line: { color: "#2a8c4a" } }),
    line("champion's age", statistics, x, "age", { yaxis: "y2", line: { color: "#c8321e", width: 1 } }),
  ], [along, "diversity"], {
    yaxis: { range: [0, 1.05] },
    yaxis2: { title: { text: "age / generations" }, overlaying: "y", side: "right", rangemode: "tozero", showgrid: false,
      tickmode: "auto", nticks: 5, tickformat: ",d" },
  });
  const world = improvements.at(-1)?.world;
  const born = improvements.filter((each) => each.world === world).slice(-LINEAGE).map((each) => each.cell);
  torus.trace(born, /^(torus|moore)/.test(job.topology));
  showImprovements(improvements);
}

function showImprovements(improvements) {
  const rows = byId("rows");
  for (const each of improvements.slice(rows.children.length)) {
    rows.append(fillRow(make("tr"), [each.seconds, each.generation, each.cell, each.fitness, each.feasible ? "yes" : "no"]));
  }
}

function showCells(snapshot) {
  if (job === null) return;
  bests = Array(job.rows * job.columns).fill(null);
  const cells = bests.map(() => ({ value: null, state: "alive" })), { nodes } = snapshot;
  nodes.node.forEach((_, index) => {
    const cell = nodes.cell[index];
    if (nodes.job[index] !== job.number || hasEnded(job.status) || cell >= cells.length) return;
    bests[cell] = nodes.best[index];
    cells[cell] = { value: nodes.best[index], state: nodes.state[index] };
  });
  torus.show(job.rows, job.columns, cells);
}

// The planner's drawing: fetched again when there is a better solution, at most every second. What it has in three
// dimensions can be turned, if this browser can do so; the rest is a picture.
const scene = {
  shown: null, wanted: null, due: 0, timer: null, flat: !canTurn(),
  show(of) {
    this.wanted = of;
    if (this.wanted === this.shown || this.timer !== null) return;
    this.timer = setTimeout(() => this.fetch(), Math.max(0, this.due - Date.now()));
  },
  async fetch() {
    const of = this.wanted;
    const words = `The best solution of job ${id} so far, fitness ${number(job.best?.fitness)}`;
    try {
      const whole = !this.flat && await this.fetchSpaces(of, words);
      if (!whole) await this.fetchPicture(of, words);
      byId("scene").hidden = whole;
      setText(byId("no-scene"), "");
    } catch {
      setText(byId("no-scene"), "There is no picture of this problem.");
    }
    this.timer = null;
    this.due = Date.now() + SCENE_EVERY;
    this.shown = of;
    this.show(this.wanted);
  },
  async fetchSpaces(of, words) {
    const { spaces, whole } = await getJson(`${address}/spaces?of=${encodeURIComponent(of)}`);
    this.flat = spaces.length === 0;
    showSpaces(byId("spaces"), spaces, words);
    return whole;
  },
  async fetchPicture(of, words) {
    const image = new Image();
    image.src = `/jobs/${encodeURIComponent(id)}/scene.png?of=${encodeURIComponent(of)}`;
    await image.decode();
    byId("scene").src = image.src;
    byId("scene").alt = words;
  },
};

byId("cancel").addEventListener("click", async () => {
  try {
    await postJson(`${address}/cancel`, {});
  } catch (error) {
    setText(byId("trouble"), error.message);
  }
});
for (const each of ["against", "log"]) byId(each).addEventListener("change", () => job && showHistory());
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => job && showHistory());
follow(show);
