// Time in a recording: slider, play and pause, speed, keys.

import { element, number } from "./format.js";

const SEEK_EVERY_MS = 40;
const ANSWER_MS = 300; // states from before what was asked are still on their way

export class Replay {
  constructor(connection) {
    this.connection = connection;
    this.slider = element("slider");
    this.isPlaying = false;
    this.isHeld = false;
    this.isActive = false;
    element("play").onclick = () => this.play(!this.isPlaying);
    element("speed").onchange = () => this.play(this.isPlaying);
    this.slider.addEventListener("input", () => this.seek(Number(this.slider.value)));
    this.slider.addEventListener("pointerdown", () => (this.isHeld = true));
    for (const end of ["pointerup", "pointercancel", "blur"]) this.slider.addEventListener(end, () => (this.isHeld = false));
    addEventListener("keydown", (event) => this.key(event));
  }

  begin(hello) {
    const wasActive = this.isActive;
    this.isActive = hello.mode === "replay";
    element("replay").hidden = !this.isActive;
    document.body.classList.toggle("replaying", this.isActive);
    if (!this.isActive) return;
    this.durationS = hello.duration_s ?? 0;
    this.slider.max = String(this.durationS);
    if (!wasActive) this.play(!matchMedia("(prefers-reduced-motion: reduce)").matches);
    else this.play(this.isPlaying); // a new connection knows nothing of it
  }

  update(state) {
    if (!this.isActive || this.isHeld) return;
    if (performance.now() < (this.trustFromMs ?? 0)) return;
    this.nowS = state.now_s;
    this.slider.value = String(state.now_s);
    this.tell(state.now_s);
    if (state.speed !== undefined) this.showPlaying(state.speed > 0); // it ends by itself, too
  }

  play(wanted) {
    if (wanted && (this.nowS ?? 0) >= this.durationS - 1e-6) this.seek(0);
    this.trustFromMs = performance.now() + ANSWER_MS;
    this.connection.send({ kind: "play", speed: wanted ? Number(element("speed").value) : 0 });
    this.showPlaying(wanted);
  }

  showPlaying(isPlaying) {
    this.isPlaying = isPlaying;
    element("play").textContent = isPlaying ? "Pause" : "Play";
    element("play").setAttribute("aria-pressed", String(isPlaying));
  }

  // at most every SEEK_EVERY_MS, the last one always
  seek(atS) {
    const at = Math.min(Math.max(atS, 0), this.durationS);
    this.nowS = at;
    this.slider.value = String(at);
    this.tell(at);
    this.trustFromMs = performance.now() + ANSWER_MS;
    this.wantedS = at;
    if (this.pending) return;
    this.connection.send({ kind: "seek", at_s: at });
    this.sentS = at;
    this.pending = setTimeout(() => {
      this.pending = undefined;
      if (this.wantedS !== this.sentS) this.seek(this.wantedS);
    }, SEEK_EVERY_MS);
  }

  tell(atS) {
    const clock = `${atS.toFixed(2)} of ${number(this.durationS)} s`;
    element("clock").value = clock;
    this.slider.setAttribute("aria-valuetext", clock);
  }

  key(event) {
    if (!this.isActive || event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    if (event.key === " " && event.target.tagName === "BUTTON" && event.target.id !== "play") return; // the key of that button
    const step = event.shiftKey ? 0.1 : 1;
    const now = this.nowS ?? 0;
    const acts = {
      " ": () => this.play(!this.isPlaying),
      ArrowLeft: () => this.seek(now - step),
      ArrowRight: () => this.seek(now + step),
      Home: () => this.seek(0),
      End: () => this.seek(this.durationS),
    };
    if (!acts[event.key]) return;
    event.preventDefault();
    acts[event.key]();
  }
}
