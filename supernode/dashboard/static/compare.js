// Runs side by side: their fitness over time, their settings and results.

import { byId, follow, getJson, hasEnded, make, number, setText } from "./common.js";
import { History, generation, line, plot, since } from "./history.js";

const MOST = 8; // runs
const ids = (new URLSearchParams(location.search).get("jobs") ?? "").split(",").map((id) => id.trim()).filter(Boolean);
const runs = ids.slice(0, MOST).map((id) => ({ id, job: null, history: new History(id) }));
let busy = false, loaded = 0;

async function show() {
  const stale = runs.filter((run) => run.job === null || !hasEnded(run.job.status) || !run.whole);
  if (busy || stale.length === 0 || Date.now() - loaded < 1000) return;
  busy = true;
  try {
    for (const run of stale) {
      run.whole = run.job !== null && hasEnded(run.job.status);
      run.job = await getJson(`/api/jobs/${encodeURIComponent(run.id)}`);
      await run.history.load();
    }
    showPlots();
    showTable();
    setText(byId("trouble"), "");
  } catch (error) {
    setText(byId("trouble"), error.message);
  } finally {
    busy = false;
    loaded = Date.now();
  }
}

function showPlots() {
  const drawn = (along) => runs.map(({ id, job, history }) => {
    const x = along === "seconds" ? since(job.started ?? job.submitted) : generation;
    return line(id, history.improvements, x, "fitness", { line: { shape: "hv" }, mode: "lines+markers" });
  });
  for (const along of ["seconds", "generation"]) plot(byId(along), drawn(along), [along, "fitness"]);
}

function showTable() {
  const told = runs.map(({ job }) => ({
    kind: job.kind, problem: job.name, status: job.status, fitness: job.fitness, topology: job.topology,
    "took / s": job.started && job.ended ? job.ended - job.started : null,
    generations: job.result?.generations, evaluations: job.result?.evaluations,
    "messages lost": job.result?.messages?.lost, ...job.run,
  }));
  const names = [...new Set(told.flatMap(Object.keys))];
  const say = (value) => (value !== null && typeof value === "object" ? JSON.stringify(value) : number(value));
  const head = make("tr", {}, make("th", { scope: "col" }, "setting"), ...runs.map(({ id }) =>
    make("th", { scope: "col" }, make("a", { href: `/jobs/${encodeURIComponent(id)}` }, id))));
  const rows = names.map((name) => make("tr", {}, make("th", { scope: "row" }, name),
    ...told.map((each) => make("td", { class: "wrap" }, say(each[name])))));
  byId("table").replaceChildren(make("thead", {}, head), make("tbody", {}, ...rows));
}

byId("jobs").value = ids.join();
if (runs.length === 0) setText(byId("trouble"), "Name jobs, or choose them on the page of jobs.");
follow(show);
