// Shared by all pages: live updates, small parts of a page, numbers for people.
// Text from the cluster enters a page only as text nodes and attributes, never as HTML.

export const TROUBLED = 3000; // ms until a failed request is tried again

export const byId = (id) => document.getElementById(id);

export function make(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

export function setText(element, text) {
  if (element.textContent !== String(text)) element.textContent = text;
}

export function number(value) {
  if (value === null || value === undefined) return "–";
  if (typeof value !== "number") return String(value);
  return Number.isInteger(value) ? value.toLocaleString("en") : Number(value.toPrecision(6)).toString();
}

// Date and time in the browser's time zone, as YYYY-MM-DD hh:mm:ss: a history has many days.
export const moment = (seconds) => new Date(seconds * 1000).toLocaleString("sv-SE");

const ENDS = ["solved", "optimal", "infeasible", "stalled", "exhausted", "deadline", "cancelled", "failed"];
export const hasEnded = (status) => ENDS.includes(status);

// Whether an improvement is better than another one of its job, or than none. A later epoch counts more; null is infinite.
export function isBetter(one, other) {
  if (!other || one.epoch !== other.epoch) return !other || one.epoch > other.epoch;
  return (one.fitness ?? Infinity) < (other.fitness ?? Infinity);
}

// Fills a list of facts. A list with the same names is changed in place, so that the page does not jump.
export function showFacts(list, facts) {
  const names = Object.keys(facts);
  if (list.dataset.names !== names.join()) {
    list.dataset.names = names.join();
    list.replaceChildren(...names.map((name) => make("div", {}, make("dt", {}, name), make("dd"))));
  }
  names.forEach((name, index) => setText(list.children[index].lastChild, number(facts[name])));
}

export function fillRow(row, texts) {
  while (row.children.length < texts.length) row.append(make("td"));
  texts.forEach((text, index) => setText(row.children[index], number(text)));
  return row;
}

// Returns the answer to a request. A refusal is thrown as an error with the server's words and its `status`.
export async function ask(address, options) {
  const answer = await fetch(address, options).catch(() => { throw new Error("the dashboard does not answer"); });
  if (answer.ok) return answer;
  const text = await answer.text(), isJson = answer.headers.get("Content-Type")?.startsWith("application/json");
  const words = (isJson ? JSON.parse(text).error : text.trim()) || answer.statusText;
  throw Object.assign(new Error(words), { status: answer.status });
}

export const getJson = async (address) => (await ask(address)).json();

export const postJson = async (address, value) => (await ask(address, {
  method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(value),
})).json();

// Announces the latest change to screen readers.
export const announce = (text) => setText(byId("live"), text);

// Announces where the keyboard's cursor is. It has an element of its own, so that changes do not overwrite it.
export const announceVisited = (text) => setText(byId("visited"), text);

// Calls `show` with each snapshot of the cluster while the page is visible: browsers allow few connections to a host.
// A page that does not show `nodes` is not sent them. Events without nodes get those of the event before.
// `improvements` of a snapshot are the latest of each job, by the job's number: they come in events of their own.
export function follow(show, { nodes }) {
  let last = null, source = null, timer = null, known = null;
  const pill = byId("link"), improvements = new Map();
  const say = (state, text) => { pill.dataset.state = state; setText(pill, text); };

  function hear(message) {
    const snapshot = JSON.parse(message.data);
    say(snapshot.answers ? "answers" : "lost", snapshot.answers ? `cluster ${snapshot.cluster}` : "no answer");
    pill.title = snapshot.trouble ?? "";
    const newest = snapshot.lines.at(-1);
    if (last !== null && newest && newest.number > last) announce(newest.text);
    last = newest ? newest.number : 0;
    snapshot.stirred = "nodes" in snapshot;
    known = snapshot.nodes ??= known;
    snapshot.improvements = improvements;
    show(snapshot);
  }

  function hearImprovement(message) {
    const improvement = JSON.parse(message.data);
    improvements.set(improvement.job, improvement);
  }

  function fail() {
    say("lost", "dashboard away");
    if (source.readyState !== EventSource.CLOSED) return;
    timer = setTimeout(open, TROUBLED); // refused: no browser retries
    sayIfLoggedOut();
  }

  // The page is not reloaded by itself: somebody may be filling in its form.
  async function sayIfLoggedOut() {
    const answer = await fetch("/jobs", { method: "HEAD" }).catch(() => null);
    if (answer?.status === 401) say("lost", "logged out: reload this page");
  }

  function open() {
    close();
    const address = nodes ? "/events" : "/events?nodes=0";
    if (document.hidden) return;
    source = Object.assign(new EventSource(address), { onmessage: hear, onerror: fail });
    source.addEventListener("improvement", hearImprovement);
  }

  function close() {
    clearTimeout(timer);
    source?.close();
  }

  document.addEventListener("visibilitychange", () => (document.hidden ? close() : open()));
  addEventListener("pagehide", close);
  addEventListener("pageshow", (event) => event.persisted && open()); // the page came from the back/forward cache
  open();
}

for (const link of document.querySelectorAll("header nav a")) {
  const here = link.pathname === "/" ? location.pathname === "/" : location.pathname.startsWith(link.pathname);
  if (here) link.setAttribute("aria-current", "page");
}
