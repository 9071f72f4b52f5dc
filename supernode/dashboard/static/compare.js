// The page that compares runs: their fitness over time, their settings and results.

import { TROUBLED, byId, follow, getJson, hasEnded, make, number, setText } from "./common.js";
import { History, generation, line, plot, since } from "./history.js";

const MOST = 8; // runs that are compared
const LOADED_EVERY = 1000; // ms between two rounds of requests, at least
const ids = (new URLSearchParams(location.search).get("jobs") ?? "").split(",").map((id) => id.trim()).filter(Boolean);
const left = ids.length > MOST ? [`Only the first ${MOST} of ${ids.length} jobs are compared.`] : [];
const runs = ids.slice(0, MOST).map((id) => ({ id, job: null, history: new History(id), trouble: "" }));
let busy = false, due = 0;

async function show({ improvements }) {
  const stale = runs.filter((run) => run.job === null || !hasEnded(run.job.status) || !run.whole);
  if (busy || stale.length === 0 || Date.now() < due) return;
  busy = true;
  try {
    for (const run of stale) await load(run, improvements);
    const known = runs.filter((run) => run.job !== null);
    showPlots(known);
    showTable(known);
    showTroubles();
  } finally {
    busy = false;
    due = Date.now() + (runs.some((run) => run.trouble) ? TROUBLED : LOADED_EVERY);
  }
}

function showTroubles() {
  const troubles = runs.filter((run) => run.trouble).map(({ id, trouble }) => `${id}: ${trouble}`);
  setText(byId("trouble"), [...left, ...troubles].join("\n"));
}

async function load(run, improvements) {
  const over = run.job !== null && hasEnded(run.job.status); // then load once more: the last records come after the end
  try {
    run.job = await getJson(`/api/jobs/${encodeURIComponent(run.id)}`);
    run.history.hear(improvements.get(run.job.number));
    await run.history.load();
    [run.whole, run.trouble] = [over, ""];
  } catch (error) {
    run.trouble = error.message;
  }
}

function showPlots(known) {
  const drawn = (along) => known.map(({ id, job, history }) => {
    const x = along === "seconds" ? since(job.started ?? job.submitted) : generation;
    return line(id, along === "seconds" ? history.improvements : history.births, x, "fitness", { line: { shape: "hv" }, mode: "lines+markers" });
  });
  const bests = known.map(({ id, job }) => `${id} ${number(job.fitness)}`).join(", ");
  const say = (along) => `Best fitness of each run against ${along}, now: ${bests}`;
  plot(byId("seconds"), drawn("seconds"), ["seconds", "fitness"], say("seconds"));
  plot(byId("generation"), drawn("generation"), ["generation of its epoch", "fitness"], say("generations"));
}

function showTable(known) {
  const told = known.map(({ job }) => ({
    kind: job.kind, problem: job.name, status: job.status, fitness: job.fitness, topology: job.topology,
    "took / s": job.started && job.ended ? job.ended - job.started : null,
    generations: job.result?.generations, evaluations: job.result?.evaluations,
    "messages lost": job.result?.messages?.lost, ...job.run,
  }));
  const names = [...new Set(told.flatMap(Object.keys))];
  const say = (value) => (value !== null && typeof value === "object" ? JSON.stringify(value) : number(value));
  const head = make("tr", {}, make("th", { scope: "col" }, "setting"), ...known.map(({ id }) =>
    make("th", { scope: "col" }, make("a", { href: `/jobs/${encodeURIComponent(id)}` }, id))));
  const rows = names.map((name) => make("tr", {}, make("th", { scope: "row" }, name),
    ...told.map((each) => make("td", { class: "wrap" }, say(each[name])))));
  byId("table").replaceChildren(make("thead", {}, head), make("tbody", {}, ...rows));
}

byId("jobs").value = ids.join();
if (runs.length === 0) setText(byId("trouble"), "Name jobs, or choose them on the page of jobs.");
follow(show, { nodes: false });
