// The page of the cluster: its nodes on the torus, one node in detail, and what happened lately.

import { byId, fillRow, follow, getJson, make, moment, number, setText, showFacts } from "./common.js";
import { Torus } from "./torus.js";

const COLUMNS = ["node", "state", "cell", "generation", "champion", "best", "age", "sent"];
const SHOWN = {
  state: "state", process: "process", cell: "cell", job: "job", epoch: "epoch", generation: "generation",
  evaluations: "evaluations", best: "best", median: "median", worst: "worst", champion: "champion", age: "champion's age",
  sent: "sent", received: "received", lost: "lost", rejected: "rejected", deaths: "deaths", megabytes: "memory / MB",
};
const MEANINGS = {
  champion: "champion's fitness, lower is better", best: "best fitness of the deme, lower is better",
  age: "champion's age in generations", sent: "messages sent",
};
// `chosen` is the number of the node in detail. `asking` keeps a slow answer about it from queueing up more questions.
let nodes = null, chosen = null, asking = false, latest = null;

const torus = new Torus(byId("torus"), byId("legend"), {
  choose: (index) => { if (index in nodes.node) { chosen = nodes.node[index]; showNode(); } },
  describe: (index) => (index in nodes.node
    ? `node ${nodes.node[index]}, ${nodes.state[index]}, ${byId("what").value} ${value(index)}` : "no node"),
});
const value = (index) => number(nodes[byId("what").value][index]);

function show(snapshot) {
  latest = snapshot;
  nodes = snapshot.nodes;
  const states = (name) => nodes.state.filter((state) => state === name).length;
  showUnprotected(snapshot.unprotected);
  showFacts(byId("facts"), {
    nodes: nodes.node.length - states("absent"), alive: states("alive"), dead: states("dead"), joining: states("joining"),
    ...Object.fromEntries(Object.entries(snapshot.counts).map(([status, count]) => [`jobs ${status}`, count])),
    ...Object.fromEntries(snapshot.placements.map((spread) => [`cells of ${spread.job} by host`, spreadOf(spread)])),
  });
  // Only when nodes were sent: redrawing a thousand squares costs the browser time.
  if (snapshot.stirred) showTorus();
  if (snapshot.stirred && byId("all").open) showTable();
  showLines(snapshot.lines);
  if (chosen !== null) showNode();
}

function showUnprotected(endpoints) {
  const note = byId("unprotected");
  note.hidden = endpoints.length === 0;
  const text = `Not protected: whoever reaches ${endpoints.join(" or ")} can use, and misuse, this cluster.`;
  if (!note.hidden && note.textContent !== text) note.textContent = text;
}

function spreadOf({ hosts, crossing, edges }) {
  const cells = Object.entries(hosts).map(([host, count]) => `${host} ${count}`).join(", ");
  return `${cells}; ${Math.round(100 * crossing / edges)} % of edges cross`;
}

function showTorus() {
  const what = byId("what").value, at = nodes.job;
  const cells = nodes.state.map((state, index) => ({ state, value: nodes[what][index], job: at[index] }));
  const none = at.some((job) => job !== null) ? "nothing feasible yet" : "no job on the nodes";
  torus.show(latest.rows, latest.columns, cells, MEANINGS[what], none);
}

function showTable() {
  const rows = byId("rows");
  while (rows.children.length > nodes.node.length) rows.lastChild.remove();
  nodes.node.forEach((_, index) => {
    const row = rows.children[index] ?? rows.appendChild(make("tr"));
    fillRow(row, COLUMNS.map((name) => nodes[name][index]));
    row.children[1].dataset.state = nodes.state[index];
  });
}

function showLines(lines) {
  const list = byId("lines"), newest = String(lines.at(-1)?.number ?? 0);
  if (list.dataset.newest === newest) return;
  list.dataset.newest = newest;
  list.replaceChildren(...lines.toReversed().map((line) =>
    make("li", { "data-level": line.level }, make("time", {}, moment(line.at)), line.text)));
}

async function showNode() {
  if (asking) return;
  asking = true;
  try {
    const told = await getJson(`/api/nodes/${chosen}`);
    if (typeof told.memory === "number") told.megabytes = Math.round(told.memory / 1e6);
    setText(byId("node-title"), `Node ${chosen}`);
    byId("hint").hidden = true;
    const facts = Object.entries(SHOWN).filter(([name]) => told[name] !== undefined);
    showFacts(byId("node"), Object.fromEntries(facts.map(([name, words]) => [words, told[name]])));
  } catch { /* the node or the dashboard is gone: keep showing what was known */ } finally {
    asking = false;
  }
}

byId("what").addEventListener("change", () => nodes && showTorus());
byId("all").addEventListener("toggle", () => nodes && showTable());
follow(show, { nodes: true });
