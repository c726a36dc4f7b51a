// Counters that say whether what is seen can be trusted; bad ones stand out, in words too.

import { element, made } from "./format.js";

export class Health {
  begin() {
    this.said = "";
  }

  update(state) {
    const said = JSON.stringify(state.health);
    if (said === this.said) return;
    this.said = said;
    const bad = state.health.filter((entry) => !entry.is_good).length;
    const head = element("health-head");
    head.textContent = bad ? `Health: ${bad} bad` : "Health";
    head.className = bad ? "bad" : "";
    element("health-list").replaceChildren(...state.health.map(entryOf));
  }
}

function entryOf(entry) {
  const row = made("div", "", entry.is_good ? "" : "bad");
  row.append(made("dt", entry.name), made("dd", entry.is_good ? entry.value : `${entry.value} – bad`));
  return row;
}
