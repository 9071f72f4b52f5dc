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

export const clock = (seconds) => new Date(seconds * 1000).toLocaleTimeString("en-GB");

export const hasEnded = (status) => ["solved", "stalled", "exhausted", "deadline", "cancelled", "failed"].includes(status);

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

export async function getJson(address) {
  const answer = await fetch(address);
  const told = await answer.json();
  if (!answer.ok) throw new Error(told.error);
  return told;
}

export async function postJson(address, value) {
  const answer = await fetch(address, {
    method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(value),
  });
  const told = await answer.json().catch(() => ({ error: answer.statusText }));
  if (!answer.ok) throw new Error(told.error);
  return told;
}

// For screen readers: the latest change.
export const announce = (text) => setText(byId("live"), text);

// Calls `show` with each snapshot of the cluster.
export function follow(show) {
  let last = null, unseen = null;
  const pill = byId("link");
  const say = (state, text) => { pill.dataset.state = state; setText(pill, text); };
  const source = new EventSource("/events");
  source.onmessage = (message) => {
    const snapshot = JSON.parse(message.data);
    say(snapshot.answers ? "answers" : "lost", snapshot.answers ? `cluster ${snapshot.cluster}` : "no answer");
    pill.title = snapshot.trouble ?? "";
    const newest = snapshot.lines.at(-1);
    if (last !== null && newest && newest.number > last) announce(newest.text);
    last = newest ? newest.number : 0;
    if (document.hidden) unseen = snapshot; // nobody looks
    else show(snapshot);
  };
  document.addEventListener("visibilitychange", () => {
    if (unseen && !document.hidden) show(unseen);
    unseen = null;
  });
  source.onerror = () => say("lost", "dashboard away");
  addEventListener("pagehide", () => source.close());
}

for (const link of document.querySelectorAll("header nav a")) {
  const here = link.pathname === "/" ? location.pathname === "/" : location.pathname.startsWith(link.pathname);
  if (here) link.setAttribute("aria-current", "page");
}
