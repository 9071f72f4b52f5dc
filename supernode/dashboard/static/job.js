// The page of a job: convergence, diversity, lineage, and the best solution or attempt so far.

import {
  TROUBLED, announce, ask, byId, fillRow, follow, getJson, hasEnded, isBetter, make, number, postJson, setText, showFacts,
} from "./common.js";
import { History, generation, isOfNewLife, line, plot, since } from "./history.js";
import { Moving } from "./moving.js";
import { canTurn, showSpaces } from "./spaces.js";
import { Torus } from "./torus.js";

const LINEAGE = 40; // births that are drawn
const SCENE_EVERY = 1100; // ms between two pictures
const LOOK_EVERY = 2000; // ms between two requests for the job when the live updates do not say that it has changed
const REST = 20; // pause after drawing the curves, as a multiple of the time it took: a busy machine has other work
const id = byId("job").dataset.job, address = `/api/jobs/${encodeURIComponent(id)}`;
const history = new History(id);
// `heard` is what the live updates said when all was last fetched: as long as it is the same, nothing is fetched.
// Improvements are not part of it: the live updates have all of an improvement, before the store has it.
// `patient` and `due` are times before which a failed request is not repeated, and the curves are not drawn again.
let job = null, latest = null, busy = false, patient = 0, heard = "", due = 0, stale = true, bests = [];

const torus = new Torus(byId("torus"), byId("legend"), {
  describe: (cell) => `cell ${cell}, node ${job.nodes[cell] ?? "none"}, best ${number(bests[cell])}`,
});

async function show(snapshot) {
  latest = snapshot;
  if (job !== null) showLive();
  const line = snapshot.jobs.find((each) => each.job === id);
  const now = JSON.stringify([line, statistics()?.generation]);
  if (busy || now === heard || Date.now() < patient) return;
  if (job?.status === line?.status && Date.now() < due) return;
  busy = true;
  try {
    const over = job !== null && hasEnded(job.status); // then load once more: the last records come after the end
    job = await getJson(address);
    showJob();
    showCells();
    history.hear(live());
    stale = (await history.load()) || stale;
    if (stale) showHistory();
    if (!stale && (over || !hasEnded(job.status))) heard = now;
    setText(byId("trouble"), "");
  } catch (error) {
    setText(byId("trouble"), error.message);
    patient = Date.now() + TROUBLED;
  } finally {
    busy = false;
  }
}

// Shows what the live updates themselves hold of the job.
function showLive() {
  if (latest.stirred) showCells();
  showJob();
  stale = history.hear(live()) || stale;
  // Not before the records are there: the latest improvement alone would be drawn as a flat curve.
  if (stale && due > 0 && Date.now() >= due) showHistory();
}

const live = () => latest.improvements.get(job.number);

// The best answer: that of the live updates, unless it is of another epoch or the cluster knows a better one.
const bestAnswer = () => live()?.epoch === job.epoch && isBetter(live(), job.best) ? live() : job.best;

// The latest statistics of the job, or the last recorded ones.
const statistics = () => latest.statistics[job?.number] ?? history.statistics.at(-1);

function showJob() {
  const { name, kind, status, topology, result } = job, now = statistics(), answer = bestAnswer();
  const end = job.ended ?? latest.at;
  showFacts(byId("facts"), {
    status, fitness: fitness(), feasible: answer === null ? null : answer.feasible ? "yes" : "no",
    problem: name, kind, topology, seed: job.run.seed, epoch: job.epoch,
    seconds: job.started ? Number((end - job.started).toFixed(1)) : null,
    generations: result?.generations ?? now?.generation, evaluations: result?.evaluations ?? now?.evaluations,
    "best alive": now?.best, "median alive": now?.median, "worst alive": now?.worst,
    diversity: now && `${Math.round(100 * now.diversity)} %`, "champion's age": now?.age,
    ...(job.message && { message: job.message }),
    ...(result?.advice?.length && { "what to turn": result.advice.join("; ") }),
  });
  if (byId("job").dataset.status !== status) announce(`job ${id} is ${status}`);
  byId("job").dataset.status = status;
  if (byId("cancel")) byId("cancel").hidden = hasEnded(status);
  setText(byId("scene-title"), `${found()} so far`);
  scene.show(JSON.stringify(answer === null ? [job.epoch] : [answer.epoch, answer.fitness, job.epoch]));
  byId("solution").parentElement.hidden = answer === null;
  setText(byId("solution"), answer === null ? "" : JSON.stringify(answer.solution, null, 1));
}

const fitness = () => bestAnswer() === job.best ? job.fitness : bestAnswer().fitness;

// What the check rejects is not called a solution.
const found = () => bestAnswer() === null || bestAnswer().feasible ? "The best solution" : "The best attempt (infeasible)";

