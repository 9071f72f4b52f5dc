// The page of jobs: queue and history, and a form to submit a job.

import { announce, ask, byId, follow, hasEnded, make, moment, number, postJson, setText } from "./common.js";

const rows = new Map(), mayCancel = document.body.dataset.access === "full";

function show(snapshot) {
  byId("none").hidden = snapshot.jobs.length > 0;
  const known = new Set(snapshot.jobs.map((job) => job.job));
  for (const [id, row] of rows) if (!known.has(id)) { row.remove(); rows.delete(id); }
  for (const job of snapshot.jobs) {
    if (!rows.has(job.job)) byId("rows").prepend(newRow(job.job));
    update(rows.get(job.job), job, snapshot.at);
  }
}

function newRow(id) {
  const box = make("input", { type: "checkbox", value: id, "aria-label": `choose ${id}` });
  const link = make("a", { href: `/jobs/${encodeURIComponent(id)}` }, id);
  const cells = Array.from({ length: 9 }, () => make("td"));
  cells[0].append(box);
  cells[1].append(link);
  if (mayCancel) cells[8].append(newCancel(id));
  cells[3].className = "wrap";
  const row = make("tr", {}, ...cells);
  rows.set(id, row);
  return row;
}

function newCancel(id) {
  const cancel = make("button", { type: "button", "aria-label": `cancel ${id}` }, "Cancel");
  cancel.addEventListener("click", () => attempt(() => postJson(`/api/jobs/${encodeURIComponent(id)}/cancel`, {})));
  return cancel;
}

function update(row, job, now) {
  const from = job.started ?? job.submitted, took = (job.ended ?? now) - from;
  const status = job.message ? `${job.status}: ${job.message}` : job.status;
  const texts = [job.kind, status, number(job.fitness), number(job.cells), moment(job.submitted), `${took.toFixed(1)} s`];
  texts.forEach((text, index) => setText(row.children[index + 2], text));
  row.children[3].dataset.state = job.status;
  if (mayCancel) row.children[8].firstChild.hidden = hasEnded(job.status);
}

// Does some work and returns whether it succeeded; if not, the page says why.
async function attempt(work) {
  setText(byId("trouble"), "");
  try {
    await work();
    return true;
  } catch (error) {
    setText(byId("trouble"), error.message);
    return false;
  }
}

byId("compare").addEventListener("click", () => {
  const chosen = [...document.querySelectorAll("#rows input:checked")].map((box) => box.value);
  location.assign(`/compare?jobs=${chosen.join()}`);
});

function prepareForm(form) {
  const fields = form.elements;
  fields.kind.addEventListener("change", () => attempt(async () => {
    const kind = fields.kind.value;
    fields.file.value = kind ? await (await ask(`/api/templates/${kind}`)).text() : "";
    fields.name.value = kind ? `${kind}.toml` : "form.toml";
  }));
  fields.upload.addEventListener("change", () => attempt(async () => {
    const [file] = fields.upload.files;
    if (!file) return;
    fields.file.value = await file.text();
    fields.name.value = file.name;
  }));
  const button = form.querySelector("button");
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    button.disabled = true; // a second click would submit a second job
    button.disabled = await attempt(async () => {
      const { job } = await postJson("/api/jobs", Object.fromEntries(new FormData(form)));
      announce(`job ${job} is submitted`);
      location.assign(`/jobs/${encodeURIComponent(job)}`);
    });
  });
  addEventListener("pageshow", () => { button.disabled = false; }); // the page may come from the back/forward cache
}

if (byId("submit")) prepareForm(byId("submit")); // a single run takes no jobs, and who may only look submits none
follow(show, { nodes: false });
