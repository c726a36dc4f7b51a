// What must not be overlooked: a trip, the end, data that stand still, a connection that is lost.

import { duration, element } from "./format.js";

const STANDSTILL_MS = 1500;

export class Alerts {
  begin(hello) {
    this.docs = hello.docs;
    this.mode = hello.mode;
    this.movedMs = performance.now();
  }

  update(state) {
    this.isEnded = state.ended !== null;
    this.showTrip(state.trip);
    this.showEnd(state);
    if (state.now_s !== this.nowS) this.movedMs = performance.now();
    this.nowS = state.now_s;
  }

  showTrip(trip) {
    element("trip").hidden = !trip;
    if (!trip || this.trip === trip.text) return;
    this.trip = trip.text; // an alert is read out anew when its text is set
    element("trip-code").textContent = `TRIP ${trip.code}`;
    element("trip-text").textContent = trip.text.replace(`TRIP ${trip.code}: `, "");
    this.pointTo(trip.code);
  }

  // an address is linked; the name of a file, which a browser could not open, is named
  pointTo(code) {
    const link = element("trip-link");
    const isAddress = /^(\/|https?:)/.test(this.docs);
    if (isAddress) link.href = this.docs.includes("{code}") ? this.docs.replace("{code}", code) : `${this.docs}#${code.toLowerCase()}`;
    else link.removeAttribute("href");
    link.textContent = isAddress ? "What it means and what to do" : `What it means and what to do: ${this.docs} ${code}`;
    link.hidden = !this.docs;
  }

  showEnd(state) {
    element("ended").hidden = !this.isEnded || Boolean(state.trip) || this.mode === "replay";
    if (this.isEnded) element("ended").textContent = `The run has ended: ${state.ended}. This picture does not change any more.`;
  }

  // the server lives, but the run tells nothing new
  checkStandstill(status) {
    const stillMs = performance.now() - (this.movedMs ?? performance.now());
    const isStale = status === "open" && this.mode === "live" && !this.isEnded && stillMs > STANDSTILL_MS;
    element("stale").hidden = !isStale;
    if (isStale) element("stale").textContent = `No new data from the run for ${duration(stillMs / 1e3)}: it waits, for you or for a device.`;
  }

  showConnection(status, silentMs) {
    const isFrozen = ["lost", "refused", "full"].includes(status) && !(this.isEnded && this.mode === "live");
    element("lost").hidden = !isFrozen;
    document.body.classList.toggle("frozen", isFrozen);
    if (isFrozen) this.tellLoss(status, silentMs);
  }

  tellLoss(status, silentMs) {
    const isRefused = status === "refused";
    const isReplay = this.mode === "replay";
    const isFull = status === "full";
    const says = isFull
      ? "As many pages are open as the run serves. Close another one; this one then goes on by itself."
      : isRefused
      ? "The address lacks the token, or has that of an earlier run. Open the address that the run printed."
      : isReplay
        ? "To go on looking at the recording, type rfca-rig view again."
        : "What you see is not what happens. The run may go on, and the buttons above may not reach it. Use ^C at its terminal, or the emergency stop.";
    setText("lost-head", isFull ? "Too many pages" : isRefused ? "Not allowed" : isReplay ? "The view has ended" : "Connection lost");
    setText("lost-says", says);
    setText("lost-since", isFull || isRefused || this.mode === undefined ? "" : `This picture is ${(silentMs / 1e3).toFixed(1)} s old.`);
  }
}

// an alert is read out anew when its text is set, so it is set only when it changes
function setText(id, text) {
  if (element(id).textContent !== text) element(id).textContent = text;
}
