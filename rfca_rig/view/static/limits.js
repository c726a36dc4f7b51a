// How far each limit is from its trip: a bar to the limit, a mark where it came nearest in this stage.

import { element, made, number, percent } from "./format.js";

const NEAR = 0.6;
const CLOSE = 0.85;

export class Limits {
  begin(hello) {
    this.rows = new Map(hello.limits.map((limit) => [limit.name, rowOf(limit)]));
    element("limit-list").replaceChildren(...[...this.rows.values()].map((row) => row.item));
  }

  update(state) {
    for (const [name, row] of this.rows) {
      const seen = state.limits[name];
      if (seen) tell(row, seen);
    }
  }
}

function rowOf(limit) {
  const item = made("li");
  const bar = made("div", "", "bar");
  bar.setAttribute("role", "meter");
  bar.setAttribute("aria-label", `${limit.name}, trip ${limit.code}`);
  bar.setAttribute("aria-valuemin", "0");
  const fill = made("i", "", "fill");
  const peak = made("i", "", "peak");
  bar.append(fill, peak);
  const value = made("b");
  const left = made("small");
  const named = made("p");
  const drawn = made("p");
  named.append(made("span", limit.name), value);
  drawn.append(bar, left);
  item.append(named, drawn);
  return { limit, item, bar, fill, peak, value, left };
}

function tell({ limit, item, bar, fill, peak, value, left }, seen) {
  const share = Math.min(Math.max(seen.share, 0), 1);
  const highest = Math.min(Math.max(seen.peak_share, share), 1);
  fill.style.width = percentage(share);
  peak.style.left = percentage(highest);
  const trips = seen.limit ?? limit.limit; // that of the following error grows with the speed
  value.textContent = `${number(seen.value)} of ${number(trips)} ${limit.unit}`;
  left.textContent = `${percent(1 - share)} left`;
  item.title = `trips with ${limit.code}; at its nearest in this stage, ${percent(1 - highest)} was left`;
  item.className = highest >= CLOSE ? "close" : highest >= NEAR ? "near" : "";
  bar.setAttribute("aria-valuenow", String(seen.value));
  bar.setAttribute("aria-valuemax", String(trips));
  bar.setAttribute("aria-valuetext", `${value.textContent}, ${left.textContent}`);
}

function percentage(share) {
  return `${(100 * share).toFixed(1)}%`;
}
