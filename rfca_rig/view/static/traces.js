// Force, moment, angle and speed over time: bands from the lowest to the highest value of each bucket, so that no peak is lost.

import { Expected } from "./expected.js";
import { number, made, element } from "./format.js";

const GAP_S = 0.06; // a slow device leaves buckets without record; longer than this it is silent
const SPANS_S = [2, 8, 30, 120];
const PANELS = [
  { plot: "force", title: "Force", share: 3.2 },
  { plot: "moment", title: "Moment", share: 1.7 },
  { plot: "angle", title: "Shaft below horizontal", share: 1.3 },
  { plot: "speed", title: "Shaft speed", share: 1.3 },
];
const MAIN = "#173f6b";
const COLOURS = { fy_N: "#b84a00", fx_N: "#7b8794", ty_Nm: "#7b8794", tz_Nm: "#9a6fb0" };
const INK = "#5a5a5a";
const HAIR = "#e7e2d8";
const FONT = '12px "Iowan Old Style", "Palatino Linotype", Palatino, "Book Antiqua", "URW Palladio L", P052, Georgia, serif';

export class Traces {
  constructor(connection) {
    this.connection = connection;
    this.panels = [];
    this.spanS = 8;
    this.expected = new Expected(() => (this.wanted = true));
    this.buttons = SPANS_S.map((seconds) => this.spanButton(seconds));
    new ResizeObserver(() => this.fit()).observe(element("traces"));
  }

  // the panels anew, for the channels of a hello
  begin(hello, buckets) {
    this.buckets = buckets;
    for (const panel of this.panels) panel.remove();
    this.panels = PANELS.map((kind) => ({ ...kind, channels: hello.channels.filter((channel) => channel.plot === kind.plot) }))
      .filter((kind) => kind.channels.length)
      .map((kind, i, all) => new Panel(kind, this, i === all.length - 1));
    this.markSpan(hello.span_s);
    this.fit();
  }

  spanButton(seconds) {
    const button = made("button", `${seconds} s`);
    button.type = "button";
    button.dataset.span = seconds;
    button.onclick = () => {
      this.connection.send({ kind: "span", span_s: seconds });
      this.markSpan(seconds);
    };
    document.querySelector("#traces .spans").append(button);
    return button;
  }

  markSpan(seconds) {
    this.spanS = seconds;
    for (const button of this.buttons) button.setAttribute("aria-pressed", String(Number(button.dataset.span) === seconds));
    this.wanted = true;
  }

  get toS() {
    return Math.max(this.buckets?.endS ?? 0, this.spanS);
  }

  // what was measured ends here; nothing is expected beyond
  get endS() {
    return this.buckets?.endS ?? 0;
  }

  get fromS() {
    return this.toS - this.spanS;
  }

  fit() {
    const box = element("traces");
    const heads = this.panels.length * 26 + 26;
    const room = Math.max(box.clientHeight - heads, 60 * this.panels.length);
    const shares = this.panels.reduce((sum, panel) => sum + panel.kind.share, 0);
    for (const panel of this.panels) {
      panel.plot.setSize({ width: box.clientWidth, height: Math.floor((room * panel.kind.share) / shares) });
    }
  }

  draw() {
    if (!this.buckets) return;
    for (const panel of this.panels) panel.draw();
    this.expected.tell(this.buckets.t[this.panels[0]?.plot.cursor.idx] ?? this.endS);
  }
}

class Panel {
  constructor(kind, traces, hasTimes) {
    this.kind = kind;
    this.traces = traces;
    // the telling channel is drawn last, on top
    this.channels = [...kind.channels].sort((a, b) => (a.name in COLOURS ? 0 : 1) - (b.name in COLOURS ? 0 : 1));
    this.range = [-1, 1];
    this.box = made("div", "", "panel");
    this.box.dataset.plot = kind.plot;
    this.box.append(this.head());
    element("traces").append(this.box);
    this.plot = new uPlot(this.options(hasTimes), this.data(), this.box);
    this.plot.root.setAttribute("aria-hidden", "true"); // its legend says the values
  }

  remove() {
    this.plot.destroy();
    this.box.remove();
  }

  head() {
    const head = made("div", "", "head");
    const units = [...new Set(this.kind.channels.map((channel) => channel.unit))].join(", ");
    head.append(made("h2", `${this.kind.title} (${units})`));
    this.readings = this.kind.channels.map((channel) => new Reading(channel, colour(channel), (on) => this.show(channel, on)));
    head.append(...this.readings.map((reading) => reading.button));
    return head;
  }

  show(channel, on) {
    const first = 1 + 2 * this.channels.indexOf(channel);
    this.plot.setSeries(first, { show: on });
    this.plot.setSeries(first + 1, { show: on });
    channel.isHidden = !on;
    this.draw();
  }

