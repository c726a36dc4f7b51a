// The force that the model expects in each stroke, and its 95 % band, from the commanded start on: drawn below the measured traces.

import { made, number } from "./format.js";

const BAND = "#f2a93b52";
const LINE = "#f2a93b"; // as the ghost of the leg
const LINE_PX = 2.4;
const TELLS = "fz_N"; // the channel whose expected value is told in words
const SAYS = "The nominal model's force for the commanded motion. Band: 95 % interval from the uncertainty of the model's values.";

export class Expected {
  constructor(changed) {
    this.changed = changed;
    this.isShown = true;
    this.button = made("button", "", "reading expected");
    this.button.type = "button";
    this.button.title = SAYS;
    this.button.hidden = true;
    this.now = made("b");
    this.button.append(made("i"), made("span", "expected"), this.now);
    this.button.onclick = () => this.toggle();
    document.querySelector("#traces .spans").prepend(this.button);
    this.clear();
  }

  // a connection that begins anew is sent everything again
  clear() {
    this.byCondition = new Map();
    this.strokes = [];
    this.button.hidden = true;
  }

  toggle() {
    this.isShown = !this.isShown;
    this.button.setAttribute("aria-pressed", String(this.isShown));
    this.changed();
  }

  takeCondition(message) {
    this.byCondition.set(message.condition, message);
    this.changed();
  }

  takeStrokes(message) {
    this.strokes = message.strokes;
    this.changed();
  }

  // strokes within the window that have a prediction of the channel, with its lines
  *within(name, fromS, toS) {
    if (!this.isShown) return;
    for (const stroke of this.strokes) {
      if (stroke.to_s < fromS || stroke.from_s > toS) continue;
      const message = this.byCondition.get(stroke.condition);
      const lines = message?.channels[name];
      if (!lines) continue;
      const first = Math.max(0, Math.ceil((fromS - stroke.from_s) / message.dt_s));
      const last = Math.floor((Math.min(toS, stroke.to_s) - stroke.from_s) / message.dt_s);
      yield { lines, fromS: stroke.from_s, dtS: message.dt_s, first, end: Math.min(last + 1, lines.value.length) };
    }
  }

  // [lowest, highest] of a channel in the window, band included; null where nothing is expected
  extremes(name, fromS, toS) {
    let lowest = Infinity;
    let highest = -Infinity;
    for (const { lines, first, end } of this.within(name, fromS, toS)) {
      const { value, low = value, high = value } = lines;
      for (let i = first; i < end; i++) {
        lowest = Math.min(lowest, low[i]);
        highest = Math.max(highest, high[i]);
      }
    }
    return lowest <= highest ? [lowest, highest] : null;
  }

  // the lines of a channel at a time, null outside of strokes
  at(name, t) {
    for (const { lines, fromS, dtS } of this.within(name, t, t)) {
      const i = Math.round((t - fromS) / dtS);
      if (i < lines.value.length) return { value: lines.value[i], low: lines.low?.[i], high: lines.high?.[i] };
    }
    return null;
  }

  // below the lines of a uPlot panel; nothing is drawn beyond what was measured
  draw(plot, channels, fromS, toS) {
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    for (const channel of channels) {
      for (const stroke of this.within(channel.name, fromS, toS)) drawStroke(plot, stroke);
    }
    ctx.restore();
  }

  // value and band in words, at the mouse or now
  tell(t) {
    this.button.hidden = !this.strokes.some((stroke) => this.byCondition.has(stroke.condition));
    const there = this.isShown ? this.at(TELLS, t) : null;
    const band = there?.low === undefined ? "" : ` (${number(there.low)} … ${number(there.high)})`;
    this.now.textContent = there ? `fz ${number(there.value)}${band}` : "";
  }
}

// the least and the greatest of each column of pixels, so that no peak is lost
function drawStroke(plot, stroke) {
  const { value, low, high } = stroke.lines;
  const line = columns(plot, stroke, value, value);
  const { ctx } = plot;
  if (low) {
    const band = columns(plot, stroke, low, high);
    ctx.beginPath();
    for (const [x, , top] of band) ctx.lineTo(x, top);
    for (const [x, bottom] of band.reverse()) ctx.lineTo(x, bottom);
    ctx.closePath();
    ctx.fillStyle = BAND;
    ctx.fill();
  }
  ctx.beginPath();
  for (const [x, bottom, top, isFalling] of line) {
    ctx.lineTo(x, isFalling ? top : bottom);
    ctx.lineTo(x, isFalling ? bottom : top);
  }
  ctx.strokeStyle = LINE;
  ctx.lineWidth = LINE_PX * (devicePixelRatio || 1);
  ctx.lineJoin = "round";
  ctx.stroke();
}

// [x, y of the least, y of the greatest, whether it falls] for each column of pixels
function columns(plot, { fromS, dtS, first, end }, low, high) {
  const found = [];
  let last = null;
  // both scales are linear: two positions give all, where asking for each would take ten times as long
  const startX = plot.valToPos(fromS, "x", true);
  const stepX = plot.valToPos(fromS + dtS, "x", true) - startX;
  for (let i = first; i < end; i++) {
    const x = Math.round(startX + i * stepX);
    if (last === null || x !== last.x) found.push((last = { x, least: low[i], most: high[i], begin: low[i], end: low[i] }));
    else {
      if (low[i] < last.least) last.least = low[i];
      if (high[i] > last.most) last.most = high[i];
      last.end = low[i];
    }
  }
  const y = (newtons) => plot.valToPos(newtons, "y", true);
  return found.map(({ x, least, most, begin, end: ends }) => [x, y(least), y(most), ends < begin]);
}
