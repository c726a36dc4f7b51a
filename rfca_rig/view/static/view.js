// The live view: messages of the server to what shows them. See docs/live-view.md.

import { Alerts } from "./alerts.js";
import { Buckets } from "./buckets.js";
import { Connection } from "./connection.js";
import { duration, element, percent } from "./format.js";
import { Health } from "./health.js";
import { LegPicture } from "./leg.js";
import { Limits } from "./limits.js";
import { Pausing } from "./pausing.js";
import { Replay } from "./replay.js";
import { StageList } from "./stages.js";
import { Stopping } from "./stopping.js";
import { Traces } from "./traces.js";

const MARKS = { SIM: "a twin, nothing moves", REAL: "a shaft that moves", IMPORT: "a recording from elsewhere" };
const TAKES = { hello, trace, state, leg, expected, strokes };

const connection = new Connection((message) => TAKES[message.kind]?.(message), checked);
const alerts = new Alerts();
const traces = new Traces(connection);
const picture = new LegPicture();
const stopping = new Stopping(connection);
const pausing = new Pausing(connection);
const replay = new Replay(connection);
const parts = [new StageList(), new Limits(), new Health(), picture, stopping, pausing, replay, alerts];
const shown = { hello: null, buckets: null, state: null, leg: null, isNew: false };

function hello(message) {
  const channels = message.channels.map((channel) => channel.name);
  const same = shown.buckets && JSON.stringify(shown.buckets.names) === JSON.stringify(channels) && shown.wasOpen;
  shown.hello = message;
  shown.wasOpen = true;
  document.body.className = `mark-${message.mark} mode-${message.mode}`;
  showMark(message);
  element("title").textContent = message.title;
  for (const part of parts) part.begin(message);
  traces.expected.clear();
  if (same) return; // a plan that changed leaves the traces as they are
  shown.buckets = new Buckets(channels);
  traces.begin(message, shown.buckets);
}

function showMark(message) {
  const mark = element("mark");
  const says = MARKS[message.mark] ?? "";
  mark.className = `mark ${message.mark}`;
  mark.querySelector("b").textContent = message.mark;
  mark.querySelector("span").textContent = message.mode === "replay" ? "replay" : says;
  mark.setAttribute("aria-label", `${message.mark}: ${says}${message.mode === "replay" ? ", replayed" : ""}`);
}

function trace(message) {
  if (!shown.buckets) return;
  shown.buckets.add(message);
  shown.buckets.forgetBefore(traces.fromS - 0.1 * traces.spanS); // here, because a page that nobody sees paints nothing
  shown.isNew = true;
}

function expected(message) {
  traces.expected.takeCondition(message);
}

function strokes(message) {
  traces.expected.takeStrokes(message);
}

function leg(message) {
  shown.leg = message;
  shown.isNew = true;
}

function state(message) {
  if (!shown.hello) return;
  shown.state = message;
  for (const part of parts) part.update?.(message);
  showProgress(message);
  element("going-on").textContent = message.stage_label ?? shown.hello.stages[message.stage]?.label ?? "";
  showSaid(message.said);
}

// a run that was cut short is over, but it is not done
function showProgress({ done, ended, eta_s: etaS, now_s: nowS }) {
  element("done").value = done;
  const left = etaS === null ? "" : `, ${duration(etaS)} to go`;
  const cutShort = ended !== null && ended !== "done" ? "cut short at " : "";
  const paused = shown.state?.pause === "paused" ? "paused at " : "";
  const live = `${paused}${cutShort}${percent(done)} after ${duration(nowS)}${left}`;
  element("eta").textContent = shown.hello.mode === "live" ? live : percent(done);
}

function showSaid(lines) {
  const box = element("said-lines");
  const text = lines.join("\n");
  if (box.textContent === text) return;
  box.textContent = text;
  box.scrollTop = box.scrollHeight;
}

function checked(status, silentMs) {
  if (status !== "open") shown.wasOpen = false;
  alerts.showConnection(status, silentMs);
  alerts.checkStandstill(status);
  document.title = titleFor(status);
}

function titleFor(status) {
  if (["lost", "refused", "full"].includes(status)) return alerts.isEnded ? `ended – ${shown.hello?.title ?? ""}` : "CONNECTION LOST";
  if (shown.state?.trip) return `TRIP ${shown.state.trip.code}`;
  if (shown.state?.pause === "paused") return `PAUSED – ${shown.hello.title}`;
  return shown.hello ? `${shown.hello.mark} ${percent(shown.state?.done ?? 0)} ${shown.hello.title}` : "rfca-rig";
}

function paint() {
  if (shown.isNew || traces.wanted) {
    shown.isNew = traces.wanted = false;
    traces.draw();
    if (shown.leg) picture.draw(shown.leg);
  }
  requestAnimationFrame(paint);
}

requestAnimationFrame(paint);
window.rfcaView = { shown, traces, connection, replay }; // for tests, and for a look from the browser's console