  options(hasTimes) {
    const series = this.channels.flatMap((channel) => [this.edge(channel, "low"), this.edge(channel, "high")]);
    const bands = this.channels.map((channel, i) => ({ series: [2 + 2 * i, 1 + 2 * i], fill: `${colour(channel)}59` }));
    const axis = { stroke: INK, font: FONT, grid: { stroke: HAIR, width: 1 }, ticks: { show: false } };
    return {
      width: 600,
      height: 100,
      padding: [6, 8, hasTimes ? 0 : 4, 0],
      legend: { show: false },
      cursor: { y: false, points: { show: false }, drag: { x: false, y: false }, sync: { key: "time" } },
      scales: { x: { time: false, range: () => [this.traces.fromS, this.traces.toS] }, y: { range: () => this.range } },
      axes: [
        hasTimes
          ? { ...axis, size: 26, gap: 2, values: (_, times) => times.map((t, i) => (i === times.length - 1 ? `${t} s` : String(t))) }
          : { ...axis, size: 0, values: () => [] },
        { ...axis, size: 52, gap: 6, space: 15, values: (_, values) => values.map((v) => String(v).replace("-", "−")) },
      ],
      hooks: { drawAxes: [(plot) => this.drawExpected(plot)] },
      series: [{}, ...series],
      bands,
    };
  }

  drawExpected(plot) {
    const shown = this.channels.filter((channel) => !channel.isHidden);
    this.traces.expected.draw(plot, shown, this.traces.fromS, this.traces.endS);
  }

  edge(channel, which) {
    return {
      label: `${channel.name} ${which}`,
      stroke: colour(channel),
      width: channel.name in COLOURS ? 1 : 1.4,
      points: { show: false },
      gaps: (plot, _series, _from, _to, gaps) => gaps.filter(([left, right]) => right - left > this.gapPixels(plot)),
    };
  }

  gapPixels(plot) {
    return (plot.bbox.width * Math.max(GAP_S, 3 * this.traces.buckets.dtS)) / this.traces.spanS;
  }

  data() {
    const { t, low, high } = this.traces.buckets;
    return [t, ...this.channels.flatMap((channel) => [low[channel.name], high[channel.name]])];
  }

  draw() {
    this.range = this.nextRange();
    this.plot.setData(this.data());
    for (const reading of this.readings) reading.tell(this.traces.buckets, this.plot.cursor.idx, this.traces.fromS);
  }

  // grows at once, shrinks only when half of it is empty, so that the scale does not breathe
  nextRange() {
    const { buckets, expected, fromS, endS } = this.traces;
    const shown = this.channels.filter((channel) => !channel.isHidden);
    const seen = shown.flatMap(({ name }) => [buckets.extremes(name, fromS), expected.extremes(name, fromS, endS)]);
    const known = seen.filter((pair) => pair !== null);
    if (!known.length) return this.range;
    const wanted = rounded(Math.min(...known.map((pair) => pair[0])), Math.max(...known.map((pair) => pair[1])));
    const [low, high] = this.range;
    const fits = wanted[0] >= low && wanted[1] <= high;
    return fits && wanted[1] - wanted[0] > 0.5 * (high - low) ? this.range : wanted;
  }
}

// name, value now (or under the cursor), and the extremes of what is shown; a click hides the channel
class Reading {
  constructor(channel, colour, toggled) {
    this.channel = channel;
    this.button = made("button", "", "reading");
    this.button.type = "button";
    this.button.setAttribute("aria-pressed", "true");
    this.button.title = `${channel.name}: hide or show`;
    const swatch = made("i");
    swatch.style.background = colour;
    this.now = made("b");
    this.span = made("small");
    this.button.append(swatch, made("span", channel.label), this.now, this.span);
    this.button.onclick = () => {
      const on = this.button.getAttribute("aria-pressed") !== "true";
      this.button.setAttribute("aria-pressed", String(on));
      toggled(on);
    };
  }

  tell(buckets, cursor, fromS) {
    const now = cursor === null || cursor === undefined ? buckets.value(this.channel.name) : buckets.value(this.channel.name, cursor);
    this.now.textContent = number(now);
    const seen = buckets.extremes(this.channel.name, fromS);
    this.span.textContent = seen ? `${number(seen[0])} … ${number(seen[1])}` : "";
  }
}

function colour(channel) {
  return COLOURS[channel.name] ?? MAIN;
}

// the least range of round ends around [low, high], with some air
function rounded(low, high) {
  const size = Math.max(high - low, 0.02 * Math.max(Math.abs(low), Math.abs(high)), 0.1);
  const step = 10 ** Math.floor(Math.log10(size)) / 5;
  return [step * Math.floor((low - 0.05 * size) / step), step * Math.ceil((high + 0.05 * size) / step)];
}
