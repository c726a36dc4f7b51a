// The two ways to ask for a stop. Each is sent once; what came of it is said in words.

import { element } from "./format.js";

const HOWS = [
  { how: "safe point", button: "stop-safe", asked: "Asked: the run stops at the next safe point." },
  { how: "now", button: "stop-now", asked: "Asked: torque off now." },
];
const NOT_SENT = "NOT SENT. Use the emergency stop.";

export class Stopping {
  constructor(connection) {
    this.connection = connection;
    this.answer = element("stop-answer");
    for (const way of HOWS) element(way.button).onclick = () => this.ask(way);
  }

  begin(hello) {
    this.canStop = hello.can_stop;
    this.allow(hello.can_stop);
    if (hello.mode === "replay") this.say("A recording: there is nothing to stop.");
    else if (!hello.can_stop) this.say("This run cannot be stopped from here.");
    else if (!this.asked) this.say("");
  }

  // what the run has heard, be it from another page
  update(state) {
    if (!this.canStop) return;
    const way = HOWS.find(({ how }) => how === state.stop_asked);
    if (way && this.asked !== way.how && this.asked !== "now") {
      this.asked = way.how;
      this.allow(true);
      this.say(way.asked);
    }
    if (state.ended !== null) this.ended();
  }

  ended() {
    if (this.isOver) return;
    this.isOver = true;
    this.allow(false);
    this.say("The run has ended.");
  }

  allow(isAllowed) {
    for (const way of HOWS) element(way.button).disabled = !isAllowed || this.isOver || way.how === this.asked || this.asked === "now";
  }

  async ask(way) {
    this.asked = way.how;
    this.allow(true);
    this.say("Asking …");
    try {
      const answer = await this.connection.request("stop", {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify({ how: way.how }),
      });
      if (answer.ok) this.say(way.asked);
      else this.failed(answer.status === 409 ? "Nothing to stop: the run has ended." : `Refused (${answer.status}). ${NOT_SENT}`);
    } catch {
      this.failed(NOT_SENT);
    }
  }

  failed(why) {
    this.asked = undefined;
    this.allow(this.canStop);
    this.say(why, true);
  }

  say(text, isBad = false) {
    this.answer.textContent = text;
    this.answer.className = isBad ? "bad" : "";
  }
}
