// The history of a job, fetched from the cluster's store page by page, and how it is plotted.

import { getJson, isBetter } from "./common.js";

const MOST = 2000; // points of a curve
const LATEST = 200; // improvements that are all kept, for the table and the lineage

// Keeps an evenly spaced selection of a growing list of records, and always the last record.
class Thinned {
  records = [];
  #count = 0;
  #step = 1;

  push(record) {
    if ((this.#count - 1) % this.#step !== 0) this.records.pop(); // it was kept only for being the last
    this.records.push(record);
    this.#count += 1;
    if (this.records.length < MOST) return;
    this.#step *= 2;
    this.records = this.records.filter((each, index) => index % 2 === 0 || each === record);
  }
}

export class History {
  #kept = { improvements: new Thinned(), history: new Thinned(), statistics: new Thinned() };
  #last = { improvements: 0, history: 0, statistics: 0 };
  #latest = { improvements: [], history: [], statistics: [] };
  #live = null; // the latest improvement of the live updates

  constructor(job) { this.job = job; }

  get improvements() { return this.#withLive(this.#kept.improvements.records); } // as the spy received them
  get births() { return byBirth(this.#kept.history.records, this.improvements); }
  get latest() { return byBirth(this.#latest.history, this.#withLive(this.#latest.improvements)).slice(-LATEST); }
  get statistics() { return this.#kept.statistics.records; }

  // Takes an improvement of the live updates: the store may not have it yet. Returns whether it is a better one.
  hear(improvement) {
    if (!improvement || !isBetter(improvement, this.#live)) return false;
    const { epoch, generation, cell, fitness, at } = improvement;
    this.#live = { kind: "live", id: at, at, epoch, generation, cell, fitness };
    return true;
  }

  // A record of the store replaces the live one.
  #withLive(records) {
    return this.#live !== null && isBetter(this.#live, records.at(-1)) ? [...records, this.#live] : records;
  }

  // Fetches new records; returns whether there were any.
  async load() {
    let news = false, more = true;
    while (more) {
      const query = new URLSearchParams(this.#last);
      const pages = Object.entries(await getJson(`/api/jobs/${encodeURIComponent(this.job)}/history?${query}`));
      for (const [kind, page] of pages) this.#take(kind, page);
      more = pages.some(([, page]) => page.more);
      news ||= pages.some(([, page]) => page.rows.length > 0);
    }
    return news;
  }

  #take(kind, { columns, rows }) {
    const records = rows.map((row) => ({ kind, ...Object.fromEntries(columns.map((name, index) => [name, row[index]])) }));
    for (const record of records) this.#kept[kind].push(record);
    this.#last[kind] = records.at(-1)?.id ?? this.#last[kind];
    this.#latest[kind] = [...this.#latest[kind], ...records].slice(-LATEST);
  }
}

// Of each epoch that has ended, the improvements as its cells recorded them; of any other, as the spy received them.
function byBirth(noted, heard) {
  const ended = new Set(noted.map((each) => each.epoch));
  return [...noted, ...heard.filter((each) => !ended.has(each.epoch))].sort((one, other) => one.epoch - other.epoch);
}

export const since = (start) => (record) => record.at - start;
export const generation = (record) => record.generation;

// Where a line of improvements, or one of statistics, is interrupted: the same places as in the report.
const isOfNewEpoch = (before, record) => record.epoch !== before.epoch;
export const isOfNewLife = (before, record) => isOfNewEpoch(before, record) || record.generation < before.generation;

export function line(name, records, x, y, more = {}, beginsAnew = isOfNewEpoch) {
  const points = records.flatMap((record, index) => {
    const point = [x(record), record[y]];
    return index > 0 && beginsAnew(records[index - 1], record) ? [[null, null], point] : [point];
  });
  const mode = points.length > 1 ? "lines" : "markers"; // no line leads to a single point
  return { name, x: points.map(([x]) => x), y: points.map(([, y]) => y), mode, ...more };
}

// Plots `lines`. `words` describe the plot to screen readers.
export function plot(element, lines, titles, words, more = {}) {
  const style = getComputedStyle(document.documentElement), of = (name) => style.getPropertyValue(name).trim();
  const axis = { gridcolor: of("--line"), zerolinecolor: of("--line") };
  const { yaxis, ...rest } = more;
  element.setAttribute("aria-label", words);
  Plotly.react(element, lines, {
    margin: { l: 64, r: 56, t: 8, b: 44 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: { color: of("--ink"), family: "system-ui, sans-serif" }, legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom" },
    dragmode: matchMedia("(pointer: coarse)").matches ? false : "zoom", // a finger scrolls the page
    showlegend: true, xaxis: { ...axis, title: { text: titles[0] }, rangemode: "tozero" },
    yaxis: { ...axis, title: { text: titles[1] }, exponentformat: "power", ...yaxis }, uirevision: "same", ...rest,
  }, { displayModeBar: false, responsive: true });
}
