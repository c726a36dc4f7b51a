// The window of time that is shown: for every bucket its middle, and for every channel the lowest and highest value in it.

export class Buckets {
  constructor(names) {
    this.names = names;
    this.clear();
  }

  clear() {
    this.t = [];
    this.low = Object.fromEntries(this.names.map((name) => [name, []]));
    this.high = Object.fromEntries(this.names.map((name) => [name, []]));
    this.endS = null;
    this.dtS = 0;
  }

  // takes a trace message; what it covers again is replaced, what lies between is a gap
  add(trace) {
    if (trace.reset) this.clear();
    const count = Math.max(0, ...this.names.map((name) => trace.low[name]?.length ?? 0));
    this.forgetFrom(trace.from_s + 0.25 * trace.dt_s);
    if (this.endS !== null && trace.from_s > this.endS + 0.5 * trace.dt_s) this.push(0.5 * (this.endS + trace.from_s), () => [null, null]);
    for (let i = 0; i < count; i++) {
      this.push(trace.from_s + (i + 0.5) * trace.dt_s, (name) => [trace.low[name]?.[i] ?? null, trace.high[name]?.[i] ?? null]);
    }
    this.endS = trace.from_s + count * trace.dt_s;
    this.dtS = trace.dt_s;
  }

  push(t, valuesOf) {
    this.t.push(t);
    for (const name of this.names) {
      const [low, high] = valuesOf(name);
      this.low[name].push(low);
      this.high[name].push(high);
    }
  }

  forgetFrom(t) {
    let keep = this.t.length;
    while (keep > 0 && this.t[keep - 1] > t) keep--;
    this.cut(0, keep);
  }

  // lets go of what is older than the window; rarely, because it moves all arrays
  forgetBefore(t) {
    const first = this.t.findIndex((time) => time >= t);
    if (first > 0.25 * this.t.length) this.cut(Math.max(0, first - 1), this.t.length);
  }

  cut(from, to) {
    if (from === 0 && to === this.t.length) return;
    this.t = this.t.slice(from, to);
    for (const name of this.names) {
      this.low[name] = this.low[name].slice(from, to);
      this.high[name] = this.high[name].slice(from, to);
    }
  }

  // [lowest, highest] of a channel in the window; null where it has no record there
  extremes(name, fromS) {
    let lowest = Infinity;
    let highest = -Infinity;
    for (let i = this.t.length - 1; i >= 0 && this.t[i] >= fromS; i--) {
      if (this.low[name][i] === null) continue;
      lowest = Math.min(lowest, this.low[name][i]);
      highest = Math.max(highest, this.high[name][i]);
    }
    return lowest <= highest ? [lowest, highest] : null;
  }

  // the value around index i, or the latest; buckets without a record are passed over for a moment
  value(name, i = this.t.length - 1) {
    for (let back = 0; back < 20 && i - back >= 0; back++) {
      const low = this.low[name][i - back];
      if (low !== null) return 0.5 * (low + this.high[name][i - back]);
    }
    return null;
  }
}
