// What happened in a job, from the cluster's store, page by page; and how it is plotted.

import { getJson } from "./common.js";

export class History {
  constructor(job) {
    Object.assign(this, { job, improvements: [], statistics: [], last: { improvements: 0, statistics: 0 } });
  }

  // Fetch what is new; true if there is anything.
  async load() {
    let news = false, more = true;
    while (more) {
      const { improvements, statistics } = this.last;
      const query = `improvements=${improvements}&statistics=${statistics}`;
      const pages = await getJson(`/api/jobs/${encodeURIComponent(this.job)}/history?${query}`);
      more = false;
      for (const [kind, page] of Object.entries(pages)) {
        for (const row of page.rows) this[kind].push(Object.fromEntries(page.columns.map((name, index) => [name, row[index]])));
        this.last[kind] = page.rows.at(-1)?.[0] ?? this.last[kind];
        more ||= page.more;
        news ||= page.rows.length > 0;
      }
    }
    return news;
  }
}

export const since = (start) => (record) => record.at - start;
export const generation = (record) => record.generation;

export function line(name, records, x, y, more = {}) {
  return { name, x: records.map(x), y: records.map((record) => record[y]), mode: "lines", ...more };
}

export function plot(element, lines, titles, more = {}) {
  const style = getComputedStyle(document.documentElement), of = (name) => style.getPropertyValue(name).trim();
  const axis = { gridcolor: of("--line"), zerolinecolor: of("--line") };
  const { yaxis, ...rest } = more;
  Plotly.react(element, lines, {
    margin: { l: 64, r: 56, t: 8, b: 44 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: { color: of("--ink"), family: "system-ui, sans-serif" }, legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom" },
    showlegend: true, xaxis: { ...axis, title: { text: titles[0] }, rangemode: "tozero" },
    yaxis: { ...axis, title: { text: titles[1] }, exponentformat: "power", ...yaxis }, uirevision: "same", ...rest,
  }, { displayModeBar: false, responsive: true });
}