function showHistory() {
  const began = Date.now();
  const seconds = byId("against").value === "seconds";
  const x = seconds ? since(job.started ?? job.submitted) : generation;
  const along = seconds ? "seconds" : "generation of its epoch", { statistics } = history;
  const lines = [
    line("worst", statistics, x, "worst", { line: { color: "#b0713c", width: 1 } }, isOfNewLife),
    line("median", statistics, x, "median", { line: { color: "#8a4fbf", width: 1.5 } }, isOfNewLife),
    line("best", statistics, x, "best", { line: { color: "#2a8c4a", width: 1.5 } }, isOfNewLife),
    line(seconds ? "verified" : "best so far", seconds ? history.improvements : history.births, x, "fitness",
      { line: { color: "#3b82d6", width: 2.5, shape: "hv" }, mode: "lines+markers", marker: { size: 5 } }),
  ];
  const now = history.statistics.at(-1), [best, median, worst, age] =
    ["best", "median", "worst", "age"].map((name) => number(now?.[name]));
  const words = `Fitness against ${along}, now: verified ${number(fitness())}, of those alive best ${best}, median ${median}, worst ${worst}`;
  plot(byId("convergence"), lines, [along, "fitness"], words, { yaxis: { type: byId("log").checked ? "log" : "linear" } });
  plot(byId("diversity"), [
    line("diversity", statistics, x, "diversity", { line: { color: "#2a8c4a" } }, isOfNewLife),
    line("champion's age", statistics, x, "age", { yaxis: "y2", line: { color: "#c8321e", width: 1 } }, isOfNewLife),
  ], [along, "diversity"], `Diversity against ${along}, now ${number(now?.diversity)}; the champion's age ${age}`, {
    yaxis: { range: [0, 1.05] },
    yaxis2: { title: { text: "age / generations" }, overlaying: "y", side: "right", rangemode: "tozero", showgrid: false,
      tickmode: "auto", nticks: 5, tickformat: ",d" },
  });
  showBirths(history.latest);
  stale = false;
  due = Date.now() + Math.max(LOOK_EVERY, REST * (Date.now() - began));
}

function showBirths(improvements) {
  const epoch = improvements.at(-1)?.epoch, rows = byId("rows");
  const born = improvements.filter((each) => each.epoch === epoch).slice(-LINEAGE).map((each) => each.cell);
  torus.trace(born, job.wraps);
  const keys = improvements.map((each) => `${each.kind} ${each.id}`);
  while (rows.firstElementChild && rows.firstElementChild.dataset.key !== keys[0]) rows.firstElementChild.remove();
  for (const [index, each] of improvements.entries()) {
    const old = rows.children[index];
    if (old?.dataset.key === keys[index]) continue;
    const texts = [each.epoch, each.generation, each.cell, each.evaluations, each.fitness];
    const row = fillRow(make("tr", { "data-key": keys[index] }), texts);
    if (old) old.replaceWith(row);
    else rows.append(row);
  }
  while (rows.children.length > improvements.length) rows.lastElementChild.remove();
}

// Shows each cell with the state of its node. A node's value counts only if the node reports this job.
function showCells() {
  const { nodes } = latest, indices = new Map(nodes.node.map((node, index) => [node, index]));
  const at = hasEnded(job.status) ? [] : job.nodes.map((node) => indices.get(node));
  const cells = Array.from({ length: job.rows * job.columns }, (_, cell) => {
    const index = at[cell], state = nodes.state[index] ?? "alive";
    return { state, value: nodes.job[index] === job.number ? nodes.best[index] : null };
  });
  bests = cells.map(({ value }) => value);
  torus.show(job.rows, job.columns, cells, "best fitness of the deme, lower is better", noBests());
}

function noBests() {
  if (hasEnded(job.status)) return "the job has ended";
  return job.nodes.length ? "nothing feasible yet" : "the job is on no nodes yet";
}

const moving = new Moving(byId("spaces"), `${address}/bodies`);

// The planner's drawing. It is fetched when there is a better answer, at most every SCENE_EVERY, and again after a
// failure. What it has in three dimensions can be turned if the browser has WebGL; the rest is a picture. Robots move.
const scene = {
  shown: null, wanted: null, due: 0, timer: null, flat: !canTurn(),
  show(of) {
    this.wanted = of;
    if (this.wanted === this.shown || this.timer !== null) return;
    this.timer = setTimeout(() => this.fetch(), Math.max(0, this.due - Date.now()));
  },
  async fetch() {
    const of = this.wanted;
    const words = `${found()} of job ${id} so far, fitness ${number(bestAnswer()?.fitness)}`;
    let wait = SCENE_EVERY;
    try {
      const whole = !this.flat && await this.fetchSpaces(of, words);
      if (!whole) await this.fetchPicture(of, words);
      byId("scene").hidden = whole;
      setText(byId("no-scene"), "");
      this.shown = of;
    } catch (error) {
      setText(byId("no-scene"), error.message);
      if (error.status === 400) this.shown = of; // there will be none
      else wait = TROUBLED;
    }
    this.timer = null;
    this.due = Date.now() + wait;
    this.show(this.wanted);
  },
  async fetchSpaces(of, words) {
    const { spaces, whole, animation } = await getJson(`${address}/spaces?of=${encodeURIComponent(of)}`);
    if (animation) {
      await moving.show(animation, words);
      return whole;
    }
    this.flat = spaces.length === 0;
    showSpaces(byId("spaces"), spaces, words);
    return whole;
  },
  async fetchPicture(of, words) {
    const picture = await (await ask(`/jobs/${encodeURIComponent(id)}/scene.png?of=${encodeURIComponent(of)}`)).blob();
    byId("scene").src = await asDataUrl(picture);
    byId("scene").alt = words;
  },
};

const asDataUrl = (blob) => new Promise((done, fail) => {
  const reader = new FileReader();
  reader.onload = () => done(reader.result);
  reader.onerror = () => fail(reader.error);
  reader.readAsDataURL(blob);
});

byId("cancel")?.addEventListener("click", async () => {
  try {
    await postJson(`${address}/cancel`, {});
  } catch (error) {
    setText(byId("trouble"), error.message);
  }
});
for (const each of ["against", "log"]) byId(each).addEventListener("change", () => job && showHistory());
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => job && showHistory());
follow(show, { nodes: true });
