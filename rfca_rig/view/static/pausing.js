// A pause between stages and its end. The shaft stays held; going on starts motion again, so it is asked twice.

import { element } from "./format.js";

const CLEAR = "nobody is near the leg";
const SAYS = {
  none: "waits in the air, motor on",
  sending: "Asking …",
  asked: "waits once the leg is in the air",
  paused: "PAUSED, motor on: keep away",
  sure: "Nobody near? The shaft turns",
};
const LABELS = { none: "Pause", sending: "Pause", asked: "Do not pause", paused: "Continue", sure: "Yes, continue" };
const SURE_MS = 5000; // a second click after this is a first one again

export class Pausing {
  constructor(connection) {
    this.connection = connection;
    this.button = element("pause");
    this.says = element("pause-says");
    this.button.onclick = () => this.click();
  }

  begin(hello) {
    this.canPause = hello.can_stop;
    this.show("none");
  }

  // what the run does, be it asked from another page
  update(state) {
    if (!this.canPause) return;
    if (state.ended !== null || state.stop_asked) this.canPause = false;
    const word = state.pause ?? "none";
    this.button.disabled = !this.canPause || this.step === "sending";
    if (word === this.word) return;
    this.word = word;
    this.show(word);
  }

  click() {
    if (this.step === "paused") return this.makeSure();
    return this.send(this.step === "none" ? { how: "pause" } : { how: "continue", confirmed: CLEAR });
  }

  makeSure() {
    this.show("sure");
    setTimeout(() => this.step === "sure" && this.show(this.word ?? "none"), SURE_MS);
  }

  async send(body) {
    this.show("sending");
    try {
      const answer = await this.connection.request("pause", {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify(body),
      });
      if (answer.ok || answer.status === 409) this.word = undefined; // the next state shows what came of it
      else this.failed();
    } catch {
      this.failed();
    }
  }

  failed() {
    this.show(this.word ?? "none");
    this.says.textContent = "NOT SENT; all goes on as before";
  }

  show(step) {
    this.step = step;
    this.button.textContent = LABELS[step];
    this.says.textContent = SAYS[step];
    this.button.disabled = !this.canPause || step === "sending";
    document.body.classList.toggle("paused", step === "paused" || step === "sure");
  }
}
