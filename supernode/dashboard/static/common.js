// What all pages share: live news, small pieces of page, numbers for people. Text from outside is only ever text.

export const TROUBLED = 3000; // ms until what failed is tried again

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

// A date and a time, as here; a history has many days.
export const moment = (seconds) => new Date(seconds * 1000).toLocaleString("sv-SE");

const ENDS = ["solved", "optimal", "infeasible", "stalled", "exhausted", "deadline", "cancelled", "failed"];
export const hasEnded = (status) => ENDS.includes(status);

// A list of facts; what is there already is changed in place, so that nothing jumps.
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

// The answer to a request; a refusal becomes an error that says the same, and has its `status`.
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

// For screen readers: the latest change.
export const announce = (text) => setText(byId("live"), text);

// And what the keyboard is at, which no change takes the place of.
export const announceVisited = (text) => setText(byId("visited"), text);

// Calls `show` with each snapshot of the cluster, while the page is seen: a browser has few connections to a host.
// A page that shows no `nodes` is not sent them; another has those of before where there is no news of them.
export function follow(show, { nodes }) {
  let last = null, source = null, timer = null, known = null;
  const pill = byId("link");
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
    show(snapshot);
  }

  function fail() {
    say("lost", "dashboard away");
    if (source.readyState === EventSource.CLOSED) timer = setTimeout(open, TROUBLED); // it was refused: no browser retries
  }

  function open() {
    close();
    const address = nodes ? "/events" : "/events?nodes=0";
    if (!document.hidden) source = Object.assign(new EventSource(address), { onmessage: hear, onerror: fail });
  }

  function close() {
    clearTimeout(timer);
    source?.close();
  }

  document.addEventListener("visibilitychange", () => (document.hidden ? close() : open()));
  addEventListener("pagehide", close);
  addEventListener("pageshow", (event) => event.persisted && open()); // by the button Back
  open();
}

for (const link of document.querySelectorAll("header nav a")) {
  const here = link.pathname === "/" ? location.pathname === "/" : location.pathname.startsWith(link.pathname);
  if (here) link.setAttribute("aria-current", "page");
}
