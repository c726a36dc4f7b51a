// The plan as a list: what is done, what goes on, what is to come. Of very long plans the part around now.

import { duration, element, made } from "./format.js";

const MOST = 240;
const WORTH = ["flap", "hold", "cycles"]; // stages that take too long to come and go unseen between two states

export class StageList {
  constructor() {
    this.list = element("stage-list");
    new ResizeObserver(() => this.scrollToNow()).observe(this.list);
  }

  begin(hello) {
    this.stages = hello.stages;
    this.first = -1;
    this.current = undefined;
    this.reached = -1; // the last stage that was under way
    this.leaps = []; // [from, to] of stages that were passed over
    this.show(0);
  }

  update(state) {
    const isStopped = Boolean(state.stop_asked || state.trip || (state.ended && state.ended !== "done"));
    if (state.ended === "done") this.reached = this.stages.length - 1;
    else if (this.current === undefined) this.reached = state.reached ?? -1; // a page that was opened late
    if (state.stage !== this.current || isStopped !== this.isStopped) this.go(state.stage, isStopped);
    const item = this.items.get(this.current);
    if (item) item.querySelector("progress").value = state.stage_done;
  }

  go(stage, isStopped) {
    const isFirst = this.current === undefined;
    if (!isFirst && stage > this.reached + 1) this.leaps.push([this.reached + 1, stage - 1]);
    this.current = stage;
    this.isStopped = isStopped;
    this.reached = stage < 0 ? this.reached : stage;
    this.show(Math.max(this.reached, 0));
    for (const [number, item] of this.items) this.mark(item, number);
    this.scrollToNow();
  }

  mark(item, number) {
    const isNow = number === this.current;
    item.className = isNow ? "now" : number > this.reached ? "" : this.isLeftOut(number) ? "left" : "past";
    if (isNow) item.setAttribute("aria-current", "step");
    else item.removeAttribute("aria-current");
  }

  // after a stop the run goes the way to safety, which may be the last stage of the plan: what lies before it was not done
  isLeftOut(number) {
    const leap = this.leaps.find(([from, to]) => from <= number && number <= to);
    return Boolean(this.isStopped && leap && this.stages.slice(leap[0], leap[1] + 1).some((stage) => WORTH.includes(stage.kind)));
  }

  // by hand, because scrollIntoView would move the page as well
  scrollToNow() {
    const item = this.items?.get(this.current);
    if (item) this.list.scrollTop = item.offsetTop - 0.3 * this.list.clientHeight;
  }

  show(around) {
    const first = Math.min(Math.max(0, around - MOST / 2), Math.max(0, this.stages.length - MOST));
    const kept = Math.abs(first - this.first) < MOST / 4 && this.first >= 0;
    if (kept) return;
    this.first = first;
    this.items = new Map(this.stages.slice(first, first + MOST).map((stage, i) => [first + i, itemOf(stage)]));
    const before = first ? [made("li", `… ${first} before`, "more")] : [];
    const left = this.stages.length - first - this.items.size;
    const after = left > 0 ? [made("li", `… ${left} more`, "more")] : [];
    this.list.replaceChildren(...before, ...this.items.values(), ...after);
    element("stages-head").textContent = `Stages (${this.stages.length})`;
  }
}

function itemOf(stage) {
  const item = made("li");
  item.dataset.kind = stage.kind;
  const bar = made("progress");
  bar.max = 1;
  bar.value = 0;
  bar.setAttribute("aria-label", stage.label);
  item.append(made("span", stage.label), made("small", stage.duration_s > 0 ? duration(stage.duration_s) : ""), bar);
  return item;
}
